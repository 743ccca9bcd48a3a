// One load mass behind a shaft, from sample to sample.
#pragma once
#include <algorithm>
#include <cmath>

#include "model/effects/shaft.hpp"
#include "model/math.hpp"

namespace twinrate {

// z(h) = Phi z(0) of d'' + 2 sigma d' + omega_0^2 d = 0, z = [d, d'].
struct Oscillation {
  double Phi_dd = 1, Phi_dr = 0, Phi_rd = 0, Phi_rr = 1;

  static Oscillation of(const ShaftFacts& shaft, double h) {
    const double sigma = 0.5 * shaft.damping / shaft.J_load;
    const double omega_0_sq = shaft.stiffness / shaft.J_load;
    const double omega_sq = omega_0_sq - sigma * sigma, omega = std::sqrt(std::abs(omega_sq));
    double c = 1, s = h;  // cos(omega h), sin(omega h)/omega, times exp(-sigma h)
    if (omega * h < 1e-6) {
      c = math::exp(-sigma * h);
      s = c * h;
    } else if (omega_sq > 0) {
      const double decay = math::exp(-sigma * h);
      const auto [sine, cosine] = math::sincos(omega * h);
      c = decay * cosine;
      s = decay * sine / omega;
    } else {
      const double slow = math::exp((omega - sigma) * h), fast = math::exp(-(omega + sigma) * h);
      c = 0.5 * (slow + fast);
      s = 0.5 * (slow - fast) / omega;
    }
    return {c + sigma * s, s, -omega_0_sq * s, c - sigma * s};
  }
};

// Which flank carries: 0 none. Without a gap the shaft always does (1).
enum class Contact : int { kLower = -1, kNone = 0, kUpper = 1 };

class LoadMass {
 public:
  LoadMass(const ShaftFacts& shaft, double T_s, const ShaftState& start)
      : shaft_(shaft),
        T_s_(T_s),
        half_(0.5 * shaft.gap),
        compliance_(1 / shaft.stiffness),
        per_J_(1 / shaft.J_load),
        whole_(Oscillation::of(shaft, T_s)),
        x_(start) {}

  // Advances one sample. The motor has the speed `omega_m` at its beginning and the acceleration
  // `omega_rate`; the load is `T_load`. Relative to the motor it is T_load + J_load omega_rate.
  void advance(double omega_m, double omega_rate, double T_load) {
    const double held = T_load + shaft_.J_load * omega_rate;
    Twist x{x_.delta, omega_m - x_.omega_load};
    if (half_ <= 0)
      x = carried(x, 0, whole_, held);
    else
      across(x, held);
    x_ = {x.delta, omega_m + T_s_ * omega_rate - x.rate};
  }
  const ShaftState& state() const { return x_; }
  void set_state(const ShaftState& x) { x_ = x; }
  double torque(double omega_m) const {
    return shaft_torque(shaft_, x_.delta, omega_m - x_.omega_load);
  }

 private:
  static constexpr int kMostChanges = 4;  // of contact within a sample

  // Of the shaft: delta and its rate.
  struct Twist {
    double delta, rate;
  };

  // A sample on with a gap.
  void across(Twist& x, double held) const {
    double left = T_s_;
    Contact contact = contact_at(x);
    for (int change = 0; change < kMostChanges && left > 0; ++change) {
      const Twist end = moved(x, contact, left, held);
      const double margin_end = margin(end, contact);
      if (margin_end >= 0) {
        x = end;
        return;
      }
      const double share = crossing(x, contact, left, margin_end, held);
      x = moved(x, contact, share * left, held);
      left *= 1 - share;
      contact = contact != Contact::kNone ? Contact::kNone
                : x.delta > 0             ? Contact::kUpper
                                          : Contact::kLower;
    }
    x = moved(x, contact, left, held);
  }
  // On a flank at `at`: an oscillation about the twist that holds the load.
  Twist carried(const Twist& x, double at, const Oscillation& Phi, double held) const {
    const double rest = at + held * compliance_, d = x.delta - rest;
    return {rest + Phi.Phi_dd * d + Phi.Phi_dr * x.rate, Phi.Phi_rd * d + Phi.Phi_rr * x.rate};
  }
  Twist moved(const Twist& x, Contact contact, double h, double held) const {
    if (contact != Contact::kNone) {
      const double at = static_cast<int>(contact) * half_;
      return carried(x, at, h == T_s_ ? whole_ : Oscillation::of(shaft_, h), held);
    }
    const double parting = held * per_J_;
    return {x.delta + h * x.rate + 0.5 * h * h * parting, x.rate + h * parting};
  }
  Contact contact_at(const Twist& x) const {
    const double T = shaft_torque(shaft_, x.delta, x.rate);
    return T > 0 ? Contact::kUpper : T < 0 ? Contact::kLower : Contact::kNone;
  }
  // Negative if the contact has changed: the flank would pull, or the gap has closed.
  double margin(const Twist& x, Contact contact) const {
    const int side = static_cast<int>(contact);
    if (contact != Contact::kNone)
      return side * (x.delta - side * half_) * shaft_.stiffness + side * shaft_.damping * x.rate;
    const double beyond = std::abs(x.delta) - half_;
    const double pressing =
        shaft_.stiffness * beyond + shaft_.damping * std::copysign(x.rate, x.rate * x.delta);
    return -std::min(beyond, pressing);
  }
  // Share of `left` after which the margin is gone: regula falsi, two rounds.
  double crossing(const Twist& x, Contact contact, double left, double margin_end,
                  double held) const {
    double lo = 0, hi = 1, margin_lo = std::max(0.0, margin(x, contact));
    double share = 0;
    for (int round = 0; round < 2; ++round) {
      share = lo + (hi - lo) * margin_lo / (margin_lo - margin_end);
      const double there = margin(moved(x, contact, share * left, held), contact);
      if (there > 0) {
        lo = share;
        margin_lo = there;
      } else {
        hi = share;
        margin_end = std::min(there, -1e-300);
      }
    }
    return share;
  }

  ShaftFacts shaft_;
  double T_s_, half_, compliance_, per_J_;
  Oscillation whole_;
  ShaftState x_;
};

}  // namespace twinrate
