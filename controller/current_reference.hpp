// The currents for a torque: maximum torque per ampere, current limit, field weakening.
//
// MTPA, with dL = L_q - L_d; I_s is the signed peak current:
//
//   i_d     = [psi_f - sqrt(psi_f^2 + 8 dL^2 I_s^2)]/(4 dL)          0 where dL = 0
//   i_q     = sign(I_s) sqrt(I_s^2 - i_d^2)
//
// Field weakening, with u_max = v_dc/sqrt3; |u_ref| is the voltage requested by the current loop,
// before its limit:
//
//   i_d_fw' = -omega_fw/(max(|omega_e|, omega_0) L_d) (|u_ref| - margin u_max)
//   i_d     = i_d + i_d_fw                             -i_max <= i_d_fw <= 0
//
// Limit:
//
//   |i_dq| <= i_max                                    i_d has precedence, because it holds the
//                                                      voltage: i_q is reduced
//
// omega_fw = 2 pi field_weakening_bandwidth_Hz. omega_0 = u_max/(2 psi_f): below this speed i_d
// hardly lowers the voltage.
// Source: Kim, Yoon, Kook, section 5 (MTPA); Kim, Sul, voltage feedback field weakening.
#pragma once
#include "model/fields.hpp"
#include "model/frames.hpp"
#include "model/machine.hpp"

namespace twinrate {

Vec2 mtpa(const MachineParameters& machine, double I_s);
// The I_s whose MTPA point has this i_q.
double mtpa_amplitude(const MachineParameters& machine, double i_q);

// The I_s whose MTPA point has this torque.
double mtpa_for_torque(const MachineParameters& machine, double T);

enum class CurrentAngle : int { kReference = 0, kMtpa = 1 };
inline constexpr const char* kCurrentAngleNames[] = {"reference", "mtpa"};

struct FieldWeakeningParameters {
  bool active = false;
  double margin = 0.97;
  double bandwidth_Hz = 20;
  void fields(FieldVisitor& f) {
    f.boolean("field_weakening", active,
              "keep the voltage within its limit by a negative i_d, above base speed");
    f.number("voltage_margin", margin, 0.5, 1,
             "fraction of v_dc/sqrt3 at which field weakening begins");
    f.number("field_weakening_bandwidth_Hz", bandwidth_Hz, 0.1, 500,
             "bandwidth of the field-weakening loop");
  }
};

class FieldWeakening {
 public:
  FieldWeakening(const FieldWeakeningParameters& p, const MachineParameters& machine, double i_max,
                 double T_s);
  double i_d() const { return i_d_; }
  // `u_ref`: amplitude requested in this tick.
  void update(double u_ref, double u_max, double omega_e);

 private:
  FieldWeakeningParameters p_;
  double L_d_, psi_f_, i_max_, T_s_;
  double i_d_ = 0;
};

// Within the limit: i_d_extra (field weakening) has precedence over i_q, i_d_fade (left from a
// start) gives way to it.
Vec2 limit_current(const Vec2& i_dq_wanted, double i_d_extra, double i_d_fade, double i_max);

}  // namespace twinrate
