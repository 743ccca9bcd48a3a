// The part `sundials`.
#include "plant_sim/sundials.hpp"

#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <fmt/format.h>
#include <nvector/nvector_serial.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <algorithm>
#include <stdexcept>
#include <sundials/sundials_context.hpp>
#include <type_traits>

#include "core/load_part.hpp"

namespace twinrate {
namespace {

void check(int code, const char* call) {
  if (code < 0) throw std::runtime_error(fmt::format("{} failed with code {}", call, code));
}
template <class T>
T* check_made(T* object, const char* call) {
  if (!object) throw std::runtime_error(fmt::format("{} returned no object", call));
  return object;
}

struct FreeVector {
  void operator()(N_Vector v) const { N_VDestroy(v); }
};
using Vector = std::unique_ptr<std::remove_pointer_t<N_Vector>, FreeVector>;

int right_hand_side(realtype t, N_Vector y, N_Vector ydot, void* user) {
  const auto* problem = static_cast<const OdeProblem*>(user);
  return problem->rate(t, N_VGetArrayPointer(y), N_VGetArrayPointer(ydot)) ? 0 : 1;
}

// The common parts of both solvers: context, state vector, problem.
class Solver : public OdeSolver {
 public:
  void advance(double* x, double T) override {
    double* const y = N_VGetArrayPointer(y_.get());
    std::copy_n(x, problem_.states, y);
    evolve(T);
    std::copy_n(y, problem_.states, x);
  }

 protected:
  explicit Solver(const OdeProblem& problem)
      : problem_(problem),
        y_(check_made(N_VNew_Serial(problem.states, context_), "N_VNew_Serial")) {
    N_VConst(0, y_.get());
  }
  // Takes y_ over T.
  virtual void evolve(double T) = 0;

  sundials::Context context_;
  OdeProblem problem_;
  Vector y_;
};

class Erk final : public Solver {
 public:
  Erk(const OdeProblem& problem, int steps)
      : Solver(problem),
        steps_(steps),
        erk_(check_made(ERKStepCreate(right_hand_side, 0, y_.get(), context_), "ERKStepCreate")) {
    check(ERKStepSetUserData(erk_, &problem_), "ERKStepSetUserData");
    check(ERKStepSetTableNum(erk_, ARKODE_DORMAND_PRINCE_7_4_5), "ERKStepSetTableNum");
    check(ERKStepSetMaxNumSteps(erk_, steps + 2), "ERKStepSetMaxNumSteps");  // 500 by default
  }
  Erk(const Erk&) = delete;
  Erk& operator=(const Erk&) = delete;
  ~Erk() override { ERKStepFree(&erk_); }

  void evolve(double T) override {
    double t = 0;
    check(ERKStepReset(erk_, 0, y_.get()), "ERKStepReset");
    check(ERKStepSetFixedStep(erk_, T / steps_), "ERKStepSetFixedStep");
    check(ERKStepSetStopTime(erk_, T), "ERKStepSetStopTime");
    if (const int code = ERKStepEvolve(erk_, T, y_.get(), &t, ARK_NORMAL); code < 0)
      throw std::runtime_error(fmt::format(
          "erk: {} fixed step(s) in one interval do not follow the plant (ERKStepEvolve "
          "code {}); more plant.erk_steps, or plant.engine = rk or cvode, may",
          steps_, code));
  }

 private:
  int steps_;
  void* erk_;
};

class Cvode final : public Solver {
 public:
  Cvode(const OdeProblem& problem, double relative_tolerance)
      : Solver(problem), cvode_(check_made(CVodeCreate(CV_ADAMS, context_), "CVodeCreate")) {
    check(CVodeInit(cvode_, right_hand_side, 0, y_.get()), "CVodeInit");
    check(CVodeSStolerances(cvode_, relative_tolerance, 0.01 * relative_tolerance),
          "CVodeSStolerances");
    check(CVodeSetUserData(cvode_, &problem_), "CVodeSetUserData");
    solver_ = check_made(SUNNonlinSol_FixedPoint(y_.get(), 0, context_), "SUNNonlinSol_FixedPoint");
    check(CVodeSetNonlinearSolver(cvode_, solver_), "CVodeSetNonlinearSolver");
    check(CVodeSetMaxNumSteps(cvode_, 100000), "CVodeSetMaxNumSteps");
  }
  Cvode(const Cvode&) = delete;
  Cvode& operator=(const Cvode&) = delete;
  ~Cvode() override {
    CVodeFree(&cvode_);
    SUNNonlinSolFree(solver_);
  }

  void evolve(double T) override {
    double t = 0;
    check(CVodeReInit(cvode_, 0, y_.get()), "CVodeReInit");
    check(CVodeSetStopTime(cvode_, T), "CVodeSetStopTime");
    check(CVode(cvode_, T, y_.get(), &t, CV_NORMAL), "CVode");
  }

 private:
  void* cvode_;
  SUNNonlinearSolver solver_ = nullptr;
};

}  // namespace
}  // namespace twinrate

TWINRATE_PART const twinrate::SundialsFunctions twinrate_part;
const twinrate::SundialsFunctions twinrate_part = {
    .erk = [](const twinrate::OdeProblem& problem,
              int steps) -> std::unique_ptr<twinrate::OdeSolver> {
      return std::make_unique<twinrate::Erk>(problem, steps);
    },
    .cvode = [](const twinrate::OdeProblem& problem,
                double relative_tolerance) -> std::unique_ptr<twinrate::OdeSolver> {
      return std::make_unique<twinrate::Cvode>(problem, relative_tolerance);
    }};
