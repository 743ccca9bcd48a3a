#include "plant_sim/plant_parameters.hpp"

namespace twinrate {

void FaultParameters::fields(FieldVisitor& f) {
  f.choice("kind", kind, kMadeFaultNames, "fault that the simulated plant makes");
  f.number("at_s", at_s, 0, 1e5, "drive time at which it begins");
  f.number("for_s", for_s, 0, 1e5, "how long it lasts");
  f.number("value", value, -1e6, 1e6,
           "current_jump: A added to phase a; position_jump: rad added to the angle; bus_voltage: "
           "V; temperature: degC that its sensor reads; command_too_large: factor");
}

void PlantParameters::fields(FieldVisitor& f) {
  kind_field(f);
  f.choice("engine", engine, kEngineNames, "integrator of the simulated plant");
  equation_fields(f);
  f.integer("erk_steps", erk_steps, 1, 1000, "fixed steps of the erk engine per tick");
  delay_field(f);
  f.integer("hold_ticks", hold_ticks, 1, 100000,
            "number of ticks without a command for which the last voltage is held; safety.hold_ms "
            "may be shorter");
  start_field(f);
  f.table("winding", [&](FieldVisitor& sub) { winding.fields(sub); });
  f.table("fault", [&](FieldVisitor& sub) { fault.fields(sub); });
}

}  // namespace twinrate
