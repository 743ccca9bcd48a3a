// Errors of the plant model on a log: one-step prediction and free run.
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "drive_log/followed_log.hpp"
#include "model/effects/lag.hpp"
#include "plant_sim/plant_parameters.hpp"
#include "verify/rms.hpp"
#include "verify/verify.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kOneStepStride = 23;  // rows between the starts of one-step runs

// Sensor readings along a run of one model, row by row.
struct Readings {
  std::vector<Vec2> i_dq;  // in the axes of the read angle
  std::vector<double> theta_m;
};

// Delays and filters of the current and angle readings.
struct LateSignals {
  LateSignals(const SamplingFacts& late, double T_s)
      : i_delay(late.delay[SamplingFacts::kCurrent], T_s),
        i_filter(late.lowpass[SamplingFacts::kCurrent], T_s),
        theta_delay(late.delay[SamplingFacts::kAngle], T_s),
        theta_filter(late.lowpass[SamplingFacts::kAngle], T_s) {}
  Vec2 currents(const Vec2& i_alphabeta) { return i_filter.pass(i_delay.pass(i_alphabeta)); }
  double angle(double theta_m) { return theta_filter.pass(theta_delay.pass(theta_m)); }

  DelayLine<Vec2> i_delay;
  LowPass<Vec2> i_filter;
  DelayLine<double> theta_delay;
  LowPass<double> theta_filter;
};

// Free run of one model over a stretch of the log.
class FreeRun {
 public:
  FreeRun(const DriveConfig& drive, const PlantParameters& plant, const Record& record)
      : drive_(drive),
        record_(record),
        log_(followed(record, drive)),
        sensors_(current_sensors(record, drive)),
        model_(drive.machine, drive.model_effects(), drive.inverter.v_dc, plant.saliency),
        integrator_(make_integrator(Engine::kRk, model_)) {
    for (const auto& effect : drive.model_effects()) effect->describe_sampling(late_);
  }

  // Readings of the rows first .. first + count. The run starts rows_late earlier, at the instant
  // to which the delayed readings of row `first` belong.
  Readings operator()(std::size_t first, std::size_t count) const {
    const std::size_t begin = first - std::min(first, log_.rows_late);
    const Vec2 i_dq = park(log_.i_alphabeta[begin], drive_.machine.n_p * log_.theta_m[begin]);
    PlantState x(i_dq[0], i_dq[1], log_.omega_m[begin], log_.theta_m[begin]);
    ShaftState load = model_.has_shaft() ? log_.load_mass[begin] : ShaftState{};
    LateSignals late = late_before(begin);
    Readings readings;
    PlantInput input{.t_k = record_.t[begin]};
    for (std::size_t k = begin;; ++k) {
      const auto [i_read, theta_read] = read(x, input, k == begin, late);
      if (k >= first) readings.i_dq.push_back(i_read), readings.theta_m.push_back(theta_read);
      if (k == first + count) return readings;
      input = {.t_k = record_.t[k], .u_alphabeta = log_.u_alphabeta[k], .T_load = log_.T_load[k]};
      step(x, load, input);
    }
  }

 private:
  // The delays and filters in the state after the rows before `first`.
  LateSignals late_before(std::size_t first) const {
    constexpr double kSettled = 5;  // time constants
    double memory = 0;
    for (const int signal : {SamplingFacts::kCurrent, SamplingFacts::kAngle})
      memory = std::max(memory, late_.delay[signal] + kSettled * late_.lowpass[signal]);
    LateSignals late(late_, record_.T_s);
    const auto rows = static_cast<std::size_t>(std::ceil(memory / record_.T_s));
    for (std::size_t k = first - std::min(first, rows); k < first; ++k) {
      late.currents(log_.i_alphabeta[k]);
      late.angle(log_.theta_m[k]);
    }
    return late;
  }
  void step(PlantState& x, ShaftState& load, const PlantInput& input) const {
    if (!model_.has_shaft()) {
      x = integrator_->advance(x, input, record_.T_s);
      return;
    }
    TwoMassState both;
    both << x, load.delta, load.omega_load;
    both = integrator_->advance_two_masses(both, input, record_.T_s);
    x = both.head<4>();
    load = {both[4], both[5]};
  }
  std::pair<Vec2, double> read(const PlantState& x, const PlantInput& input, bool first,
                               LateSignals& late) const {
    const Contribution added = model_.sensing_at(x, input, first ? 0 : record_.T_s);
    const double theta_m = late.angle(x[3]) + added.theta_m;
    Vec3 i_added = added.i_abc;
    if (sensors_ == 2) i_added[2] = -(i_added[0] + i_added[1]);
    const Vec2 i_alphabeta =
        late.currents(inverse_park(x.head<2>(), drive_.machine.n_p * x[3])) + clarke(i_added);
    return {park(i_alphabeta, drive_.machine.n_p * theta_m), theta_m};
  }

