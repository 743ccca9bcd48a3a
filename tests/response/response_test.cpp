// The measured response against the design, where theory says that they agree.
#include "response/response.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "loop/load_drive.hpp"

namespace twinrate::test {
namespace {

Response measured(ResponseOf of, const std::vector<std::string>& overrides) {
  Config config = load_drive("dilys2021", overrides);
  return measure_response(config, of);
}

TEST(Response, OnTheTrueAngleAndWithoutNoiseItIsTheDesigns) {
  for (const ResponseOf of : {ResponseOf::kSpeed, ResponseOf::kCurrent, ResponseOf::kLoad}) {
    const Response r = measured(
        of, {"controller.angle_source=truth", "sensors.i_noise_rms_A=0.0", "sensors.i_lsb_A=0.0"});
    ASSERT_TRUE(r.locked);
    ASSERT_GE(r.lines.size(), 15u);
    for (const ResponseLine& l : r.lines) {
      // The decoupling of the current loop is late by the delay: at most a tenth near its bandwidth.
      const double allowed = of == ResponseOf::kCurrent ? 0.15 : 0.03;
      EXPECT_LT(std::abs(l.H - *l.design), allowed * std::abs(*l.design))
          << kResponseNames[static_cast<int>(of)] << " at " << l.f << " Hz";
      EXPECT_GT(l.coherence, 0.999);
    }
  }
}

TEST(Response, AWiderDesignIsMeasuredWider) {
  const auto at = [](const char* bandwidth_Hz) {
    return *bandwidth(measured(ResponseOf::kSpeed,
                               {"controller.angle_source=truth",
                                std::string("controller.foc.speed_bandwidth_Hz=") + bandwidth_Hz}),
                      false);
  };
  EXPECT_NEAR(at("12.0") / at("6.0"), 2, 0.15);
}

TEST(Response, ALostRunHasNoResponse) {
  const Response r = measured(ResponseOf::kSpeed, {"rates.n=20"});
  EXPECT_FALSE(r.locked);
  EXPECT_TRUE(r.lines.empty());
}

}  // namespace
}  // namespace twinrate::test
