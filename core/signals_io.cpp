#include "core/signals_io.hpp"

#include <algorithm>

#include "core/decode.hpp"

namespace twinrate {
namespace {

template <class Wire>
Wire header(std::int64_t k, std::int64_t t_ns, std::int64_t session) {
  Wire w{};
  w.seq = k;
  w.t_ns = t_ns;
  w.session = session;
  return w;
}

// Sizes come off the wire: never trust them beyond the arrays they index.
int bounded(std::int64_t size, int max) {
  return static_cast<int>(std::clamp<std::int64_t>(size, 0, max));
}

// Element of a row-major matrix.
std::size_t at(int row, int col, int columns) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
         static_cast<std::size_t>(col);
}

// Big-endian int32 at a byte offset; -1 beyond the end.
std::int64_t int32_at(const std::uint8_t* bytes, std::size_t size, std::size_t offset) {
  if (offset + 4 > size) return -1;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | bytes[offset + i];
  return static_cast<std::int32_t>(value);
}

}  // namespace

// Offsets: fingerprint, seq, t_ns, session, a further int64, and what the .lcm file says after
// them.
bool sizes_fit(const estimate_t*, const std::uint8_t* bytes, std::size_t size) {
  const std::int64_t n_x = int32_at(bytes, size, 44), n_y = int32_at(bytes, size, 48);
  return n_x >= 0 && n_x <= kMaxStates && n_y >= 0 && n_y <= kMaxOutputs;
}

bool sizes_fit(const gain_t*, const std::uint8_t* bytes, std::size_t size) {
  const std::int64_t n_x = int32_at(bytes, size, 40), n_y = int32_at(bytes, size, 44);
  const std::int64_t n_K = int32_at(bytes, size, 56);
  if (n_x < 0 || n_x > kMaxStates || n_y < 0 || n_y > kMaxOutputs || n_K != n_x * n_y) return false;
  if (int32_at(bytes, size, 60 + 8 * static_cast<std::size_t>(n_K)) != n_x * n_x) return false;
  const std::size_t speeds_at = 64 + 8 * static_cast<std::size_t>(n_K + n_x * n_x);
  const std::int64_t n_speeds = int32_at(bytes, size, speeds_at);
  if (n_speeds < 0 || n_speeds > kMaxSpeeds) return false;
  if (n_speeds > 0 && (n_x > kMaxTurningStates || n_y > 2)) return false;
  return int32_at(bytes, size, speeds_at + 4 + 8 * static_cast<std::size_t>(n_speeds)) ==
         n_speeds * n_K;
}

measurement_t to_wire(const Measurement& m, std::int64_t session) {
  auto w = header<measurement_t>(m.k, m.t_ns, session);
  w.signals = m.signals;
  w.i_a_A = m.i_abc[0];
  w.i_b_A = m.i_abc[1];
  w.i_c_A = m.i_abc[2];
  w.u_alpha_V = m.u_alphabeta[0];
  w.u_beta_V = m.u_alphabeta[1];
  w.duty_a = m.duty_abc[0];
  w.duty_b = m.duty_abc[1];
  w.duty_c = m.duty_abc[2];
  w.mode = static_cast<std::int32_t>(m.mode);
  w.theta_forced_rad = m.theta_forced;
  w.v_dc_V = m.v_dc;
  w.theta_m_rad = m.theta_m;
  w.omega_m_rad_s = m.omega_m;
  return w;
}

Measurement from_wire(const measurement_t& w) {
  Measurement m;
  m.k = w.seq;
  m.t_ns = w.t_ns;
  m.signals = w.signals;
  m.i_abc = {w.i_a_A, w.i_b_A, w.i_c_A};
  m.u_alphabeta = {w.u_alpha_V, w.u_beta_V};
  m.duty_abc = {w.duty_a, w.duty_b, w.duty_c};
  m.mode = static_cast<Mode>(w.mode);
  m.theta_forced = w.theta_forced_rad;
  m.v_dc = w.v_dc_V;
  m.theta_m = w.theta_m_rad;
  m.omega_m = w.omega_m_rad_s;
  return m;
}

truth_t to_wire(const Truth& t, std::int64_t session) {
  auto w = header<truth_t>(t.k, t.t_ns, session);
  w.i_d_A = t.i_dq[0];
  w.i_q_A = t.i_dq[1];
  w.omega_m_rad_s = t.omega_m;
  w.theta_m_rad = t.theta_m;
  w.T_em_Nm = t.T_em;
  w.T_load_Nm = t.T_load;
  return w;
}

Truth from_wire(const truth_t& w) {
  Truth t;
  t.k = w.seq;
  t.t_ns = w.t_ns;
  t.i_dq = {w.i_d_A, w.i_q_A};
  t.omega_m = w.omega_m_rad_s;
  t.theta_m = w.theta_m_rad;
  t.T_em = w.T_em_Nm;
  t.T_load = w.T_load_Nm;
  return t;
}

estimate_t to_wire(const Estimate& e, std::int64_t session) {
  auto w = header<estimate_t>(e.k, e.t_ns, session);
  w.gain_seq = e.gain_seq;
  w.status = e.status;
  w.n_x = e.n_x;
  w.n_y = e.n_y;
  w.theta_e_rad = e.theta_e;
  w.omega_m_rad_s = e.omega_m;
  w.i_d_A = e.i_dq[0];
  w.i_q_A = e.i_dq[1];
  w.T_load_Nm = e.T_load;
  w.dT_load_Nm_s = e.dT_load_dt;
  w.x_hat.assign(e.x_hat.data(), e.x_hat.data() + e.n_x);
  w.innov.assign(e.innov.data(), e.innov.data() + e.n_y);
  return w;
}

