#include "lanes/engine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <thread>
#include <vector>

#include "controller/scaled_tuning.hpp"
#include "estimator/scaled_tuning.hpp"
#include "lanes/isa.hpp"
#include "model/math.hpp"
#include "model/random.hpp"

namespace twinrate::lanes {
namespace {

// The first key whose value the engine does not cover; "" if none.
std::string not_covered(const DriveConfig& d) {
  if (static_cast<int>(d.gain.policy) > static_cast<int>(Policy::kRotorFrame))
    return fmt::format("gain.policy is {}", kGainPolicyNames[static_cast<int>(d.gain.policy)]);
  if (d.estimator.kind != "ekf_sensorless") return "estimator.kind is not ekf_sensorless";
  if (d.controller.kind != "foc") return "controller.kind is not foc";
  if (d.controller.angle_source != AngleSource::kEstimate)
    return "controller.angle_source is not estimate";
  if (d.estimator.prediction == Prediction::kExact) return "estimator.prediction is exact";
  if (d.machine.L_d != d.machine.L_q) return "the machine is salient";
  if (!d.effects.empty()) return "the drive has effects";
  if (d.plant.inverter != InverterModel::kAveraged) return "plant.inverter is not averaged";
  if (d.plant.delay_samples != 1) return "plant.delay_samples is not 1";
  if (d.locks_first()) return "rates.n_from is locked";
  if (d.start == Start::kAlignIf) return "start is align_if";
  if (!d.reference.omega_e_rad_s.is_constant() || !d.reference.speed_rpm.is_constant() ||
      !d.reference.i_d_A.is_constant() || !d.load.T_load_Nm.is_constant())
    return "a reference or the load is a profile";
  return "";
}

}  // namespace

std::string lane_settings(Config& config, LaneSettings& s) {
  const DriveConfig& d = config.drive();
  if (std::string why = not_covered(d); !why.empty()) return why;
  EkfSensorlessParameters tuning;
  FocParameters foc;
  scale(tuning, per_unit(d.machine, d.inverter.v_dc, d.T_s()), d.machine.J, d.T_s());
  scale(foc, d);
  config.read_table("estimator.ekf_sensorless", [&](FieldVisitor& f) { tuning.fields(f); });
  config.read_table("controller.foc", [&](FieldVisitor& f) { foc.fields(f); });
  const MachineParameters& m = d.machine;
  s = {.T_s = d.T_s(),
       .R_s = m.R_s,
       .L = m.L_d,
       .psi_f = m.psi_f,
       .J = m.J,
       .B = m.B,
       .n_p = static_cast<double>(m.n_p),
       .theta_e_start = d.plant.theta_e_start,
       .i_noise_rms = d.sensors.i_noise_rms,
       .i_lsb = d.sensors.i_lsb,
       .v_dc = d.inverter.v_dc};
  std::copy_n(tuning.Q_diag, 4, s.Q);
  std::copy_n(tuning.R_diag, 2, s.R);
  std::copy_n(tuning.P0_diag, 4, s.P0);
  s.rk4 = d.estimator.prediction == Prediction::kRk4;
  s.covariance = resolve(d.estimator.covariance, tuning.Q_diag, tuning.R_diag, tuning.P0_diag);
  s.current_bandwidth_Hz = foc.current_bandwidth;
  s.speed_bandwidth_Hz = foc.speed_bandwidth;
  s.i_max = foc.i_max;
  s.decoupling = foc.decoupling;
  s.i_d_ref = std::clamp(d.reference.i_d_A.at(0), -foc.i_max, foc.i_max);
  // Limits of one step: decay of the currents by exp(-1/2), rotation by 0.4 rad at rated speed.
  s.plant_steps = static_cast<int>(std::ceil(
      s.T_s * std::max({s.R_s / s.L / 0.5, m.omega_m_rated * s.n_p / 0.4, 1e-9 / s.T_s})));
  return "";
}

Point point_of(const DriveConfig& d) {
  return {.omega_e_ref_rad_s = d.reference_at(0).omega_m_ref * d.machine.n_p,
          .slew_rad_s2 = d.reference.slew_rate_rad_s2,
          .n = d.rates.n,
          .policy = static_cast<Policy>(d.gain.policy),
          .seed = static_cast<std::uint64_t>(d.run.seed),
          .flying = d.start == Start::kFlying,
          .full_until_s = static_cast<double>(d.background_rate().from) * d.T_s(),
          .T_load_Nm = d.load.T_load_Nm.at(0),
          .load_slew_Nm_s = d.load.slew_Nm_s,
          .duration_s = d.run.duration_s,
          .settle_s = d.run.settle_s};
}

// tau^-1 int_0^end e^(-a (end - x)) N(x) dx by Simpson's rule on a fine grid, N the basis
// polynomial of a node. Times a b: share of the node in the current due to the flux of the magnet.
template <class Basis>
static double node_share(double a, double b, double end, Basis N) {
  constexpr int kPanels = 400;
  double sum = 0;
  for (int i = 0; i <= kPanels; ++i) {
    const double x = end * i / kPanels;
    const double share = i == 0 || i == kPanels ? 1 : i % 2 ? 4 : 2;
    sum += share * math::exp(-a * (end - x)) * N(x);
  }
  return a * b * sum * end / (3 * kPanels);
}

// Coefficients of lanes/plant.hpp: polynomials through value and rate at 0 and 1, without and with
// the value at 2.
static void set_plant(LaneConstants<double>& c, const LaneSettings& s) {
  c.tau = 0.5 * s.T_s / s.plant_steps;
  c.inv_tau = 1 / c.tau;
  c.a = c.tau * s.R_s / s.L;
  c.b = s.psi_f / s.L;
  c.k_T = c.tau * c.tau * 1.5 * s.n_p * s.n_p * s.psi_f / s.J;
  c.B = c.tau * s.B / s.J;
  c.load = c.tau * c.tau * s.n_p / s.J;
  c.g = c.tau / s.L;
  const auto mid = [&](auto N) { return node_share(c.a, c.b, 1, N); };
  const auto end = [&](auto N) { return node_share(c.a, c.b, 2, N); };
  const auto sq = [](double x) { return x * x; };
  c.mid_decay = math::exp(-c.a);
  c.mid_u = -math::expm1(-c.a) / c.a;
  c.mid_0 = mid([&](double x) { return (1 + 2 * x) * sq(1 - x); }) + c.b * c.mid_decay;
  c.mid_d0 = mid([&](double x) { return x * sq(1 - x); });
  c.mid_1 = mid([&](double x) { return sq(x) * (3 - 2 * x); }) - c.b;
  c.mid_d1 = mid([&](double x) { return sq(x) * (x - 1); });
  c.end_decay = math::exp(-2 * c.a);
  c.end_u = -math::expm1(-2 * c.a) / c.a;
  c.end_0 =
      end([&](double x) { return sq(1 - x) * (2 - x) * (0.5 + 1.25 * x); }) + c.b * c.end_decay;
  c.end_d0 = end([&](double x) { return 0.5 * x * sq(1 - x) * (2 - x); });
  c.end_1 = end([&](double x) { return sq(x) * sq(2 - x); });
  c.end_d1 = end([&](double x) { return sq(x) * (x - 1) * (2 - x); });
  c.end_2 = end([&](double x) { return 0.25 * sq(x) * sq(x - 1); }) - c.b;
  // Cubic through A and its rate at 0 and 1: W_1 and the angle at 1, less the Taylor polynomial of
  // plant_step.
  c.late_0 = 0.5 * c.end_d1 - 0.15 * c.end_1;
  c.late_d0 = c.end_d1 / 12 - 7.0 / 60 * c.end_1;
  c.late_1 = 0.5 * c.end_d1 + 0.15 * c.end_1;
  c.late_d1 = -c.end_d1 / 12 - c.end_1 / 30;
}

LaneConstants<double> lane_constants(const LaneSettings& s) {
  LaneConstants<double> c{};
  set_plant(c, s);
  const double count_A = s.i_lsb > 0 ? s.i_lsb : 1;
  c.counts_an_A = 1 / count_A;
  c.half_sqrt3_counts_an_A = 0.5 * std::numbers::sqrt3 / count_A;
  c.noise_counts = s.i_noise_rms / count_A;
  c.third_A_a_count = count_A / 3;
  c.inv_sqrt3_A_a_count = count_A * std::numbers::inv_sqrt3;
  c.filter = s.rk4 ? kernel::sensorless_rk4(s.R_s, s.L, s.psi_f, s.T_s)
                   : kernel::sensorless_euler(s.R_s, s.L, s.psi_f, s.T_s);
  std::copy_n(s.Q, 4, c.Q);
  std::copy_n(s.R, 2, c.R);
  c.inv_n_p = 1 / s.n_p;
  c.T_s = s.T_s;
  const PiGains speed = speed_pi(kTwoPi * s.speed_bandwidth_Hz, s.J, 1.5 * s.n_p * s.psi_f);
  const PiGains current = current_pi(kTwoPi * s.current_bandwidth_Hz, s.R_s, s.L);
  c.K_p_speed = speed.K_p, c.K_i_speed = speed.K_i * s.T_s, c.k_awu_speed = speed.k_awu * s.T_s;
  c.K_p = current.K_p, c.K_i = current.K_i * s.T_s, c.k_awu = current.k_awu * s.T_s;
  c.i_d_ref = s.i_d_ref;
  c.i_q_max = std::sqrt(s.i_max * s.i_max - s.i_d_ref * s.i_d_ref);
  c.advance_s = 1.5 * s.T_s;
  c.u_max = s.v_dc * std::numbers::inv_sqrt3;
  c.u_max_square = c.u_max * c.u_max;
  c.L = s.decoupling ? s.L : 0;
  c.psi_f = s.decoupling ? s.psi_f : 0;
  return c;
}

LaneSwitches lane_switches(const LaneSettings& s) {
  return {s.plant_steps, s.i_noise_rms > 0, s.i_lsb > 0, s.rk4, s.covariance};
}

void prepare(const LaneSettings& s, const Point& p, LaneDrive<double>& d) {
  constexpr double kNoLimit = std::numeric_limits<double>::infinity();
  d = {};
  d.omega_m_target = p.omega_e_ref_rad_s / s.n_p;
  d.slew_step = p.slew_rad_s2 > 0 ? p.slew_rad_s2 / s.n_p * s.T_s : kNoLimit;
  d.T_load_target = p.T_load_Nm;
  d.load_step = p.load_slew_Nm_s > 0 ? p.load_slew_Nm_s * s.T_s : kNoLimit;
  d.n = p.n;
  d.k_full = std::round(p.full_until_s / s.T_s);
  d.k_settle = std::round(p.settle_s / s.T_s);
  d.k_end = std::round(p.duration_s / s.T_s);
  for (int phase = 0; phase < 3; ++phase)
    for (int half = 0; half < 2; ++half)
      d.noise_seed[phase][half] = std::bit_cast<double>(twinrate::splitmix64(
          twinrate::splitmix64(p.seed) ^ static_cast<std::uint64_t>(2 * phase + half)));
  const double omega_e = p.flying ? p.omega_e_ref_rad_s : 0;
  const math::SinCos at = math::sincos(s.theta_e_start);
  d.plant = {0, 0, omega_e, s.theta_e_start, {at.sin, at.cos}};
  d.x = {0, 0, omega_e, 0};
  d.at = {0, 1};
  d.gain.at = d.next_gain.at = {0, 1};
  d.P = {s.P0[0], 0, 0, 0, s.P0[1], 0, 0, s.P0[2], 0, s.P0[3]};
  d.omega_m_ref = omega_e / s.n_p;
}

bool available(Isa isa) {
  switch (isa) {
    case Isa::kPortable:
      return true;
    case Isa::kScalar:
    case Isa::kAvx2:
      return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    case Isa::kAvx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
             __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  }
  return false;
}

Isa widest() {
  for (Isa isa : {Isa::kAvx512, Isa::kAvx2})
    if (available(isa)) return isa;
  return Isa::kPortable;
}

int width(Isa isa) {
  return isa == Isa::kAvx512 ? 8 : isa == Isa::kAvx2 ? 4 : 1;
}

static RunLanes* lanes_of(Isa isa) {
  RunLanes* const all[] = {run_portable, run_scalar, run_avx2, run_avx512};
  return all[static_cast<int>(isa)];
}

// Sorts by n, so that the drives of a row take their snapshots together.
static std::vector<std::size_t> order_of(std::span<const Point> points, Policy policy) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].policy == policy) order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return points[i].n < points[j].n; });
  return order;
}

