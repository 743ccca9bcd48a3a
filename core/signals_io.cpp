#include "core/signals_io.hpp"

#include <algorithm>
#include <concepts>
#include <vector>

#include "core/decode.hpp"

namespace twinrate {
namespace {

// Sizes come off the wire: never trust them beyond the arrays they index.
int bounded(std::int64_t size, int max) {
  return static_cast<int>(std::clamp<std::int64_t>(size, 0, max));
}

// Big-endian int32 at a byte offset; -1 beyond the end.
std::int64_t int32_at(const std::uint8_t* bytes, std::size_t size, std::size_t offset) {
  if (offset + 4 > size) return -1;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | bytes[offset + i];
  return static_cast<std::int32_t>(value);
}

// Either direction of a field, and of a row-major matrix that begins at `offset` of an array.
struct ToWire {
  template <class Wire, class Own>
  void operator()(Wire& wire, const Own& own) const {
    wire = static_cast<Wire>(own);
  }
  template <class Matrix>
  void rows(std::vector<double>& wire, int offset, const Matrix& own, int n_rows,
            int n_cols) const {
    wire.resize(static_cast<std::size_t>(offset + n_rows * n_cols));
    for (int row = 0; row < n_rows; ++row)
      for (int col = 0; col < n_cols; ++col)
        wire[static_cast<std::size_t>(offset + row * n_cols + col)] = own(row, col);
  }
};
struct FromWire {
  template <class Wire, class Own>
  void operator()(const Wire& wire, Own& own) const {
    own = static_cast<Own>(wire);
  }
  template <class Matrix>
  void rows(const std::vector<double>& wire, int offset, Matrix& own, int n_rows,
            int n_cols) const {
    for (int row = 0; row < n_rows; ++row)
      for (int col = 0; col < n_cols; ++col)
        own(row, col) = wire[static_cast<std::size_t>(offset + row * n_cols + col)];
  }
};

// The fields of each message, listed once for both directions: w is the message, the other one the
// struct. Sizes of arrays are set before.
template <class T, class U>
concept Is = std::same_as<std::remove_const_t<T>, U>;

void fields(auto& w, Is<Measurement> auto& m, auto copy) {
  copy(w.signals, m.signals);
  copy(w.i_a_A, m.i_abc[0]);
  copy(w.i_b_A, m.i_abc[1]);
  copy(w.i_c_A, m.i_abc[2]);
  copy(w.u_alpha_V, m.u_alphabeta[0]);
  copy(w.u_beta_V, m.u_alphabeta[1]);
  copy(w.duty_a, m.duty_abc[0]);
  copy(w.duty_b, m.duty_abc[1]);
  copy(w.duty_c, m.duty_abc[2]);
  copy(w.mode, m.mode);
  copy(w.theta_forced_rad, m.theta_forced);
  copy(w.v_dc_V, m.v_dc);
  copy(w.theta_m_rad, m.theta_m);
  copy(w.omega_m_rad_s, m.omega_m);
}

void fields(auto& w, Is<Truth> auto& t, auto copy) {
  copy(w.i_d_A, t.i_dq[0]);
  copy(w.i_q_A, t.i_dq[1]);
  copy(w.omega_m_rad_s, t.omega_m);
  copy(w.theta_m_rad, t.theta_m);
  copy(w.T_em_Nm, t.T_em);
  copy(w.T_load_Nm, t.T_load);
}

void fields(auto& w, Is<Estimate> auto& e, auto copy) {
  copy(w.gain_seq, e.gain_seq);
  copy(w.status, e.status);
  copy(w.theta_e_rad, e.theta_e);
  copy(w.omega_m_rad_s, e.omega_m);
  copy(w.i_d_A, e.i_dq[0]);
  copy(w.i_q_A, e.i_dq[1]);
  copy(w.T_load_Nm, e.T_load);
  copy(w.dT_load_Nm_s, e.dT_load_dt);
  copy.rows(w.x_hat, 0, e.x_hat, e.n_x, 1);
  copy.rows(w.innov, 0, e.innov, e.n_y, 1);
}

void fields(auto& w, Is<Gain> auto& g, auto copy) {
  copy(w.first_use_seq, g.first_use);
  copy(w.theta_e_rad, g.theta_e);
  copy.rows(w.K, 0, g.K, g.n_x, g.n_y);
  copy.rows(w.P, 0, g.P, g.n_x, g.n_x);
  for (int i = 0; i < g.n_speeds; ++i) {
    const auto node = static_cast<std::size_t>(i);
    copy(w.at_omega_m_rad_s[node], g.at_speed[node].omega_m);
    copy.rows(w.K_at, i * g.n_x * g.n_y, g.at_speed[node].K, g.n_x, g.n_y);
  }
}

void fields(auto& w, Is<Reference> auto& r, auto copy) {
  copy(w.omega_m_ref_rad_s, r.omega_m_ref);
  copy(w.i_d_ref_A, r.i_d_ref);
}

void fields(auto& w, Is<Command> auto& c, auto copy) {
  copy(w.mode, c.mode);
  copy(w.u_alpha_V, c.u_alphabeta_ref[0]);
  copy(w.u_beta_V, c.u_alphabeta_ref[1]);
  copy(w.i_d_ref_A, c.i_dq_ref[0]);
  copy(w.i_q_ref_A, c.i_dq_ref[1]);
  copy(w.i_d_A, c.i_dq[0]);
  copy(w.i_q_A, c.i_dq[1]);
  copy(w.theta_ctrl_rad, c.theta_ctrl);
  copy(w.omega_m_ref_rad_s, c.omega_m_ref);
}

// Header and fields; the sizes of arrays are set in `w`.
template <class Wire, class Own>
void fill(Wire& w, const Own& own, std::int64_t session) {
  w.seq = own.k;
  w.t_ns = own.t_ns;
  w.session = session;
  fields(w, own, ToWire{});
}
template <class Wire, class Own>
Wire filled(const Own& own, std::int64_t session) {
  Wire w{};
  fill(w, own, session);
  return w;
}

// The sizes of arrays are set in `own`.
template <class Wire, class Own>
Own decoded(const Wire& w, Own own) {
  own.k = w.seq;
  own.t_ns = w.t_ns;
  fields(w, own, FromWire{});
  return own;
}

}  // namespace

// Offsets: fingerprint, seq, t_ns, session, a further int64, then the fields of the .lcm file.
int estimate_status(const std::uint8_t* bytes, std::size_t size) {
  return static_cast<int>(std::max<std::int64_t>(0, int32_at(bytes, size, kEstimateStatusAt)));
}

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
  return filled<measurement_t>(m, session);
}
truth_t to_wire(const Truth& t, std::int64_t session) {
  return filled<truth_t>(t, session);
}
reference_t to_wire(const Reference& r, std::int64_t session) {
  return filled<reference_t>(r, session);
}
command_t to_wire(const Command& c, std::int64_t session) {
  return filled<command_t>(c, session);
}

