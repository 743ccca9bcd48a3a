#include "estimator/ekf_sensorless.hpp"

#include <complex>

#include "estimator/kernels/riccati_doubling.hpp"
#include "model/math.hpp"

namespace twinrate {

EkfSensorless::EkfSensorless(const MachineParameters& machine,
                             const EkfSensorlessParameters& tuning, Prediction prediction,
                             CovarianceForm covariance, double T_s, double omega_e_start)
    : Ekf({tuning.Q_diag, tuning.R_diag, tuning.P0_diag,
           resolve(covariance, tuning.Q_diag, tuning.R_diag, tuning.P0_diag)}),
      a_(machine.R_s / machine.L_d),
      b_(machine.psi_f / machine.L_d),
      inv_L_(1 / machine.L_d),
      n_p_(machine.n_p),
      T_s_(T_s),
      omega_e_start_(omega_e_start),
      prediction_(prediction),
      constants_(prediction == Prediction::kRk4
                     ? kernel::sensorless_rk4(machine.R_s, machine.L_d, machine.psi_f, T_s)
                     : kernel::sensorless_euler(machine.R_s, machine.L_d, machine.psi_f, T_s)) {}

namespace {

kernel::SensorlessState<double> kernel_state(const EkfSensorless::State& x) {
  return {x[0], x[1], x[2], x[3]};
}
EkfSensorless::State eigen_state(const kernel::SensorlessState<double>& x) {
  return {x.i_alpha, x.i_beta, x.omega_e, x.theta_e};
}
kernel::UnitVector<double> unit_vector(double theta_e) {
  const auto [s, c] = math::sincos(theta_e);
  return {s, c};
}
kernel::Symmetric4<double> kernel_covariance(const Gain& gain) {
  const auto& P = gain.P;
  return {P(0, 0), P(0, 1), P(0, 2), P(0, 3), P(1, 1), P(1, 2), P(1, 3), P(2, 2), P(2, 3), P(3, 3)};
}

}  // namespace

EkfSensorless::State EkfSensorless::f(const State& x, const Vec2& u_alphabeta) const {
  const double i_alpha = x[0], i_beta = x[1], omega_e = x[2];
  const auto at = unit_vector(x[3]);
  return {-a_ * i_alpha + b_ * omega_e * at.sin + inv_L_ * u_alphabeta[0],
          -a_ * i_beta - b_ * omega_e * at.cos + inv_L_ * u_alphabeta[1], 0.0, omega_e};
}

// With omega_e constant over the interval, i = i_alpha + j i_beta and u likewise:
//
//   i' = -a i + u/L - j b omega_e exp(j (theta_e + omega_e t))
static Vec2 exact_currents(const EkfSensorless::State& x, const Vec2& u_alphabeta, double a,
                           double b, double inv_L, double T) {
  using Complex = std::complex<double>;
  const Complex j(0, 1), i0(x[0], x[1]), u(u_alphabeta[0], u_alphabeta[1]);
  const double omega_e = x[2], decay = math::exp(-a * T);
  const Complex forced = (math::polar(1.0, omega_e * T) - decay) / (a + j * omega_e);
  const Complex i =
      decay * i0 + inv_L * u * (1 - decay) / a - j * b * omega_e * math::polar(1.0, x[3]) * forced;
  return {i.real(), i.imag()};
}

EkfSensorless::State EkfSensorless::predict(const State& x, const Vec2& u_alphabeta) const {
  return predict_at(x, unit_vector(x[3]), u_alphabeta);
}

EkfSensorless::State EkfSensorless::predict_at(const State& x, const kernel::UnitVector<double>& at,
                                               const Vec2& u_alphabeta) const {
  const kernel::Stationary<double> u{u_alphabeta[0], u_alphabeta[1]};
  const double theta_e = x[3], turned = x[2] * T_s_;
  switch (prediction_) {
    case Prediction::kEuler:
      return eigen_state(predict_euler(constants_, kernel_state(x), at, u));
    case Prediction::kRk4:
      return eigen_state(predict_rk4(constants_, kernel_state(x), at,
                                     unit_vector(theta_e + 0.5 * turned),
                                     unit_vector(theta_e + turned), u));
    case Prediction::kExact: {
      const Vec2 i = exact_currents(x, u_alphabeta, a_, b_, inv_L_, T_s_);
      return {i[0], i[1], x[2], x[3] + T_s_ * x[2]};
    }
  }
  return x;
}

EkfSensorless::Covariance EkfSensorless::jacobian(const State& x) const {
  const auto g = kernel::jacobian(constants_, x[2], unit_vector(x[3]));
  Covariance F;
  F << constants_.d, 0, g.g02, g.g03,  //
      0, constants_.d, g.g12, g.g13,   //
      0, 0, 1, 0,                      //
      0, 0, T_s_, 1;
  return F;
}

FastState EkfSensorless::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = clarke(first.i_abc);
  state.x_hat[2] = omega_e_start_;
  return state;
}

[[gnu::flatten]] Correction EkfSensorless::fast_step(FastState& state, const Measurement& m,
                                                     const Gain& gain) const {
  return fast_step_of(*this, state, m, gain);
}

EkfSensorless::State EkfSensorless::prior(const FastState& state, const Measurement& m) const {
  const auto [s, c] = state.rotor_axes.of(state.x_hat[3]);
  return predict_at(state.x_hat.head<4>(), {s, c}, m.u_alphabeta);
}

