// A drive that tripped leaves SAFE on request, and runs again.
#include <gtest/gtest.h>

#include "loop/closed_loop.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::reset_test {
namespace {

struct Seen {
  std::vector<Reason> events;
  bool was_idle = false, aligned = false;
  double worst_late = 0;  // angle error in the last tenth of a second, rad
};

// The currents are not numbers from 0.3 s on for 30 ms; reset at 0.5 s.
Seen run(const std::string& drive, test::Overrides overrides) {
  overrides.insert(overrides.begin(), {"plant.fault.kind=current_nan", "plant.fault.at_s=0.3",
                                       "plant.fault.for_s=0.03"});
  Config config = test::load(drive, overrides);
  ClosedLoop loop(config);
  const double T_s = config.drive().T_s();
  const auto at = [&](double t) { return static_cast<std::int64_t>(t / T_s); };
  Seen seen;
  EXPECT_EQ(loop.reset(), "the drive is not off");
  while (loop.k() < at(2.5)) {
    if (loop.k() == at(0.5)) {
      EXPECT_EQ(loop.reset(), "");
    }
    const TickRecord& tick = loop.step();
    for (const PlantEvent& event : tick.plant_events) seen.events.push_back(event.reason);
    seen.was_idle = seen.was_idle || loop.plant().safety().state() == DriveState::kIdle;
    seen.aligned = seen.aligned || (loop.k() > at(0.5) && tick.measurement.mode == Mode::kAlign);
    const double error =
        wrap_pi(tick.estimate.theta_e - config.drive().machine.n_p * tick.truth.theta_m);
    if (loop.k() > at(2.4)) seen.worst_late = std::max(seen.worst_late, std::abs(error));
  }
  return seen;
}

bool holds(const Seen& seen, Reason reason) {
  return std::find(seen.events.begin(), seen.events.end(), reason) != seen.events.end();
}

TEST(Reset, ADriveWithoutAnAngleSensorAlignsAndRunsAgainWhateverItsStartWas) {
  for (const char* start : {"aligned", "flying", "align_if"}) {
    const std::string fault_after_start =
        std::string(start) == "align_if" ? "plant.fault.at_s=0.1" : "plant.fault.at_s=0.3";
    const Seen seen = run("dilys2021", {std::string("start=") + start, fault_after_start});
    EXPECT_TRUE(holds(seen, Reason::kSensorLost)) << start;
    EXPECT_TRUE(holds(seen, Reason::kReset)) << start;
    EXPECT_TRUE(seen.aligned) << start;
    EXPECT_LT(seen.worst_late, 0.3) << start;
  }
}

TEST(Reset, ADriveWithAnAngleSensorRunsAtOnce) {
  const Seen seen = run("niewiara2020", {"controller.angle_source=measured"});
  EXPECT_TRUE(holds(seen, Reason::kReset));
  EXPECT_FALSE(seen.aligned);
  EXPECT_FALSE(holds(seen, Reason::kOverCurrent));
  EXPECT_LT(seen.worst_late, 0.3);
}

}  // namespace
}  // namespace twinrate::reset_test
