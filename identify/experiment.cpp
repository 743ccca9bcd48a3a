#include "identify/experiment.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kTooMuch = 2;        // of i_max: the experiment ends
constexpr double kVoltageUse = 0.95;  // of u_max, by the current loop

Vec2 times_j(const Vec2& x) {
  return {-x[1], x[0]};
}

}  // namespace

Experiment::Experiment(Rig& rig, const IdentifyLimits& limits, IdentifyHooks hooks)
    : rig_(rig), limits_(limits), hooks_(std::move(hooks)) {}

void Experiment::show(const std::string& what, double share) const {
  if (hooks_.progress) hooks_.progress(what, share);
}

RigRow Experiment::step(const Vec2& u_alphabeta, double theta_e) {
  if (hooks_.stop && hooks_.stop()) throw RunFailed("stopped");
  ++k_;
  return rig_.step(u_alphabeta, theta_e);
}

void Experiment::wait_for_rest() {
  constexpr double kAtRest = 0.002, kWindow_s = 0.2, kLongest_s = 10;  // rad
  const double count = facts().encoder_counts > 0 ? kTwoPi / facts().encoder_counts : 0;
  for (double t = 0; t < kLongest_s; t += kWindow_s) {
    double least = INFINITY, most = -INFINITY;
    for (int k = 0; k < ticks(kWindow_s); ++k) {
      const double theta = step(Vec2::Zero(), 0).theta_m;
      least = std::min(least, theta), most = std::max(most, theta);
    }
    if (most - least < std::max(kAtRest, 2.5 * count)) return;
  }
}

void Experiment::measure_offsets(int ticks) {
  constexpr double kAtRest = 0.02;  // rad
  wait_for_rest();
  Vec3 sum = Vec3::Zero(), squares = Vec3::Zero();
  double first = 0;
  for (int k = 0; k < ticks; ++k) {
    const RigRow row = step(Vec2::Zero(), 0);
    sum += row.i_abc;
    squares += row.i_abc.cwiseAbs2();
    if (k == 0) first = row.theta_m;
    if (std::abs(row.theta_m - first) > kAtRest)
      throw RunFailed("the shaft turns without a voltage: it has to be at rest at the start");
  }
  offset_abc_ = sum / ticks;
  const Vec3 variance = (squares / ticks - offset_abc_.cwiseAbs2()).cwiseMax(0.0) / ticks;
  offset_sigma_alpha_ = std::sqrt(4 * variance[0] + variance[1] + variance[2]) / 3;
}

const Row& Experiment::apply(const Vec2& u_alphabeta, double theta_e) {
  const RigRow row = step(u_alphabeta, theta_e);
  row_ = {clarke(row.i_abc - offset_abc_), row.u_alphabeta, direction_ * row.theta_m,
          row.i_abc == before_};
  before_ = row.i_abc;
  if (rows_) rows_->push_back(row_);
  if (!(row_.i.norm() < kTooMuch * limits_.i_max)) {
    rig_.step(Vec2::Zero(), theta_e);
    throw RunFailed(fmt::format("{:.3g} A: more than {:g} times the test current of {:.3g} A{}",
                                row_.i.norm(), kTooMuch, limits_.i_max,
                                stale_share() > 0
                                    ? fmt::format("; {:.2g} % of the readings of the currents were "
                                                  "those of the tick before (stale)",
                                                  100 * stale_share())
                                    : ""));
  }
  return row_;
}

const Row& Experiment::control(const Vec2& i_dq_ref, double theta_e, double omega_e) {
  const double delay = facts().delay_ticks + 0.5;
  const double omega_c = kTwoPi / (25 * T_s()) * 1.5 / delay;
  const double k_p = omega_c * L_, k_i = k_p * omega_c / 8;
  const Vec2 error = i_dq_ref - park(row_.i, theta_e);
  Vec2 u = k_p * error + integral_ + times_j(omega_e * L_ * i_dq_ref);
  const double limit = kVoltageUse * u_max();
  if (u.norm() > limit)
    u *= limit / u.norm();  // the integral waits
  else
    integral_ += T_s() * (k_i * error + omega_e * k_p * times_j(error));
  return apply(inverse_park(u, theta_e + omega_e * delay * T_s()), theta_e);
}

}  // namespace twinrate
