#include "trace/equations.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/losses.hpp"
#include "trace/keys.hpp"
#include "trace/record_contributions.hpp"
#include "trace/row_point.hpp"
#include "trace/signals.hpp"

namespace twinrate {
namespace {

constexpr int kSensing = kOnCurrents | kOnAngle;
constexpr double kProbe = 1e-5;  // share of a unit coefficient at which sensing is linearised

// A vector in the frame whose d axis has the unit vector `axis`, and back.
Vec2 into(const Vec2& axis, const Vec2& x) {
  return {axis[0] * x[0] + axis[1] * x[1], axis[0] * x[1] - axis[1] * x[0]};
}
Vec2 out_of(const Vec2& axis, const Vec2& x) {
  return {axis[0] * x[0] - axis[1] * x[1], axis[1] * x[0] + axis[0] * x[1]};
}

void add(Channels& x, std::size_t row, const Vec2& dq) {
  x.d[row] += dq[0];
  x.q[row] += dq[1];
}

// Difference between the mean of a cubic and the mean of both ends, or a torque at a row.
constexpr double kOfEnds = -1.0 / 12, kOfRow = 1.0 / 12;

// cos and sin; of a small angle by their series, exact to the last bit but one.
Vec2 direction(double angle) {
  constexpr double kSmall = 0.3;
  if (std::abs(angle) > kSmall) return {std::cos(angle), std::sin(angle)};
  const double x = angle * angle;
  const auto series = [x](double a, double b, double c, double d, double e, double f) {
    return 1 - x / a * (1 - x / b * (1 - x / c * (1 - x / d * (1 - x / e * (1 - x / f)))));
  };
  return {series(1. * 2, 3. * 4, 5. * 6, 7. * 8, 9. * 10, 11. * 12),
          angle * series(2. * 3, 4. * 5, 6. * 7, 8. * 9, 10. * 11, 12. * 13)};
}

// The regressors of an effect on the voltage, means over the path. `part` has the size of `columns`.
void regressors_along(const EffectTracing& tracing, const CurrentPath& path,
                      std::span<Contribution> columns, std::span<Contribution> part) {
  if (path.parts() == 1) return tracing.regressors(path.part(0), columns);
  for (Contribution& column : columns) column = {};
  for (int j = 0; j < path.parts(); ++j) {
    const OperatingPoint point = path.part(j);
    tracing.regressors(point, part);
    for (std::size_t r = 0; r < columns.size(); ++r)
      columns[r].u_dq_drop += path.share(point, part[r].u_dq_drop);
  }
}

// Unit vector halfway between two close unit vectors: 1/|a + b| by its series.
Vec2 between(const Vec2& a, const Vec2& b) {
  constexpr double kFar = 0.01;
  const Vec2 sum = a + b;
  const double off = 1 - sum.squaredNorm() / 4;  // the sine of half their angle, squared
  if (off > kFar) return sum.normalized();
  return sum *
         (0.5 +
          off * (1. / 4 + off * (3. / 16 +
                                 off * (5. / 32 + off * (35. / 256 +
                                                         off * (63. / 512 + off * 231. / 2048))))));
}

}  // namespace

Equations::Equations(const Record& record, const DriveFacts& facts, Effects known,
                     Considered considered)
    : record_(record), facts_(facts), known_(std::move(known)), considered_(std::move(considered)) {
  const double T_row = record.T_s / record.rows_each;  // of the log
  T_held_ = facts.T_s > 0 ? std::min(facts.T_s, T_row) : T_row;
  bent_ = 1 - std::pow(T_held_ / record.T_s, 2);
  load_held_ = record.load_measured ? 0 : T_held_ / record.T_s;
  measured_ = {
      .i_alphabeta = record.i_alphabeta, .i_dq = {}, .theta_m = record.theta_m, .axes = {}};
  turn_angle(measured_);
  turn_currents(measured_);
  omega_m_ = smooth_rate(record.theta_m, record.T_s, record.rows_each);
  points_.resize(record.size());
  const std::vector<Vec2> i_dq = smoothed(measured_.i_dq, record.rows_each);
  for (std::size_t k = 0; k < points_.size(); ++k) {
    RotorFrame frame = frame_at(record.theta_m[k], omega_m_[k], facts.machine.n_p);
    frame.d_axis = measured_.axes->at[k];
    OperatingPoint& p = points_[k] = point_of(record, k, frame, facts.v_dc);
    if (!i_dq.empty()) p.i_dq = i_dq[k];
    if (!record.T_load.empty())  // at the middle of its hold time
      p.T_load =
          record.T_load[k] -
          0.5 * load_held_ * (record.T_load[k] - record.T_load[k - std::min<std::size_t>(k, 1)]);
  }
  ripple_ = ripple_share(i_dq);
  base_ = known_.empty() ? assemble(measured_, {}, points_) : residual_of(known_);
}

void Equations::turn_angle(Signals& s) const {
  const auto axes = std::make_shared<Axes>();
  const std::size_t n = s.theta_m.size();
  axes->at.resize(n);
  for (std::size_t k = 0; k < n; ++k)
    axes->at[k] =
        measured_.axes
            ? out_of(measured_.axes->at[k],
                     direction(facts_.machine.n_p * (s.theta_m[k] - measured_.theta_m[k])))
            : direction(facts_.machine.n_p * s.theta_m[k]);
  axes->mid.resize(n, Vec2::Zero());
  for (std::size_t k = 1; k < n; ++k) axes->mid[k] = between(axes->at[k - 1], axes->at[k]);
  s.axes = axes;
}

void Equations::turn_currents(Signals& s) const {
  s.i_dq.resize(s.i_alphabeta.size());
  for (std::size_t k = 0; k < s.i_dq.size(); ++k) s.i_dq[k] = into(s.axes->at[k], s.i_alphabeta[k]);
}

void Equations::move_points(const Signals& s, bool angle_moved,
                            std::vector<OperatingPoint>& points) const {
  if (angle_moved) {
    const std::vector<double> omega_m = smooth_rate(s.theta_m, record_.T_s, record_.rows_each);
    for (std::size_t k = 0; k < points.size(); ++k) {
      OperatingPoint& p = points[k];
      p.theta_m = s.theta_m[k];
      p.theta_e = facts_.machine.n_p * p.theta_m;
      p.d_axis = s.axes->at[k];
      p.omega_m = omega_m[k];
      if (!record_.u_alphabeta.empty()) p.u_dq = p.rotor_axes(record_.u_alphabeta[k]);
    }
  }
  const std::vector<Vec2> i_dq = smoothed(s.i_dq, record_.rows_each);
  for (std::size_t k = 0; k < i_dq.size(); ++k) points[k].i_dq = i_dq[k];
}

Equations::Signals Equations::undo_sensing(const Effects& effects,
                                           const std::vector<OperatingPoint>& points) const {
  Signals s{.i_alphabeta = measured_.i_alphabeta,
            .i_dq = {},
            .theta_m = measured_.theta_m,
            .axes = measured_.axes};
  int moved = 0;
  SamplingFacts late;
  Effects adding;
  for (const auto& effect : effects) {
    moved |= effect->acts_on() & kSensing;
    if (!effect->describe_sampling(late)) adding.push_back(effect);
  }
  const auto undo = [&](auto& signal, SamplingFacts::Signal which) {
    if (late.delay[which] > 0 || late.lowpass[which] > 0)
      signal = ahead(signal, late.delay[which], late.lowpass[which], record_.T_s);
  };
  undo(s.i_alphabeta, SamplingFacts::kCurrent);
  undo(s.theta_m, SamplingFacts::kAngle);
  const RecordContributions added(adding, points, record_);
  const bool currents = moved & kOnCurrents && !s.i_alphabeta.empty();
  for (std::size_t k = 0; !adding.empty() && k < points.size(); ++k) {
    const Contribution c = added[k];
    s.theta_m[k] -= c.theta_m;
    if (!currents) continue;
    Vec3 i_abc = c.i_abc;
    if (record_.current_sensors == 2) i_abc[2] = -(i_abc[0] + i_abc[1]);
    s.i_alphabeta[k] -= clarke(i_abc);
  }
  if (moved & kOnAngle) turn_angle(s);
  turn_currents(s);
  return s;
}

double Equations::omega_rate(const Signals& s, std::size_t k) const {
  return (s.theta_m[k + 1] - 2 * s.theta_m[k] + s.theta_m[k - 1]) / (record_.T_s * record_.T_s);
}

// Mean in rotor axes of a current whose samples are i_dq in these axes.
Vec2 Equations::mean_of_tick(const Vec2& i_dq, double omega_m) const {
  if (record_.i_alphabeta.empty()) return i_dq;
  const MachineParameters& m = facts_.machine;
  const double omega_e = m.n_p * omega_m, turned = std::pow(omega_e * T_held_, 2) / 12,
               decayed = m.R_s * omega_e * T_held_ * T_held_ / 12;
  return (1 - turned) * i_dq - Vec2(turned * m.psi_f / m.L_d, 0) +
         decayed * Vec2(-i_dq[1] / m.L_d, i_dq[0] / m.L_q);
}

// By Wiener: the share of ripple in the power that smoothing takes away, of which the sensors' noise is
// the remainder.
Vec2 Equations::ripple_share(const std::vector<Vec2>& i_smoothed) const {
  Vec2 share = Vec2::Zero();
  for (Eigen::Index axis = 0; axis < 2 && !i_smoothed.empty(); ++axis) {
    const std::vector<Vec2>& i = measured_.i_dq;
    const double sigma = white_noise(
        i.size(), [&](std::size_t k) { return i[k][axis]; }, record_.electrical_ok);
    double power = 0, rows = 0;
    for (std::size_t k = 0; k < i.size(); ++k)
      if (record_.electrical_ok[k]) power += std::pow(i[k][axis] - i_smoothed[k][axis], 2), ++rows;
    const double noise = rows * (1 - own_share(record_.rows_each)) * sigma * sigma;
    if (power > noise) share[axis] = 1 - noise / power;
  }
  return share;
}

std::vector<Vec2> Equations::path_currents(const Signals& s,
                                           const std::vector<OperatingPoint>& points) const {
  std::vector<Vec2> i(s.i_dq.size());
  for (std::size_t k = 0; k < i.size(); ++k)
    i[k] = mean_of_tick(points[k].i_dq + ripple_.cwiseProduct(s.i_dq[k] - points[k].i_dq),
                        points[k].omega_m);
  return i;
}

Channels Equations::assemble(const Signals& s, const Effects& effects,
                             const std::vector<OperatingPoint>& points) const {
  const MachineParameters& m = facts_.machine;
  const std::size_t n = record_.size();
  const double T_s = record_.T_s;
  const std::vector<Vec2> i_path =
      std::any_of(effects.begin(), effects.end(),
                  [](const auto& effect) { return follows_current(*effect); })
          ? path_currents(s, points)
          : std::vector<Vec2>();
  const RecordContributions added(effects, points, record_, i_path);
  Channels e = empty(kOnTorque | kOnVoltage);
  const double bow = T_held_ * T_held_ * m.psi_f / (12 * m.L_d);
  const auto decay = [&](double L) { return std::pow(m.R_s * T_held_, 2) / (12 * L); };
  const double L_d = m.L_d + decay(m.L_d), L_q = m.L_q + decay(m.L_q);
  Vec2 psi_before = Vec2::Zero(), drop_before = Vec2::Zero(), bent_before = Vec2::Zero();
  Vec2 not_acting = Vec2::Zero();
  Bend<Vec2> means{Vec2::Zero()};
  Bend<double> torques{0};
  const double bends_of_load = (1 - load_held_) * (1 - 2 * load_held_);
  for (std::size_t k = 0; k < n; ++k) {
    const Contribution c = effects.empty() ? Contribution{} : added[k];
    const Vec2 i_dq = s.i_dq.empty() ? Vec2(0, 0) : s.i_dq[k];
    if (has_voltage()) {
      const Vec2& axis = s.axes->at[k];
      const Vec2 psi = out_of(axis, Vec2(m.psi_f + L_d * i_dq[0], L_q * i_dq[1]) + c.psi_dq);
      const double omega_e = m.n_p * points[k].omega_m;
      const Vec2 drop = m.R_s * s.i_alphabeta[k] +
                        out_of(axis, c.u_dq_drop - Vec2(m.R_s * bow * omega_e * omega_e, 0));
      const Vec2 bent = bent_ * drop + (1 - bent_) * out_of(axis, added.drop_by_angle(k));
      if (k > 0) {
        const Vec2 left = record_.u_alphabeta[k - 1] - not_acting - 0.5 * (drop_before + drop) -
                          (psi - psi_before) / T_s;
        add(e, k - 1, into(s.axes->mid[k], left));
        const Vec2 bend = means.pass(0.5 * (bent_before + bent));
        if (k > 2) add(e, k - 2, into(s.axes->mid[k - 1], -kOfEnds * bend));
      }
      psi_before = psi;
      drop_before = drop;
      bent_before = bent;
      if (added.any_of_interval()) not_acting = out_of(axis, added.of_interval(k));
    }
    const Vec2 i = mean_of_tick(i_dq, points[k].omega_m);
    const double inner =
        m.torque(i[0], i[1]) + 1.5 * m.n_p * (c.psi_dq[0] * i[1] - c.psi_dq[1] * i[0]) - c.T_load;
    const double torque = inner - points[k].T_load;
    const double bend = torques.pass(inner - bends_of_load * points[k].T_load);
    if (k > 1) e.torque[k - 1] += kOfRow * bend;
    if (k == 0 || k + 1 == n) continue;
    const double omega_m = (s.theta_m[k + 1] - s.theta_m[k - 1]) / (2 * T_s);
    e.torque[k] += torque - m.B * omega_m - (m.J + c.J) * omega_rate(s, k);
  }
  return e;
}

Channels Equations::residual(const Effects& effects, Undone undone) const {
  if (effects.empty()) return base_;
  Effects all = known_;
  all.insert(all.end(), effects.begin(), effects.end());
  return residual_of(all, undone);
}

Channels Equations::residual_of(const Effects& effects, Undone undone) const {
  const Effects sensing = acting_on(effects, kSensing);
  const Effects others = acting_on(effects, kOnTorque | kOnVoltage | kOnFlux);
  if (sensing.empty()) return assemble(measured_, others, points_);
  std::vector<std::pair<std::string_view, std::vector<double>>> errors;
  for (const auto& effect : sensing) errors.emplace_back(effect->kind(), key_values(*effect));
  std::shared_ptr<const UndoneSensing> there;
  {
    const std::lock_guard lock(undone_mutex_);
    if (undone_ && undone_->errors == errors) there = undone_;
  }
  if (!there) {
    auto made = std::make_shared<UndoneSensing>(true_signals(sensing));
    made->errors = std::move(errors);
    there = std::move(made);
    if (undone == Undone::kKept) {
      const std::lock_guard lock(undone_mutex_);
      undone_ = there;
    }
  }
  return assemble(there->signals, others, there->points);
}

Equations::UndoneSensing Equations::true_signals(const Effects& sensing) const {
  // A sensor's error depends on the true signal, not on the reading.
  const bool angle = !acting_on(sensing, kOnAngle).empty();
  UndoneSensing there{.errors = {}, .signals = {}, .points = points_};
  there.signals = undo_sensing(sensing, points_);
  move_points(there.signals, angle, there.points);
  SamplingFacts late;
  if (std::all_of(sensing.begin(), sensing.end(),
                  [&](const auto& effect) { return effect->describe_sampling(late); }))
    return there;
  there.signals = undo_sensing(sensing, there.points);
  move_points(there.signals, angle, there.points);
  return there;
}

Record Equations::without_errors(const Effects& effects) const {
  Record record = record_;
  const Effects sensing = acting_on(effects, kSensing);
  if (sensing.empty()) return record;
  Signals undone = true_signals(sensing).signals;
  record.i_alphabeta = std::move(undone.i_alphabeta);
  record.theta_m = std::move(undone.theta_m);
  return record;
}

bool Equations::needs_missing_i_d(const Effect& effect) const {
  if (!record_.i_q_alone) return false;
  if (effect.acts_on() & kOnFlux) {
    const auto ratio =
        kinds_read(*make_of(Traits::Family::kInertia), Traits::Reading::kWithoutVoltage);
    return std::find(ratio.begin(), ratio.end(), effect.kind()) == ratio.end();
  }
  const bool turns_axes = is_of(effect, Traits::Family::kLag) ||
                          (effect.acts_on() & kOnAngle && has_key(effect, "offset_rad"));
  return turns_axes && facts_.machine.L_d != facts_.machine.L_q;
}

bool Equations::possible(const Effect& effect) const {
  Effects all = known_;
  all.push_back(effect.clone());
  return considered_(effect.kind()) && !needs_missing_i_d(effect) && within_ranges(effect) &&
         effect.clone()->prepare(facts_).empty() && negative_loss(all, facts_.machine).empty();
}

Channels Equations::empty(int acts_on) const {
  Channels x;
  if (acts_on & (kOnTorque | kOnFlux)) x.torque.assign(record_.size(), 0.0);
  if (has_voltage() && acts_on & (kOnVoltage | kOnFlux)) {
    x.d.assign(record_.size(), 0.0);
    x.q.assign(record_.size(), 0.0);
  }
  return x;
}

Equations::Mean Equations::mean_of(const Effect& effect) const {
  const bool of_interval = acts_on_command(effect) || follows_current(effect);
  return {of_interval, of_interval ? 0 : effect.drops_by_angle() ? 1 : bent_};
}

inline void Equations::explain(std::size_t k, const Contribution& c, Mean how, Channels& x,
                               Before& before) const {
  const double T_s = record_.T_s;
  const Signals& s = measured_;
  if (!x.d.empty()) {
    const Vec2& axis = s.axes->at[k];
    const bool flux = !x.torque.empty();  // an effect without torque has none
    const Vec2 psi = flux ? out_of(axis, c.psi_dq) : Vec2(0, 0), drop = out_of(axis, c.u_dq_drop);
    if (k > 0) {
      const Vec2 mean = how.of_interval ? before.drop : Vec2(0.5 * (drop + before.drop));
      const Vec2 bend = how.bent * before.mean.pass(mean);
      add(x, k - 1, into(s.axes->mid[k], flux ? Vec2(mean + (psi - before.psi) / T_s) : mean));
      if (k > 2) add(x, k - 2, into(s.axes->mid[k - 1], kOfEnds * bend));
    }
    before.psi = psi;
    before.drop = drop;
  }
  if (x.torque.empty()) return;
  const Vec2& i_dq = points_[k].i_dq;
  const double torque =
      c.T_load - 1.5 * facts_.machine.n_p * (c.psi_dq[0] * i_dq[1] - c.psi_dq[1] * i_dq[0]);
  const double bend = before.torque.pass(torque);
  if (k > 1) x.torque[k - 1] += kOfRow * bend;
  if (k == 0 || k + 1 == points_.size()) return;
  x.torque[k] += torque + (c.J != 0 ? c.J * omega_rate(s, k) : 0.0);
}

std::vector<Channels> Equations::columns(const Effect& effect) const {
  const EffectTracing& tracing = effect.tracing();
  const auto count = static_cast<std::size_t>(tracing.regressor_count());
  std::vector<Channels> x(count);
  if (effect.acts_on() & kSensing) {
    for (std::size_t r = 0; r < count; ++r) {
      const std::shared_ptr<Effect> probe = effect.clone();
      std::vector<double> coefficients(count, 0.0);
      coefficients[r] = kProbe;
      probe->tracing().set_coefficients(coefficients);
      x[r] = contribution(*probe);
      for (std::vector<double>* v : {&x[r].d, &x[r].q, &x[r].torque})
        for (double& value : *v) value /= kProbe;
    }
    return x;
  }
  for (Channels& one : x) one = empty(effect.acts_on());
  std::vector<Contribution> all(count), part(count);
  std::vector<Before> before(count);
  const Mean how = mean_of(effect);
  const bool path = follows_current(effect) && !measured_.i_dq.empty();
  const std::vector<Vec2> i = path ? path_currents(measured_, points_) : std::vector<Vec2>();
  for (std::size_t k = 0; k < points_.size(); ++k) {
    if (!path || k + 1 == points_.size())
      tracing.regressors(points_[k], all);
    else
      regressors_along(tracing,
                       CurrentPath(points_[k], points_[k + 1], i[k], i[k + 1], record_.ticks_each),
                       all, part);
    for (std::size_t r = 0; r < count; ++r) explain(k, all[r], how, x[r], before[r]);
  }
  return x;
}

std::vector<std::vector<double>> Equations::load_columns(const Effect& effect, std::size_t first,
                                                         std::size_t stride) const {
  const EffectTracing& tracing = effect.tracing();
  const auto count = static_cast<std::size_t>(tracing.regressor_count());
  std::vector<std::vector<double>> x(count);
  for (std::vector<double>& one : x) one.reserve(points_.size() / stride + 1);
  std::vector<Contribution> all(count);
  for (std::size_t k = first; k < points_.size(); k += stride) {
    tracing.regressors(points_[k], all);
    for (std::size_t r = 0; r < count; ++r) x[r].push_back(all[r].T_load);
  }
  const double of_row = kOfRow / static_cast<double>(stride * stride);
  for (std::vector<double>& one : x) {
    Bend<double> torques{0};
    for (std::size_t n = 0; n < one.size(); ++n) {
      const double bend = torques.pass(one[n]);
      if (n > 1) one[n - 1] += of_row * bend;
    }
  }
  return x;
}

Channels Equations::contribution(const Effect& effect) const {
  if (!(effect.acts_on() & kSensing)) {
    Channels x = empty(effect.acts_on());
    if (ShaftFacts shaft; effect.describe_shaft(shaft)) {
      {
        const std::lock_guard lock(motor_mutex_);
        if (!motor_) motor_.emplace(points_, load_behind_shaft({}, points_), record_.T_s, 0);
      }
      motor_->along(shaft, x.torque);
      Bend<double> torques{0};
      for (std::size_t k = 0; k < points_.size(); ++k) {
        const double bend = torques.pass(x.torque[k]);
        if (k > 1) x.torque[k - 1] += kOfRow * bend;
        if (k > 0 && k + 1 < points_.size() && shaft.J_load > 0)
          x.torque[k] -= shaft.J_load * omega_rate(measured_, k);
      }
      x.torque.front() = x.torque.back() = 0;
      return x;
    }
    const Effects alone{effect.clone()};  // RecordContributions keeps a reference to it
    const std::vector<Vec2> i_path =
        follows_current(effect) ? path_currents(measured_, points_) : std::vector<Vec2>();
    const RecordContributions added(alone, points_, record_, i_path);
    const Mean how = mean_of(effect);
    Before before;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      Contribution c = added[k];
      if (how.of_interval) c.u_dq_drop = added.of_interval(k);
      explain(k, c, how, x, before);
    }
    return x;
  }
  // The sensor's error acts on all equations: the contribution is the change of the residual.
  const bool alone = known_.empty() && !(effect.acts_on() & ~kSensing);
  Channels x = alone ? assemble(undo_sensing({effect.clone()}, points_), {}, points_)
                     : residual({effect.clone()});
  for (std::size_t k = 0; k < record_.size(); ++k) {
    if (!x.d.empty()) {
      x.d[k] = base_.d[k] - x.d[k];
      x.q[k] = base_.q[k] - x.q[k];
    }
    x.torque[k] = base_.torque[k] - x.torque[k];
  }
  return x;
}

}  // namespace twinrate
