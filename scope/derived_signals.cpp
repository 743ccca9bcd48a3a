// The signals that the scope derives from those of the messages.
#include <cmath>
#include <stdexcept>
#include <string>

#include "scope/recording.hpp"

namespace twinrate::scope {

// The derived signals are added first, so that their columns are the same in every recording.
void Recording::add_derived_signals() {
  signals_ = {};
  const auto message = [this](Channel channel, const char* wire) {
    const MessageLayout& layout = layout_of(channel);
    for (std::size_t i = 0; i < layout.fields.size(); ++i)
      if (layout.fields[i].wire == wire)
        return signals_.of_message(channel, "", static_cast<int>(i), 0);
    throw std::runtime_error(layout.short_name + ": no field " + wire);
  };
  const auto derived = [this](const char* name, const char* unit, const char* comment) {
    return signals_.add({std::string("drive.") + name, unit, comment, true});
  };
  inputs_ = {.est_theta = message(Channel::kEstimate, "theta_e_rad"),
             .est_omega = message(Channel::kEstimate, "omega_m_rad_s"),
             .truth_theta = message(Channel::kTruth, "theta_m_rad"),
             .truth_omega = message(Channel::kTruth, "omega_m_rad_s"),
             .u_alpha = message(Channel::kMeasurement, "u_alpha_V"),
             .u_beta = message(Channel::kMeasurement, "u_beta_V"),
             .v_dc = message(Channel::kMeasurement, "v_dc_V"),
             .i_a = message(Channel::kMeasurement, "i_a_A"),
             .i_b = message(Channel::kMeasurement, "i_b_A"),
             .i_c = message(Channel::kMeasurement, "i_c_A")};
  derived_ = {
      .angle_error =
          derived("angle_error_rad", "rad",
                  "wrap(theta_e_hat - n_p theta_m) of estimate and truth of the same tick"),
      .speed_error =
          derived("speed_error_rad_s", "rad/s",
                  "omega_m_hat - omega_m of estimate and truth of the same tick, mechanical"),
      .u_d = derived(
          "u_d_V", "V",
          "voltage applied t_{k-1} .. t_k, in the frame of the estimate at the middle of it"),
      .u_q = derived(
          "u_q_V", "V",
          "voltage applied t_{k-1} .. t_k, in the frame of the estimate at the middle of it"),
      .u_abs = derived("u_abs_V", "V", "amplitude of the voltage applied t_{k-1} .. t_k"),
      .u_limit =
          derived("u_limit_V", "V", "v_dc / sqrt 3: the largest amplitude without overmodulation"),
      .i_alpha = derived("i_alpha_A", "A", "measured currents, stationary frame"),
      .i_beta = derived("i_beta_A", "A", "measured currents, stationary frame"),
      .theta_e = derived("theta_e_rad", "rad", "n_p times the true mechanical angle, 0 .. 2 pi")};
}

void Recording::derive(Channel channel, std::int64_t k) {
  if (channel == Channel::kEstimate || channel == Channel::kTruth) derive_pair(k);
  if (channel == Channel::kEstimate || channel == Channel::kMeasurement) derive_voltage(k);
  if (channel != Channel::kMeasurement) return;
  const double i_a = store_.at(inputs_.i_a, k), i_b = store_.at(inputs_.i_b, k),
               i_c = store_.at(inputs_.i_c, k);
  put(derived_.i_alpha, k, 2.0 / 3 * (i_a - i_b / 2 - i_c / 2));
  put(derived_.i_beta, k, (i_b - i_c) / std::sqrt(3.0));
}

void Recording::derive_pair(std::int64_t k) {
  const double theta_m = store_.at(inputs_.truth_theta, k);
  if (std::isnan(theta_m)) return;
  const double theta_e = drive_.n_p * theta_m;
  if (drive_.n_p > 0)
    put(derived_.theta_e, k, theta_e - 2 * M_PI * std::floor(theta_e / (2 * M_PI)));
  const double theta_e_hat = store_.at(inputs_.est_theta, k);
  if (std::isnan(theta_e_hat)) return;
  if (drive_.n_p > 0) put(derived_.angle_error, k, std::remainder(theta_e_hat - theta_e, 2 * M_PI));
  put(derived_.speed_error, k, store_.at(inputs_.est_omega, k) - store_.at(inputs_.truth_omega, k));
}

void Recording::derive_voltage(std::int64_t k) {
  const double u_alpha = store_.at(inputs_.u_alpha, k), u_beta = store_.at(inputs_.u_beta, k);
  put(derived_.u_abs, k, std::hypot(u_alpha, u_beta));
  put(derived_.u_limit, k, store_.at(inputs_.v_dc, k) / std::sqrt(3.0));
  const double middle = store_.at(inputs_.est_theta, k) -
                        0.5 * drive_.n_p * store_.at(inputs_.est_omega, k) * drive_.T_s;
  if (drive_.n_p == 0 || std::isnan(middle) || std::isnan(u_alpha)) return;
  const double c = std::cos(middle), s = std::sin(middle);
  put(derived_.u_d, k, c * u_alpha + s * u_beta);
  put(derived_.u_q, k, -s * u_alpha + c * u_beta);
}

}  // namespace twinrate::scope
