// Checks from the signals of the controller that the estimate turns with the rotor.
//
// EMF consistency, in the estimated rotor axes:
//
//   e_d = u_d - R_s i_d + omega_e L_q i_q              0 in synchronism
//   e_q = u_q - R_s i_q - omega_e L_d i_d              omega_e psi_f in synchronism
//   r   = |LP(e_dq - [0; omega_e psi_f])|/(psi_f max(|omega_e|, omega_min))
//
// Innovation, of the first two outputs (currents):
//
//   nis   = LP(|innov|^2)/(2 innovation_A^2)
//   share = sqrt(LP(|innov|^2))/(T_s psi_f max(|omega_e|, omega_min)/L_q)
//
// share: part of the EMF that one tick leaves unexplained. An angle error delta leaves 2
// sin(delta/2), 1.4 at 90 deg; the limit is kShare. A load step unknown to the filter makes
// innovations far above the noise, at a small share: on dilys2021 a step of half the rated load
// keeps nis above 10 for 15 ms, at a share that does not stay above 0.24 for 10 ms; in a stall with
// foc it stays above 1 for 15 ms.
//
// LP is a first-order low-pass. Synchronism is lost if r > emf_limit, or nis > nis_limit and share
// > kShare, without interruption for t_lost_s; the controller then reports lost_synchronism and
// reacts. Near standstill r contains little information; there the innovation decides.
#pragma once
#include "model/fields.hpp"
#include "model/machine.hpp"
#include "model/signals.hpp"

namespace twinrate {

// The reaction to a loss: controller/watched.hpp.
enum class SyncLost : int { kOff = 0, kStop = 1 };
inline constexpr const char* kSyncLostNames[] = {"off", "stop"};

struct SynchronismParameters {
  bool watch = false;
  SyncLost reaction = SyncLost::kOff;
  double emf_limit = 0.6, innovation = 0.02, nis_limit = 10;
  double lowpass_Hz = 30, t_lost = 0.01, t_find = 0.5, omega_e_min = 50;
  void fields(FieldVisitor& f) {
    f.boolean("watch", watch, "watch the synchronism; a loss leads to an event and the reaction");
    f.choice("reaction", reaction, kSyncLostNames,
             "off: safe mode, zero voltage; stop: a current vector that comes to rest first");
    f.number("emf_limit", emf_limit, 0.05, 10, "limit of the EMF residual over the expected EMF");
    f.number("innovation_A", innovation, 1e-6, 1e3,
             "rms of a current innovation, for its normalisation");
    f.number("nis_limit", nis_limit, 0.1, 1e6, "limit of the normalised innovation squared");
    f.number("lowpass_Hz", lowpass_Hz, 0.1, 5000,
             "cut-off of the low-pass of residual and innovation");
    f.number("t_lost_s", t_lost, 0, 10, "time beyond a limit after which synchronism is lost");
    f.number("t_find_s", t_find, 0, 100, "t_lost_s before the first agreement of the estimate");
    f.number("omega_e_min_rad_s", omega_e_min, 0.1, 1e5,
             "smallest electrical speed in the expected EMF");
  }
};

class Synchronism {
 public:
  static constexpr double kShare = 0.5;
  Synchronism(const SynchronismParameters& p, const MachineParameters& machine, double T_s);
  // One tick in mode run; true if synchronism is lost. u_dq: applied over the last period.
  bool lost(const Estimate& e, const Vec2& i_dq, const Vec2& u_dq, double omega_e);
  // The mode has changed: restart.
  void reset();

  double emf_residual() const { return r_; }
  double nis() const { return innov2_ / (2 * p_.innovation * p_.innovation); }
  // Which of the two it was, for an event.
  const char* text(bool stops) const;
  bool by_emf() const { return r_ > p_.emf_limit; }

 private:
  SynchronismParameters p_;
  MachineParameters machine_;
  double T_s_, share_;
  Vec2 residual_ = Vec2::Zero();
  double innov2_ = 0, share_of_emf_ = 0, r_ = 0, t_beyond_ = 0, t_within_ = 0;
  bool found_ = false;  // the estimate has agreed once
};

}  // namespace twinrate
