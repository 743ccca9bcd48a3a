#include "verify/verify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/multicast.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "loop/closed_loop.hpp"
#include "loop/estimator_loop.hpp"
#include "loop/lcm_replay.hpp"
#include "loop/load_drive.hpp"
#include "verify/rms.hpp"

namespace twinrate {
namespace {

constexpr double kLoopSettle_s = 1.0;       // of the closed loop
constexpr double kEstimatorSettle_s = 0.3;  // of a replayed estimator

struct EstimateErrors {
  std::vector<Rms> innovation;
  Rms theta_e;
  bool has_angle = false;
  void add(const Estimate& e, const Measurement& m, int n_p) {
    innovation.resize(static_cast<std::size_t>(e.n_y));
    for (int i = 0; i < e.n_y; ++i) innovation[static_cast<std::size_t>(i)].add(e.innov[i]);
    if (!(m.signals & kPosition) || e.status & kMeasuredAngle) return;
    has_angle = true;
    theta_e.add(wrap_pi(e.theta_e - n_p * m.theta_m));
  }
};

// For each measurement: true if it is held out and the estimator has settled.
std::vector<char> counted(const VerifyLog& log) {
  std::vector<char> counts(log.measurements.size(), 0);
  if (log.measurements.empty()) return counts;
  const std::int64_t begin = log.measurements.front().t_ns;
  const std::vector<double>& rows_t = log.record.t;
  for (std::size_t n = 0; n < counts.size(); ++n) {
    const double t = 1e-9 * static_cast<double>(log.measurements[n].t_ns - begin);
    const auto row =
        std::lower_bound(rows_t.begin(), rows_t.end(), rows_t.front() + t - 0.5 * log.record.T_s);
    counts[n] = t > kEstimatorSettle_s && row != rows_t.end() &&
                log.held_out[static_cast<std::size_t>(row - rows_t.begin())];
  }
  return counts;
}

}  // namespace

EstimatorError estimator_error(const std::vector<VerifyLog>& logs, Config& declared,
                               Config& extended, const VerifySettings& settings) {
  EstimatorError result;
  EstimateErrors before, after;
  const int n_p = declared.drive().machine.n_p;
  result.over_lcm = settings.over_lcm;
  for (const VerifyLog& log : logs) {
    EstimatorLoop loop_before(declared), loop_after(extended);
    std::optional<OwnEstimator> processes;
    std::optional<LcmReplay> bus;
    if (settings.over_lcm) {
      const std::int64_t session = new_session_id();
      const BusAddress address{.url = settings.url};
      processes.emplace(extended.resolved(), address, session);
      bus.emplace(extended.read<BusParameters>(), address, session);
    }
    const std::vector<char> counts = counted(log);
    for (std::size_t n = 0; n < log.measurements.size(); ++n) {
      if (stop_signalled()) throw Stopped{};
      const Measurement& m = log.measurements[n];
      const Estimate e_before = loop_before.tick(m);
      Estimate e_after = loop_after.tick(m);
      if (bus) {
        const std::optional<Estimate> answer = bus->play(m);
        if (!answer && stop_signalled()) throw Stopped{};
        if (!answer)
          throw std::runtime_error(fmt::format("no ESTIMATE({}) from the extended estimator", m.k));
        result.different += !same_bits(*answer, e_after);
        e_after = *answer;
      }
      if (!counts[n]) continue;
      ++result.ticks;
      before.add(e_before, m, n_p);
      after.add(e_after, m, n_p);
    }
    if (bus) result.repeats += bus->repeats();
  }
  for (std::size_t i = 0; i < before.innovation.size(); ++i)
    result.innovation.push_back({before.innovation[i].value(), after.innovation[i].value()});
  if (before.has_angle) result.theta_e = {before.theta_e.value(), after.theta_e.value()};
  return result;
}

// Overrides for constant speed and load, with their values at settle_s.
static std::vector<std::string> constant_profile(const DriveConfig& drive) {
  const double t = drive.run.settle_s;
  return {drive.reference.in_rpm
              ? fmt::format("reference.speed_rpm={}", drive.reference.speed_rpm.at(t))
              : fmt::format("reference.omega_e_rad_s={}", drive.reference.omega_e_rad_s.at(t)),
          fmt::format("load.T_load_Nm={}", drive.load.T_load_Nm.at(t))};
}

// The drive of the closed loop. The plant has all effects of the extended model; estimator and
// controller compensate all of them (`after`) or the first `n_declared`.
static Config loop_config(const Config& extended, std::size_t n_declared, bool after) {
  std::vector<ConfiguredEffect> effects;
  for (ConfiguredEffect e : extended.drive().effects) {
    if (e.used_in == UsedIn::kPlant) continue;
    e.used_in = after || effects.size() < n_declared ? UsedIn::kBoth : UsedIn::kPlant;
    effects.push_back(e);
  }
  Config config = Config::parse(extended.resolved_with(std::move(effects)), "closed loop",
                                constant_profile(extended.drive()));
  read_all_tables(config);
  return config;
}

// Runs the loop and sets one side of `result`.
static void run_loop(Config& config, double loop_s, bool after, LoopError& result) {
  const DriveConfig& drive = config.drive();
  const auto settle =
      static_cast<std::int64_t>(std::max(kLoopSettle_s, drive.run.settle_s) / drive.T_s());
  const auto end = settle + static_cast<std::int64_t>(loop_s / drive.T_s());
  ClosedLoop loop(config);
  Rms theta_e, speed, T_load;
  double sum = 0;
  std::vector<double> speed_error;
  while (loop.k() < end) {
    if (stop_signalled()) throw Stopped{};
    const TickRecord& tick = loop.step();
    if (tick.truth.k < settle) continue;
    theta_e.add(wrap_pi(tick.estimate.theta_e - drive.machine.n_p * tick.truth.theta_m));
    T_load.add(tick.estimate.T_load - tick.truth.T_load);
    result.has_load = result.has_load || tick.estimate.T_load != 0;
    speed_error.push_back(tick.truth.omega_m - tick.command.omega_m_ref);
    sum += speed_error.back();
  }
  const auto count = static_cast<double>(speed_error.size());
  for (const double error : speed_error) speed.add(error - sum / count);
  set(result.theta_e, after, theta_e.value());
  set(result.speed_ripple, after, speed.value());
  set(result.T_load, after, T_load.value());
  result.duration_s = static_cast<double>(end - settle) * drive.T_s();
}

LoopError closed_loop_error(const Config& declared, const Config& extended, double loop_s) {
  LoopError result;
  const std::size_t n_declared = declared.drive().model_effects().size();
  for (const bool after : {false, true}) {
    Config config = loop_config(extended, n_declared, after);
    run_loop(config, loop_s, after, result);
  }
  return result;
}

Verification verify(const std::vector<VerifyLog>& logs, const Config& declared,
                    const Config& extended, const VerifySettings& settings) {
  Verification v;
  v.window_s = settings.window_s;
  v.speed_horizon_s = settings.speed_horizon_s;
  const auto fresh = [](const Config& config) {
    Config copy = Config::parse(config.resolved(), "verify");
    read_all_tables(copy);
    return copy;
  };
  Config before = fresh(declared), after = fresh(extended);
  const bool voltage = std::all_of(logs.begin(), logs.end(), [](const VerifyLog& log) {
    return log.record.has_voltage_equation();
  });
  if (voltage) {
    v.one_step = model_error(logs, before, after, 0, settings.speed_horizon_s);
    v.free_run = model_error(logs, before, after, settings.window_s, settings.speed_horizon_s);
    for (auto* level : {&v.one_step, &v.free_run})
      if ((*level)->runs == 0) level->reset();
    if (!v.free_run) v.notes.push_back("no held-out stretch is long enough for a free run");
  } else {
    v.notes.push_back("the log has no voltage or no i_d: no one-step prediction, no free run");
  }
  VerifySettings how = settings;
  if (how.over_lcm && !multicast_route_exists(kDefaultMulticastAddress)) {
    how.over_lcm = false;
    v.notes.push_back("no multicast route: replayed in this process, not over LCM");
  }
  try {
    v.estimator = estimator_error(logs, before, after, how);
  } catch (const std::runtime_error& error) {
    v.notes.push_back(fmt::format("estimator: {}", error.what()));
  }
  try {
    v.closed_loop = closed_loop_error(before, after, settings.loop_s);
  } catch (const BadInput& error) {
    v.notes.push_back(fmt::format("closed loop: {}", error.what()));
  }
  return v;
}

}  // namespace twinrate
