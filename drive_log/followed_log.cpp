#include "drive_log/followed_log.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/motor_side.hpp"
#include "model/effects/undo.hpp"
#include "trace/record_contributions.hpp"
#include "trace/row_point.hpp"

namespace twinrate {
namespace {

double at_or(const std::vector<double>& column, std::size_t k, double otherwise) {
  return column.empty() ? otherwise : column[k];
}

void undo_sensors(const Record& record, const DriveConfig& drive, FollowedLog& log) {
  Effects adding;
  for (const auto& effect : drive.model_effects())
    if (SamplingFacts spoilt; !effect->describe_sampling(spoilt)) adding.push_back(effect);
  const SensingUndo undo(adding, drive.machine.n_p, current_sensors(record, drive), record.T_s);
  Measurement m;
  m.k = 0;
  m.signals = kPhaseCurrents | kPosition | kSpeed;
  for (std::size_t k = 0; k < record.size(); ++k) {
    m.t_ns = std::llround(1e9 * record.t[k]);
    m.i_abc = inverse_clarke(record.i_alphabeta[k]);
    m.theta_m = record.theta_m[k];
    m.omega_m = slope(record.theta_m, k, record.T_s);
    m.v_dc = at_or(record.v_dc, k, drive.inverter.v_dc);
    const Measurement s = undo(m);
    log.i_alphabeta.push_back(clarke(s.i_abc));
    log.theta_m.push_back(s.theta_m);
    log.omega_m.push_back(s.omega_m);
    log.T_load.push_back(at_or(record.T_load, k, 0));
  }
}

// Moves late readings back by whole rows and by a rotation for the remaining fraction of a row
// (exact in steady state). The time constant of a filter counts as a delay.
void undo_lags(const SamplingFacts& late, double T_s, int n_p, FollowedLog& log) {
  const std::size_t last = log.theta_m.size() - 1;
  const auto back = [&](auto& signal, SamplingFacts::Signal which, auto turn) {
    const double lag = late.delay[which] + late.lowpass[which];
    const auto rows = static_cast<std::size_t>(lag / T_s);
    if (lag == 0) return;
    for (std::size_t k = 0; k <= last; ++k)
      signal[k] = turn(signal[std::min(last, k + rows)],
                       log.omega_m[k] * (lag - static_cast<double>(rows) * T_s));
    log.rows_late = std::max(log.rows_late, rows);
  };
  back(log.i_alphabeta, SamplingFacts::kCurrent,
       [&](const Vec2& i, double angle) { return rotate(i, n_p * angle); });
  back(log.theta_m, SamplingFacts::kAngle, [](double x, double angle) { return x + angle; });
  back(log.omega_m, SamplingFacts::kAngle, [](double x, double) { return x; });
}

std::vector<OperatingPoint> points_of(const Record& record, const DriveConfig& drive,
                                      const FollowedLog& log) {
  std::vector<OperatingPoint> points(record.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const RotorFrame frame = frame_at(log.theta_m[k], log.omega_m[k], drive.machine.n_p);
    OperatingPoint& p = points[k] = point_of(record, k, frame, drive.inverter.v_dc);
    p.i_dq = p.rotor_axes(log.i_alphabeta[k]);
    p.T_load = log.T_load[k];
  }
  return points;
}

}  // namespace

int current_sensors(const Record& record, const DriveConfig& drive) {
  return std::min(record.current_sensors, drive.sensors.current_sensors);
}

FollowedLog followed(const Record& record, const DriveConfig& drive) {
  FollowedLog log;
  undo_sensors(record, drive, log);
  SamplingFacts spoilt;
  for (const auto& effect : drive.model_effects()) effect->describe_sampling(spoilt);
  undo_lags(spoilt, record.T_s, drive.machine.n_p, log);
  const std::vector<OperatingPoint> points = points_of(record, drive, log);
  Effects late;  // voltage delays only: the model itself applies a wrong voltage gain
  ShaftFacts shaft;
  for (const auto& effect : drive.model_effects()) {
    SamplingFacts lag;
    if (acts_on_command(*effect) && effect->describe_sampling(lag)) late.push_back(effect);
    effect->describe_shaft(shaft);
  }
  log.u_alphabeta = record.u_alphabeta;
  const RecordContributions along(late, points, record);
  for (std::size_t k = 0; !late.empty() && k < points.size(); ++k)
    log.u_alphabeta[k] -= points[k].stator_axes(along.of_interval(k));
  if (shaft.J_load > 0)
    log.load_mass = MotorSide(points, load_behind_shaft(drive.model_effects(), points), record.T_s)
                        .load_mass(shaft);
  return log;
}

double slope(const std::vector<double>& x, std::size_t k, double T_s) {
  const auto h =
      static_cast<std::ptrdiff_t>(std::min<std::size_t>({kSlopeRows, k, x.size() - 1 - k}));
  double sum = 0, weight = 0;
  for (std::ptrdiff_t j = 1; j <= h; ++j) {
    const auto row = static_cast<std::ptrdiff_t>(k);
    sum += static_cast<double>(j) *
           (x[static_cast<std::size_t>(row + j)] - x[static_cast<std::size_t>(row - j)]);
    weight += static_cast<double>(2 * j * j);
  }
  return weight > 0 ? sum / (weight * T_s) : 0;
}

}  // namespace twinrate
