#include "plant_sim/rk_integrator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "plant_sim/plain_machine.hpp"
#include "plant_sim/runge_kutta.hpp"

namespace twinrate {
namespace {

// A, rad/s. tests/plant_sim/rk_integrator_test.cpp holds the currents to 1e-8 A with these, to 2e-7
// A for an effect with a corner. The plain machine has no corner: its estimate is far above the
// error.
constexpr double kTolerance = 1e-10, kPlainTolerance = 3e-8;
constexpr double kWeightOfAngle = 100;
constexpr double kHardnessOfStep = 0.6;  // pair_8 is accepted about here: R_s/L T of a small motor
constexpr double kHardnessOfOrder5 = 0.05;  // below, pair_5 is accepted with 7 evaluations
constexpr int kMaxSteps = 1000;

double size_squared(const PlantState& e) {
  return e.head<3>().squaredNorm() + kWeightOfAngle * kWeightOfAngle * e[3] * e[3];
}
double size_squared(const TwoMassState& e) {
  return e.head<3>().squaredNorm() + e[5] * e[5] +
         kWeightOfAngle * kWeightOfAngle * (e[3] * e[3] + e[4] * e[4]);
}

int steps_at_first(double hardness) {
  return hardness < kHardnessOfStep * kMaxSteps ? 1 + static_cast<int>(hardness / kHardnessOfStep)
                                                : kMaxSteps;
}

[[noreturn]] void refuse(double t, double error_squared) {
  if (!std::isfinite(error_squared))
    throw std::runtime_error(fmt::format("rk: the state is not finite at t = {:.6f} s", t));
  throw std::runtime_error(
      fmt::format("rk: more than {} steps in one interval at t = {:.6f} s, the equations are "
                  "stiff; plant.engine = cvode is made for them",
                  kMaxSteps, t));
}

bool is_accepted(double error_squared, double tolerance) {
  return error_squared / (tolerance * tolerance) <= 1;
}

// Takes x over T. step_over(x, t, h): the RkStep from t to t + h, t from the interval's start.
template <class State, class StepOver>
[[gnu::always_inline]] inline State over_interval(const State& begin, double t_k, double T,
                                                  int steps, double tolerance,
                                                  const StepOver& step_over) {
  constexpr double kSafety = 0.9, kLeast = 0.1, kMostAfterRefusal = 0.8, kSmallest = 1e-16;
  constexpr double kLast = 1 + 1e-9;  // a remainder shorter than this belongs to the step before
  State x = begin;
  double t = 0, h = T / steps;
  for (int tried = 0; tried < kMaxSteps; ++tried) {
    const bool is_last = t + h * kLast >= T;
    if (is_last) h = T - t;
    const RkStep<State> step = step_over(x, t, h);
    const double error_squared = step.error_squared / (tolerance * tolerance);
    if (!std::isfinite(error_squared)) refuse(t_k + t, error_squared);
    const bool accepted = error_squared <= 1;
    if (accepted && is_last) return step.x_1;
    // The eighth root of the error. sqrt is exact on every machine, pow is not.
    const double factor =
        kSafety / std::sqrt(std::sqrt(std::sqrt(std::sqrt(std::max(error_squared, kSmallest)))));
    if (accepted) {
      x = step.x_1;
      t += h;
      h *= factor;
    } else {
      h *= std::clamp(factor, kLeast, kMostAfterRefusal);
    }
  }
  refuse(t_k + t, 0);
}

[[gnu::always_inline]] inline RkStep<PlainState> plain_step(const PlainMachine& machine,
                                                            const PlainState& x_0, double T_load) {
  const double load = machine.load(T_load);
  const auto rate = [&](double /*c*/, const PlainState& x) __attribute__((always_inline)) {
    return machine.rate(x, load);
  };
  const auto size = [&](const PlainState& e) __attribute__((always_inline)) {
    return machine.size_squared(e, kWeightOfAngle);
  };
  return pair_8(x_0, rate, size);
}
[[gnu::always_inline]] inline PlainState plain_state(const PlantState& x, double u_d, double u_q) {
  return {Four{x[0], x[1], u_d, u_q}, Pair{x[2], x[3]}};
}
[[gnu::always_inline]] inline void take(const PlainState& from, PlantState& x) {
  x = {from.electrical[0], from.electrical[1], from.motion[0], from.motion[1]};
}

// The plain machine over a whole interval in one step; u_d, u_q at t_k. False if the step is too
// long; x is then unchanged.
[[gnu::always_inline]] inline bool over_whole(const PlainMachine& machine, double T_load,
                                              double u_d, double u_q, PlantState& x) {
  const RkStep<PlainState> step = plain_step(machine, plain_state(x, u_d, u_q), T_load);
  if (!is_accepted(step.error_squared, kPlainTolerance)) return false;
  take(step.x_1, x);
  return true;
}
__attribute__((target("avx2"))) bool over_whole_avx2(const PlainMachine& machine, double T_load,
                                                     double u_d, double u_q, PlantState& x) {
  return over_whole(machine, T_load, u_d, u_q, x);
}

// The same in parts.
[[gnu::always_inline]] inline void over_parts(const MachineParameters& m, const PlantInput& input,
                                              double T, int steps, double u_d, double u_q,
                                              PlantState& x) {
  const auto step_over = [&](const PlainState& x_0, double /*t*/, double h)
      __attribute__((always_inline)) {
    return plain_step(PlainMachine(m, h), x_0, input.T_load);
  };
  take(over_interval(plain_state(x, u_d, u_q), input.t_k, T, steps, kPlainTolerance, step_over), x);
}
__attribute__((target("avx2"))) void over_parts_avx2(const MachineParameters& m,
                                                     const PlantInput& input, double T, int steps,
                                                     double u_d, double u_q, PlantState& x) {
  over_parts(m, input, T, steps, u_d, u_q, x);
}

}  // namespace

double RkIntegrator::hardness(double omega_m, double T) const {
  return T * (fastest_rate_ + model_.machine().n_p * std::abs(omega_m));
}

PlantState RkIntegrator::advance_plain(const PlantState& begin, const Vec2& u_alphabeta,
                                       const PlantInput& input, double T) {
  const MachineParameters& m = model_.machine();
  const Vec2 u_dq = park(u_alphabeta, input.rotor_axes.of(m.n_p * begin[3]));
  const int steps = steps_at_first(hardness(begin[2], T));
  PlantState x = begin;
  if (steps == 1) {
    if (plain_.h() != T) plain_ = PlainMachine(m, T);
    if ((has_avx2() ? over_whole_avx2 : over_whole)(plain_, input.T_load, u_dq[0], u_dq[1], x))
      return x;
  }
  (has_avx2() ? over_parts_avx2 : over_parts)(m, input, T, steps, u_dq[0], u_dq[1], x);
  return x;
}

[[gnu::flatten]] PlantState RkIntegrator::advance(const PlantState& x, const PlantInput& input,
                                                  double T) {
  if (is_plain_)
    if (const auto u_alphabeta = model_.constant_voltage(input))
      return advance_plain(x, *u_alphabeta, input, T);
  const double hard = hardness(x[2], T);
  return over_interval(x, input.t_k, T, steps_at_first(hard), kTolerance,
                       [&](const PlantState& x_0, double t, double h) {
                         const auto f = [&](double c, const PlantState& x_c) -> PlantState {
                           return h * model_.rate(x_c, input, t + c * h);
                         };
                         const auto size = [](const PlantState& e) { return size_squared(e); };
                         return hard < kHardnessOfOrder5 ? pair_5(x_0, f, size)
                                                         : pair_8(x_0, f, size);
                       });
}

TwoMassState RkIntegrator::advance_two_masses(const TwoMassState& x, const PlantInput& input,
                                              double T) {
  return over_interval(x, input.t_k, T, steps_at_first(hardness(x[2], T)), kTolerance,
                       [&](const TwoMassState& x_0, double t, double h) {
                         const auto f = [&](double c, const TwoMassState& x_c) -> TwoMassState {
                           return h * model_.two_mass_rate(x_c, input, t + c * h);
                         };
                         return pair_8(x_0, f,
                                       [](const TwoMassState& e) { return size_squared(e); });
                       });
}

}  // namespace twinrate
