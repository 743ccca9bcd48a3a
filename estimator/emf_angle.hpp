// Angle and speed from an estimated back-EMF, the processing that Kim et al. put around their
// filter. It runs every `divider` ticks (T_est = divider T_s, the paper's speed loop) and
// extrapolates between.
//
//   theta_emf = atan2(-e_alpha, e_beta)                                                  (28), (29)
//   direction = -1 where theta_emf, unwrapped, went back since the last interval, else +1
//   theta_hat = theta_emf, + pi where direction = -1                                           (30)
//   omega_e   = direction |e|/psi            (speed_from = emf)                          (31), (33)
//             = (theta_emf change)/T_est     (speed_from = angle_rate)                         (32)
//   omega_f   = first-order low-pass of omega_e, bilinear, cut-off a                           (34)
//   theta_e  += change towards theta_hat, at most max(2 |omega_f| T_est, floor)          (36)-(38)
//   theta_e(k) = theta_e + j T_s omega_e,  j ticks after the interval's first                  (39)
//
// psi is psi_f as printed, or psi_f + (L_d - L_q) i_d (saliency_in_speed). As printed, (30) adds pi
// at standstill and (36) is zero there, so that the angle freezes: hence the strict sign and the
// floor. Pure: state in, state out. Source: Kim, Yoon, Kook, section 4.
#pragma once
#include <algorithm>

#include "model/fields.hpp"
#include "model/frames.hpp"

namespace twinrate {

enum class SpeedFrom : int { kEmf = 0, kAngleRate = 1 };
inline constexpr const char* kSpeedFromNames[] = {"emf", "angle_rate"};

struct EmfAngleParameters {
  int divider = 5;
  SpeedFrom speed_from = SpeedFrom::kEmf;
  bool saliency_in_speed = false;
  double lowpass_Hz = 100;
  double limit_floor = 0.02;
  bool limit = true;
  void fields(FieldVisitor& f) {
    f.integer("divider", divider, 1, 100, "control ticks of one speed interval");
    f.choice("speed_from", speed_from, kSpeedFromNames,
             "speed from the length of the EMF, (33), or from the rate of its angle, (32)");
    f.boolean("saliency_in_speed", saliency_in_speed,
              "divide the length of the EMF by psi_f + (L_d - L_q) i_d instead of psi_f");
    f.number("lowpass_Hz", lowpass_Hz, 0.1, 1e4, "cut-off of the low-pass of the speed, (34)");
    f.boolean("limit", limit, "limit the change of the angle per interval, (36)-(38)");
    f.number("limit_floor_rad", limit_floor, 0, 3.2,
             "smallest limit of the change of the angle; 0: the angle freezes at standstill, as "
             "printed");
  }
};

// What it remembers from interval to interval; part of FastState.
struct EmfAngle {
  int ticks = 0;         // since the interval's first tick
  double theta_emf = 0;  // (29) at that tick
  double theta_e = 0;    // (38)
  double omega_e = 0;    // (33)
  double omega_f = 0;    // (34)

  // (39)
  double theta_now(double T_s) const { return wrap_turn(theta_e + ticks * T_s * omega_e); }
};

inline EmfAngle emf_angle_at(double theta_e, double omega_e) {
  const double theta = wrap_turn(theta_e);
  return {.theta_emf = omega_e < 0 ? wrap_turn(theta + kPi) : theta,
          .theta_e = theta,
          .omega_e = omega_e,
          .omega_f = omega_e};
}

// One tick; `psi` is the flux that (33) divides by.
inline EmfAngle emf_angle_step(EmfAngle s, const EmfAngleParameters& p, const Vec2& e_alphabeta,
                               double psi, double T_s) {
  if (++s.ticks < p.divider) return s;
  const double T_est = p.divider * T_s, aT = kTwoPi * p.lowpass_Hz * T_est;
  const double theta_emf = std::atan2(-e_alphabeta[0], e_alphabeta[1]);
  const double change = wrap_pi(theta_emf - s.theta_emf);
  const double direction = change < 0 ? -1 : 1;
  const double theta_hat = direction < 0 ? theta_emf + kPi : theta_emf;
  const double omega_e =
      p.speed_from == SpeedFrom::kEmf ? direction * e_alphabeta.norm() / psi : change / T_est;
  const double omega_f = (2 - aT) / (2 + aT) * s.omega_f + aT / (2 + aT) * (omega_e + s.omega_e);
  double step = wrap_pi(theta_hat - s.theta_e);
  if (p.limit) {
    const double limit = std::max(2 * std::abs(omega_f) * T_est, p.limit_floor);
    step = std::clamp(step, -limit, limit);
  }
  return {.ticks = 0,
          .theta_emf = theta_emf,
          .theta_e = wrap_turn(s.theta_e + step),
          .omega_e = omega_e,
          .omega_f = omega_f};
}

}  // namespace twinrate
