#include "plant_sim/integrator.hpp"

#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <fmt/format.h>
#include <nvector/nvector_serial.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <stdexcept>
#include <sundials/sundials_context.hpp>

namespace twinrate {
namespace {

constexpr int kStates = 4;

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

// What the right-hand side needs; SUNDIALS hands it back by pointer.
struct Problem {
  const DriveModel& model;
  PlantInput input;
};

int right_hand_side(realtype t, N_Vector y, N_Vector ydot, void* user) {
  const auto* problem = static_cast<const Problem*>(user);
  const Eigen::Map<const PlantState> x(N_VGetArrayPointer(y));
  Eigen::Map<PlantState> dx(N_VGetArrayPointer(ydot));
  dx = problem->model.rate(x, problem->input, t);
  return dx.allFinite() ? 0 : 1;
}

// The parts both engines share: context, state vector, problem.
class SundialsIntegrator : public Integrator {
 protected:
  explicit SundialsIntegrator(const DriveModel& model)
      : problem_{model, {}}, y_(check_made(N_VNew_Serial(kStates, context_), "N_VNew_Serial")) {
    N_VConst(0, y_.get());
  }
  Eigen::Map<PlantState> state() { return Eigen::Map<PlantState>(N_VGetArrayPointer(y_.get())); }

  sundials::Context context_;
  Problem problem_;
  Vector y_;
};

class ErkIntegrator final : public SundialsIntegrator {
 public:
  ErkIntegrator(const DriveModel& model, int steps)
      : SundialsIntegrator(model),
        steps_(steps),
        erk_(check_made(ERKStepCreate(right_hand_side, 0, y_.get(), context_), "ERKStepCreate")) {
    check(ERKStepSetUserData(erk_, &problem_), "ERKStepSetUserData");
    check(ERKStepSetTableNum(erk_, ARKODE_DORMAND_PRINCE_7_4_5), "ERKStepSetTableNum");
  }
  ErkIntegrator(const ErkIntegrator&) = delete;
  ErkIntegrator& operator=(const ErkIntegrator&) = delete;
  ~ErkIntegrator() override { ERKStepFree(&erk_); }

  PlantState advance(const PlantState& x, const PlantInput& input, double T) override {
    problem_.input = input;
    state() = x;
    double t = 0;
    check(ERKStepReset(erk_, 0, y_.get()), "ERKStepReset");
    check(ERKStepSetFixedStep(erk_, T / steps_), "ERKStepSetFixedStep");
    check(ERKStepSetStopTime(erk_, T), "ERKStepSetStopTime");
    check(ERKStepEvolve(erk_, T, y_.get(), &t, ARK_NORMAL), "ERKStepEvolve");
    return state();
  }

 private:
  int steps_;
  void* erk_;
};

class CvodeIntegrator final : public SundialsIntegrator {
 public:
  explicit CvodeIntegrator(const DriveModel& model)
      : SundialsIntegrator(model),
        cvode_(check_made(CVodeCreate(CV_ADAMS, context_), "CVodeCreate")) {
    check(CVodeInit(cvode_, right_hand_side, 0, y_.get()), "CVodeInit");
    check(CVodeSStolerances(cvode_, 1e-8, 1e-10), "CVodeSStolerances");
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

  PlantState advance(const PlantState& x, const PlantInput& input, double T) override {
    problem_.input = input;
    state() = x;
    double t = 0;
    check(CVodeReInit(cvode_, 0, y_.get()), "CVodeReInit");
    check(CVodeSetStopTime(cvode_, T), "CVodeSetStopTime");
    check(CVode(cvode_, T, y_.get(), &t, CV_NORMAL), "CVode");
    return state();
  }

 private:
  void* cvode_;
  SUNNonlinearSolver solver_ = nullptr;
};

}  // namespace

std::unique_ptr<Integrator> make_integrator(Engine engine, const DriveModel& model, int steps) {
  if (engine == Engine::kCvode) return std::make_unique<CvodeIntegrator>(model);
  return std::make_unique<ErkIntegrator>(model, steps);
}

}  // namespace twinrate
