#include "trace/no_change.hpp"

namespace twinrate {

Sampled no_change(const Chain& chain) {
  const Equations& e = chain.equations();
  const Record& r = e.record();
  const Sampler& sampler = chain.sampler();
  const MachineParameters& m = e.facts().machine;
  std::vector<double> torque(r.size(), 0.0);
  for (std::size_t k = 1; k + 1 < r.size(); ++k)
    torque[k] = m.J * (r.theta_m[k + 1] - 2 * r.theta_m[k] + r.theta_m[k - 1]) / (r.T_s * r.T_s);
  Sampled s;
  s.torque = sampler(torque, sampler.torque());
  if (!e.has_voltage()) return s;
  std::vector<double> d(r.size(), 0.0), q(r.size(), 0.0);
  const std::vector<OperatingPoint>& p = e.points();
  for (std::size_t k = 0; k + 1 < r.size(); ++k) {
    d[k] = m.L_d * (p[k + 1].i_dq[0] - p[k].i_dq[0]) / r.T_s;
    q[k] = m.L_q * (p[k + 1].i_dq[1] - p[k].i_dq[1]) / r.T_s;
  }
  s.d = sampler(d, sampler.electrical());
  s.q = sampler(q, sampler.electrical());
  return s;
}

}  // namespace twinrate
