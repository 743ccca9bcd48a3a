// Looks for the shaft that leaves least of the torque, with a gap or without. Without slopes:
// impacts move in time with every key, and a slope says little beyond the next bump.
#pragma once
#include "model/effects/motor_side.hpp"
#include "trace/fit.hpp"

namespace twinrate {

class ShaftSearch {
 public:
  struct Point {
    std::shared_ptr<Effect> shaft;
    double error = 1e300;  // sum over pieces of their norm: a missed impact spoils one of them
    double inertia = 0;    // kgm2 beyond that of the members, where it is free
  };
  static bool better(const Point& a, const Point& b) { return a.error < b.error; }

  // Rows at which the load mass is followed: at the sampler's stride, which is enough to find where
  // to look, or all.
  enum class Rows { kStride, kAll };
  // Whether the drive's inertia is known, or whatever leaves least with each shaft: where it is
  // wrong by more than the gap's own share, no gap fits beside it.
  enum class Inertia { kKnown, kFree };
  ShaftSearch(const Chain& chain, const Members& now, Inertia inertia, Rows rows = Rows::kStride);

  // How much a shaft leaves of the torque that the members leave, as the tracer samples it: not
  // whitened, for what the noise is taken for is part impacts.
  using Points = std::vector<Point>;
  Points at(std::vector<std::shared_ptr<Effect>> shafts) const;
  Point at(std::shared_ptr<Effect> shaft) const;
  // Nelder and Mead's simplex in the logarithms of the keys, from each start; `first_step`: of
  // these.
  Points descend(Points starts, int most, double first_step) const;
  Point descend(const Point& start, int most, double first_step) const;
  // Each key by itself and some together, a few per cent up and down, as long as that helps: out of
  // the small hollows in which a simplex ends.
  Point along_keys(Point best) const;

 private:
  // Sum of the pieces' norms of `left` less the inertia times omega_m', which is found if free. The
  // noise of omega_m' goes with the mass that is left at the motor: what of it the shaft takes
  // along is put back, or all of the mass would be best.
  double error_of(const Eigen::VectorXd& left, double J_load, double& inertia) const;

  double error_with(const ShaftFacts& shaft, const std::vector<double>& T_load,
                    double& inertia) const;

  const Chain& chain_;
  bool all_, free_;
  Runs runs_;                                   // outputs that are compared: not those kept back
  Eigen::VectorXd now_, noise_, acceleration_;  // what is left, noise in it; omega_m'
  MotorSide motor_;                             // with the members' load behind the shaft
};

// The best few, no two of them with nearly the same mass and gap.
std::vector<ShaftSearch::Point> apart(std::vector<ShaftSearch::Point> points, std::size_t most);

}  // namespace twinrate
