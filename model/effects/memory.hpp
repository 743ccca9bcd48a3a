// Effects with a state along a record: a shaft, a lag. Their at() is zero.
#pragma once
#include <span>

#include "model/operating_point.hpp"

namespace twinrate {

class Effect;

class EffectMemory {
 public:
  virtual ~EffectMemory() = default;
  // The contribution at every point of a record, T_s apart. `sums` has the record's size.
  virtual void along(std::span<const OperatingPoint> record, double T_s,
                     std::span<Contribution> sums) const = 0;
};

// The same of any effect: by its memory, or at() of each point.
void contributions(const Effect& effect, std::span<const OperatingPoint> record, double T_s,
                   std::span<Contribution> sums);

}  // namespace twinrate
