// GUDHI's Čech complex (C++ only): builds it up to dimension 3 at a radius, reduces over Z/2, prints one JSON line. Called by race.py.
//
// cech POINTS.txt RADIUS fast|safe
#include <gudhi/Cech_complex.h>
#include <gudhi/Persistent_cohomology.h>
#include <gudhi/Simplex_tree.h>
#include <CGAL/Epeck_d.h>
#include <CGAL/Epick_d.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <vector>

using Tree = Gudhi::Simplex_tree<Gudhi::Simplex_tree_options_fast_persistence>;
using Field = Gudhi::persistent_cohomology::Field_Zp;

static double cpu() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

template <class Kernel>
static int race(const char* file, double radius) {
  std::vector<typename Kernel::Point_d> points;
  std::ifstream in(file);
  double x, y, z;
  while (in >> x >> y >> z) points.emplace_back(x, y, z);

  const double start = cpu();
  Tree tree;
  Gudhi::cech_complex::Cech_complex<Kernel, Tree> cech(points, radius);
  cech.create_complex(tree, 3);
  const double built = cpu();
  Gudhi::persistent_cohomology::Persistent_cohomology<Tree, Field> cohomology(tree);
  cohomology.init_coefficients(2);
  cohomology.compute_persistent_cohomology(0.);
  const std::vector<int> betti = cohomology.betti_numbers();
  const double reduced = cpu();
  const auto rank = [&](std::size_t k) { return k < betti.size() ? betti[k] : 0; };
  std::printf("{\"simplices\":%zu,\"betti\":[%d,%d,%d],\"build_ms\":%.1f,\"reduce_ms\":%.1f}\n", tree.num_simplices(),
              rank(0), rank(1), rank(2), 1e3 * (built - start), 1e3 * (reduced - built));
  return 0;
}

int main(int argc, char** argv) {
  if (argc != 4) return 1;
  const double radius = std::atof(argv[2]);
  if (std::strcmp(argv[3], "fast") == 0) return race<CGAL::Epick_d<CGAL::Dimension_tag<3>>>(argv[1], radius);
  return race<CGAL::Epeck_d<CGAL::Dimension_tag<3>>>(argv[1], radius);
}
