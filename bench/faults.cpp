// What a drive does about faults, as a table: fault, trials, detected after, what it did, what was
// lost.
//
//   faults [--drive NAME] [--trials 20] [--seed 1] [--only TEXT] [--set TWINRATE [--messages]]
//
// Each row has its trials at random ticks of a drive that runs. Without --set: in lock-step in this
// process, with the faults of [plant.fault] and of the load. With --set the processes of
// `TWINRATE launch` are killed, stopped and out of disk, in lock-step and in realtime
// (process_faults.cpp). With --messages somebody else sends to that set (message_faults.cpp).
//
//   detected after   from the fault to the event that names it: worst (median) of the trials. A set
//                    in realtime: from the last GAIN to the event `gain_scheduled`, in drive time
//   off after        lock-step: from the fault to the first interval in mode safe. A set in
//                    realtime: from the last COMMAND, or the last heartbeat of the supervisor where
//                    that is stopped, to it, in drive time
//   end after        from the signal to the end of the five processes, in wall time
//   as expected      trials whose reaction is the one of the row
//
// Exit code 1 if a trial is not as expected.
#include "bench/faults.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/command_line.hpp"
#include "core/reason.hpp"
#include "core/report_error.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

using namespace faults;

// -- in this process ------------------------------------------------------------------------------

struct LoopRow {
  const char* fault;
  // {t}: the time of the fault.
  std::vector<std::string> overrides;
  Reason names_it;      // the event that names the fault
  Reason switches_off;  // kNone: the drive goes on, locked
  int within;           // ticks from the fault to the event; 0: any
};

