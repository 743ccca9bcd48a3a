// The measured response against the design, where theory says that they agree.
#include "response/response.hpp"

#include <fmt/format.h>
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

TEST(Response, TheDesignIsOfTheBandwidthThatTheDriveFileGives) {
  for (const double speed_Hz : {5.0, 12.0}) {
    const Response r = measured(
        ResponseOf::kSpeed,
        {"controller.angle_source=truth", "sensors.i_noise_rms_A=0.0", "sensors.i_lsb_A=0.0",
         fmt::format("controller.foc.speed_bandwidth_Hz={}", speed_Hz)});
    ASSERT_TRUE(bandwidth(r, false) && bandwidth(r, true));
    EXPECT_NEAR(*bandwidth(r, false) / *bandwidth(r, true), 1, 0.03) << speed_Hz << " Hz";
  }
}

TEST(Response, StepsOfTheDriveFileAreNoPartOfIt) {
  // The steps fall into the measured periods.
  const std::vector<std::string> clean{"controller.angle_source=truth", "sensors.i_noise_rms_A=0.0",
                                       "sensors.i_lsb_A=0.0"};
  auto stepped = clean;
  stepped.emplace_back("load.T_load_Nm=[[0.0, 0.0], [2.5, 0.02]]");
  stepped.emplace_back("reference.omega_e_rad_s=[[0.0, 300.0], [3.1, 400.0]]");
  for (const ResponseLine& l : measured(ResponseOf::kLoad, stepped).lines)
    EXPECT_GT(l.coherence, 0.999) << l.f << " Hz";
}

// The slew limit is that of the load of the drive file; a slow one left no line of the load measured.
TEST(Response, ASlowLoadOfTheDriveFileHidesNoLine) {
  const Response r = measured(ResponseOf::kLoad, {"load.slew_Nm_s=0.002", "load.T_load_Nm=0.001"});
  ASSERT_TRUE(r.locked);
  for (const ResponseLine& l : r.lines) EXPECT_TRUE(l.measured()) << l.f << " Hz";
}

TEST(Response, ALineBelowTheNoiseIsNotMeasured) {
  ResponseLine known{.f = 1, .H = 1, .coherence = 0.99, .sigma = 0.058, .design = {}};
  ResponseLine hidden{.f = 2, .H = 50, .coherence = 0.1, .sigma = 87, .design = {}};
  EXPECT_TRUE(known.measured());
  EXPECT_FALSE(hidden.measured());
  ResponseLine edge = known;  // two sigma against 3 dB, 0.2929 of the gain
  edge.sigma = 0.146;
  EXPECT_TRUE(edge.measured());
  edge.sigma = 0.147;
  EXPECT_FALSE(edge.measured());
  ResponseLine fallen = known;
  fallen.f = 4;
  fallen.H = 0.5;
  fallen.sigma = 0.029;
  const Response r{.lines = {known, hidden, fallen}};
  ASSERT_TRUE(bandwidth(r, false));
  EXPECT_NEAR(*bandwidth(r, false), 2, 1e-9);  // sqrt(2) of the gain: half of the way over log f
  EXPECT_FALSE(bandwidth(Response{.lines = {hidden, fallen}}, false));
}

TEST(Response, ALostRunHasNoResponse) {
  const Response r = measured(ResponseOf::kSpeed, {"rates.n=20"});
  EXPECT_FALSE(r.locked);
  EXPECT_TRUE(r.lines.empty());
}

// On the true angle the drive goes on without a trip: the angle of the estimate alone shows the loss.
TEST(Response, ALostEstimateHasNoResponseWithoutATrip) {
  const Response r = measured(ResponseOf::kSpeed, {"rates.n=20", "controller.angle_source=truth"});
  EXPECT_FALSE(r.locked);
  EXPECT_TRUE(r.lines.empty());
}

}  // namespace
}  // namespace twinrate::test
