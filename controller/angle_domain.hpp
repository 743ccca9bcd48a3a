// Adaptive feed-forward in the mechanical angle: it learns the torque that smooths the speed, order
// by order.
//
//   T_ff(theta_m) = Re sum_N c_N e^{jN theta_m},  N = 1 .. 60        Nm, adds to T_em
//   u_ff          = Re sum_N g(jN omega_m) c_N e^{jN theta_m(t + T_d)}
//   g(s)          = Z(s)/(K_pp K_t)
//   Z(s)          = R_s + s L_q + K_pp K_iq e^{-s T_d}
//
// T_d is the time from a sample to the middle of the interval in which its voltage acts. 1/g(s) is
// the response of the current loop from voltage to torque.
//
// It learns in blocks of whole turns at constant speed. The first turn of a block settles; the next
// one is measured:
//
//   E_N  = 2/T integral (omega_m - omega_m_ref) e^{-jN theta_m} dt
//   c_N -= k_N E_N/H(jN omega_m)
//
// k_N is a Kalman gain: large while E_N exceeds the noise, then 1/m after m blocks. H is the
// response of the closed loop from T_ff to the speed:
//
//   H(s) = kappa(f)/(J s + B + K_t K_pp e^{-s T_d} (K_omega + K_p/s)/Z(s))
//
// kappa starts at 1. It is identified on line, from the change of E_N that the last change of c_N
// caused, on a grid of frequencies, so that it holds at other speeds, too. A wrong inertia, or a
// dead time that acts as a resistance, shows in kappa. A block in which the load stepped, seen by
// its mean speed error, is discarded.
//
// Source: own; the observer of Niewiara 2020 takes the periodic torque for a random constant
// (docs/theory/angle-domain.md). Speed and angle are those of the position sensor: its eccentricity
// is imprinted on the shaft.
#pragma once
#include <array>
#include <complex>
#include <string>

#include "model/fields.hpp"
#include "model/machine.hpp"

namespace twinrate {

inline constexpr int kCompensatedOrders = 60;

struct AngleDomainParameters {
  bool learn = true;
  int highest_order = kCompensatedOrders;
  double rate = 0.8;
  std::array<double, kCompensatedOrders> cos_Nm{}, sin_Nm{};  // of orders 1 .. 60
  void fields(FieldVisitor& f);
};

// The closed loop in which the feed-forward acts.
struct LoopModel {
  double R_s = 0, L_q = 0, K_t = 0, J = 0, B = 0;
  double K_pp = 0, K_iq = 0, K_omega = 0, K_p = 0;
  double T_d = 0;  // from a sample to the middle of the voltage that it determines
  std::complex<double> voltage_for_torque(double omega) const;  // g(j omega), normalised u per Nm
  std::complex<double> speed_for_torque(double omega) const;    // H(j omega) with kappa = 1
};

class AngleDomain {
 public:
  using Complex = std::complex<double>;

  AngleDomain(const AngleDomainParameters& p, const LoopModel& loop, double T_s);

  // One tick: returns the normalised voltage to add to u_q. `theta_m` is the sensor's angle at t_k.
  double step(double theta_m, double omega_m_ref);
  // Forgets the sample before; the next step starts a new block.
  void restart() { running_ = false; }

  // The table learnt so far, in the form of the config.
  AngleDomainParameters learnt() const;
  int blocks() const { return blocks_; }  // measured and used
  Complex kappa(double omega) const;      // identified correction of H at a frequency

 private:
  static constexpr int kBins = 64;  // of frequency, four an octave from 0.05 Hz on
  using Orders = std::array<Complex, kCompensatedOrders>;

  void begin_block(double theta_m, double omega_m_ref);
  void measure(double theta_mid, double error);
  void end_block();
  void identify(const Orders& E, const std::array<double, kCompensatedOrders>& noise2);
  void learn(const Orders& E, const std::array<double, kCompensatedOrders>& noise2);
  double output(double theta_m, double omega_m_ref);
  Complex response(int N) const;  // H with kappa at the speed of the block

  AngleDomainParameters p_;
  LoopModel loop_;
  double T_s_;
  Orders c_{}, c_change_{}, E_last_{};
  Orders sum_{};
  double sum_error_ = 0, time_ = 0, mean_last_ = 0;
  std::array<double, kCompensatedOrders> P_{};  // variance of the error of c_N, Nm^2
  std::array<double, kCompensatedOrders> noise2_{};
  std::array<Complex, kBins> kappa_{};
  std::array<double, kBins> kappa_variance_{};
  Orders g_{};
  double g_speed_ = 0;
  bool running_ = false, measuring_ = false, have_last_ = false, have_mean_ = false;
  double theta_prev_ = 0, theta_begin_ = 0, omega_block_ = 0, t_phase_ = 0;
  int blocks_ = 0;
};

}  // namespace twinrate
