// The two properties of a machine that reach the last bits of a figure: the cache sizes, from which
// Eigen takes the blocks of its products, and fused multiply-add, with which the C library has
// other variants of sin, exp and pow.
#include <gtest/gtest.h>
#if __has_include(<sys/platform/x86.h>) && !defined(__clang__)  // it uses _Bool in C++
#include <sys/platform/x86.h>
#endif

#include <Eigen/Core>
#include <cstdlib>
#include <string>

namespace twinrate::machines_test {

std::string environment(const char* name) {
  const char* text = std::getenv(name);
  return text ? text : "";
}

// Without EIGEN_NO_CPUID they are those of the processor.
TEST(Machines, EigensBlocksAreThoseOfTheBuildNotOfTheProcessor) {
  std::string expected = environment("TWINRATE_EIGEN_CACHES");
  if (expected.empty()) expected = "49152,2097152,33554432";
  EXPECT_EQ(std::to_string(Eigen::l1CacheSize()) + "," + std::to_string(Eigen::l2CacheSize()) +
                "," + std::to_string(Eigen::l3CacheSize()),
            expected);
}

#ifdef CPU_FEATURE_ACTIVE
TEST(Machines, TheMathLibraryHasNoFusedMultiplyAddWhereItIsTakenAway) {
  if (environment("GLIBC_TUNABLES").find("-FMA") == std::string::npos)
    GTEST_SKIP() << "GLIBC_TUNABLES does not take it away";
  EXPECT_FALSE(CPU_FEATURE_ACTIVE(FMA));
}
#endif

}  // namespace twinrate::machines_test
