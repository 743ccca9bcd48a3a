// Angle and speed from an estimated back-EMF, as Kim et al. process the output of their filter. It
// runs every `divider` ticks (T_est = divider T_s, the speed loop of the paper) and extrapolates in
// between.
//
// Interval n:
//
//   theta_emf(n) = atan2(-e_alpha, e_beta)                                               (28), (29)
//   change       = wrap(theta_emf(n) - theta_emf(n-1))           in (-pi, pi]
//   direction    = -1 where change < 0, else +1
//   theta_hat    = theta_emf(n) + pi where direction = -1, else theta_emf(n)                  (30)*
//   omega_e(n)   = direction |e|/psi                             speed_from = "emf"    (31)*, (33)*
//                = change/T_est                                  speed_from = "angle_rate"    (32)*
//   omega_f(n)   = (2 - a T_est)/(2 + a T_est) omega_f(n-1)
//                  + a T_est/(2 + a T_est) [omega_e(n) + omega_e(n-1)]                         (34)
//   limit        = max(2 |omega_f(n)| T_est, limit_floor)                               (36)*, (37)
//   theta_e(n)   = theta_e(n-1) + wrap(theta_hat - theta_e(n-1)) within +-limit                (38)
//
// Tick j of interval n:
//
//   theta_e      = theta_e(n) + j T_s omega_e(n)                                               (39)
//
// a = 2 pi lowpass_Hz. psi = psi_f as printed, or psi_f + (L_d - L_q) i_d (saliency_in_speed).
// An asterisk marks an equation whose printed form is wrong: (30) adds pi at standstill, too; (31)
// and (33) divide by psi_f alone; (32) divides by T_s; (36) is zero at standstill and freezes the
// angle, hence limit_floor.
// Pure: state in, state out. Source: Kim, Yoon, Kook, section 4.
#pragma once
#include <algorithm>

#include "model/fields.hpp"
#include "model/frames.hpp"
#include "model/math.hpp"

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

// The memory from interval to interval; part of FastState.
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
  const double theta_emf = math::atan2(-e_alphabeta[0], e_alphabeta[1]);
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
