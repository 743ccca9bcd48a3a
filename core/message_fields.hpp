// Every message as named fields, in the order of lcmtypes/: for writing messages as numbers and
// texts (export), and for making messages from them (import).
//
// The header (seq, t_ns, session) and the tag are not among the fields. A visitor is called with
//
//   f(name, number)              double, int32_t, int64_t
//   f(name, text)                std::string
//   f(name, array)               int32_t[N], int64_t[N]
//   f(name, array, used_length)  std::vector<double>; the length is an earlier field
#pragma once
#include "core/channels.hpp"

namespace twinrate {

#define TWINRATE_NAMED(name) #name, m.name

template <class Visitor>
void each_field(measurement_t& m, Visitor& f) {
  f(TWINRATE_NAMED(signals));
  f(TWINRATE_NAMED(i_a_A));
  f(TWINRATE_NAMED(i_b_A));
  f(TWINRATE_NAMED(i_c_A));
  f(TWINRATE_NAMED(u_alpha_V));
  f(TWINRATE_NAMED(u_beta_V));
  f(TWINRATE_NAMED(duty_a));
  f(TWINRATE_NAMED(duty_b));
  f(TWINRATE_NAMED(duty_c));
  f(TWINRATE_NAMED(mode));
  f(TWINRATE_NAMED(theta_forced_rad));
  f(TWINRATE_NAMED(v_dc_V));
  f(TWINRATE_NAMED(theta_m_rad));
  f(TWINRATE_NAMED(omega_m_rad_s));
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(truth_t& m, Visitor& f) {
  f(TWINRATE_NAMED(i_d_A));
  f(TWINRATE_NAMED(i_q_A));
  f(TWINRATE_NAMED(omega_m_rad_s));
  f(TWINRATE_NAMED(theta_m_rad));
  f(TWINRATE_NAMED(T_em_Nm));
  f(TWINRATE_NAMED(T_load_Nm));
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(estimate_t& m, Visitor& f) {
  f(TWINRATE_NAMED(gain_seq));
  f(TWINRATE_NAMED(status));
  f(TWINRATE_NAMED(n_x));
  f(TWINRATE_NAMED(n_y));
  f(TWINRATE_NAMED(theta_e_rad));
  f(TWINRATE_NAMED(omega_m_rad_s));
  f(TWINRATE_NAMED(i_d_A));
  f(TWINRATE_NAMED(i_q_A));
  f(TWINRATE_NAMED(T_load_Nm));
  f(TWINRATE_NAMED(dT_load_Nm_s));
  f(TWINRATE_NAMED(x_hat), m.n_x);
  f(TWINRATE_NAMED(innov), m.n_y);
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(gain_t& m, Visitor& f) {
  f(TWINRATE_NAMED(first_use_seq));
  f(TWINRATE_NAMED(n_x));
  f(TWINRATE_NAMED(n_y));
  f(TWINRATE_NAMED(theta_e_rad));
  f(TWINRATE_NAMED(n_K));
  f(TWINRATE_NAMED(K), m.n_K);
  f(TWINRATE_NAMED(n_P));
  f(TWINRATE_NAMED(P), m.n_P);
  f(TWINRATE_NAMED(n_speeds));
  f(TWINRATE_NAMED(at_omega_m_rad_s), m.n_speeds);
  f(TWINRATE_NAMED(n_K_at));
  f(TWINRATE_NAMED(K_at), m.n_K_at);
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(reference_t& m, Visitor& f) {
  f(TWINRATE_NAMED(omega_m_ref_rad_s));
  f(TWINRATE_NAMED(i_d_ref_A));
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(command_t& m, Visitor& f) {
  f(TWINRATE_NAMED(mode));
  f(TWINRATE_NAMED(u_alpha_V));
  f(TWINRATE_NAMED(u_beta_V));
  f(TWINRATE_NAMED(i_d_ref_A));
  f(TWINRATE_NAMED(i_q_ref_A));
  f(TWINRATE_NAMED(i_d_A));
  f(TWINRATE_NAMED(i_q_A));
  f(TWINRATE_NAMED(theta_ctrl_rad));
  f(TWINRATE_NAMED(omega_m_ref_rad_s));
  f(TWINRATE_NAMED(host_ns));
}
template <class Visitor>
void each_field(status_t& m, Visitor& f) {
  f(TWINRATE_NAMED(config_hash));
  f(TWINRATE_NAMED(role));
  f(TWINRATE_NAMED(state));
  f(TWINRATE_NAMED(steps));
  f(TWINRATE_NAMED(repeats));
  f(TWINRATE_NAMED(duplicates));
  f(TWINRATE_NAMED(gaps));
  f(TWINRATE_NAMED(refused));
  f(TWINRATE_NAMED(undecodable));
  f(TWINRATE_NAMED(late_commands));
  f(TWINRATE_NAMED(late_gains));
  f(TWINRATE_NAMED(deadline_misses));
}
template <class Visitor>
void each_field(event_t& m, Visitor& f) {
  f(TWINRATE_NAMED(role));
  f(TWINRATE_NAMED(reason));
  f(TWINRATE_NAMED(waited_for));
  f(TWINRATE_NAMED(text));
}
template <class Visitor>
void each_field(manifest_t& m, Visitor& f) {
  f(TWINRATE_NAMED(schema));
  f(TWINRATE_NAMED(revision));
  f(TWINRATE_NAMED(config_toml));
  f(TWINRATE_NAMED(manifest_json));
}
template <class Visitor>
void each_field(request_t& m, Visitor& f) {
  f(TWINRATE_NAMED(kind));
  f(TWINRATE_NAMED(value));
  f(TWINRATE_NAMED(text));
}
template <class Visitor>
void each_field(reply_t& m, Visitor& f) {
  f(TWINRATE_NAMED(role));
  f(TWINRATE_NAMED(accepted));
  f(TWINRATE_NAMED(applied_seq));
  f(TWINRATE_NAMED(text));
}
template <class Visitor>
void each_field(ack_t& m, Visitor& f) {
  f(TWINRATE_NAMED(n_missing));
  f(TWINRATE_NAMED(missing_channel));
  f(TWINRATE_NAMED(missing_seq));
}

#undef TWINRATE_NAMED

}  // namespace twinrate
