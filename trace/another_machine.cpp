#include "trace/another_machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/gate.hpp"
#include "trace/keys.hpp"
#include "trace/scale_bounds.hpp"

namespace twinrate {
namespace {

// Share of a machine parameter that an effect leaves, and its bounds for this machine.
struct Left {
  const char* name;
  double share, least, most;
};
std::vector<Left> left_of(const Effect& effect, const MachineParameters& m) {
  const ScaleBounds& most = kThisMachine;
  const double least_left = Criterion{}.least_left;
  struct Key {
    const char *change, *name;
    double whole, least, most;
  };
  const Key keys[] = {{"change_kgm2", "J", m.J, 1 / most.lightest, most.heaviest},
                      {"change_Wb", "psi_f", m.psi_f, 1 / most.psi_f, most.psi_f},
                      {"change_Ohm", "R_s", m.R_s, 1 / most.R_s, most.R_s},
                      {"change_d_H", "L_d", m.L_d, 1 / most.L, most.L},
                      {"change_q_H", "L_q", m.L_q, 1 / most.L, most.L}};
  std::vector<Left> list;
  for (const Key& key : keys)
    if (has_key(effect, key.change) && key.whole > 0)
      list.push_back({key.name, 1 + get_key(effect, key.change) / key.whole,
                      std::max(least_left, key.least), key.most});
  // A shaft lowers the inertia at the motor. If that were zero, noise of the angle would make no
  // torque.
  ShaftFacts shaft;
  if (effect.describe_shaft(shaft) && m.J > 0)
    list.push_back({"J at the motor", 1 - shaft.J_load / m.J, 1 / most.heaviest, 1});
  return list;
}

}  // namespace

std::pair<double, const char*> least_left(const Effect& effect, const MachineParameters& m) {
  std::pair<double, const char*> least{1, ""};
  for (const Left& left : left_of(effect, m))
    if (left.share < least.first) least = {left.share, left.name};
  return least;
}

std::string another_machine(const Effect& effect, const DriveFacts& facts, double& share) {
  for (const Left& left : left_of(effect, facts.machine)) {
    share = left.share;
    if (share < left.least || share > left.most)
      return fmt::format("it leaves {:.2g} of {}: check units, scale and K_t", share, left.name);
  }
  share = 0;
  ShaftFacts shaft;
  if (effect.describe_shaft(shaft) && shaft.damping > 2 * std::sqrt(shaft.stiffness * shaft.J_load))
    return "it is damped beyond the critical damping: no resonance of a shaft is shown";
  return plausible(effect, facts) ? "" : "it is larger than a running drive can lack";
}

}  // namespace twinrate
