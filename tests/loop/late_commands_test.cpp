// What 15 ticks of late commands do to a drive at 400 rad/s: 3 ms in which the rotor turns by 1.2 rad.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "controller/make_controller.hpp"
#include "loop/estimator_loop.hpp"
#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

enum class Commands { kInTime, kOneTickLate, kNone };

// The largest current vector, A, in 40 ms from the first of these ticks on.
double largest_current(Commands commands) {
  constexpr std::int64_t kFirst = 3000, kLast = 3014, kEnd = 3200;
  Config config = test::load("dilys2021", {"start=flying", "safety.hold_ms=4"});
  Plant plant(config);
  EstimatorLoop estimator(config, make_filter, {});
  const auto controller = make_controller(config);
  std::array<Command, 3> sent;  // COMMAND(k) at k modulo 3; COMMAND(k - 1) is due in tick k
  double largest = 0;
  for (std::int64_t k = 0; k < kEnd; ++k) {
    const Measurement& m = plant.sample();
    const Truth truth = plant.truth();
    const auto at = [k, &sent](std::int64_t before) -> Command& {
      return sent[static_cast<std::size_t>(k - before) % sent.size()];
    };
    at(0) = controller->step({m, estimator.tick(m), config.drive().reference_at(k), &truth});
    const bool disturbed = k >= kFirst && k <= kLast;
    if (!disturbed || commands == Commands::kInTime)
      plant.take_command(at(0));
    else if (commands == Commands::kOneTickLate)
      plant.take_command(at(2));
    plant.advance();
    if (k >= kFirst) largest = std::max(largest, plant.truth().i_dq.norm());
  }
  EXPECT_FALSE(plant.tripped());
  return largest;
}

TEST(LateCommands, OneTickLateHardlyMovesTheDrive) {
  const double in_time = largest_current(Commands::kInTime);
  EXPECT_LT(in_time, 0.1);
  EXPECT_LT(largest_current(Commands::kOneTickLate), in_time + 0.2);
  EXPECT_GT(largest_current(Commands::kNone), 1) << "a voltage that stands still beside the rotor";
}

}  // namespace
}  // namespace twinrate
