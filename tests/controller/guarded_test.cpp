// The guard around every controller: nothing that is not finite leaves it.
#include "controller/guarded.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace twinrate {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Passes the estimated speed on as its voltage.
class EchoController final : public Controller {
 public:
  std::string_view kind() const override { return "echo"; }
  Command step(const ControllerInput& in) override {
    Command c;
    c.k = in.measurement.k;
    c.u_alphabeta_ref = {std::isfinite(in.estimate.omega_m) ? in.estimate.omega_m : 1.0, 0};
    return c;
  }
};

struct GuardedDrive {
  Guarded controller{std::make_unique<EchoController>()};
  Measurement m;
  Estimate e;
  Command step(double omega_m) {
    ++m.k;
    e.omega_m = omega_m;
    return controller.step({m, e, Reference{}});
  }
};

TEST(Guarded, PassesFiniteCommandsOn) {
  GuardedDrive drive;
  EXPECT_EQ(drive.step(7).u_alphabeta_ref[0], 7);
  EXPECT_EQ(drive.controller.take_event().reason, Reason::kNone);
}

TEST(Guarded, TripsForGoodOnACommandThatIsNotFinite) {
  GuardedDrive drive;
  const Command c = drive.step(1e200);  // its square overflows
  EXPECT_EQ(c.mode, Mode::kSafe);
  EXPECT_EQ(c.u_alphabeta_ref, Vec2(0, 0));
  EXPECT_EQ(drive.controller.take_event().reason, Reason::kCommandNotFinite);
  EXPECT_EQ(drive.step(7).mode, Mode::kSafe);
  EXPECT_EQ(drive.controller.take_event().reason, Reason::kNone);
}

TEST(Guarded, TripsOnAnEstimateThatStaysNotFinite) {
  GuardedDrive drive;
  for (int tick = 0; tick < Guarded::kHoldTicks; ++tick)
    EXPECT_EQ(drive.step(kNaN).u_alphabeta_ref[0], 1) << "the inner controller bridges it";
  EXPECT_EQ(drive.step(7).u_alphabeta_ref[0], 7);
  for (int tick = 0; tick < Guarded::kHoldTicks; ++tick)
    EXPECT_EQ(drive.step(kNaN).u_alphabeta_ref[0], 1) << "the ticks count anew";
  EXPECT_EQ(drive.step(kNaN).mode, Mode::kSafe);
  EXPECT_EQ(drive.controller.take_event().reason, Reason::kInputNotFinite);
}

}  // namespace
}  // namespace twinrate
