// CGAL's Efficient RANSAC on clouds read from stdin: int64 n, then n x 3 doubles (mm), until the end. For each cloud a
// line: milliseconds, point on the axis (3), axis (3), radius of the largest cylinder of a radius near the nominal one;
// zeros where CGAL finds none. Arguments: nominal radius (mm), inlier distance (mm), a third that is not used.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

#include <CGAL/Simple_cartesian.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>

using Kernel = CGAL::Simple_cartesian<double>;
using PointNormal = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using Points = std::vector<PointNormal>;
using PointMap = CGAL::First_of_pair_property_map<PointNormal>;
using NormalMap = CGAL::Second_of_pair_property_map<PointNormal>;
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, Points, PointMap, NormalMap>;
using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;
using Cylinder = CGAL::Shape_detection::Cylinder<Traits>;

int main(int argc, char **argv) {
  if (argc != 4) return 2;
  const double nominal = std::atof(argv[1]), distance = std::atof(argv[2]);
  std::int64_t n;
  while (std::fread(&n, sizeof n, 1, stdin) == 1) {
    if (n <= 0 || n > 10000000) return 3;
    Points points(n);
    for (auto &point : points) {
      double xyz[3];
      if (std::fread(xyz, sizeof xyz, 1, stdin) != 1) return 4;
      point.first = Kernel::Point_3(xyz[0], xyz[1], xyz[2]);
    }
    const auto start = std::chrono::steady_clock::now();
    // So many neighbours that they lie on several rings: those on one ring span no plane.
    CGAL::pca_estimate_normals<CGAL::Sequential_tag>(
        points, static_cast<unsigned>(std::min<std::int64_t>(n, 200)),
        CGAL::parameters::point_map(PointMap()).normal_map(NormalMap()));
    Ransac ransac;
    ransac.set_input(points);
    ransac.add_shape_factory<Cylinder>();
    Ransac::Parameters parameters;
    parameters.probability = 0.01;
    parameters.min_points = static_cast<std::size_t>(n / 4);
    parameters.epsilon = distance;
    parameters.cluster_epsilon = 0.5 * nominal;  // rings lie far apart, and are one wall all the same
    parameters.normal_threshold = 0.8;
    ransac.detect(parameters);
    double best[7] = {0, 0, 0, 0, 0, 0, 0};
    std::size_t most = 0;
    for (const auto &shape : ransac.shapes()) {
      const auto *cylinder = dynamic_cast<const Cylinder *>(shape.get());
      if (!cylinder || shape->indices_of_assigned_points().size() <= most) continue;
      const double radius = cylinder->radius();
      if (radius < 0.8 * nominal || radius > 1.2 * nominal) continue;
      most = shape->indices_of_assigned_points().size();
      const auto point = cylinder->axis().point(0);
      const auto axis = cylinder->axis().to_vector();
      const double found[7] = {point.x(), point.y(), point.z(), axis.x(), axis.y(), axis.z(), radius};
      std::copy(found, found + 7, best);
    }
    const auto end = std::chrono::steady_clock::now();
    std::printf("%.4f", std::chrono::duration<double, std::milli>(end - start).count());
    for (const double value : best) std::printf(" %.9g", value);
    std::printf("\n");
    std::fflush(stdout);
  }
  return 0;
}
