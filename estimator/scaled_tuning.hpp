// Defaults of the filters for the machine of the drive file: each paper's own values, written in the
// sizes of its motor (model/per_unit.hpp) and taken over to the machine at hand. Keys that the drive
// file gives win.
#pragma once
#include "estimator/active_flux.hpp"
#include "estimator/dq_ekf.hpp"
#include "estimator/eemf.hpp"
#include "estimator/ekf_disturbance.hpp"
#include "estimator/ekf_harmonic.hpp"
#include "estimator/ekf_joint.hpp"
#include "estimator/ekf_sensorless.hpp"
#include "model/per_unit.hpp"

namespace twinrate {

void scale(EkfSensorlessParameters& p, const PerUnit& base, double J, double T_s);
void scale(EkfDisturbanceParameters& p, const PerUnit& base, double J, double T_s);
void scale(EkfHarmonicParameters& p, const PerUnit& base, double J, double T_s);
void scale(BackEmfParameters& p, const PerUnit& base, double J, double T_s);
void scale(ActiveFluxParameters& p, const PerUnit& base, double J, double T_s);
void scale(EemfParameters& p, const PerUnit& base, double J, double T_s);
void scale(DqEkfParameters& p, const PerUnit& base, double J, double T_s);
void scale(EkfJointParameters& p, const PerUnit& base, double J, double T_s);

}  // namespace twinrate
