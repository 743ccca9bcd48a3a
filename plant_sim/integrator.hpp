// One sampling interval of the drive by SUNDIALS; voltage and load are constant inside it.
//
//   erk    ERKStep, fixed steps of the 7(4,5) Dormand-Prince table: the default
//   cvode  CVODE, Adams with fixed-point iteration, rtol 1e-8: the referee
//
// Both are created once and re-initialised at every voltage jump. A SUNDIALS call that fails throws
// std::runtime_error with the function's name and code.
#pragma once
#include <memory>

#include "plant_sim/drive_model.hpp"

namespace twinrate {

enum class Engine : int { kErk = 0, kCvode = 1 };
inline constexpr const char* kEngineNames[] = {"erk", "cvode"};

class Integrator {
 public:
  virtual ~Integrator() = default;
  // State at the end of an interval of length T that starts at x.
  virtual PlantState advance(const PlantState& x, const PlantInput& input, double T) = 0;
  // The same of a drive with an elastic shaft, and of no other.
  virtual TwoMassState advance_two_masses(const TwoMassState& x, const PlantInput& input,
                                          double T) = 0;
};

// `steps`: fixed steps an interval (erk only). `model` must outlive the integrator.
std::unique_ptr<Integrator> make_integrator(Engine engine, const DriveModel& model, int steps);

}  // namespace twinrate
