// The default engine: embedded Runge-Kutta pairs on states of fixed size (plant_sim/runge_kutta.hpp)
// with step control inside the interval.
//
//   step     the whole interval at first, or parts of it if T (fastest rate) exceeds 0.6; a step
//            is accepted if its estimated error is at most the tolerance
//   pair     order 5 if T (fastest rate) is below 0.05, else order 8
//   plain    a machine without effects: order 8 on plant_sim/plain_machine.hpp
//
// The tolerance is absolute: A, rad/s and 100 times rad, as a root of squares. For smooth equations
// the true error is 10 to 100 times smaller than the estimate. At a corner (a clamped dead time,
// the flank of a gap) the steps become small; the estimate can miss one.
//
// Only the products of the plain machine's parameters with the length of the last interval are kept
// between intervals. Throws std::runtime_error if an interval takes more than 1000 steps (stiff
// equations) and if the state is not finite.
#pragma once
#include "plant_sim/integrator.hpp"
#include "plant_sim/plain_machine.hpp"

namespace twinrate {

class RkIntegrator final : public Integrator {
 public:
  // `model` must outlive the integrator.
  explicit RkIntegrator(const DriveModel& model)
      : model_(model),
        fastest_rate_(model.fastest_rate()),
        is_plain_(model.is_plain()),
        plain_(model.machine(), 0) {}

  PlantState advance(const PlantState& x, const PlantInput& input, double T) override;
  TwoMassState advance_two_masses(const TwoMassState& x, const PlantInput& input,
                                  double T) override;

 private:
  // T times the fastest rate of the equations at this speed.
  double hardness(double omega_m, double T) const;
  PlantState advance_plain(const PlantState& x, const Vec2& u_alphabeta, const PlantInput& input,
                           double T);

  const DriveModel& model_;
  double fastest_rate_;
  bool is_plain_;
  PlainMachine plain_;  // over a step of the length of the last interval
};

}  // namespace twinrate
