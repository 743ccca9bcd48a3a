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

// Of effects on both equations, the equation whose error falls further (here: rises less).
TEST(Errors, OfEffectsOnBothEquationsTheOneThatFallsFurtherIsQuoted) {
  const auto of_both = [](double change_Ohm, double torque_Nm) {
    return main_equation({effect_with("resistance", {{"change_Ohm", change_Ohm}}),
                          effect_with("coulomb_friction", {{"torque_Nm", torque_Nm}})});
  };
  EXPECT_EQ(of_both(1e-3, 0.5), "electrical");
  EXPECT_EQ(of_both(0.5, 1e-3), "mechanical");
}

}  // namespace twinrate::errors_test
