// A test program as on another machine. TWINRATE_EIGEN_CACHES=L1,L2,L3 (bytes) sets the cache sizes
// from which Eigen takes the blocks of its products. Programs do not read it: CMakeLists.txt fixes
// theirs.
#include <Eigen/Core>
#include <cstdio>
#include <cstdlib>

namespace {

bool set_eigen_caches() {
  const char* text = std::getenv("TWINRATE_EIGEN_CACHES");
  if (!text) return false;
  long l1 = 0, l2 = 0, l3 = 0;
  char end = 0;
  if (std::sscanf(text, "%ld,%ld,%ld%c", &l1, &l2, &l3, &end) != 3 || l1 <= 0 || l2 <= 0 ||
      l3 <= 0) {
    std::fprintf(stderr, "TWINRATE_EIGEN_CACHES=%s: three sizes in bytes, L1,L2,L3\n", text);
    std::exit(2);
  }
  Eigen::setCpuCacheSizes(l1, l2, l3);
  return true;
}

[[maybe_unused]] const bool g_set = set_eigen_caches();

}  // namespace
