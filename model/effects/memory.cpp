#include "model/effects/memory.hpp"

#include "model/effects/effect.hpp"

namespace twinrate {

void contributions(const Effect& effect, std::span<const OperatingPoint> record, double T_s,
                   std::span<Contribution> sums) {
  if (const EffectMemory* memory = effect.memory()) return memory->along(record, T_s, sums);
  for (std::size_t k = 0; k < record.size(); ++k) sums[k] = effect.at(record[k]);
}

}  // namespace twinrate
