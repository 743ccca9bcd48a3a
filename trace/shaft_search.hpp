// Search for the shaft, with a gap or without, that has the smallest residual torque.
//
// The search uses no derivatives. Every key shifts the impacts in time, so the error has many local
// minima.
#pragma once
#include "model/effects/motor_side.hpp"
#include "trace/fit.hpp"

namespace twinrate {

class ShaftSearch {
 public:
  struct Point {
    std::shared_ptr<Effect> shaft;
    double error = 1e300;  // sum of the norms of pieces: a missed impact spoils only one
    double inertia = 0;    // kgm2, added to the members'; if it is free
  };
  static bool better(const Point& a, const Point& b) { return a.error < b.error; }

  // Rows at which the load mass is simulated: at the sampler's stride, which is accurate enough to
  // find a start, or all.
  enum class Rows { kStride, kAll };
  // The drive's inertia is known, or free: each shaft has the inertia with the smallest error. If
  // the known inertia is wrong by more than the effect of a gap, no gap fits beside it.
  enum class Inertia { kKnown, kFree };
  ShaftSearch(const Chain& chain, const Members& now, Inertia inertia, Rows rows = Rows::kStride);
  // The same search with the load tied to the measured torque (MotorSide::tie).
  ShaftSearch tied(double damping) const;

  // The error of the members with each shaft, from the residual torque at the tracer's rate. It is
  // not whitened, because the noise model contains part of the impacts. A shaft that is impossible
  // or too small keeps the error 1e300.
  using Points = std::vector<Point>;
  Points at(std::vector<std::shared_ptr<Effect>> shafts) const;
  Point at(std::shared_ptr<Effect> shaft) const;
  // Nelder and Mead's simplex method in the logarithms of the keys, from each start. `first_step`:
  // first change of a logarithm.
  Points descend(Points starts, int most, double first_step) const;
  Point descend(const Point& start, int most, double first_step) const;
  // Changes each key, and some keys together, by 1 to 17 per cent up and down, as long as the error
  // falls. This leaves the small local minima in which a simplex ends.
  Point along_keys(Point best) const;

 private:
  // Sum of the norms of the pieces of `left` less the inertia times omega_m'; fits the inertia if
  // it is free. The noise of omega_m' enters with the inertia at the motor. The part of it that a
  // shaft removes is added again. Otherwise all of the inertia behind the shaft would be best.
  double error_of(const Eigen::VectorXd& left, double J_load, double& inertia) const;

  double error_with(const ShaftFacts& shaft, const std::vector<double>& T_load,
                    double& inertia) const;

  // After the filter that whitens the sensors' noise, the outputs that are compared.
  Eigen::VectorXd in_sensors(const Eigen::VectorXd& torque) const;

  const Chain& chain_;
  bool all_, free_;
  std::vector<Eigen::Index> outputs_;           // those that are compared: none held out
  Eigen::VectorXd now_, noise_, acceleration_;  // residual torque, its noise; omega_m'; in_sensors
  MotorSide motor_;                             // with the load of the members behind the shaft
  std::vector<MotorSide::Measured> measured_;   // torque in the shaft at the rows of motor_
};

// The best points, at most `most`, no two of them with nearly the same load inertia and gap.
std::vector<ShaftSearch::Point> apart(std::vector<ShaftSearch::Point> points, std::size_t most);

}  // namespace twinrate
