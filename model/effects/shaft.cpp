#include "model/effects/shaft.hpp"

#include <vector>

#include "model/effects/motor_side.hpp"

namespace twinrate {

ShaftState shaft_at_rest(const ShaftFacts& shaft, double omega_m, double T_load) {
  const double flank = T_load > 0 ? 0.5 * shaft.gap : T_load < 0 ? -0.5 * shaft.gap : 0.0;
  return {flank + T_load / shaft.stiffness, omega_m};
}

std::vector<double> load_behind_shaft(const Effects& effects,
                                      std::span<const OperatingPoint> record) {
  std::vector<double> behind(record.size());
  for (std::size_t k = 0; k < record.size(); ++k) behind[k] = record[k].T_load;
  for (const auto& effect : effects) {
    if (!effect->behind_shaft()) continue;
    for (std::size_t k = 0; k < record.size(); ++k) behind[k] += effect->at(record[k]).T_load;
  }
  return behind;
}

void along_shaft(const ShaftFacts& shaft, std::span<const OperatingPoint> record,
                 std::span<const double> behind, double T_s, double held,
                 std::span<double> T_load) {
  MotorSide(record, {behind.begin(), behind.end()}, T_s, held).along(shaft, T_load);
}

void along_shaft(const ShaftFacts& shaft, std::span<const OperatingPoint> record, double T_s,
                 std::span<Contribution> sums) {
  std::vector<double> T_load(record.size());
  along_shaft(shaft, record, load_behind_shaft({}, record), T_s, 1, T_load);
  const double J = record.size() < 2 || shaft.J_load <= 0 ? 0 : -shaft.J_load;
  for (std::size_t k = 0; k < sums.size(); ++k) sums[k] = {.T_load = T_load[k], .J = J};
}

}  // namespace twinrate
