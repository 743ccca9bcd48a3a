#include "identify/admittance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "model/matrix_exponential.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;
using Parameters = Eigen::Matrix<double, 5, 1>;  // ln of L, R, c, k, d; standstill.hpp
constexpr int kMeasuredTicks = 6000;
constexpr double kSineSettle_s = 0.03, kSineVoltageUse = 0.9;

// With a delay, the state at t_k - lag is the state of an earlier row, propagated over the rest of
// that tick. A filter adds a state of its own.
Complex admittance(const Parameters& p, double T_s, int period, const Lateness& late) {
  const double L = std::exp(p[0]), R = std::exp(p[1]);
  const double c = std::exp(p[2]), k = std::exp(p[3]), d = std::exp(p[4]);
  SmallMatrix A = SmallMatrix::Zero(5, 5);
  A.row(0) << -R / L, -1 / L, 0, 0, 1 / L;
  A.row(1) << c, -d * kTwoPi / (period * T_s), -k, 0, 0;
  A(2, 1) = 1;
  const bool filtered = late.form == Lateness::kFirstOrder && late.lag.value > 0;
  if (filtered) A(3, 0) = 1 / late.lag.value, A(3, 3) = -1 / late.lag.value;
  const SmallMatrix step = matrix_exponential(A * T_s);
  const Complex z_inverse = std::polar(1.0, -kTwoPi / period);
  const Eigen::Matrix4cd M =
      Eigen::Matrix4cd::Identity() - z_inverse * step.topLeftCorner(4, 4).cast<Complex>();
  const Eigen::Vector4cd x =
      M.partialPivLu().solve(Eigen::Vector4cd(step.topRightCorner(4, 1).cast<Complex>()));
  if (filtered) return x[3];
  if (late.form != Lateness::kDelay) return x[0];
  const double ticks = late.lag.value / T_s, whole = std::floor(ticks);
  const SmallMatrix part = matrix_exponential(A * (T_s * (1 - (ticks - whole))));
  const Complex now = z_inverse * (part.topLeftCorner(1, 4).cast<Complex>() * x)(0) + part(0, 4);
  return now * std::pow(z_inverse, whole);
}

// The last row keeps R near its value at direct current.
Eigen::VectorXd residual(const Parameters& p, double R, const std::vector<Sine>& sines, double T_s,
                         const Lateness& late) {
  constexpr double kWeightOfR = 0.2;
  Eigen::VectorXd r(2 * static_cast<Eigen::Index>(sines.size()) + 1);
  for (std::size_t s = 0; s < sines.size(); ++s) {
    const Complex ratio = std::log(sines[s].I_over_U / admittance(p, T_s, sines[s].period, late));
    r[2 * static_cast<Eigen::Index>(s)] = sines[s].weight * ratio.real();
    r[2 * static_cast<Eigen::Index>(s) + 1] = sines[s].weight * ratio.imag();
  }
  r[r.size() - 1] = kWeightOfR * (p[1] - std::log(R));
  return r;
}

struct Minimum {
  Parameters p;
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
};

// Levenberg-Marquardt in the first `n` parameters.
Minimum descend(Parameters p, Eigen::Index n, double R, const std::vector<Sine>& sines, double T_s,
                const Lateness& late) {
  constexpr double kStep = 1e-5, kLeastGain = 1e-9;
  constexpr double kMove = 2.3;  // a factor of ten: beyond it the derivatives say nothing
  Eigen::VectorXd r = residual(p, R, sines, T_s, late);
  Eigen::MatrixXd jacobian(r.size(), n);
  double damping = 1e-3;
  for (int round = 0; round < 60; ++round) {
    for (Eigen::Index j = 0; j < n; ++j) {
      Parameters moved = p;
      moved[j] += kStep;
      jacobian.col(j) = (residual(moved, R, sines, T_s, late) - r) / kStep;
    }
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    const double before = r.squaredNorm();
    for (; damping < 1e6; damping *= 10) {
      Eigen::MatrixXd N = normal;
      N.diagonal().array() += damping * (1e-6 + N.diagonal().array());
      const Eigen::VectorXd move = N.ldlt().solve(jacobian.transpose() * r);
      if (!(move.lpNorm<Eigen::Infinity>() < kMove)) continue;
      Parameters next = p;
      next.head(n) -= move;
      const Eigen::VectorXd after = residual(next, R, sines, T_s, late);
      if (!after.allFinite() || after.squaredNorm() >= before) continue;
      p = next, r = after;
      break;
    }
    if (r.squaredNorm() > (1 - kLeastGain) * before) break;
    damping = std::max(1e-9, 0.1 * damping);
  }
  return {p, r, jacobian};
}