EkfSensorless::Output EkfSensorless::innovation(const State& x_prior, const Measurement& m) const {
  const Vec2 i_alphabeta = clarke(m.i_abc);
  return {i_alphabeta[0] - x_prior[0], i_alphabeta[1] - x_prior[1]};
}

EkfSensorless::State EkfSensorless::wrapped(const State& x) const {
  return {x[0], x[1], x[2], wrap_turn(x[3])};
}

void EkfSensorless::align(FastState& state, double theta_e) const {
  state.x_hat[2] = 0;
  state.x_hat[3] = wrap_turn(theta_e);
}

void EkfSensorless::describe(const FastState& state, const Measurement&, Estimate& e) const {
  const double i_alpha = state.x_hat[0], i_beta = state.x_hat[1];
  const auto [s, c] = state.rotor_axes.of(state.x_hat[3]);
  e.theta_e = state.x_hat[3];
  e.omega_m = state.x_hat[2] / n_p_;
  e.i_dq = park({i_alpha, i_beta}, {s, c});
}

[[gnu::flatten]] void EkfSensorless::output_of_tick(FastState& state, const Measurement& m,
                                                    Estimate& e) const {
  state.rotor_axes = RotorAxes(state.x_hat[3]);
  e.n_x = 4;
  e.n_y = 2;
  e.status = 0;
  e.T_load = e.dT_load_dt = 0;
  describe(state, m, e);
}

static kernel::GainAndCovariance<double> correct_covariance(
    CovarianceForm form, const kernel::Symmetric4<double>& P_prior, const double (&R)[2]) {
  if (form == CovarianceForm::kSequential) return kernel::sequential(P_prior, R);
  const auto K = kernel::gain(P_prior, R);
  return {K, form == CovarianceForm::kPaper ? posterior(P_prior, K, R)
                                            : posterior_joseph(P_prior, K, R)};
}

static void set_gain_of(Gain& gain, const Estimate& snapshot, const kernel::Gain42<double>& K,
                        const kernel::Symmetric4<double>& P) {
  EkfSensorless::GainMatrix K_new;
  K_new << K.k00, K.k01, K.k10, K.k11, K.k20, K.k21, K.k30, K.k31;
  EkfSensorless::Covariance P_new;
  P_new << P.m00, P.m01, P.m02, P.m03,  //
      P.m01, P.m11, P.m12, P.m13,       //
      P.m02, P.m12, P.m22, P.m23,       //
      P.m03, P.m13, P.m23, P.m33;
  set_gain(gain, snapshot, K_new, P_new);
}

[[gnu::flatten]] void EkfSensorless::update_gain(Gain& gain, const Estimate& snapshot) const {
  const auto F = kernel::jacobian(constants_, snapshot.x_hat[2], unit_vector(snapshot.x_hat[3]));
  const auto P_prior = propagate(constants_, F, kernel_covariance(gain), tuning().Q_diag);
  const auto [K, P] = correct_covariance(tuning().form, P_prior, tuning().R_diag);
  set_gain_of(gain, snapshot, K, P);
}

Gain EkfSensorless::background_step(const Gain& previous, const Estimate& snapshot) const {
  Gain gain = previous;
  update_gain(gain, snapshot);
  return gain;
}

std::optional<CovarianceModel> EkfSensorless::covariance_model(const Estimate& snapshot) const {
  return model_of(jacobian(snapshot.x_hat.head<4>()), OutputMatrix(OutputMatrix::Identity()),
                  tuning());
}

Estimate EkfSensorless::ahead(const Estimate& snapshot, double ticks) const {
  const double angle = ticks * T_s_ * snapshot.x_hat[2];
  Estimate e = turned(snapshot, turning_pairs(), angle);
  e.x_hat[3] = e.theta_e = snapshot.x_hat[3] + angle;
  return e;
}

// The Jacobian does not depend on the currents.
std::optional<Estimate> EkfSensorless::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[2] = n_p_ * omega_m;
  return estimate_of(state, {});
}

// In rotor axes P is turned back by omega_e T_s before each step, so F becomes F T(-omega_e T_s).
Gain EkfSensorless::background_steps(const Gain& gain, double omega_m, int ticks) const {
  const Estimate at = *steady_state(omega_m);
  const auto [s, c] = math::sincos(at.x_hat[2] * T_s_);
  Covariance back = Covariance::Identity();
  back.topLeftCorner<2, 2>() << c, s, -s, c;
  kernel::RiccatiMap<4> map{jacobian(at.x_hat.head<4>()) * back, Covariance::Zero(),
                            Eigen::Map<const State>(tuning().Q_diag).asDiagonal()};
  map.G.diagonal().head<2>() << 1 / tuning().R_diag[0], 1 / tuning().R_diag[1];
  const Covariance P = gain.P.topLeftCorner<4, 4>();
  const Covariance P_prior =
      kernel::riccati_steps<4>(map, map.A * P * map.A.transpose() + map.Q, ticks - 1);
  Gain later = gain;
  later.P.topLeftCorner<4, 4>() = P_prior;
  const auto [K, P_posterior] =
      correct_covariance(tuning().form, kernel_covariance(later), tuning().R_diag);
  later = gain;
  set_gain_of(later, at, K, P_posterior);
  return later;
}

}  // namespace twinrate
