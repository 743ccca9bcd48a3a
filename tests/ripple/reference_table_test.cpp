// The reference table of the smooth drive: speed ripple without compensation, with the paper's, and
// with a faster observer.
#include <gtest/gtest.h>

#include "tests/ripple/ripple.hpp"

namespace twinrate::test {
namespace {

struct Row {
  double speed_rpm, off, paper, faster;  // rad/s rms, from an independent implementation
};
constexpr Row kReference[] = {{10, 0.117, 0.0645, 0.0406},
                              {20, 0.121, 0.0788, 0.0497},
                              {30, 0.117, 0.0808, 0.0510},
                              {50, 0.083, 0.0647, 0.0420}};

class ReferenceTable : public testing::TestWithParam<Row> {};

TEST_P(ReferenceTable, IsMetWithinFifteenPercent) {
  const Row& row = GetParam();
  const auto rms = [&](std::vector<std::string> overrides) {
    return ripple(row.speed_rpm, 2, 3, std::move(overrides)).rms;
  };
  EXPECT_NEAR(rms({"controller.compensation=off"}), row.off, 0.15 * row.off);
  EXPECT_NEAR(rms({"controller.compensation=paper"}), row.paper, 0.15 * row.paper);
  EXPECT_NEAR(rms({"controller.compensation=paper", "estimator.ekf_disturbance.L_Nm_rad=-3000"}),
              row.faster, 0.15 * row.faster);
}

INSTANTIATE_TEST_SUITE_P(Niewiara, ReferenceTable, testing::ValuesIn(kReference),
                         [](const auto& i) {
                           return std::to_string(static_cast<int>(i.param.speed_rpm)) + "rpm";
                         });

}  // namespace
}  // namespace twinrate::test
