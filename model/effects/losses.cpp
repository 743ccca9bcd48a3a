#include "model/effects/losses.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

namespace twinrate {
namespace {

constexpr double kOff = 0.05;  // of all sizes: what an estimate that takes one away may be off

double size_of(const Effect& loss) {
  std::vector<double> coefficients(static_cast<std::size_t>(loss.regressor_count()));
  loss.coefficients(coefficients);
  return coefficients[0];
}

}  // namespace

bool takes_back(const Effect& effect) {
  return effect.is_loss() && size_of(effect) < 0;
}

std::string negative_loss(const Effects& effects, const MachineParameters& machine) {
  struct Sum {
    double in_all = 0, sizes = 0;
    void add(double size) {
      in_all += size;
      sizes += std::abs(size);
    }
  };
  std::map<std::string_view, Sum> sums;
  for (const auto& effect : effects) {
    if (effect->is_loss()) sums[effect->kind()].add(size_of(*effect));
  }
  if (const auto viscous = sums.find("viscous_friction"); viscous != sums.end())
    viscous->second.add(machine.B);
  for (const auto& [kind, sum] : sums)
    if (sum.in_all < -kOff * sum.sizes)
      return fmt::format("{}: {:.4g} in all, 0 or more allowed", kind, sum.in_all);
  return "";
}

}  // namespace twinrate
