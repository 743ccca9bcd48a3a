// State feedback of the drive after decoupling, axis by axis: model and design of the gains.
//
// d axis, x = [i_d, p_id]:
//
//   L_d i_d'   = -R_s i_d + K_pp u                                                       (31), (37)
//   p_id'      = i_d - i_d_ref                                                                 (35)
//
// q axis, x = [i_q, omega_m, p_omega]:
//
//   L_q i_q'   = -R_s i_q + K_pp u                                                       (31), (37)
//   J omega_m' = K_t i_q - T_o                                                           (31), (37)
//   p_omega'   = omega_m - omega_m_ref                                                         (36)
//
// Control law, u normalised by K_pp (V):
//
//   u    = -K x - K_ff T_o                                                                     (38)
//   K_ff = -(R_s/K_pp + K_iq)/K_t                                                             (41)*
//
// * K_ff is negative: a positive load asks for more voltage. The paper prints +0.078 with the sign
// of (38).
// The gains are given, or come from weights by lqrd. Weights are numbers, largest deviations
// (Bryson: Q = 1/deviation^2), or bandwidths: the wanted closed-loop poles, from which the weights
// follow in closed form by the symmetric root locus (see weights_of_bandwidths).
// Source: Niewiara 2020, corrected.
#pragma once
#include <string>
#include <vector>

#include "controller/riccati.hpp"
#include "model/machine.hpp"

namespace twinrate {

enum class GainSource : int { kGiven = 0, kNumbers = 1, kDeviations = 2, kBandwidths = 3 };
inline constexpr const char* kGainSourceNames[] = {"given", "weights", "deviations", "bandwidths"};

struct LqrDesignParameters {
  GainSource gains = GainSource::kGiven;
  double K_d[2] = {0.22, 8.14};        // (40): i_d, p_id
  double K_q[3] = {0.08, 0.06, 4.05};  // (40): i_q, omega_m, p_omega
  double Q_d[2] = {0.063, 82.5}, R_d = 1;
  double Q_q[3] = {5.55e-3, 1.35e-4, 17.7}, R_q = 1;
  double deviation_d[3] = {4, 0.11, 1};         // i_d, p_id, u_d
  double deviation_q[4] = {13.4, 86, 0.24, 1};  // i_q, omega_m, p_omega, u_q
  double bandwidth_d_Hz[2] = {300, 5};          // current, integral
  double bandwidth_q_Hz[3] = {150, 10, 5};      // current, speed, integral
  void fields(FieldVisitor& f);
};

// One axis, designed or taken over.
struct AxisDesign {
  std::vector<std::string> states;
  Eigen::MatrixXd A, B;  // continuous
  Eigen::VectorXd Q;     // diagonal weights; empty if gains are given
  double R = 1;
  DiscreteLqrProblem problem;  // A_d, B_d always; the cost only with weights
  Eigen::RowVectorXd K;
  double residual = 0;
  int iterations = 0;
  std::vector<std::complex<double>> poles;  // of z
  std::vector<std::string> complaints;      // inconsistencies; empty if there are none
};

struct LqrDesign {
  AxisDesign d, q;
  double K_pp = 0, K_ff = 0;
};

// Never throws: `complaints` reports an axis that cannot be designed; its gains are then zero.
LqrDesign design_lqr(const MachineParameters& machine, double v_dc, double T_s,
                     const LqrDesignParameters& p);

// Of the axis' own loop, with `delay` samples in it: 20,000 frequencies, some 10 ms.
Margins margins_of(const AxisDesign& axis, int delay, double T_s);

// Diagonal weights that come nearest to given gains, each gain's relative error counted alike:
// the inverse question, which has no exact answer for most gains.
struct NearestWeights {
  Eigen::VectorXd Q;
  Eigen::RowVectorXd K;      // of these weights
  double largest_error = 0;  // relative
};
NearestWeights nearest_weights(const AxisDesign& axis, double T_s);

// The Q (for R = 1) whose continuous optimum has its poles at -2 pi f_i: from a(s)a(-s) + sum Q_i
// b_i(s)b_i(-s) = product(omega_i^2 - s^2). A negative entry means that the requested poles are
// slower together than the open loop.
Eigen::VectorXd weights_of_bandwidths(const AxisDesign& axis, const std::vector<double>& f_Hz);

}  // namespace twinrate
