#include "model/inverter.hpp"

#include "model/fields.hpp"

namespace twinrate {

void InverterParameters::fields(FieldVisitor& f) {
  f.number("v_dc_V", v_dc, 1, 2000, "DC-bus voltage", Presence::kRequired);
  f.number("f_pwm_Hz", f_pwm, 0, 1e6, "switching frequency; 0: the control rate");
}

}  // namespace twinrate