void run_points(const LaneSettings& settings, std::span<const Point> points,
                std::span<PointResult> results, int threads, Isa isa, const std::atomic<bool>* stop,
                std::atomic<std::size_t>* done) {
  const LaneConstants<double> c = lane_constants(settings);
  if (threads <= 0) threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  for (Policy policy : {Policy::kPaper, Policy::kImmediate, Policy::kExtrapolate, Policy::kRotate,
                        Policy::kRotorFrame}) {
    const std::vector<std::size_t> order = order_of(points, policy);
    if (order.empty()) continue;
    std::atomic<std::size_t> next = 0;
    const LaneQueue queue{points.data(), results.data(), order.data(), order.size(),
                          &next,         stop,           done};
    const std::size_t rows = (order.size() + width(isa) - 1) / width(isa);
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < std::min<std::size_t>(threads, rows); ++i)
      others.emplace_back([&] { lanes_of(isa)(settings, c, policy, queue); });
    lanes_of(isa)(settings, c, policy, queue);
  }
}

PlantSample advance_plant(const LaneSettings& settings, const PlantSample& x, double u_alpha,
                          double u_beta, double T_load) {
  using T = Lanes<1, struct PlantSampleTag>;
  const LaneConstants<double> constants = lane_constants(settings);
  LaneConstants<T> c;
  static_assert(sizeof c == sizeof constants);
  std::memcpy(static_cast<void*>(&c), &constants, sizeof c);
  LanePlant<T> plant{x.i_alpha, x.i_beta, x.omega_e, x.theta_e, sincos<T>(x.theta_e)};
  advance<T>(c, settings.plant_steps, plant, {u_alpha, u_beta}, T_load);
  return {plant.i_alpha.v, plant.i_beta.v, plant.omega_e.v, plant.theta_e.v};
}

}  // namespace twinrate::lanes
