#include "bench/blind/drawn_points.hpp"

#include <array>
#include <cmath>
#include <numeric>

#include "model/effects/effect.hpp"
#include "trace/bus_ripple.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"
#include "trace/split.hpp"
#include "trace/verdict.hpp"

namespace twinrate::blind {
namespace {

// Adds the errors of the sensors to one signal, row by row. `unit`: size of the signal on this
// drive.
class Readings {
 public:
  Readings(Draw& d, Spoilt spoilt, double unit, std::uint64_t seed)
      : seed_(seed), noise_(unit * d.log_between(3e-4, 5e-3)) {
    if (spoilt == Spoilt::kLoud) noise_ = unit * d.log_between(0.01, 0.06);
    if (spoilt == Spoilt::kCoarse) lsb_ = unit * d.log_between(3e-3, 3e-2);
    if (spoilt == Spoilt::kDrifting) walk_ = unit * d.log_between(3e-4, 5e-3);
  }
  double of(double value) {
    drift_ += walk_ * normal(seed_, 1, k_);
    value += drift_ + noise_ * normal(seed_, 0, k_++);
    return lsb_ > 0 ? lsb_ * std::floor(value / lsb_) : value;
  }

 private:
  std::uint64_t seed_, k_ = 0;
  double noise_, lsb_ = 0, walk_ = 0, drift_ = 0;
};

DriveFacts facts_of(const DrawnMachine& x) {
  return {.machine = x.machine, .v_dc = x.v_dc, .f_pwm = x.f_s};
}

std::shared_ptr<Effect> made(const char* kind, const std::vector<std::pair<const char*, double>>& k,
                             const DriveFacts& facts) {
  const auto effect = make_effect(kind);
  for (const auto& [key, value] : k) set_key(*effect, key, value);
  effect->prepare(facts);
  return effect;
}

// Changes every constant by half of the smallest size worth reporting.
void make_small(MachineParameters& m, Draw& d) {
  m.R_s *= 1 + 0.01 * d.either(-1, 1);
  m.L_d *= 1 + 0.007 * d.either(-1, 1);
  m.L_q *= 1 + 0.007 * d.either(-1, 1);
  m.psi_f *= 1 + 0.003 * d.either(-1, 1);
}

std::shared_ptr<Effect> draw_iron(Draw& d, const DriveFacts& facts, double i_max) {
  const MachineParameters& m = facts.machine;
  switch (d.whole(0, 3)) {
    case 0:
      return made("flux_linkage", {{"change_Wb", d.signed_between(0.02, 0.15) * m.psi_f}}, facts);
    case 1:
      return made("inductance",
                  {{"change_d_H", d.signed_between(0.04, 0.3) * m.L_d},
                   {"change_q_H", d.signed_between(0.04, 0.3) * m.L_q}},
                  facts);
    case 2:
      return made("saturation",
                  {{"form", d.whole(0, 2)},
                   {"current_q_A", d.between(0.3, 1) * i_max},
                   {"share_q", d.between(0.3, 0.8)}},
                  facts);
    default:
      return made("cross_saturation",
                  {{"coefficient_H_A", d.between(0.08, 0.3) * m.L_q / m.i_rated}}, facts);
  }
}

// Changes of a flux map that no kind of the catalogue describes: turned axes, a ripple, a part of
// |psi| in q.
Vec2 unknown_flux(int which, double size, double phase, const Vec2& i, const Vec2& psi,
                  double i_max) {
  if (which == 0) {
    const double c = std::cos(size), s = std::sin(size);
    return {c * psi[0] + s * psi[1] - psi[0], c * psi[1] - s * psi[0] - psi[1]};
  }
  if (which == 1)
    return size * psi.norm() * Vec2(std::sin(5 * i[1] / i_max + phase), std::sin(6 * i[0] / i_max));
  return {0, size * psi.norm()};
}

TraceResult flux_map(Draw& d, PointCase& c, const DrawnMachine& x, std::uint64_t seed) {
  const DriveFacts facts = facts_of(x);
  MachineParameters m = x.machine;
  const double i_max = d.between(0.8, 1.5) * m.i_rated;
  if (c.spoilt == Spoilt::kSmall) make_small(m, d);
  Effects effects;
  if (c.spoilt == Spoilt::kEffect) effects = {draw_iron(d, facts, i_max)};
  for (const auto& e : effects) c.truth.emplace_back(e->kind());
  const double unit = std::hypot(m.psi_f, m.L_q * m.i_rated);
  Readings d_readings(d, c.spoilt, unit, seed), q_readings(d, c.spoilt, unit, seed + 1);
  const int rows = d.whole(7, 19), columns = d.whole(7, 23), which = d.whole(0, 2);
  const bool quarter = d.happens(0.4);
  const double size = d.log_between(0.01, 0.06), phase = d.phase();
  StaticSet set{.path = "drawn", .columns = {}};
  for (int a = 0; a < rows; ++a)
    for (int b = 0; b < columns; ++b) {
      const double share_d = a / (rows - 1.0), share_q = b / (columns - 1.0);
      const Vec2 i =
          i_max * Vec2(quarter ? -share_d : 2 * share_d - 1, quarter ? share_q : 2 * share_q - 1);
      Vec2 psi = Vec2(m.psi_f + m.L_d * i[0], m.L_q * i[1]) + sum_at(effects, {.i_dq = i}).psi_dq;
      if (c.spoilt == Spoilt::kUnknown) psi += unknown_flux(which, size, phase, i, psi, i_max);
      set.columns["i_d"].push_back(i[0]), set.columns["i_q"].push_back(i[1]);
      set.columns["psi_d"].push_back(d_readings.of(psi[0]));
      set.columns["psi_q"].push_back(q_readings.of(psi[1]));
    }
  return static_result(set, trace_flux_map(set, facts), StaticKind::kFluxMap);
}

TraceResult inverter_curve(Draw& d, PointCase& c, const DrawnMachine& x, std::uint64_t seed) {
  const DriveFacts facts = facts_of(x);
  MachineParameters m = x.machine;
  const double i_max = d.log_between(0.1, 1.2) * m.i_rated;
  if (c.spoilt == Spoilt::kSmall) make_small(m, d);
  Effects effects;
  if (c.spoilt == Spoilt::kEffect && d.happens(0.6)) {
    effects = {made("inverter_drop",
                    {{"threshold_V", d.log_between(0.005, 0.04) * x.v_dc},
                     {"linear_current_A", d.log_between(0.01, 0.2) * i_max},
                     {"shape", d.whole(0, 3)}},
                    facts)};
    c.aliases = {"dead_time", "resistance"};
  } else if (c.spoilt == Spoilt::kEffect) {
    effects = {made("resistance", {{"change_Ohm", d.between(0.06, 0.4) * m.R_s}}, facts)};
  }
  for (const auto& e : effects) c.truth.emplace_back(e->kind());
  const double unit = std::max(m.R_s * i_max, 0.02 * x.v_dc);
  Readings readings(d, c.spoilt, unit, seed);
  const int rows = d.whole(60, 300), which = d.whole(0, 4);
  const double size = unit * d.log_between(0.02, 0.1) * d.either(-1, 1);
  StaticSet set{.path = "drawn", .columns = {}};
  for (int k = 0; k < rows; ++k) {
    const double s = -1 + 2 * k / (rows - 1.0), i = s * i_max;
    double u = m.R_s * i + sum_at(effects, {.i_dq = Vec2(i, 0), .v_dc = x.v_dc}).u_dq_drop[0];
    const double unknown[] = {1.0, s * s * s, std::sin(9 * s), s * s, s > 0.3 ? 1.0 : 0.0};
    if (c.spoilt == Spoilt::kUnknown) u += size * unknown[which];
    set.columns["i_a"].push_back(i), set.columns["u_a"].push_back(readings.of(u));
  }
  return static_result(set, trace_inverter_curve(set, facts), StaticKind::kInverterCurve);
}

struct Torque {
  double friction = 0;
  std::vector<std::array<double, 3>> sines;  // order, Nm, rad
};

Torque draw_torque(Draw& d, PointCase& c, const MachineParameters& m, bool both_ways) {
  Torque torque;
  if (c.spoilt != Spoilt::kEffect) return torque;
  if (both_ways && d.happens(0.3)) {
    torque.friction = d.log_between(0.01, 0.1) * m.T_rated;
    c.truth = {"coulomb_friction"};
    return torque;
  }
  const int orders[] = {m.n_slots, std::lcm(m.n_slots, 2 * m.n_p), 2 * m.n_p};
  for (int n = d.whole(0, 2); n < 3; ++n)
    if (orders[n] < 200)
      torque.sines.push_back({1.0 * orders[n], d.log_between(0.01, 0.1) * m.T_rated, d.phase()});
  if (!torque.sines.empty()) c.truth = {"cogging"}, c.aliases = {"current_gain"};
  return torque;
}

TraceResult holding(Draw& d, PointCase& c, const DrawnMachine& x, std::uint64_t seed) {
  const DriveFacts facts = facts_of(x);
  const MachineParameters& m = x.machine;
  const bool map = d.happens(0.4), both_ways = !map && d.happens(0.7);
  const Torque torque = draw_torque(d, c, m, both_ways);
  Readings readings(d, c.spoilt, m.i_rated, seed);
  const int rows = d.whole(800, 4000), which = d.whole(0, 2);
  const double turns = map ? 1 : d.between(1, 2), T = d.between(10, 60);
  const double size = d.log_between(0.01, 0.1) * m.i_rated, f = d.log_between(0.05, 3);
  const double jump = d.between(0.2, 0.8);
  PositionLog log{.path = "drawn"};
  for (int k = 0; k < rows; ++k) {
    const double s = k / (rows - 1.0), t = s * T;
    const double way = both_ways && s > 0.5 ? -1 : 1;
    const double theta_m = kTwoPi * turns * (both_ways ? (s < 0.5 ? 2 * s : 2 - 2 * s) : s);
    double i = way * torque.friction;
    for (const auto& [order, A, phase] : torque.sines) i += A * std::sin(order * theta_m + phase);
    i /= m.torque_constant();
    const double unknown[] = {std::sin(kTwoPi * f * t), s > jump ? 1.0 : 0.0,
                              std::sin(kTwoPi * (1 + 20 * s * s) * s)};
    if (c.spoilt == Spoilt::kUnknown) i += size * unknown[which];
    if (!map) log.t.push_back(t);
    log.theta_m.push_back(theta_m + (map ? 0 : x.angle_noise * normal(seed, 9, k)));
    log.i_q.push_back(readings.of(i));
  }
  return trace_positions(hold_out({log}, 0.25, facts.machine), facts);
}

TraceResult bus_voltage(Draw& d, PointCase& c, const DrawnMachine& x, std::uint64_t seed) {
  const DriveFacts facts = facts_of(x);
  Readings readings(d, c.spoilt, 0.2 * x.v_dc, seed);
  const double T = d.between(1.5, 6), f = d.log_between(40, 1200), phase = d.phase();
  const double A = d.log_between(0.006, 0.04) * x.v_dc, begin = d.between(0.2, 0.6);
  const bool there = c.spoilt == Spoilt::kEffect || c.spoilt == Spoilt::kUnknown;
  const int which = d.whole(0, 2);
  if (c.spoilt == Spoilt::kEffect) c.truth = {"dc_bus_ripple"};
  Record record;
  record.T_s = 1e-4;
  for (int k = 0; k < T / record.T_s; ++k) {
    const double t = k * record.T_s, s = t / T;
    double amount = 1, at = f * t;
    if (c.spoilt == Spoilt::kUnknown && which == 0) amount = s > begin && s < begin + 0.3 ? 1 : 0;
    if (c.spoilt == Spoilt::kUnknown && which == 1) at += 3 * std::sin(2.1 * t);
    if (c.spoilt == Spoilt::kUnknown && which == 2) at += 0.1 * f * t * s;
    record.t.push_back(t);
    record.theta_m.push_back(30 * t);
    record.v_dc.push_back(
        readings.of(x.v_dc + (there ? A * amount * std::sin(kTwoPi * at + phase) : 0)));
    record.electrical_ok.push_back(1), record.motion_ok.push_back(1);
  }
  const BusRipple bus =
      find_bus_ripple(record, held_out_rows(record, 0.25, x.machine.n_p), facts, {});
  TraceResult r;
  r.effects = bus.effects;
  r.refused = bus.refused;
  r.verdict = verdict_of(r);
  return r;
}

}  // namespace

PointCase trace_points(PointSet set, Spoilt spoilt, std::uint64_t seed) {
  Draw d(seed);
  const DrawnMachine x = draw_machine(d);
  PointCase c{.set = set, .spoilt = spoilt, .truth = {}, .aliases = {}, .result = {}};
  switch (set) {
    case PointSet::kFluxMap:
      c.result = flux_map(d, c, x, seed);
      break;
    case PointSet::kInverterCurve:
      c.result = inverter_curve(d, c, x, seed);
      break;
    case PointSet::kHoldingCurrent:
      c.result = holding(d, c, x, seed);
      break;
    case PointSet::kBusVoltage:
      c.result = bus_voltage(d, c, x, seed);
      break;
  }
  return c;
}

}  // namespace twinrate::blind
