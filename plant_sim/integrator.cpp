#include "plant_sim/integrator.hpp"

#include <cassert>
#include <type_traits>

#include "core/load_part.hpp"
#include "plant_sim/rk_integrator.hpp"
#include "plant_sim/sundials.hpp"

namespace twinrate {
namespace {

constexpr double kRelativeTolerance = 1e-8;  // of engine cvode

const SundialsFunctions& sundials() {
  static const auto* const functions = static_cast<const SundialsFunctions*>(load_part("sundials"));
  return *functions;
}

template <class State>
constexpr int kSize = State::RowsAtCompileTime;

// The drive as an equation for SUNDIALS.
class SundialsIntegrator final : public Integrator {
 public:
  // `make`: the solver of an equation.
  template <class Make>
  SundialsIntegrator(const DriveModel& model, const Make& make)
      : model_(model),
        problem_{model.has_shaft() ? kSize<TwoMassState> : kSize<PlantState>,
                 [this](double t, const double* x, double* dx) {
                   return model_.has_shaft() ? rate<TwoMassState>(t, x, dx)
                                             : rate<PlantState>(t, x, dx);
                 }},
        solver_(make(problem_)) {}
  SundialsIntegrator(const SundialsIntegrator&) = delete;
  SundialsIntegrator& operator=(const SundialsIntegrator&) = delete;

  PlantState advance(const PlantState& x, const PlantInput& input, double T) override {
    return advance_state(x, input, T);
  }
  TwoMassState advance_two_masses(const TwoMassState& x, const PlantInput& input,
                                  double T) override {
    return advance_state(x, input, T);
  }

 private:
  template <class State>
  bool rate(double t, const double* x_t, double* rate) const {
    const Eigen::Map<const State> x(x_t);
    Eigen::Map<State> dx(rate);
    if constexpr (std::is_same_v<State, TwoMassState>)
      dx = model_.two_mass_rate(x, input_, t);
    else
      dx = model_.rate(x, input_, t);
    return dx.allFinite();
  }
  template <class State>
  State advance_state(State x, const PlantInput& input, double T) {
    assert(problem_.states == kSize<State>);
    input_ = input;
    solver_->advance(x.data(), T);
    return x;
  }

  const DriveModel& model_;
  PlantInput input_;
  OdeProblem problem_;
  std::unique_ptr<OdeSolver> solver_;
};

}  // namespace

std::unique_ptr<Integrator> make_integrator(Engine engine, const DriveModel& model, int steps) {
  if (engine == Engine::kRk) return std::make_unique<RkIntegrator>(model);
  if (engine == Engine::kCvode) return make_referee(model, kRelativeTolerance);
  return std::make_unique<SundialsIntegrator>(
      model, [steps](const OdeProblem& problem) { return sundials().erk(problem, steps); });
}

std::unique_ptr<Integrator> make_referee(const DriveModel& model, double relative_tolerance) {
  return std::make_unique<SundialsIntegrator>(
      model, [relative_tolerance](const OdeProblem& problem) {
        return sundials().cvode(problem, relative_tolerance);
      });
}

}  // namespace twinrate
