// Simulated logs of the servo at a slow speed without load.
#pragma once
#include <string>
#include <vector>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "plan/plan.hpp"
#include "trace/measured.hpp"

namespace twinrate {

// The overrides `settings` come before those of the log.
inline Config servo(const std::string& effects, const std::vector<std::string>& settings = {
                                                    "rates.f_s_Hz=5000", "run.duration_s=3"}) {
  std::vector<std::string> all = {"controller.kind=foc",
                                  "controller.compensation=off",
                                  "controller.angle_source=measured",
                                  "sensors.current_sensors=2",
                                  "reference.speed_rpm=30",
                                  "reference.slew_rad_s2=750",
                                  "run.settle_s=0.2"};
  all.insert(all.end(), settings.begin(), settings.end());
  return Config::parse(load_drive("niewiara2020").resolved_with({}) + effects, "servo", all);
}

inline PlanLog run(Config config) {
  read_all_tables(config);
  const DriveConfig& d = config.drive();
  ClosedLoop loop(config);
  DeclaredLoad load(d);
  RawLog raw;
  Measurement before = loop.step().measurement;
  for (std::int64_t k = 1; k < d.steps(); ++k) {
    const Measurement m = loop.step().measurement;
    const double T_load = load.at(1e-9 * static_cast<double>(before.t_ns));
    append_row(raw, before, m.u_alphabeta, &T_load);
    before = m;
  }
  PlanLog log;
  log.record = make_record(raw, d.machine.n_p, log.health);
  return log;
}

}  // namespace twinrate