void to_wire(const Estimate& e, std::int64_t session, estimate_t& w) {
  w.n_x = e.n_x;
  w.n_y = e.n_y;
  fill(w, e, session);
}
estimate_t to_wire(const Estimate& e, std::int64_t session) {
  estimate_t w{};
  to_wire(e, session, w);
  return w;
}

void to_wire(const Gain& g, std::int64_t session, gain_t& w) {
  w.n_x = g.n_x;
  w.n_y = g.n_y;
  w.n_K = g.n_x * g.n_y;
  w.n_P = g.n_x * g.n_x;
  w.n_speeds = g.n_speeds;
  w.n_K_at = g.n_speeds * w.n_K;
  w.at_omega_m_rad_s.resize(static_cast<std::size_t>(g.n_speeds));
  w.K_at.resize(static_cast<std::size_t>(w.n_K_at));
  fill(w, g, session);
}
gain_t to_wire(const Gain& g, std::int64_t session) {
  gain_t w{};
  to_wire(g, session, w);
  return w;
}

Measurement from_wire(const measurement_t& w) {
  return decoded(w, Measurement{});
}
Truth from_wire(const truth_t& w) {
  return decoded(w, Truth{});
}
Reference from_wire(const reference_t& w) {
  return decoded(w, Reference{});
}
Command from_wire(const command_t& w) {
  return decoded(w, Command{});
}

Estimate from_wire(const estimate_t& w) {
  Estimate e;
  e.n_x = bounded(w.x_hat.size(), kMaxStates);
  e.n_y = bounded(w.innov.size(), kMaxOutputs);
  return decoded(w, e);
}

// Matrices shorter than their stated sizes are left out.
Gain from_wire(const gain_t& w) {
  Gain g;
  const int n_x = bounded(w.n_x, kMaxStates), n_y = bounded(w.n_y, kMaxOutputs);
  const int n_speeds = bounded(w.n_speeds, kMaxSpeeds);
  const auto holds = [](const std::vector<double>& array, int size) {
    return array.size() >= static_cast<std::size_t>(size);
  };
  if (holds(w.K, n_x * n_y) && holds(w.P, n_x * n_x)) {
    g.n_x = n_x;
    g.n_y = n_y;
    if (n_x <= kMaxTurningStates && n_y <= 2 && holds(w.at_omega_m_rad_s, n_speeds) &&
        holds(w.K_at, n_speeds * n_x * n_y))
      g.n_speeds = n_speeds;
  }
  return decoded(w, g);
}

}  // namespace twinrate
