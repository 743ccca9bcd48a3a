// One sampling interval of the drive; voltage and load are constant inside it.
//
//   rk     Runge-Kutta on states of fixed size with step control: plant_sim/rk_integrator.hpp, the
//          default
//   erk    SUNDIALS ERKStep, fixed steps of the 7(4,5) Dormand-Prince table
//   cvode  SUNDIALS CVODE, Adams with fixed-point iteration, rtol 1e-8: the referee
//
// The solvers of SUNDIALS are created once and re-initialised at every voltage jump. A call that
// fails throws std::runtime_error with the function's name and code.
#pragma once
#include <memory>

#include "plant_sim/drive_model.hpp"

namespace twinrate {

enum class Engine : int { kRk = 0, kErk = 1, kCvode = 2 };
inline constexpr const char* kEngineNames[] = {"rk", "erk", "cvode"};

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
std::unique_ptr<Integrator> make_integrator(Engine engine, const DriveModel& model, int steps = 1);
// CVODE with another relative tolerance; the absolute one is a hundredth of it.
std::unique_ptr<Integrator> make_referee(const DriveModel& model, double relative_tolerance);

}  // namespace twinrate