const std::vector<LoopRow> kLoopRows = {
    {"COMMAND missing for good",
     {"plant.fault.kind=command_missing"},
     Reason::kCommandLost,
     Reason::kCommandLost,
     22},
    {"COMMAND missing for 10 ticks",
     {"plant.fault.kind=command_missing", "plant.fault.for_s=0.002"},
     Reason::kNone,
     Reason::kNone,
     0},
    {"COMMAND not finite",
     {"plant.fault.kind=command_nan"},
     Reason::kCommandNotFinite,
     Reason::kCommandNotFinite,
     3},
    {"COMMAND beyond the bus, 1 tick",
     {"plant.fault.kind=command_too_large", "plant.fault.value=50", "plant.fault.for_s=0.0002"},
     Reason::kVoltageClamped,
     Reason::kNone,
     2},
    {"COMMAND beyond the bus for good",
     {"plant.fault.kind=command_too_large", "plant.fault.value=50"},
     Reason::kVoltageClamped,
     Reason::kOverCurrent,
     2},
    {"rotor stalled by ten times the rated load",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.63]]"},
     Reason::kNone,
     Reason::kOverCurrent,
     0},
    {"bus at 35 V",
     {"plant.fault.kind=bus_voltage", "plant.fault.value=35"},
     Reason::kOverVoltage,
     Reason::kOverVoltage,
     2},
    {"bus at 8 V",
     {"plant.fault.kind=bus_voltage", "plant.fault.value=8"},
     Reason::kUnderVoltage,
     Reason::kUnderVoltage,
     2},
    {"winding at 110 degC, limit 120 degC, rated load",
     {"plant.fault.kind=temperature", "plant.fault.value=110", "load.T_load_Nm=0.063",
      "safety.temperature_max_degC=120"},
     Reason::kDerated,
     Reason::kNone,
     500},
    {"winding at 121 degC, limit 120 degC",
     {"plant.fault.kind=temperature", "plant.fault.value=121", "safety.temperature_max_degC=120"},
     Reason::kOverTemperature,
     Reason::kOverTemperature,
     500},
    {"load drives it to over-speed",
     {"load.T_load_Nm=[[0, 0], [{t}, -0.15]]", "safety.omega_m_max_rad_s=250"},
     Reason::kOverSpeed,
     Reason::kOverSpeed,
     0},
    {"current NaN for 30 ticks",
     {"plant.fault.kind=current_nan", "plant.fault.for_s=0.006"},
     Reason::kSensorFault,
     Reason::kNone,
     1},
    {"current NaN for good",
     {"plant.fault.kind=current_nan"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     1},
    {"current 10 A off for 30 ticks",
     {"plant.fault.kind=current_jump", "plant.fault.value=10", "plant.fault.for_s=0.006"},
     Reason::kSensorFault,
     Reason::kNone,
     1},
    {"current 10 A off for good",
     {"plant.fault.kind=current_jump", "plant.fault.value=10"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     1},
    {"phase current stuck, under rated load",
     {"plant.fault.kind=current_stuck", "load.T_load_Nm=0.063"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     0},
    {"angle NaN for 30 ticks, of the sensor that the controller uses",
     {"plant.fault.kind=position_nan", "plant.fault.for_s=0.006",
      "controller.angle_source=measured"},
     Reason::kSensorFault,
     Reason::kNone,
     1},
    {"angle NaN for good, of the sensor that the controller uses",
     {"plant.fault.kind=position_nan", "controller.angle_source=measured"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     1},
    {"angle NaN, of a sensor that nobody uses",
     {"plant.fault.kind=position_nan"},
     Reason::kNone,
     Reason::kNone,
     0},
    {"synchronism lost under a stalling load, watch on, i_trip 30 A",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.foc.synchronism.watch=true",
      "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},  // from the first angle error above 90 deg, where there is one
    {"synchronism lost in the same way, lqr",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.kind=lqr",
      "controller.lqr.synchronism.watch=true", "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},
    {"synchronism lost in the same way, reaction stop",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.foc.synchronism.watch=true",
      "controller.foc.synchronism.reaction=stop", "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},
};

// What a trial saw of its run.
struct Seen {
  std::int64_t beyond_90 = -1;  // first tick with an angle error above 90 deg
  std::int64_t named = -1, off = -1, safe = -1;
  Reason why = Reason::kNone;
  bool lost_sync = false;
  double i_max = 0;
};

void note(const TickRecord& tick, Reason reason, const LoopRow& row, Seen& seen) {
  if (seen.named < 0 && reason == row.names_it) seen.named = tick.measurement.k;
  if (seen.off < 0 && is_trip(reason)) seen.off = tick.measurement.k, seen.why = reason;
}

Seen watch(Config& config, std::int64_t k_fault, const LoopRow& row) {
  const DriveConfig drive = config.drive();
  ClosedLoop loop(config);
  Seen seen;
  while (loop.k() < drive.steps()) {
    const TickRecord& tick = loop.step();
    if (loop.k() <= k_fault) continue;
    if (tick.event.reason != Reason::kNone) note(tick, tick.event.reason, row, seen);
    for (const PlantEvent& event : tick.plant_events) note(tick, event.reason, row, seen);
    if (seen.safe < 0 && tick.measurement.mode == Mode::kSafe) seen.safe = tick.measurement.k - 1;
    seen.i_max = std::max(seen.i_max, tick.truth.i_dq.norm());
    const double error = wrap_pi(tick.estimate.theta_e - drive.machine.n_p * tick.truth.theta_m);
    if (!(std::abs(error) <= kPi / 2) && !seen.lost_sync) seen.beyond_90 = tick.measurement.k;
    seen.lost_sync = seen.beyond_90 >= 0;
  }
  return seen;
}

Trial try_loop(const Options& o, const LoopRow& row, std::size_t index, int trial) {
  constexpr std::int64_t kFrom = 3000, kTicks = 2000, kAfter = 3000;
  std::int64_t k_fault = kFrom + draw(o, index, trial, kTicks);
  const double f_s = Config::load(o.drive).drive().rates.f_s_Hz;
  const double t = static_cast<double>(k_fault) / f_s;
  std::vector<std::string> list = {
      fmt::format("run.duration_s={}", static_cast<double>(k_fault + kAfter) / f_s),
      fmt::format("run.seed={}", 1 + trial)};
  for (const std::string& text : row.overrides)
    list.push_back(fmt::format(fmt::runtime(text), fmt::arg("t", t)));
  if (row.overrides.front().starts_with("plant.fault"))
    list.push_back(fmt::format("plant.fault.at_s={}", t));
  else
    list.push_back("load.slew_Nm_s=0");
  Config config = load_drive(o.drive, list);
  Seen seen = watch(config, k_fault, row);
  Trial result;
  if (row.names_it == Reason::kLostSynchronism && seen.beyond_90 >= 0) k_fault = seen.beyond_90;
  result.detected = seen.named >= 0;
  result.detected_after = static_cast<double>(seen.named - k_fault);
  if (seen.safe >= 0) result.off_after = static_cast<double>(seen.safe - k_fault);
  const bool named = row.names_it == Reason::kNone || seen.named >= 0;
  const bool in_time = row.within == 0 || seen.named - k_fault <= row.within;
  const bool went_on = row.switches_off == Reason::kNone && seen.off < 0 && !seen.lost_sync;
  result.as_expected = named && in_time &&
                       (row.switches_off == Reason::kNone ? went_on : seen.why == row.switches_off);
  result.did =
      seen.off >= 0 ? fmt::format("off: {}", reason_name(static_cast<int>(seen.why))) : "ran on";
  result.lost = seen.off >= 0 ? "the run" : seen.lost_sync ? "synchronism" : "nothing";
  return result;
}

bool run_loop_rows(const Options& o) {
  bool well = true;
  print_header(false);
  for (std::size_t row = 0; row < kLoopRows.size(); ++row) {
    if (std::string(kLoopRows[row].fault).find(o.only) == std::string::npos) continue;
    std::vector<Trial> trials;
    for (int trial = 0; trial < o.trials; ++trial) {
      trials.push_back(try_loop(o, kLoopRows[row], row, trial));
      well = well && trials.back().as_expected;
    }
    print_row(kLoopRows[row].fault, trials, "ticks", false);
  }
  return well;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("What a drive does about faults, as a table");
  Options o;
  command_line.option("--drive", &o.drive, "run this drive file or preset");
  command_line.option("--trials", &o.trials, "trials of each row");
  command_line.option("--seed", &o.seed, "draw the ticks from this seed");
  command_line.option("--only", &o.only, "only rows whose name contains this text");
  command_line.option("--set", &o.twinrate, "kill and stop processes of this twinrate's launch");
  command_line.flag("--messages", o.messages,
                    "with --set: send messages of a second sender instead");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (o.messages && o.twinrate.empty()) {
    fmt::print(stderr, "faults: --messages needs --set TWINRATE, whose set it sends them to\n");
    return 2;
  }
  if (o.messages) return run_message_rows(o) ? 0 : 1;
  return (o.twinrate.empty() ? run_loop_rows(o) : run_set_rows(o)) ? 0 : 1;
} catch (...) {
  return twinrate::report_error("faults");
}