  const DriveConfig& drive_;
  const Record& record_;
  FollowedLog log_;
  int sensors_;
  DriveModel model_;
  SamplingFacts late_;
  std::unique_ptr<Integrator> integrator_;
};

struct RunErrors {
  Rms i_d, i_q, omega_m;
};

Vec2 logged_i_dq(const Record& record, std::size_t k, int n_p) {
  return park(record.i_alphabeta[k], n_p * record.theta_m[k]);
}

bool usable(const VerifyLog& log, std::size_t first, std::size_t count) {
  if (first + count >= log.record.size()) return false;
  for (std::size_t k = first; k <= first + count; ++k)
    if (!log.held_out[k] || !log.record.electrical_ok[k] || !log.record.motion_ok[k]) return false;
  return true;
}

// Errors of every row of a window; of the speed only if the slope has kSlopeRows on both sides.
void compare_window(const VerifyLog& log, std::size_t first, const Readings& r, int n_p,
                    RunErrors& errors) {
  for (std::size_t n = 1; n < r.theta_m.size(); ++n) {
    const Vec2 off = r.i_dq[n] - logged_i_dq(log.record, first + n, n_p);
    errors.i_d.add(off[0]);
    errors.i_q.add(off[1]);
    if (n < kSlopeRows || n + kSlopeRows >= r.theta_m.size()) continue;
    errors.omega_m.add(slope(r.theta_m, n, log.record.T_s) -
                       slope(log.record.theta_m, first + n, log.record.T_s));
  }
}

// Errors of the currents after one row and of the speed after `horizon` rows.
void compare_step(const VerifyLog& log, std::size_t first, std::size_t horizon, const Readings& r,
                  int n_p, RunErrors& errors) {
  const Vec2 off = r.i_dq[1] - logged_i_dq(log.record, first + 1, n_p);
  errors.i_d.add(off[0]);
  errors.i_q.add(off[1]);
  errors.omega_m.add(slope(r.theta_m, horizon, log.record.T_s) -
                     slope(log.record.theta_m, first + horizon, log.record.T_s));
}

bool one_step_only(double window_s) {
  return window_s <= 0;
}
}  // namespace

ModelError model_error(const std::vector<VerifyLog>& logs, Config& declared, Config& extended,
                       double window_s, double speed_horizon_s) {
  ModelError result;
  for (const bool after : {false, true}) {
    Config& config = after ? extended : declared;
    const DriveConfig& drive = config.drive();
    const PlantParameters plant = config.read<PlantParameters>();
    const int n_p = drive.machine.n_p;
    RunErrors errors;
    result.runs = 0;
    for (const VerifyLog& log : logs) {
      if (!log.record.has_voltage_equation()) continue;
      const FreeRun run(drive, plant, log.record);
      const double T_s = log.record.T_s;
      const auto horizon = static_cast<std::size_t>(std::lround(speed_horizon_s / T_s));
      const std::size_t count = one_step_only(window_s)
                                    ? horizon + kSlopeRows
                                    : static_cast<std::size_t>(std::lround(window_s / T_s));
      const std::size_t stride = one_step_only(window_s) ? kOneStepStride : count;
      for (std::size_t first = kSlopeRows; first + count < log.record.size();) {
        if (!usable(log, first, count)) {
          first += kSlopeRows;
          continue;
        }
        if (stop_signalled()) throw Stopped{};
        const Readings readings = run(first, count);
        if (one_step_only(window_s))
          compare_step(log, first, horizon, readings, n_p, errors);
        else
          compare_window(log, first, readings, n_p, errors);
        ++result.runs;
        first += stride;
      }
    }
    set(result.i_d, after, errors.i_d.value());
    set(result.i_q, after, errors.i_q.value());
    set(result.omega_m, after, errors.omega_m.value());
  }
  return result;
}

}  // namespace twinrate
