// One load mass behind a shaft, from sample to sample.
#pragma once
#include <algorithm>
#include <cmath>

#include "model/effects/shaft.hpp"

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
      c = std::exp(-sigma * h);
      s = c * h;
    } else if (omega_sq > 0) {
      const double decay = std::exp(-sigma * h);
      c = decay * std::cos(omega * h);
      s = decay * std::sin(omega * h) / omega;
    } else {
      const double slow = std::exp((omega - sigma) * h), fast = std::exp(-(omega + sigma) * h);
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

  // One sample on; the motor turns at `omega_m`, the load holds `T_load`.
  void advance(double omega_m, double T_load) {
    if (half_ <= 0) {
      x_ = carried(x_, 0, whole_, omega_m, T_load);
      return;
    }
    double left = T_s_;
    Contact contact = contact_at(x_, omega_m);
    for (int change = 0; change < kMostChanges && left > 0; ++change) {
      const ShaftState end = moved(x_, contact, left, omega_m, T_load);
      const double margin_end = margin(end, contact, omega_m);
      if (margin_end >= 0) {
        x_ = end;
        return;
      }
      const double share = crossing(contact, left, margin_end, omega_m, T_load);
      x_ = moved(x_, contact, share * left, omega_m, T_load);
      left *= 1 - share;
      contact = contact != Contact::kNone ? Contact::kNone
                : x_.delta > 0            ? Contact::kUpper
                                          : Contact::kLower;
    }
    x_ = moved(x_, contact, left, omega_m, T_load);
  }
  const ShaftState& state() const { return x_; }
  void set_state(const ShaftState& x) { x_ = x; }
  double torque(double omega_m) const {
    return shaft_torque(shaft_, x_.delta, omega_m - x_.omega_load);
  }

 private:
  static constexpr int kMostChanges = 4;  // of contact within a sample

  // On a flank at `at`: an oscillation about the twist that holds the load.
  ShaftState carried(const ShaftState& x, double at, const Oscillation& Phi, double omega_m,
                     double T_load) const {
    const double rest = at + T_load * compliance_;
    const double d = x.delta - rest, rate = omega_m - x.omega_load;
    return {rest + Phi.Phi_dd * d + Phi.Phi_dr * rate,
            omega_m - (Phi.Phi_rd * d + Phi.Phi_rr * rate)};
  }
  ShaftState moved(const ShaftState& x, Contact contact, double h, double omega_m,
                   double T_load) const {
    if (contact != Contact::kNone) {
      const double at = static_cast<int>(contact) * half_;
      return carried(x, at, h == T_s_ ? whole_ : Oscillation::of(shaft_, h), omega_m, T_load);
    }
    const double slowing = T_load * per_J_;
    return {x.delta + h * (omega_m - x.omega_load) + 0.5 * h * h * slowing,
            x.omega_load - h * slowing};
  }
  Contact contact_at(const ShaftState& x, double omega_m) const {
    const double T = shaft_torque(shaft_, x.delta, omega_m - x.omega_load);
    return T > 0 ? Contact::kUpper : T < 0 ? Contact::kLower : Contact::kNone;
  }
  // Negative where the contact has changed: the flank would pull; the gap has closed.
  double margin(const ShaftState& x, Contact contact, double omega_m) const {
    const double rate = omega_m - x.omega_load;
    const int side = static_cast<int>(contact);
    if (contact != Contact::kNone)
      return side * (x.delta - side * half_) * shaft_.stiffness + side * shaft_.damping * rate;
    const double beyond = std::abs(x.delta) - half_;
    const double pressing =
        shaft_.stiffness * beyond + shaft_.damping * std::copysign(rate, rate * x.delta);
    return -std::min(beyond, pressing);
  }
  // Share of `left` after which the margin is gone: regula falsi, two rounds.
  double crossing(Contact contact, double left, double margin_end, double omega_m,
                  double T_load) const {
    double lo = 0, hi = 1, margin_lo = std::max(0.0, margin(x_, contact, omega_m));
    double share = 0;
    for (int round = 0; round < 2; ++round) {
      share = lo + (hi - lo) * margin_lo / (margin_lo - margin_end);
      const double there =
          margin(moved(x_, contact, share * left, omega_m, T_load), contact, omega_m);
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
