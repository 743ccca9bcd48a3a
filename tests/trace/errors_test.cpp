// The quoted error is that of the equation on which the effects act.
#include "trace/errors.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"

namespace twinrate::errors_test {

std::string main_equation(const Members& members) {
  static const FittedDrive drive(simulate_synthetic({.duration_s = 2}), {});
  const Fitter fitter = drive.fitter();
  TraceResult r;
  compare_errors(fitter.chain(), {members.begin(), members.end()}, r);
  return r.main_equation;
}

// Effects that the drive does not have: they raise the error of their equation only.
TEST(Errors, AreQuotedOfTheEquationThatTheEffectsActOn) {
  EXPECT_EQ(main_equation({effect_with("resistance", {{"change_Ohm", 0.2}})}), "electrical");
  EXPECT_EQ(main_equation({effect_with("coulomb_friction", {{"torque_Nm", 0.2}})}), "mechanical");
}

}  // namespace twinrate::errors_test
