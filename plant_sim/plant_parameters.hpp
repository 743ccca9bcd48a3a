// [plant] of a drive file: how the plant is simulated, and what every process knows of it.
#pragma once
#include "model/plant_facts.hpp"
#include "plant_sim/integrator.hpp"

namespace twinrate {

struct PlantParameters : PlantFacts {
  static constexpr const char* kTable = "plant";
  Engine engine = Engine::kRk;
  int erk_steps = 1;
  int hold_ticks = 20;
  void fields(FieldVisitor& f);
};

}  // namespace twinrate
