// PCL's cylinder RANSAC on clouds read from stdin: int64 n, then n x 3 doubles (mm), until the end. For each cloud a line:
// milliseconds, point on the axis (3), axis (3), radius; zeros where PCL finds none.
// Arguments: nominal radius (mm), inlier distance (mm), refine (0 or 1).
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_cylinder.h>
#include <pcl/search/kdtree.h>

int main(int argc, char **argv) {
  if (argc != 4) return 2;
  const double nominal = std::atof(argv[1]), distance = std::atof(argv[2]);
  const bool refine = std::atoi(argv[3]) != 0;
  std::int64_t n;
  while (std::fread(&n, sizeof n, 1, stdin) == 1) {
    if (n <= 0 || n > 10000000) return 3;
    pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>(n, 1));
    for (auto &point : cloud->points) {
      double xyz[3];
      if (std::fread(xyz, sizeof xyz, 1, stdin) != 1) return 4;
      point.x = xyz[0], point.y = xyz[1], point.z = xyz[2];
    }
    const auto start = std::chrono::steady_clock::now();
    pcl::PointCloud<pcl::Normal>::Ptr normals(new pcl::PointCloud<pcl::Normal>);
    // The nearest neighbours of a point on a ring lie on that ring and span no plane. Those in a thinned cloud lie on
    // several rings: the most favourable normals, and the cheapest.
    pcl::PointCloud<pcl::PointXYZ>::Ptr thin(new pcl::PointCloud<pcl::PointXYZ>);
    for (std::int64_t i = 0; i < n; i += std::max<std::int64_t>(n / 1000, 1)) thin->push_back(cloud->points[i]);
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimate;
    estimate.setInputCloud(cloud);
    estimate.setSearchSurface(thin);
    estimate.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>));
    estimate.setKSearch(16);
    estimate.compute(*normals);
    pcl::SampleConsensusModelCylinder<pcl::PointXYZ, pcl::Normal>::Ptr model(
        new pcl::SampleConsensusModelCylinder<pcl::PointXYZ, pcl::Normal>(cloud));
    model->setInputNormals(normals);
    model->setNormalDistanceWeight(0.05);
    model->setRadiusLimits(0.8 * nominal, 1.2 * nominal);
    pcl::RandomSampleConsensus<pcl::PointXYZ> ransac(model, distance);
    ransac.setMaxIterations(1000);
    Eigen::VectorXf c = Eigen::VectorXf::Zero(7);
    if (ransac.computeModel()) {
      ransac.getModelCoefficients(c);
      std::vector<int> inliers;
      ransac.getInliers(inliers);
      if (refine && inliers.size() > 100) {
        Eigen::VectorXf better;
        model->optimizeModelCoefficients(inliers, c, better);
        c = better;
      }
    }
    const auto end = std::chrono::steady_clock::now();
    const double all = std::chrono::duration<double, std::milli>(end - start).count();
    std::printf("%.4f %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", all, c[0], c[1], c[2], c[3], c[4], c[5], c[6]);
    std::fflush(stdout);
  }
  return 0;
}
