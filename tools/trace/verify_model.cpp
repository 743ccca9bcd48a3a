// The plant model against a log: one step and free run.
#include <cmath>
#include <memory>

#include "model/effects/undo.hpp"
#include "plant_sim/integrator.hpp"
#include "tools/trace/rms.hpp"
#include "tools/trace/verify.hpp"

namespace twinrate {
namespace {

constexpr int kSlope = 10;                  // half-width of a speed's slope fit, rows
constexpr std::size_t kOneStepStride = 23;  // rows between the starts of one-step runs

double slope(const std::vector<double>& x, std::size_t k, double T_s) {
  const auto h = static_cast<std::ptrdiff_t>(std::min<std::size_t>({kSlope, k, x.size() - 1 - k}));
  double sum = 0, weight = 0;
  for (std::ptrdiff_t j = 1; j <= h; ++j) {
    const auto row = static_cast<std::ptrdiff_t>(k);
    sum += static_cast<double>(j) *
           (x[static_cast<std::size_t>(row + j)] - x[static_cast<std::size_t>(row - j)]);
    weight += static_cast<double>(2 * j * j);
  }
  return weight > 0 ? sum / (weight * T_s) : 0;
}

double at_or(const std::vector<double>& column, std::size_t k, double otherwise) {
  return column.empty() ? otherwise : column[k];
}

// What the sensors of one model read, row by row, along a run of the model.
struct Readings {
  std::vector<Vec2> i_dq;  // in the axes of the read angle
  std::vector<double> theta_m;
};

// One model of the drive: what it makes of a stretch of log.
class FreeRun {
 public:
  explicit FreeRun(const DriveConfig& drive)
      : drive_(drive),
        model_(drive.machine, drive.model_effects(), drive.inverter.v_dc,
               static_cast<Saliency>(drive.plant.saliency)),
        undo_(drive.model_effects(), drive.machine.n_p, drive.sensors.current_sensors, drive.T_s()),
        integrator_(make_integrator(Engine::kErk, model_, drive.plant.erk_steps)) {}

  // Rows `first` to first + count.
  Readings operator()(const Record& record, std::size_t first, std::size_t count) {
    PlantState x = start(record, first);
    ShaftState shaft = model_.shaft_at_rest(record.t[first], x[2], at_or(record.T_load, first, 0));
    Readings readings;
    PlantInput input;
    for (std::size_t n = 0;; ++n) {
      const std::size_t k = first + n;
      read(x, input, record.T_s, n == 0, readings);
      if (n == count) return readings;
      input = {.t_k = record.t[k],
               .u_alphabeta = record.u_alphabeta[k],
               .T_load = at_or(record.T_load, k, 0)};
      step(x, shaft, input, record.T_s);
    }
  }

 private:
  PlantState start(const Record& record, std::size_t k) const {
    Measurement m;
    m.k = 0;
    m.t_ns = std::llround(1e9 * record.t[k]);
    m.signals = kPhaseCurrents | kPosition | kSpeed;
    m.i_abc = inverse_clarke(record.i_alphabeta[k]);
    m.theta_m = record.theta_m[k];
    m.omega_m = slope(record.theta_m, k, record.T_s);
    m.v_dc = at_or(record.v_dc, k, drive_.inverter.v_dc);
    const Measurement s = undo_(m);
    const Vec2 i_dq = park(clarke(s.i_abc), drive_.machine.n_p * s.theta_m);
    return {i_dq[0], i_dq[1], s.omega_m, s.theta_m};
  }
  void step(PlantState& x, ShaftState& shaft, const PlantInput& input, double T) {
    if (!model_.has_shaft()) {
      x = integrator_->advance(x, input, T);
      return;
    }
    TwoMassState both;
    both << x, shaft.delta, shaft.omega_load;
    both = integrator_->advance_two_masses(both, input, T);
    x = both.head<4>();
    shaft = {both[4], both[5]};
  }
  void read(const PlantState& x, const PlantInput& input, double T_s, bool first,
            Readings& readings) const {
    const Contribution added = model_.sensing_at(x, input, first ? 0 : T_s);
    const double theta_m = x[3] + added.theta_m;
    const Vec2 i_alphabeta =
        inverse_park(x.head<2>(), drive_.machine.n_p * x[3]) + clarke(added.i_abc);
    readings.i_dq.push_back(park(i_alphabeta, drive_.machine.n_p * theta_m));
    readings.theta_m.push_back(theta_m);
  }

  const DriveConfig& drive_;
  DriveModel model_;
  SensingUndo undo_;
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

// Every row of a window against the log; the speed where its slope is a whole one.
void compare_window(const VerifyLog& log, std::size_t first, const Readings& r, int n_p,
                    RunErrors& errors) {
  for (std::size_t n = 1; n < r.theta_m.size(); ++n) {
    const Vec2 off = r.i_dq[n] - logged_i_dq(log.record, first + n, n_p);
    errors.i_d.add(off[0]);
    errors.i_q.add(off[1]);
    if (n < kSlope || n + kSlope >= r.theta_m.size()) continue;
    errors.omega_m.add(slope(r.theta_m, n, log.record.T_s) -
                       slope(log.record.theta_m, first + n, log.record.T_s));
  }
}

// Currents after one row, speed after `horizon` rows.
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

ModelError model_error(const std::vector<VerifyLog>& logs, const DriveConfig& declared,
                       const DriveConfig& extended, double window_s, double speed_horizon_s) {
  ModelError result;
  for (const bool after : {false, true}) {
    const DriveConfig& drive = after ? extended : declared;
    const int n_p = drive.machine.n_p;
    FreeRun run(drive);
    RunErrors errors;
    result.runs = 0;
    for (const VerifyLog& log : logs) {
      if (!log.record.has_voltage_equation()) continue;
      const double T_s = log.record.T_s;
      const auto horizon = static_cast<std::size_t>(std::lround(speed_horizon_s / T_s));
      const std::size_t count = one_step_only(window_s)
                                    ? horizon + kSlope
                                    : static_cast<std::size_t>(std::lround(window_s / T_s));
      const std::size_t stride = one_step_only(window_s) ? kOneStepStride : count;
      for (std::size_t first = kSlope; first + count < log.record.size();) {
        if (!usable(log, first, count)) {
          first += kSlope;
          continue;
        }
        const Readings readings = run(log.record, first, count);
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
