// PCL's cylinder RANSAC on clouds read from stdin: int64 n, then n x 3 doubles (mm), until the end. For each cloud a line:
// milliseconds, point on the axis (3), axis (3), radius. Normals are estimated and timed too: the model needs them.
// Arguments: nominal radius (mm), inlier distance (mm), refine (0 or 1).
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
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimate;
    estimate.setInputCloud(cloud);
    estimate.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>));
    estimate.setKSearch(30);
    estimate.compute(*normals);
    const auto normals_done = std::chrono::steady_clock::now();
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
      if (refine) {
        std::vector<int> inliers;
        ransac.getInliers(inliers);
        Eigen::VectorXf better;
        model->optimizeModelCoefficients(inliers, c, better);
        c = better;
      }
    }
    const auto end = std::chrono::steady_clock::now();
    const double all = std::chrono::duration<double, std::milli>(end - start).count();
    const double fit = std::chrono::duration<double, std::milli>(end - normals_done).count();
    std::printf("%.4f %.4f %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", all, fit, c[0], c[1], c[2], c[3], c[4], c[5], c[6]);
    std::fflush(stdout);
  }
  return 0;
}
