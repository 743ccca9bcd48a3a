// [plant] of a drive file: settings of the simulation, and values that every process knows.
#pragma once
#include "model/plant_facts.hpp"
#include "plant_sim/integrator.hpp"
#include "plant_sim/winding.hpp"

namespace twinrate {

// A fault made by the simulated plant, to test the reaction of the drive.
enum class MadeFault : int {
  kNone,
  kCurrentNan,
  kCurrentStuck,
  kCurrentJump,
  kPositionNan,
  kPositionJump,
  kBusVoltage,
  kTemperature,
  kCommandMissing,
  kCommandNan,
  kCommandTooLarge,
};
inline constexpr const char* kMadeFaultNames[] = {
    "none",         "current_nan",      "current_stuck",
    "current_jump", "position_nan",     "position_jump",
    "bus_voltage",  "temperature",      "command_missing",
    "command_nan",  "command_too_large"};

struct FaultParameters {
  MadeFault kind = MadeFault::kNone;
  double at_s = 0, for_s = 1e5, value = 0;
  void fields(FieldVisitor& f);
};

struct PlantParameters : PlantFacts {
  static constexpr const char* kTable = "plant";
  Engine engine = Engine::kRk;
  int erk_steps = 1;
  int hold_ticks = 20;
  WindingParameters winding;
  FaultParameters fault;
  void fields(FieldVisitor& f);
};

}  // namespace twinrate
