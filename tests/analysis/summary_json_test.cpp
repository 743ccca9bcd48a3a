// summary.json: keys, empty figures, and the figures of the processes that come back from it.
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "tests/analysis/steady_run.hpp"

namespace twinrate {
namespace {

TEST(Summary, JsonHoldsTheContractsKeys) {
  const DriveConfig config = steady_drive();
  Summary s = summarise(steady_run(config), config);
  s.wall_s = 4;
  const auto json = nlohmann::json::parse(to_json(s, config));
  for (const char* key : {"locked",
                          "speed_held",
                          "speed_dip_percent",
                          "speed_excess_percent",
                          "speed_unevenness_percent",
                          "trip",
                          "duration_s",
                          "steps",
                          "speed_error_rms_rad_s",
                          "angle_error_rms_rad",
                          "angle_error_max_rad",
                          "speed_ripple_rms_rad_s",
                          "speed_ripple_harmonics_rms_rad_s",
                          "lost_messages",
                          "losses_counted",
                          "repeats",
                          "deadline_misses",
                          "late_gains",
                          "stalls",
                          "stalled_s",
                          "longest_stall_s",
                          "wall_s",
                          "steps_per_s",
                          "f_s_Hz",
                          "f_b_Hz",
                          "n",
                          "policy",
                          "rates_requested",
                          "gains_used",
                          "n_from_tick",
                          "P44_min",
                          "P44_max",
                          "late_commands",
                          "angle_reference"})
    EXPECT_TRUE(json.contains(key)) << key;
  EXPECT_EQ(json["locked"], true);
  EXPECT_EQ(json["f_b_Hz"], 200);
  EXPECT_EQ(json["steps_per_s"], 500);
  EXPECT_EQ(json["policy"], "paper");
}

TEST(Summary, JsonHasNullForAnEmptyFigure) {
  const DriveConfig config = steady_drive();
  Summary s;
  s.angle_error_rms = kNaN;
  const auto json = nlohmann::json::parse(to_json(s, config));
  for (const char* key :
       {"locked", "angle_error_rms_rad", "speed_ripple_rms_rad_s", "steps_per_s", "P44_min"})
    EXPECT_TRUE(json[key].is_null()) << key;
}

TEST(Summary, TakesFiguresOfTheProcessesFromASummaryFile) {
  const DriveConfig config = steady_drive();
  Summary written;
  written.repeats = 3;
  written.wall_s = 2.5;
  written.lost_messages["DRIVE_GAIN"] = 7;
  written.losses_counted = true;
  Summary read;
  EXPECT_FALSE(read.losses_counted);
  take_process_figures(to_json(written, config), read);
  EXPECT_EQ(read.repeats, 3);
  EXPECT_EQ(read.wall_s, 2.5);
  EXPECT_EQ(read.lost_messages["DRIVE_GAIN"], 7);
  EXPECT_TRUE(read.losses_counted);
  take_process_figures("not json", read);
  EXPECT_EQ(read.repeats, 3);
}

TEST(Summary, FiguresOfTheProcessesComeBackEachToItsOwn) {
  Summary written;
  written.repeats = 1;
  written.deadline_misses = 2;
  written.late_gains = 3;
  written.late_commands = 4;
  written.stalls = 5;
  written.stalled_s = 0.6;
  written.longest_stall_s = 0.7;
  Summary read;
  take_process_figures(to_json(written, steady_drive()), read);
  EXPECT_EQ(read.repeats, 1);
  EXPECT_EQ(read.deadline_misses, 2);
  EXPECT_EQ(read.late_gains, 3);
  EXPECT_EQ(read.late_commands, 4);
  EXPECT_EQ(read.stalls, 5);
  EXPECT_EQ(read.stalled_s, 0.6);
  EXPECT_EQ(read.longest_stall_s, 0.7);
}

}  // namespace
}  // namespace twinrate