Estimate from_wire(const estimate_t& w) {
  Estimate e;
  e.k = w.seq;
  e.t_ns = w.t_ns;
  e.gain_seq = w.gain_seq;
  e.status = w.status;
  e.n_x = bounded(w.x_hat.size(), kMaxStates);
  e.n_y = bounded(w.innov.size(), kMaxOutputs);
  e.theta_e = w.theta_e_rad;
  e.omega_m = w.omega_m_rad_s;
  e.i_dq = {w.i_d_A, w.i_q_A};
  e.T_load = w.T_load_Nm;
  e.dT_load_dt = w.dT_load_Nm_s;
  std::copy_n(w.x_hat.begin(), e.n_x, e.x_hat.data());
  std::copy_n(w.innov.begin(), e.n_y, e.innov.data());
  return e;
}

gain_t to_wire(const Gain& g, std::int64_t session) {
  auto w = header<gain_t>(g.k, g.t_ns, session);
  w.first_use_seq = g.first_use;
  w.n_x = g.n_x;
  w.n_y = g.n_y;
  w.theta_e_rad = g.theta_e;
  w.n_K = g.n_x * g.n_y;
  w.n_P = g.n_x * g.n_x;
  w.K.resize(static_cast<std::size_t>(w.n_K));
  w.P.resize(static_cast<std::size_t>(w.n_P));
  for (int row = 0; row < g.n_x; ++row) {
    for (int col = 0; col < g.n_y; ++col) w.K[at(row, col, g.n_y)] = g.K(row, col);
    for (int col = 0; col < g.n_x; ++col) w.P[at(row, col, g.n_x)] = g.P(row, col);
  }
  w.n_speeds = g.n_speeds;
  w.n_K_at = g.n_speeds * w.n_K;
  for (int i = 0; i < g.n_speeds; ++i) {
    const GainAtSpeed& node = g.at_speed[static_cast<std::size_t>(i)];
    w.at_omega_m_rad_s.push_back(node.omega_m);
    for (int row = 0; row < g.n_x; ++row)
      for (int col = 0; col < g.n_y; ++col) w.K_at.push_back(node.K(row, col));
  }
  return w;
}

Gain from_wire(const gain_t& w) {
  Gain g;
  g.k = w.seq;
  g.t_ns = w.t_ns;
  g.first_use = w.first_use_seq;
  g.n_x = bounded(w.n_x, kMaxStates);
  g.n_y = bounded(w.n_y, kMaxOutputs);
  g.theta_e = w.theta_e_rad;
  if (w.K.size() < at(g.n_x, 0, g.n_y) || w.P.size() < at(g.n_x, 0, g.n_x)) {
    g.n_x = g.n_y = 0;
    return g;
  }
  for (int row = 0; row < g.n_x; ++row) {
    for (int col = 0; col < g.n_y; ++col) g.K(row, col) = w.K[at(row, col, g.n_y)];
    for (int col = 0; col < g.n_x; ++col) g.P(row, col) = w.P[at(row, col, g.n_x)];
  }
  const int n_speeds = bounded(w.n_speeds, kMaxSpeeds);
  if (n_speeds == 0 || g.n_x > kMaxTurningStates || g.n_y > 2 ||
      w.at_omega_m_rad_s.size() < static_cast<std::size_t>(n_speeds) ||
      w.K_at.size() < at(n_speeds * g.n_x, 0, g.n_y))
    return g;
  g.n_speeds = n_speeds;
  for (int i = 0; i < n_speeds; ++i) {
    GainAtSpeed& node = g.at_speed[static_cast<std::size_t>(i)];
    node.omega_m = w.at_omega_m_rad_s[static_cast<std::size_t>(i)];
    for (int row = 0; row < g.n_x; ++row)
      for (int col = 0; col < g.n_y; ++col)
        node.K(row, col) = w.K_at[at(i * g.n_x + row, col, g.n_y)];
  }
  return g;
}

reference_t to_wire(const Reference& r, std::int64_t session) {
  auto w = header<reference_t>(r.k, r.t_ns, session);
  w.omega_m_ref_rad_s = r.omega_m_ref;
  w.i_d_ref_A = r.i_d_ref;
  return w;
}

Reference from_wire(const reference_t& w) {
  Reference r;
  r.k = w.seq;
  r.t_ns = w.t_ns;
  r.omega_m_ref = w.omega_m_ref_rad_s;
  r.i_d_ref = w.i_d_ref_A;
  return r;
}

command_t to_wire(const Command& c, std::int64_t session) {
  auto w = header<command_t>(c.k, c.t_ns, session);
  w.mode = static_cast<std::int32_t>(c.mode);
  w.u_alpha_V = c.u_alphabeta_ref[0];
  w.u_beta_V = c.u_alphabeta_ref[1];
  w.i_d_ref_A = c.i_dq_ref[0];
  w.i_q_ref_A = c.i_dq_ref[1];
  w.i_d_A = c.i_dq[0];
  w.i_q_A = c.i_dq[1];
  w.theta_ctrl_rad = c.theta_ctrl;
  w.omega_m_ref_rad_s = c.omega_m_ref;
  return w;
}

Command from_wire(const command_t& w) {
  Command c;
  c.k = w.seq;
  c.t_ns = w.t_ns;
  c.mode = static_cast<Mode>(w.mode);
  c.u_alphabeta_ref = {w.u_alpha_V, w.u_beta_V};
  c.i_dq_ref = {w.i_d_ref_A, w.i_q_ref_A};
  c.i_dq = {w.i_d_A, w.i_q_A};
  c.theta_ctrl = w.theta_ctrl_rad;
  c.omega_m_ref = w.omega_m_ref_rad_s;
  return c;
}

}  // namespace twinrate
