// The unit or convention that explains the scales of a log.
#pragma once
#include <optional>
#include <vector>

#include "trace/result.hpp"
#include "trace/scale_factors.hpp"

namespace twinrate {

// Dependence of the scales on a quantity that is `factor` times the meaning of the drive file.
struct Unit {
  const char* quantity;
  const char* unit;
  double R_s, L, psi_f, K_t_J;  // exponents of the factor; kAny: undetermined
  double factor;
  const char* hint;
};
inline constexpr double kAny = 99;

// Units that users confuse.
std::vector<Unit> units(const MachineParameters& machine, int encoder_counts);
// The unit that fits all scales, and the names of others that fit as well.
std::optional<Inconsistency> fitting_unit(const Record& record, const ScaleFactors& f,
                                          const DriveFacts& facts, int encoder_counts);
// Conventions of the current: every scale that depends on it shows the same factor, and psi_f is as
// declared.
std::vector<Inconsistency> of_current(const Record& record, const ScaleFactors& f,
                                      const DriveFacts& facts, int encoder_counts);

}  // namespace twinrate
