// Defaults that scale with the machine give each paper's own values back on its own motor.
#include "estimator/scaled_tuning.hpp"

#include <gtest/gtest.h>

#include "core/config.hpp"

namespace twinrate {
namespace {

template <class Parameters>
Parameters scaled_for(const char* preset) {
  const Config config = Config::load(preset);
  const DriveConfig& d = config.drive();
  Parameters p;
  scale(p, per_unit(d.machine, d.inverter.v_dc, d.T_s()), d.machine.J, d.T_s());
  return p;
}

template <std::size_t N>
void expect_near(const double (&scaled)[N], const double (&printed)[N], double share) {
  for (std::size_t i = 0; i < N; ++i) EXPECT_NEAR(scaled[i], printed[i], share * printed[i]) << i;
}

TEST(ScaledTuning, GivesDilysHisOwnValues) {
  const auto p = scaled_for<EkfSensorlessParameters>("dilys2021");
  const EkfSensorlessParameters printed;
  expect_near(p.Q_diag, printed.Q_diag, 0.02);
  expect_near(p.R_diag, printed.R_diag, 0.02);
}

TEST(ScaledTuning, GivesKimHisOwnValues) {
  expect_near(scaled_for<DqEkfParameters>("kim-ipmsm").Q_diag, DqEkfParameters().Q_diag, 0.02);
  expect_near(scaled_for<DqEkfParameters>("kim-ipmsm").P0_diag, DqEkfParameters().P0_diag, 0.02);
  expect_near(scaled_for<EemfParameters>("kim-ipmsm").Q_diag, EemfParameters().Q_diag, 0.02);
  expect_near(scaled_for<EemfParameters>("kim-ipmsm").R_diag, EemfParameters().R_diag, 0.02);
  expect_near(scaled_for<ActiveFluxParameters>("kim-ipmsm").Q_diag, ActiveFluxParameters().Q_diag,
              0.02);
}

TEST(ScaledTuning, GivesNiewiaraHisOwnValues) {
  const auto p = scaled_for<EkfDisturbanceParameters>("niewiara2020");
  const EkfDisturbanceParameters printed;
  expect_near(p.Q_diag, printed.Q_diag, 0.03);
  expect_near(p.R_diag, printed.R_diag, 0.02);
  expect_near(p.P0_diag, printed.P0_diag, 0.03);
  EXPECT_NEAR(p.L, printed.L, 0.01 * 700);
}

// A machine of twice the current and a quarter of the inertia.
TEST(ScaledTuning, FollowsCurrentAndInertia) {
  MachineParameters m = Config::load("kim-ipmsm").drive().machine;
  const auto tuned = [&] {
    DqEkfParameters p;
    scale(p, per_unit(m, 311, 1e-4), m.J, 1e-4);
    return p;
  };
  const DqEkfParameters before = tuned();
  m.i_rated *= 2;
  m.J /= 4;
  const DqEkfParameters after = tuned();
  EXPECT_NEAR(after.r / before.r, 4, 1e-9);
  EXPECT_NEAR(after.Q_diag[2] / before.Q_diag[2], 16, 1e-9);
}

}  // namespace
}  // namespace twinrate
