#include "core/signals_io.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "core/encode_tick.hpp"

namespace twinrate {
namespace {

constexpr std::int64_t kSession = 0x1234567890abcdefLL;

// A different critical double at every call: 1/3, denormals, negative zero, huge.
double awkward() {
  static int call = 0;
  const double values[] = {1.0 / 3, -0.0, 5e-324, -1.7976931348623157e308, 2.5e-7, -kPi};
  ++call;
  return call % 7 == 0 ? -0.0 : values[call % 6] / (1 + call % 5);
}

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
template <class Matrix>
bool same_bits(const Eigen::DenseBase<Matrix>& a, const Eigen::DenseBase<Matrix>& b) {
  for (Eigen::Index i = 0; i < a.size(); ++i)
    if (!same_bits(a.derived().data()[i], b.derived().data()[i])) return false;
  return true;
}

// Over the wire and back: encoded to bytes, decoded, converted.
template <class Signal>
Signal round_trip(const Signal& signal) {
  auto wire = to_wire(signal, kSession);
  EXPECT_EQ(wire.session, kSession);
  EXPECT_EQ(wire.seq, signal.k);
  EXPECT_EQ(wire.t_ns, signal.t_ns);
  wire.host_ns = 0x0102030405060708LL;
  wire.tag = -2;
  std::vector<unsigned char> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  EXPECT_EQ(wire.encode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  std::vector<unsigned char> by_encode_tick(bytes.size());
  encode_tick(wire, by_encode_tick.data());
  EXPECT_EQ(by_encode_tick, bytes);
  decltype(wire) decoded;
  EXPECT_EQ(decoded.decode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return from_wire(decoded);
}

template <class Signal>
Signal stamped() {
  Signal s;
  s.k = 123456789012LL;
  s.t_ns = -987654321098765LL;
  return s;
}

TEST(SignalsIo, MeasurementComesBackBitForBit) {
  auto m = stamped<Measurement>();
  m.signals = kPhaseCurrents | kSpeed | kQCurrentOnly;
  m.i_abc = {awkward(), awkward(), awkward()};
  m.u_alphabeta = {awkward(), awkward()};
  m.duty_abc = {awkward(), awkward(), awkward()};
  m.mode = Mode::kIfRamp;
  m.theta_forced = awkward();
  m.v_dc = awkward();
  m.theta_m = awkward();
  m.omega_m = awkward();
  const Measurement back = round_trip(m);
  EXPECT_EQ(back.k, m.k);
  EXPECT_EQ(back.t_ns, m.t_ns);
  EXPECT_EQ(back.signals, m.signals);
  EXPECT_EQ(back.mode, m.mode);
  EXPECT_TRUE(same_bits(back.i_abc, m.i_abc));
  EXPECT_TRUE(same_bits(back.u_alphabeta, m.u_alphabeta));
  EXPECT_TRUE(same_bits(back.duty_abc, m.duty_abc));
  EXPECT_TRUE(same_bits(back.theta_forced, m.theta_forced));
  EXPECT_TRUE(same_bits(back.v_dc, m.v_dc));
  EXPECT_TRUE(same_bits(back.theta_m, m.theta_m));
  EXPECT_TRUE(same_bits(back.omega_m, m.omega_m));
}

TEST(SignalsIo, EstimateComesBackBitForBit) {
  auto e = stamped<Estimate>();
  e.gain_seq = 77;
  e.status = kLateGain | kGapBridged;
  e.n_x = kMaxStates;
  e.n_y = 4;
  e.theta_e = awkward();
  e.omega_m = awkward();
  e.i_dq = {awkward(), awkward()};
  e.T_load = awkward();
  for (double& x : e.x_hat) x = awkward();
  for (double& y : e.innov) y = awkward();
  const Estimate back = round_trip(e);
  EXPECT_EQ(back.k, e.k);
  EXPECT_EQ(back.t_ns, e.t_ns);
  EXPECT_EQ(back.gain_seq, e.gain_seq);
  EXPECT_EQ(back.status, e.status);
  EXPECT_EQ(back.n_x, kMaxStates);
  EXPECT_EQ(back.n_y, 4);
  EXPECT_TRUE(same_bits(back.theta_e, e.theta_e));
  EXPECT_TRUE(same_bits(back.omega_m, e.omega_m));
  EXPECT_TRUE(same_bits(back.i_dq, e.i_dq));
  EXPECT_TRUE(same_bits(back.T_load, e.T_load));
  EXPECT_TRUE(same_bits(back.x_hat, e.x_hat));
  EXPECT_TRUE(same_bits(back.innov, e.innov));
}

TEST(SignalsIo, GainComesBackBitForBitAtEverySize) {
  for (int n_x = 1; n_x <= kMaxStates; ++n_x) {
    for (int n_y = 1; n_y <= kMaxOutputs; ++n_y) {
      auto g = stamped<Gain>();
      g.first_use = 99;
      g.n_x = n_x;
      g.n_y = n_y;
      for (int row = 0; row < n_x; ++row) {
        for (int col = 0; col < n_y; ++col) g.K(row, col) = awkward();
        for (int col = 0; col < n_x; ++col) g.P(row, col) = awkward();
      }
      const Gain back = round_trip(g);
      EXPECT_EQ(back.k, g.k);
      EXPECT_EQ(back.t_ns, g.t_ns);
      EXPECT_EQ(back.first_use, 99);
      EXPECT_EQ(back.n_x, n_x);
      EXPECT_EQ(back.n_y, n_y);
      EXPECT_TRUE(same_bits(back.K, g.K));
      EXPECT_TRUE(same_bits(back.P, g.P));
    }
  }
}

TEST(SignalsIo, TruthComesBackBitForBit) {
  auto t = stamped<Truth>();
  t.i_dq = {awkward(), awkward()};
  t.omega_m = awkward();
  t.theta_m = awkward();
  t.T_em = awkward();
  t.T_load = awkward();
  const Truth back = round_trip(t);
  EXPECT_EQ(back.k, t.k);
  EXPECT_EQ(back.t_ns, t.t_ns);
  EXPECT_TRUE(same_bits(back.i_dq, t.i_dq));
  EXPECT_TRUE(same_bits(back.omega_m, t.omega_m));
  EXPECT_TRUE(same_bits(back.theta_m, t.theta_m));
  EXPECT_TRUE(same_bits(back.T_em, t.T_em));
  EXPECT_TRUE(same_bits(back.T_load, t.T_load));
}

TEST(SignalsIo, ReferenceComesBackBitForBit) {
  auto r = stamped<Reference>();
  r.omega_m_ref = awkward();
  r.i_d_ref = awkward();
  const Reference back = round_trip(r);
  EXPECT_EQ(back.k, r.k);
  EXPECT_EQ(back.t_ns, r.t_ns);
  EXPECT_TRUE(same_bits(back.omega_m_ref, r.omega_m_ref));
  EXPECT_TRUE(same_bits(back.i_d_ref, r.i_d_ref));
}

TEST(SignalsIo, CommandComesBackBitForBit) {
  auto c = stamped<Command>();
  c.mode = Mode::kSafe;
  c.u_alphabeta_ref = {awkward(), awkward()};
  c.i_dq_ref = {awkward(), awkward()};
  c.i_dq = {awkward(), awkward()};
  c.theta_ctrl = awkward();
  c.omega_m_ref = awkward();
  const Command back = round_trip(c);
  EXPECT_EQ(back.k, c.k);
  EXPECT_EQ(back.t_ns, c.t_ns);
  EXPECT_EQ(back.mode, Mode::kSafe);
  EXPECT_TRUE(same_bits(back.u_alphabeta_ref, c.u_alphabeta_ref));
  EXPECT_TRUE(same_bits(back.i_dq_ref, c.i_dq_ref));
  EXPECT_TRUE(same_bits(back.i_dq, c.i_dq));
  EXPECT_TRUE(same_bits(back.theta_ctrl, c.theta_ctrl));
  EXPECT_TRUE(same_bits(back.omega_m_ref, c.omega_m_ref));
}

TEST(SignalsIo, NotANumberCrossesAsNotANumber) {
  Measurement m;
  m.i_abc[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(round_trip(m).i_abc[1]));
}

TEST(SignalsIo, GainsForSeveralSpeedsComeBackBitForBit) {
  for (int n_speeds : {0, 1, 5, kMaxSpeeds}) {
    auto g = stamped<Gain>();
    g.n_x = 4;
    g.n_y = 2;
    g.n_speeds = n_speeds;
    for (int i = 0; i < n_speeds; ++i) {
      auto& node = g.at_speed[static_cast<std::size_t>(i)];
      node.omega_m = awkward();
      for (int row = 0; row < 4; ++row)
        for (int col = 0; col < 2; ++col) node.K(row, col) = awkward();
    }
    const Gain back = round_trip(g);
    ASSERT_EQ(back.n_speeds, n_speeds);
    for (std::size_t i = 0; i < kMaxSpeeds; ++i) {
      EXPECT_EQ(back.at_speed[i].omega_m, g.at_speed[i].omega_m);
      EXPECT_TRUE(same_bits(back.at_speed[i].K, g.at_speed[i].K));
    }
  }
  gain_t lying{};
  lying.n_x = 4, lying.n_y = 2;
  lying.K.resize(8), lying.P.resize(16);
  lying.n_speeds = 6;  // and no speeds
  EXPECT_EQ(from_wire(lying).n_speeds, 0);
}

TEST(SignalsIo, SizesFromTheWireAreLimitedToTheirArrays) {
  for (int wrong : {-1, -2147483647, 9, 1000000}) {
    estimate_t e{};
    e.n_x = wrong;
    e.n_y = wrong;
    EXPECT_GE(from_wire(e).n_x, 0);
    EXPECT_LE(from_wire(e).n_x, kMaxStates);
    EXPECT_GE(from_wire(e).n_y, 0);
    EXPECT_LE(from_wire(e).n_y, kMaxOutputs);
    gain_t g{};
    g.n_x = wrong;
    g.n_y = wrong;
    EXPECT_GE(from_wire(g).n_x, 0);
    EXPECT_LE(from_wire(g).n_x, kMaxStates);
    EXPECT_GE(from_wire(g).n_y, 0);
    EXPECT_LE(from_wire(g).n_y, kMaxOutputs);
  }
}

}  // namespace
}  // namespace twinrate
