#include "trace/equations.hpp"

#include <algorithm>

namespace twinrate {
namespace {

constexpr int kSmooth = 10;  // half-width of the speed's slope fit, rows
constexpr int kSensing = kOnCurrents | kOnAngle | kOnBus;
constexpr double kProbe = 1e-3;  // share of a unit coefficient at which sensing is linearised

}  // namespace

Equations::Equations(const Record& record, const DriveFacts& facts, Effects known)
    : record_(record), facts_(facts), known_(std::move(known)) {
  const Signals measured{record.i_alphabeta, record.theta_m};
  points_ = points_of(measured);
  omega_m_ = speed(record.theta_m);
  for (const OperatingPoint& p : points_) {
    cos_.push_back(std::cos(p.theta_e));
    sin_.push_back(std::sin(p.theta_e));
  }
  base_ = known_.empty() ? assemble(measured, points_, nullptr) : residual_of(known_);
}

std::vector<double> Equations::speed(const std::vector<double>& theta_m) const {
  const auto n = static_cast<std::ptrdiff_t>(theta_m.size());
  std::vector<double> omega_m(theta_m.size(), 0.0);
  const auto slope = [&](std::ptrdiff_t k, std::ptrdiff_t h) {
    double sum = 0, weight = 0;
    for (std::ptrdiff_t j = 1; j <= h; ++j) {
      sum += static_cast<double>(j) * (theta_m[k + j] - theta_m[k - j]);
      weight += static_cast<double>(2 * j * j);
    }
    return weight > 0 ? sum / (weight * record_.T_s) : 0;
  };
  for (std::ptrdiff_t k = 0; k < n; ++k)
    omega_m[k] = slope(k, std::min<std::ptrdiff_t>({kSmooth, k, n - 1 - k}));
  return omega_m;
}

std::vector<OperatingPoint> Equations::points_of(const Signals& s) const {
  const std::vector<double> omega_m = speed(s.theta_m);
  std::vector<OperatingPoint> points(record_.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    OperatingPoint& p = points[k];
    p.t = record_.t[k];
    p.theta_m = s.theta_m[k];
    p.theta_e = facts_.machine.n_p * p.theta_m;
    p.omega_m = omega_m[k];
    if (!s.i_alphabeta.empty()) p.i_dq = park(s.i_alphabeta[k], p.theta_e);
    if (!record_.u_alphabeta.empty()) p.u_dq = park(record_.u_alphabeta[k], p.theta_e);
    p.v_dc = record_.v_dc.empty() ? facts_.v_dc : record_.v_dc[k];
    if (!record_.T_load.empty()) p.T_load = record_.T_load[k];
  }
  return points;
}

Equations::Signals Equations::undo_sensing(const Effects& effects) const {
  Signals s{record_.i_alphabeta, record_.theta_m};
  const Effects sensing = acting_on(effects, kOnCurrents | kOnAngle);
  if (sensing.empty()) return s;
  std::vector<Contribution> of_one(record_.size());
  for (int round = 0; round < 2; ++round) {
    const std::vector<OperatingPoint> points = round == 0 ? points_ : points_of(s);
    s = {record_.i_alphabeta, record_.theta_m};
    for (const auto& effect : sensing) {
      effect->along(points, record_.T_s, of_one);
      for (std::size_t k = 0; k < of_one.size(); ++k) {
        s.theta_m[k] -= of_one[k].theta_m;
        if (s.i_alphabeta.empty()) continue;
        Vec3 i_abc = of_one[k].i_abc;
        if (record_.current_sensors == 2) i_abc[2] = -(i_abc[0] + i_abc[1]);
        s.i_alphabeta[k] -= clarke(i_abc);
      }
    }
  }
  return s;
}

Channels Equations::assemble(const Signals& s, const std::vector<OperatingPoint>& points,
                             const std::vector<Contribution>* sums) const {
  const MachineParameters& m = facts_.machine;
  const std::size_t n = record_.size();
  const double T_s = record_.T_s;
  Channels e;
  e.torque.assign(n, 0.0);
  if (has_voltage()) {
    e.d.assign(n, 0.0);
    e.q.assign(n, 0.0);
    std::vector<Vec2> psi(n), drop(n);
    for (std::size_t k = 0; k < n; ++k) {
      const OperatingPoint& p = points[k];
      const double c = std::cos(p.theta_e), sn = std::sin(p.theta_e);
      Vec2 psi_dq(m.psi_f + m.L_d * p.i_dq[0], m.L_q * p.i_dq[1]);
      Vec2 drop_ab = m.R_s * s.i_alphabeta[k];
      if (sums) {
        psi_dq += (*sums)[k].psi_dq;
        const Vec2& x = (*sums)[k].u_dq_drop;
        drop_ab += Vec2(c * x[0] - sn * x[1], sn * x[0] + c * x[1]);
      }
      psi[k] = {c * psi_dq[0] - sn * psi_dq[1], sn * psi_dq[0] + c * psi_dq[1]};
      drop[k] = drop_ab;
    }
    for (std::size_t k = 0; k + 1 < n; ++k) {
      Vec2 u = record_.u_alphabeta[k];
      const Vec2 left = u - 0.5 * (drop[k] + drop[k + 1]) - (psi[k + 1] - psi[k]) / T_s;
      const Vec2 left_dq = park(left, 0.5 * (points[k].theta_e + points[k + 1].theta_e));
      e.d[k] = left_dq[0];
      e.q[k] = left_dq[1];
    }
  }
  for (std::size_t k = 1; k + 1 < n; ++k) {
    const OperatingPoint& p = points[k];
    const double omega_rate =
        (s.theta_m[k + 1] - 2 * s.theta_m[k] + s.theta_m[k - 1]) / (T_s * T_s);
    const double omega_m = (s.theta_m[k + 1] - s.theta_m[k - 1]) / (2 * T_s);
    double J = m.J;
    double left = m.torque(p.i_dq[0], p.i_dq[1]) - p.T_load - m.B * omega_m;
    if (sums) {
      const Contribution& c = (*sums)[k];
      left += 1.5 * m.n_p * (c.psi_dq[0] * p.i_dq[1] - c.psi_dq[1] * p.i_dq[0]) - c.T_load;
      J += c.J;
    }
    e.torque[k] = left - J * omega_rate;
  }
  return e;
}

Channels Equations::residual(const Effects& effects) const {
  if (effects.empty()) return base_;
  Effects all = known_;
  all.insert(all.end(), effects.begin(), effects.end());
  return residual_of(all);
}

Channels Equations::residual_of(const Effects& effects) const {
  const Signals s = undo_sensing(effects);
  const bool sensing = !acting_on(effects, kOnCurrents | kOnAngle).empty();
  const std::vector<OperatingPoint> own = sensing ? points_of(s) : std::vector<OperatingPoint>();
  const std::vector<OperatingPoint>& points = sensing ? own : points_;
  std::vector<Contribution> sums(record_.size()), of_one(record_.size());
  for (const auto& effect : effects) {
    if (!(effect->acts_on() & (kOnTorque | kOnVoltage | kOnFlux))) continue;
    effect->along(points, record_.T_s, of_one);
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += of_one[k];
  }
  return assemble(s, points, &sums);
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

void Equations::explain(std::size_t k, const Contribution& c, Channels& x, Vec2& psi_before,
                        Vec2& drop_before) const {
  const double T_s = record_.T_s;
  if (!x.d.empty()) {
    const auto turn = [&](const Vec2& v) {
      return Vec2(cos_[k] * v[0] - sin_[k] * v[1], sin_[k] * v[0] + cos_[k] * v[1]);
    };
    const Vec2 psi = turn(c.psi_dq), drop = turn(c.u_dq_drop);
    if (k > 0) {
      const Vec2 e = 0.5 * (drop + drop_before) + (psi - psi_before) / T_s;
      // Half-way between the two angles.
      const Vec2 mid(cos_[k - 1] + cos_[k], sin_[k - 1] + sin_[k]);
      const double scale = 1 / mid.norm();
      x.d[k - 1] = scale * (mid[0] * e[0] + mid[1] * e[1]);
      x.q[k - 1] = scale * (-mid[1] * e[0] + mid[0] * e[1]);
    }
    psi_before = psi;
    drop_before = drop;
  }
  if (x.torque.empty() || k == 0 || k + 1 >= points_.size()) return;
  const OperatingPoint& p = points_[k];
  x.torque[k] =
      c.T_load - 1.5 * facts_.machine.n_p * (c.psi_dq[0] * p.i_dq[1] - c.psi_dq[1] * p.i_dq[0]);
  if (c.J != 0)
    x.torque[k] +=
        c.J * (points_[k + 1].theta_m - 2 * p.theta_m + points_[k - 1].theta_m) / (T_s * T_s);
}

std::vector<Channels> Equations::columns(const Effect& effect) const {
  const auto count = static_cast<std::size_t>(effect.regressor_count());
  std::vector<Channels> x(count);
  if (effect.acts_on() & kSensing) {
    for (std::size_t r = 0; r < count; ++r) {
      const std::shared_ptr<Effect> probe = effect.clone();
      std::vector<double> coefficients(count, 0.0);
      coefficients[r] = kProbe;
      probe->set_coefficients(coefficients);
      x[r] = contribution(*probe);
      for (std::vector<double>* v : {&x[r].d, &x[r].q, &x[r].torque})
        for (double& value : *v) value /= kProbe;
    }
    return x;
  }
  for (Channels& one : x) one = empty(effect.acts_on());
  std::vector<Contribution> all(count);
  std::vector<Vec2> psi(count, Vec2::Zero()), drop(count, Vec2::Zero());
  for (std::size_t k = 0; k < record_.size(); ++k) {
    effect.regressors(points_[k], all);
    for (std::size_t r = 0; r < count; ++r) explain(k, all[r], x[r], psi[r], drop[r]);
  }
  return x;
}

Channels Equations::contribution(const Effect& effect) const {
  if (!(effect.acts_on() & kSensing)) {
    std::vector<Contribution> of_one(record_.size());
    effect.along(points_, record_.T_s, of_one);
    Channels x = empty(effect.acts_on());
    Vec2 psi = Vec2::Zero(), drop = Vec2::Zero();
    for (std::size_t k = 0; k < record_.size(); ++k) explain(k, of_one[k], x, psi, drop);
    return x;
  }
  // The sensor's error goes through all equations: what the residual changes by.
  Channels x = residual({effect.clone()});
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
