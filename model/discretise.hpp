// Discretisations of x' = f(x) over one period T: explicit Euler and classical Runge-Kutta 4.
//
//   euler   x(T) = x + T f(x)
//   rk4     x(T) = x + T/6 (k1 + 2 k2 + 2 k3 + k4)
//           k1 = f(x),  k2 = f(x + T/2 k1),  k3 = f(x + T/2 k2),  k4 = f(x + T k3)
//
// model/discretise_exact.hpp holds the exact solution of a linear system; it is apart, because the
// matrix exponential is slow to compile.
#pragma once
#include <Eigen/Core>

namespace twinrate {

enum class Prediction : int { kEuler = 0, kRk4 = 1, kExact = 2 };
inline constexpr const char* kPredictionNames[] = {"euler", "rk4", "exact"};

template <class X, class F>
X euler_step(const F& f, const X& x, double T) {
  return x + T * f(x);
}

template <class X, class F>
X rk4_step(const F& f, const X& x, double T) {
  const X k1 = f(x);
  const X k2 = f(X(x + 0.5 * T * k1));
  const X k3 = f(X(x + 0.5 * T * k2));
  const X k4 = f(X(x + T * k3));
  return x + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
}

}  // namespace twinrate
