// The part `sundials` (core/load_part.hpp): ordinary differential equations by ARKODE and CVODE.
//
// Debian's development files of SUNDIALS bring PETSc, hypre and MPI, 200 packages, and few drive
// files choose these engines: a program runs without them until one does.
#pragma once
#include <functional>
#include <memory>

namespace twinrate {

// dx/dt = f(t, x) of `states` numbers.
struct OdeProblem {
  int states;
  // False: dx/dt is not finite.
  std::function<bool(double t, const double* x, double* dx)> rate;
};

// Created once; restarts at each interval. A failing call throws std::runtime_error with the
// function's name and code.
class OdeSolver {
 public:
  virtual ~OdeSolver() = default;
  // Takes x from t = 0 to T.
  virtual void advance(double* x, double T) = 0;
};

struct SundialsFunctions {
  // ERKStep with `steps` fixed steps an interval, the 7(4,5) table of Dormand and Prince.
  std::unique_ptr<OdeSolver> (*erk)(const OdeProblem& problem, int steps);
  // CVODE, Adams with fixed-point iteration; the absolute tolerance is a hundredth of the relative one.
  std::unique_ptr<OdeSolver> (*cvode)(const OdeProblem& problem, double relative_tolerance);
};

}  // namespace twinrate
