#include "model/machine.hpp"

#include "model/fields.hpp"

namespace twinrate {

void MachineParameters::fields(FieldVisitor& f) {
  constexpr auto need = Presence::kRequired;
  f.number("R_s_Ohm", R_s, 1e-4, 1e3, "stator resistance of one phase", need);
  f.number("L_d_H", L_d, 1e-7, 10, "d-axis inductance", need);
  f.number("L_q_H", L_q, 1e-7, 10, "q-axis inductance", need);
  f.number("psi_f_Wb", psi_f, 1e-6, 100, "flux linkage of the magnets, peak", need);
  f.integer("n_p", n_p, 1, 200, "pole pairs", need);
  f.number("J_kgm2", J, 1e-9, 1e4, "total moment of inertia", need);
  f.number("B_Nms", B, 0, 1e3, "viscous friction", need);
  f.integer("n_slots", n_slots, 0, 2000, "stator slots, 0 where not known");
  f.number("i_rated_A", i_rated, 0, 1e4, "rated phase current, peak; 0 where not known");
  f.number("T_rated_Nm", T_rated, 0, 1e6, "rated torque; 0 where not known");
  f.number("omega_m_rated_rad_s", omega_m_rated, 0, 1e5,
           "rated speed, mechanical; 0 where not known");
  f.number(
      "i_trip_A", i_trip, 0, 1e5,
      "current amplitude at which the drive switches off; 0: four times the rated current, and "
      "twice i_max_A of the controller at least");
}

}  // namespace twinrate
