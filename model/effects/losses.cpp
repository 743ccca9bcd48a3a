#include "model/effects/losses.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "model/effects/tracing.hpp"
#include "model/machine.hpp"

namespace twinrate {
namespace {

constexpr double kOff = 0.05;  // of all sizes: possible error of an estimate that removes one

double size_of(const Effect& loss) {
  std::vector<double> coefficients(static_cast<std::size_t>(loss.tracing().regressor_count()));
  loss.tracing().coefficients(coefficients);
  return coefficients[0];
}

bool is_loss(const Effect& effect) {
  return effect.tracing().traits().loss != Traits::Loss::kNo;
}

}  // namespace

bool takes_back(const Effect& effect) {
  return is_loss(effect) && size_of(effect) < 0;
}

std::string negative_loss(const Effects& effects, const MachineParameters& machine) {
  struct Sum {
    double in_all = 0, sizes = 0, declared = 0;
    void add(double size) {
      in_all += size;
      sizes += std::abs(size);
    }
  };
  std::map<std::string_view, Sum> sums;
  for (const auto& effect : effects) {
    if (!is_loss(*effect)) continue;
    Sum& sum = sums[effect->kind()];
    sum.add(size_of(*effect));
    if (effect->tracing().traits().loss == Traits::Loss::kBeyondViscosity) sum.declared = machine.B;
  }
  for (auto& [kind, sum] : sums) {
    sum.add(sum.declared);
    if (sum.in_all < -kOff * sum.sizes)
      return fmt::format("{}: {:.4g} in all, 0 or more allowed", kind, sum.in_all);
  }
  return "";
}

}  // namespace twinrate
