// Negative losses: a part of a larger declared loss.
#include "model/effects/losses.hpp"

#include <gtest/gtest.h>

#include "model/effects/tracing.hpp"
#include "tests/support/effects.hpp"

namespace twinrate::losses_test {

std::string wrong_in(const std::vector<std::pair<const char*, double>>& losses, double B = 0.003) {
  MachineParameters machine;
  machine.B = B;
  Effects effects;
  for (const auto& [kind, size] : losses) {
    const std::shared_ptr<Effect> effect = make_effect(kind);
    std::vector<double> coefficients(static_cast<std::size_t>(effect->tracing().regressor_count()),
                                     0.0);
    coefficients[0] = size;
    effect->tracing().set_coefficients(coefficients);
    effects.push_back(effect);
  }
  return negative_loss(effects, machine);
}

TEST(NegativeLoss, MayTakeFromWhatIsDeclaredOfItsKind) {
  EXPECT_EQ(wrong_in({{"coulomb_friction", 0.15}, {"coulomb_friction", -0.09}}), "");
  EXPECT_EQ(wrong_in({{"dead_time", 1.5e-6}, {"dead_time", -0.5e-6}}), "");
  EXPECT_EQ(wrong_in({{"viscous_friction", -0.001}}), "") << "of machine.B";
  EXPECT_EQ(wrong_in({{"cogging", -0.1}}), "") << "no loss";
}

TEST(NegativeLoss, IsNoGain) {
  EXPECT_EQ(wrong_in({{"coulomb_friction", 0.05}, {"coulomb_friction", -0.09}}),
            "coulomb_friction: -0.04 in all, 0 or more allowed");
  EXPECT_NE(wrong_in({{"viscous_friction", -0.004}}), "");
  EXPECT_NE(wrong_in({{"coulomb_friction", 0.2}, {"dead_time", -1e-7}}), "") << "another kind";
}

TEST(NegativeLoss, AnEstimateThatTakesAllAwayMayBeALittleOff) {
  EXPECT_EQ(wrong_in({{"coulomb_friction", 0.15}, {"coulomb_friction", -0.151}}), "");
}

}  // namespace twinrate::losses_test
