#include "plant_sim/integrator.hpp"

#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <fmt/format.h>
#include <nvector/nvector_serial.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <cassert>
#include <stdexcept>
#include <sundials/sundials_context.hpp>

#include "plant_sim/rk_integrator.hpp"

namespace twinrate {
namespace {

constexpr double kRelativeTolerance = 1e-8;  // of engine cvode

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

// Arguments of the right-hand side; SUNDIALS passes them back by pointer.
struct Problem {
  const DriveModel& model;
  PlantInput input;
};

template <class State>
constexpr int kSize = State::RowsAtCompileTime;

template <class State>
int right_hand_side(realtype t, N_Vector y, N_Vector ydot, void* user) {
  const auto* problem = static_cast<const Problem*>(user);
  const Eigen::Map<const State> x(N_VGetArrayPointer(y));
  Eigen::Map<State> dx(N_VGetArrayPointer(ydot));
  if constexpr (std::is_same_v<State, TwoMassState>)
    dx = problem->model.two_mass_rate(x, problem->input, t);
  else
    dx = problem->model.rate(x, problem->input, t);
  return dx.allFinite() ? 0 : 1;
}

// The parts both engines share: context, state vector, problem.
class SundialsIntegrator : public Integrator {
 public:
  PlantState advance(const PlantState& x, const PlantInput& input, double T) override {
    return advance_state(x, input, T);
  }
  TwoMassState advance_two_masses(const TwoMassState& x, const PlantInput& input,
                                  double T) override {
    return advance_state(x, input, T);
  }

 protected:
  explicit SundialsIntegrator(const DriveModel& model)
      : problem_{model, {}},
        states_(model.has_shaft() ? kSize<TwoMassState> : kSize<PlantState>),
        y_(check_made(N_VNew_Serial(states_, context_), "N_VNew_Serial")) {
    N_VConst(0, y_.get());
  }
  ARKRhsFn right_hand_side_of_model() const {
    return problem_.model.has_shaft() ? right_hand_side<TwoMassState> : right_hand_side<PlantState>;
  }
  // Takes y_ over T.
  virtual void evolve(double T) = 0;

  sundials::Context context_;
  Problem problem_;
  int states_;
  Vector y_;

 private:
  template <class State>
  State advance_state(const State& x, const PlantInput& input, double T) {
    assert(states_ == kSize<State>);
    Eigen::Map<State> y(N_VGetArrayPointer(y_.get()));
    problem_.input = input;
    y = x;
    evolve(T);
    return y;
  }
};

class ErkIntegrator final : public SundialsIntegrator {
 public:
  ErkIntegrator(const DriveModel& model, int steps)
      : SundialsIntegrator(model),
        steps_(steps),
        erk_(check_made(ERKStepCreate(right_hand_side_of_model(), 0, y_.get(), context_),
                        "ERKStepCreate")) {
    check(ERKStepSetUserData(erk_, &problem_), "ERKStepSetUserData");
    check(ERKStepSetTableNum(erk_, ARKODE_DORMAND_PRINCE_7_4_5), "ERKStepSetTableNum");
    check(ERKStepSetMaxNumSteps(erk_, steps + 2), "ERKStepSetMaxNumSteps");  // 500 by default
  }
  ErkIntegrator(const ErkIntegrator&) = delete;
  ErkIntegrator& operator=(const ErkIntegrator&) = delete;
  ~ErkIntegrator() override { ERKStepFree(&erk_); }

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

class CvodeIntegrator final : public SundialsIntegrator {
 public:
  CvodeIntegrator(const DriveModel& model, double relative_tolerance)
      : SundialsIntegrator(model),
        cvode_(check_made(CVodeCreate(CV_ADAMS, context_), "CVodeCreate")) {
    check(CVodeInit(cvode_, right_hand_side_of_model(), 0, y_.get()), "CVodeInit");
    check(CVodeSStolerances(cvode_, relative_tolerance, 0.01 * relative_tolerance),
          "CVodeSStolerances");
    check(CVodeSetUserData(cvode_, &problem_), "CVodeSetUserData");
    solver_ = check_made(SUNNonlinSol_FixedPoint(y_.get(), 0, context_), "SUNNonlinSol_FixedPoint");
    check(CVodeSetNonlinearSolver(cvode_, solver_), "CVodeSetNonlinearSolver");
    check(CVodeSetMaxNumSteps(cvode_, 100000), "CVodeSetMaxNumSteps");
  }
  CvodeIntegrator(const CvodeIntegrator&) = delete;
  CvodeIntegrator& operator=(const CvodeIntegrator&) = delete;
  ~CvodeIntegrator() override {
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

std::unique_ptr<Integrator> make_integrator(Engine engine, const DriveModel& model, int steps) {
  if (engine == Engine::kRk) return std::make_unique<RkIntegrator>(model);
  if (engine == Engine::kCvode) return make_referee(model, kRelativeTolerance);
  return std::make_unique<ErkIntegrator>(model, steps);
}

std::unique_ptr<Integrator> make_referee(const DriveModel& model, double relative_tolerance) {
  return std::make_unique<CvodeIntegrator>(model, relative_tolerance);
}

}  // namespace twinrate
