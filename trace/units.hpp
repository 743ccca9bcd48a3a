// The unit or convention that makes the scales of a log what they are.
#pragma once
#include <optional>
#include <vector>

#include "trace/result.hpp"
#include "trace/scale_factors.hpp"

namespace twinrate {

// How a scale follows from a quantity that is `factor` times what the drive file means.
struct Unit {
  const char* quantity;
  const char* unit;
  double R_s, L, psi_f, K_t_J;  // exponents of the factor; kAny: does not say
  double factor;
  const char* hint;
};
inline constexpr double kAny = 99;

// Those that users confuse.
std::vector<Unit> units(const MachineParameters& machine, int encoder_counts);
// The unit that fits all scales, with others that fit as well.
std::optional<Inconsistency> fitting_unit(const Record& record, const ScaleFactors& f,
                                          const DriveFacts& facts, int encoder_counts);
// Every scale that a current moves shows one factor of a convention, and psi_f is as declared.
std::vector<Inconsistency> of_current(const Record& record, const ScaleFactors& f,
                                      const DriveFacts& facts, int encoder_counts);

}  // namespace twinrate
