// Facts of the plant for estimator, controller and the checks of a drive file: the keys of [plant]
// that are the same for a simulated and a real plant. Settings of the simulation are in
// plant_sim/plant_parameters.hpp.
#pragma once
#include "model/fields.hpp"

namespace twinrate {

// The mean voltage of an interval, or edge by edge.
enum class InverterModel : int { kAveraged = 0, kSwitched = 1 };
inline constexpr const char* kInverterModelNames[] = {"averaged", "switched"};

// Location of the machine's saliency: in the rotor, as in every real machine, or on the stator's
// axes (plant_sim/fixed_axes.hpp).
enum class Saliency : int { kRotor = 0, kFixedAxes = 1 };
inline constexpr const char* kSaliencyNames[] = {"rotor", "fixed_axes"};

// The plant: twinrate-plant, or twinrate-bridge with a real drive behind it.
enum class PlantKind : int { kSimulated = 0, kBridge = 1 };
inline constexpr const char* kPlantKindNames[] = {"simulated", "bridge"};

struct PlantFacts {
  PlantKind kind = PlantKind::kSimulated;
  InverterModel inverter = InverterModel::kAveraged;
  Saliency saliency = Saliency::kRotor;
  int delay_samples = 1;     // COMMAND(k) acts from t_{k + delay_samples}
  double theta_e_start = 0;  // electrical rotor angle at t = 0

  void fields(FieldVisitor& f) {
    kind_field(f);
    equation_fields(f);
    delay_field(f);
    start_field(f);
  }

 protected:
  void kind_field(FieldVisitor& f) {
    f.choice("kind", kind, kPlantKindNames,
             "who plays the plant: a simulation, or a real drive behind [bridge]");
  }
  // Apart, because [plant] lists the keys of the simulation between them.
  void equation_fields(FieldVisitor& f) {
    f.choice("inverter", inverter, kInverterModelNames,
             "inverter model: mean voltage, or edge by edge");
    f.choice("saliency", saliency, kSaliencyNames,
             "rotor: L_d and L_q turn with the rotor; fixed_axes: the "
             "idealised machine of Kim et al., L_q on alpha and L_d on beta");
  }
  void delay_field(FieldVisitor& f) {
    f.integer("delay_samples", delay_samples, 0, 4,
              "computation delay: COMMAND(k) acts from t_{k+delay}");
  }
  void start_field(FieldVisitor& f) {
    f.number("theta_e_start_rad", theta_e_start, -100, 100, "electrical rotor angle at t = 0");
  }
};

}  // namespace twinrate