// I of  i_k = I_0 + Re(I e^(j 2 pi k/period)). If repeated rows are more frequent than by chance,
// they are left out: their reading is that of the tick before.
Complex phasor(Experiment& e, const Rows& rows, const Vec2& axis, int period) {
  constexpr int kFast = 12;       // ticks: up to here a sine changes by much in a tick
  constexpr double kSteep = 0.3;  // of the largest change
  const auto fit = [&](bool all) {
    Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < rows.size(); ++k) {
      if (!all && rows[k].repeats) continue;
      const double at = kTwoPi * static_cast<double>(k % static_cast<std::size_t>(period)) / period;
      const Eigen::Vector3d x(1, std::cos(at), -std::sin(at));
      N += x * x.transpose(), b += x * rows[k].i.dot(axis);
    }
    const Eigen::Vector3d x = N.ldlt().solve(b);
    return Complex(x[1], x[2]);
  };
  const Complex I = fit(true);
  if (period <= kFast) {
    int repeated = 0, looked = 0;
    for (std::size_t k = 1; k < rows.size(); ++k) {
      const double at = kTwoPi * static_cast<double>(k % static_cast<std::size_t>(period)) / period;
      const double change = std::sin(at + std::arg(I) - kPi / period);  // of its largest
      if (std::abs(change) < kSteep) continue;
      ++looked, repeated += rows[k].repeats ? 1 : 0;
    }
    e.count_repeats(repeated, looked);
  }
  return e.stale_share() > 0 ? fit(false) : I;
}

}  // namespace

std::vector<Sine> sweep(Experiment& e, const SweepPlan& plan, const std::vector<int>& periods) {
  std::vector<Sine> sines;
  const double most = kSineVoltageUse * e.u_max() - plan.u_hold.norm();
  for (const int period : periods) {
    const double omega = kTwoPi / (period * e.T_s());
    const double u = std::min(most, plan.i * std::hypot(plan.R, omega * plan.L));
    const auto angle = [&](int k) { return kTwoPi * (k % period) / period; };
    const auto one = [&](int k) -> const Row& {
      return e.apply(plan.u_hold + u * std::sin(angle(k)) * plan.axis);
    };
    const int settling = std::max(e.ticks(kSineSettle_s), 10 * period) / period * period;
    for (int k = 0; k < settling; ++k) one(k);
    const int measured = kMeasuredTicks / period * period;
    Rows rows;
    e.record(&rows);
    for (int k = 0; k < measured; ++k) one(k);
    e.record(nullptr);
    Complex U;
    for (int k = 0; k < measured; ++k)
      U += rows[static_cast<std::size_t>(k)].u.dot(plan.axis) * std::polar(1.0, -angle(k));
    const Complex I = phasor(e, rows, plan.axis, period);
    sines.push_back({period, I / (2.0 / measured * U), 1, std::abs(I)});
  }
  return sines;
}

