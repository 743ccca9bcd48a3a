#include "trace/errors.hpp"

#include <algorithm>
#include <cmath>

#include "trace/statistics.hpp"

namespace twinrate {
namespace {

double rms(const Eigen::VectorXd& x, const Runs& runs, bool held_out) {
  double sum = 0, count = 0;
  for (Eigen::Index n = 0; n < x.size(); ++n)
    if ((runs.held_out[static_cast<std::size_t>(n)] != 0) == held_out) sum += x[n] * x[n], ++count;
  return count > 0 ? std::sqrt(sum / count) : 0;
}

ErrorPair rms_pair(const Eigen::VectorXd& x, const Runs& runs) {
  return {rms(x, runs, false), rms(x, runs, true)};
}

ErrorPair both_axes(const Sampled& y, const Runs& runs) {
  const ErrorPair d = rms_pair(y.d, runs), q = rms_pair(y.q, runs);
  return {std::sqrt(0.5 * (d.train * d.train + q.train * q.train)),
          std::sqrt(0.5 * (d.held_out * d.held_out + q.held_out * q.held_out))};
}

// P-value of a rest that nothing but noise is in: noise is an autoregression of its own, which a
// structure in the angle, the current or time does not fit.
double whiteness(const Eigen::VectorXd& rest, const Runs& runs) {
  constexpr int kOrder = 40, kLags = 60;  // the sampler's edge takes so many
  return whiteness_p_value(Whitener(rest, runs, kOrder)(rest, runs), runs, kLags, kOrder);
}

// What the equation balances: J omega_m', and L di/dt in rotor axes, as the tracer samples them.
double no_change_torque(const Fitter& fitter) {
  const Equations& e = fitter.chain().equations();
  const Record& r = e.record();
  std::vector<double> x(r.size(), 0.0);
  for (std::size_t k = 1; k + 1 < r.size(); ++k)
    x[k] = e.facts().machine.J * (r.theta_m[k + 1] - 2 * r.theta_m[k] + r.theta_m[k - 1]) /
           (r.T_s * r.T_s);
  const Runs& runs = fitter.chain().sampler().torque();
  const Eigen::VectorXd y = fitter.chain().sampler()(x, runs);
  return std::sqrt(y.squaredNorm() / std::max<double>(1, static_cast<double>(y.size())));
}

double no_change_voltage(const Fitter& fitter) {
  const Equations& e = fitter.chain().equations();
  const Record& r = e.record();
  std::vector<double> d(r.size(), 0.0), q(r.size(), 0.0);
  const auto& p = e.points();
  for (std::size_t k = 0; k + 1 < r.size(); ++k) {
    d[k] = e.facts().machine.L_d * (p[k + 1].i_dq[0] - p[k].i_dq[0]) / r.T_s;
    q[k] = e.facts().machine.L_q * (p[k + 1].i_dq[1] - p[k].i_dq[1]) / r.T_s;
  }
  const Sampler& sampler = fitter.chain().sampler();
  const Eigen::VectorXd y_d = sampler(d, sampler.electrical()),
                        y_q = sampler(q, sampler.electrical());
  return std::sqrt(0.5 * (y_d.squaredNorm() + y_q.squaredNorm()) /
                   std::max<double>(1, static_cast<double>(y_d.size())));
}

TraceSeries series(const Fitter& fitter, const Runs& runs, const Eigen::VectorXd& before,
                   const Eigen::VectorXd& after) {
  TraceSeries s;
  const Equations& e = fitter.chain().equations();
  for (std::size_t n = 0; n < runs.row.size(); ++n) {
    const OperatingPoint& p = e.points()[runs.row[n]];
    s.t.push_back(p.t);
    s.theta_m.push_back(p.theta_m);
    s.omega_m.push_back(p.omega_m);
    s.i_d.push_back(p.i_dq[0]);
    s.i_q.push_back(p.i_dq[1]);
    s.before.push_back(before[static_cast<Eigen::Index>(n)]);
    s.after.push_back(after[static_cast<Eigen::Index>(n)]);
    s.held_out.push_back(runs.held_out[n]);
  }
  s.rate_Hz = 1 / (e.record().T_s * fitter.chain().sampler().decimation());
  return s;
}

}  // namespace

void compare_errors(const Fitter& fitter, const Fit& fit, TraceResult& r) {
  const Chain& chain = fitter.chain();
  const Sampler& sampler = chain.sampler();
  const Sampled before = chain.residual({}), after = chain.residual(fit.effects());
  r.horizon_s = chain.equations().record().T_s * sampler.decimation();
  if (before.d.size()) {
    EquationError e{.unit = "V",
                    .before = both_axes(before, sampler.electrical()),
                    .after = both_axes(after, sampler.electrical())};
    e.no_change = no_change_voltage(fitter);
    e.noise_floor = std::hypot(chain.noise().d.rms(), chain.noise().q.rms()) / std::sqrt(2.0);
    e.whiteness_p_value = std::min(1.0, 2 * std::min(whiteness(after.d, sampler.electrical()),
                                                     whiteness(after.q, sampler.electrical())));
    e.rows = static_cast<std::size_t>(before.d.size());
    r.electrical = e;
    r.series_d = series(fitter, sampler.electrical(), before.d, after.d);
    r.series_q = series(fitter, sampler.electrical(), before.q, after.q);
  }
  if (before.torque.size()) {
    EquationError e{.unit = "Nm",
                    .before = rms_pair(before.torque, sampler.torque()),
                    .after = rms_pair(after.torque, sampler.torque())};
    e.no_change = no_change_torque(fitter);
    e.noise_floor = chain.noise().torque.rms();
    e.whiteness_p_value = whiteness(after.torque, sampler.torque());
    e.rows = static_cast<std::size_t>(before.torque.size());
    r.mechanical = e;
    r.series_torque = series(fitter, sampler.torque(), before.torque, after.torque);
  }
  const auto fall = [](const std::optional<EquationError>& e) {
    return e && e->after.train > 0 ? e->before.train / e->after.train : 0;
  };
  // Where what was found acts; of both equations the one whose error fell further.
  const Effects found = fit.effects();
  const bool of_voltage = acting_on(found, ~kOnVoltage).empty(),
             of_torque = acting_on(found, ~kOnTorque).empty();
  const bool electrical = of_voltage != of_torque ? of_voltage && r.electrical
                                                  : fall(r.electrical) > fall(r.mechanical);
  r.main_equation = electrical ? "electrical" : "mechanical";
}

}  // namespace twinrate
