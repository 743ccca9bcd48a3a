#include "plant_sim/plant_parameters.hpp"

namespace twinrate {

void PlantParameters::fields(FieldVisitor& f) {
  f.choice("engine", engine, kEngineNames, "integrator of the simulated plant");
  equation_fields(f);
  f.integer("erk_steps", erk_steps, 1, 1000, "fixed steps of the erk engine per tick");
  delay_field(f);
  f.integer("hold_ticks", hold_ticks, 1, 100000,
            "realtime: number of ticks without a command for which the last voltage is held");
  start_field(f);
}

}  // namespace twinrate