static Minimum least_squares(const std::vector<Sine>& sines, double T_s, double R, bool gives_way,
                             const Lateness& late) {
  const double omega = kTwoPi / (sines.front().period * T_s);
  const double L = std::max(std::imag(1.0 / sines.front().I_over_U) / omega, 1e-3 * R * T_s);
  const double omega_low = kTwoPi / (sines.back().period * T_s);
  const double stiff = omega_low * omega_low;
  Parameters start;
  start << std::log(L), std::log(R), -INFINITY, -INFINITY, -INFINITY;
  if (!gives_way) return descend(start, 2, R, sines, T_s, late);
  Minimum best;
  // Starts with a heavy and a light rotor: from the wrong start the fit can end in another minimum.
  for (const double c : {1e-3, 0.03, 1.0, 30.0}) {
    start.tail(3) << std::log(c * L * stiff), std::log(0.03 * stiff), std::log(0.01);
    const Minimum found = descend(start, 5, R, sines, T_s, late);
    if (best.r.size() == 0 || found.r.squaredNorm() < best.r.squaredNorm()) best = found;
  }
  return best;
}

AxisFit fit_axis(std::vector<Sine> sines, double T_s, double R, bool gives_way,
                 const Lateness& late) {
  if (gives_way)
    for (Sine& sine : sines) sine.weight = static_cast<double>(sines.front().period) / sine.period;
  const Minimum best = least_squares(sines, T_s, R, gives_way, late);
  Eigen::MatrixXd N = best.jacobian.transpose() * best.jacobian;
  // If the sines do not show a mode, its parameter is free and the inverse still exists.
  N.diagonal().array() += 1e-10 * N.diagonal().maxCoeff();
  const double variance =
      best.r.squaredNorm() / static_cast<double>(best.r.size() - best.jacobian.cols());
  const Eigen::MatrixXd covariance = variance * N.inverse();
  const auto found = [&](Eigen::Index j) {
    const double value = std::exp(best.p[j]);
    return Found{value, value * std::sqrt(covariance(j, j))};
  };
  double i = 0, weights = 0;
  for (const Sine& sine : sines) {
    i += sine.weight * sine.weight * sine.i;
    weights += sine.weight * sine.weight;
  }
  AxisFit fit{found(0), found(1), i / weights, best.r.squaredNorm()};
  if (late.lag.sigma > 0) {  // an error of the lag causes one of L
    Lateness moved = late;
    moved.lag = {late.lag.value + late.lag.sigma, 0};
    const double other = fit_axis(sines, T_s, R, gives_way, moved).L.value;
    fit.L.sigma = std::hypot(fit.L.sigma, other - fit.L.value);
  }
  return fit;
}

Lateness find_lateness(const std::vector<Sine>& sines, double T_s, double R) {
  constexpr double kBad = 3e-3, kBetter = 20, kStep = 0.02, kMost = 2;  // kStep, kMost: ticks
  const AxisFit plain = fit_axis(sines, T_s, R, false);
  if (plain.L.sigma < kBad * plain.L.value) return {};
  Lateness best;
  double least = plain.misfit / kBetter;
  const auto misfit = [&](Lateness::Form form, double lag) {
    return fit_axis(sines, T_s, R, false, {form, {lag, 0}}).misfit;
  };
  for (const auto form : {Lateness::kDelay, Lateness::kFirstOrder}) {
    double at = 0, lowest = INFINITY;
    for (double ticks = kStep; ticks < kMost; ticks += kStep)
      if (const double m = misfit(form, ticks * T_s); m < lowest) lowest = m, at = ticks * T_s;
    double step = kStep * T_s;
    for (int round = 0; round < 40; ++round) {
      const double lower = misfit(form, at - step), higher = misfit(form, at + step);
      if (lower < lowest)
        at -= step, lowest = lower;
      else if (higher < lowest)
        at += step, lowest = higher;
      else
        step /= 2;
    }
    if (lowest >= least) continue;
    least = lowest;
    // Near its minimum the misfit is a parabola.
    const double h = 0.01 * T_s;
    const double bend =
        (misfit(form, at + h) + misfit(form, std::max(0.0, at - h)) - 2 * lowest) / (h * h);
    const auto freedom = static_cast<double>(2 * sines.size()) - 2;
    best = {form, {at, std::sqrt(2 * lowest / freedom / std::max(bend, 1e-300))}};
  }
  return best;
}

}  // namespace twinrate
