// Agreement of a filter with itself: with the EMF from voltages and currents, and with its own
// innovations. Until then the background computes a gain every tick (rates.n_from = "locked").
//
// The flux of a salient machine is L_q i plus a vector on the d axis, so its EMF, over one period in
// the axes that the estimate gives the middle of the period, is
//
//   e     = R(-theta_mid) [u - R_s (i_k + i_{k-1})/2 - L_q (i_k - i_{k-1})/T_s]
//         = [0; omega_e psi_a],  psi_a = psi_f + (L_d - L_q) i_d          if the angle is right
//
// The innovation of the currents as a voltage in the same axes:
//
//   v     = [L_d innov_d; L_q innov_q]/T_s
//
// Both are averaged over one electrical turn of the estimate:
//
//   r_emf   = |mean(e) - [0; mean(omega_e psi_a)]|/|mean(omega_e psi_a)|
//   r_innov = |mean(v)|/|mean(omega_e psi_a)|
//
// Agreement: both at most kResidualMax in one turn. 0.3 is an angle of 17 deg. The mirrored state
// (theta_e + pi, -omega_e) has the EMF of the true one, but it turns the other way: over a turn its
// mean is zero, r_emf is 1. A filter whose angle is measured agrees at its first sample.
#pragma once
#include "model/machine.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Of the event gain_every_nth.
inline constexpr const char* kAgreedText =
    "the filter agrees with itself: a gain every n ticks from now on";

class Agreement {
 public:
  static constexpr double kResidualMax = 0.3;
  // `innov_turns`: the innovations are in the stationary frame.
  Agreement(const MachineParameters& machine, bool innov_turns, double T_s)
      : machine_(machine), innov_turns_(innov_turns), T_s_(T_s) {}

  // One tick, with the sample that the estimate belongs to. True from the agreement on.
  bool step(const Estimate& e, const Measurement& m);
  void reset();

 private:
  void add(const Estimate& e, const Vec2& i, const Vec2& u_alphabeta);
  bool agrees() const;
  void begin_turn();

  MachineParameters machine_;
  bool innov_turns_;
  double T_s_;
  bool agreed_ = false, has_sample_ = false;
  Vec2 i_before_ = Vec2::Zero();
  double theta_e_before_ = 0;
  double turned_ = 0, expected_ = 0;  // over the present turn: rad, and sums, V
  Vec2 emf_ = Vec2::Zero(), unexplained_ = Vec2::Zero();
};

}  // namespace twinrate
