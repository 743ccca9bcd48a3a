// twinrate design lqr DRIVE.toml: gains, closed-loop poles and margins of the state feedback.
// twinrate design bandwidths DRIVE.toml: bandwidths of foc from J, K_t, f_s and the filter.
// twinrate design orders RUN: the orders detected in the estimated load of a run.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "analysis/load_orders.hpp"
#include "controller/scaled_tuning.hpp"
#include "estimator/ekf_harmonic.hpp"
#include "estimator/make_filter.hpp"
#include "loop/bandwidths.hpp"
#include "loop/closed_floquet.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kDegrees = 180 / kPi;
constexpr double kGainTolerance = 1e-3;  // relative error of gains from weights

struct DesignOptions {
  std::string drive;
  std::vector<std::string> overrides;
  bool json = false;
  int for_n = 0;  // 0: the gains of the drive file
};

// The continuous pole of a discrete pole z, rad/s.
std::complex<double> continuous(std::complex<double> z, double T_s) {
  return std::log(z) / T_s;
}

std::string pole_text(std::complex<double> s) {
  if (std::abs(s.imag()) < 1e-9 * std::abs(s)) return fmt::format("{:.4g}", s.real());
  return fmt::format("{:.4g}{:+.4g}j", s.real(), s.imag());
}

std::string margins_text(const Margins& m) {
  const std::string up = std::isfinite(m.gain_up) ? fmt::format("{:.2f} ({:.1f} dB)", m.gain_up,
                                                                20 * std::log10(m.gain_up))
                                                  : "none";
  const std::string down =
      m.gain_down > 0 ? fmt::format(", down to {:.3f}", m.gain_down) : std::string();
  return fmt::format("gain {}{}, phase {:.1f} deg at {:.4g} rad/s", up, down,
                     m.phase_rad * kDegrees, m.crossover_rad_s);
}

Json margins_json(const Margins& m) {
  return {{"gain_up", std::isfinite(m.gain_up) ? Json(m.gain_up) : Json()},
          {"gain_down", m.gain_down},
          {"phase_deg", m.phase_rad * kDegrees},
          {"crossover_rad_s", m.crossover_rad_s}};
}

// The weights whose gains are nearest to the given ones, and the error of their gains.
std::string inverse_verdict(const NearestWeights& nearest) {
  if (nearest.largest_error < kGainTolerance)
    return fmt::format("optimal for Q = diag({:.4g}), R = 1", fmt::join(nearest.Q, ", "));
  return fmt::format(
      "not optimal for any non-negative diagonal weights: the nearest, Q = diag({:.4g}), R = 1, "
      "give "
      "[{:.4g}] ({:.1f} % off)",
      fmt::join(nearest.Q, ", "), fmt::join(nearest.K, ", "), 100 * nearest.largest_error);
}

void print_axis(const char* name, const AxisDesign& axis, double T_s, int delay) {
  fmt::print("\n{} axis, x = [{}]\n", name, fmt::join(axis.states, ", "));
  fmt::print("  K               [{:.5g}]\n", fmt::join(axis.K, ", "));
  if (axis.Q.size() > 0) {
    fmt::print("  weights         Q = diag({:.5g}), R = {:.5g}\n", fmt::join(axis.Q, ", "), axis.R);
    fmt::print("  Riccati         residual {:.1e} after {} doublings\n", axis.residual,
               axis.iterations);
  } else {
    fmt::print("  as weights      {}\n", inverse_verdict(nearest_weights(axis, T_s)));
  }
  std::vector<std::string> poles;
  for (const auto& z : axis.poles) poles.push_back(pole_text(continuous(z, T_s)));
  fmt::print("  poles (rad/s)   {}\n", fmt::join(poles, ", "));
  fmt::print("  margins         {}\n", margins_text(margins_of(axis, 0, T_s)));
  fmt::print("  with the delay  {}\n", margins_text(margins_of(axis, delay, T_s)));
  for (const std::string& complaint : axis.complaints)
    fmt::print("  INCONSISTENT    {}\n", complaint);
}

Json axis_json(const AxisDesign& axis, double T_s, int delay) {
  Json json{{"states", axis.states}, {"K", std::vector<double>(axis.K.begin(), axis.K.end())}};
  if (axis.Q.size() > 0) {
    json["Q"] = std::vector<double>(axis.Q.begin(), axis.Q.end());
    json["R"] = axis.R;
    json["riccati_residual"] = axis.residual;
  } else {
    const NearestWeights nearest = nearest_weights(axis, T_s);
    json["nearest_weights"] = {{"Q", std::vector<double>(nearest.Q.begin(), nearest.Q.end())},
                               {"K", std::vector<double>(nearest.K.begin(), nearest.K.end())},
                               {"largest_error", nearest.largest_error}};
  }
  json["poles_z"] = Json::array();
  json["poles_rad_s"] = Json::array();
  for (const auto& z : axis.poles) {
    const auto s = continuous(z, T_s);
    json["poles_z"].push_back({z.real(), z.imag()});
    json["poles_rad_s"].push_back({s.real(), s.imag()});
  }
  json["margins"] = margins_json(margins_of(axis, 0, T_s));
  json["margins_with_delay"] = margins_json(margins_of(axis, delay, T_s));
  json["inconsistent"] = axis.complaints;
  return json;
}

int design(const DesignOptions& o) {
  Config config = load_drive(o.drive, o.overrides);
  const DriveConfig& d = config.drive();
  LqrParameters p;
  scale(p, config.drive());
  p.i_max = d.machine.i_rated > 0 ? d.machine.i_rated : 1;  // the design does not depend on it
  if (config.has_table("controller.lqr"))
    config.read_table("controller.lqr", [&](FieldVisitor& f) { p.fields(f); });
  const LqrDesign design = design_lqr(d.machine, d.inverter.v_dc, d.T_s(), p.design);
  if (o.json) {
    std::cout << Json{{"gains", kGainSourceNames[static_cast<int>(p.design.gains)]},
                      {"T_s_s", d.T_s()},
                      {"K_pp_V", design.K_pp},
                      {"K_ff_1_Nm", design.K_ff},
                      {"d", axis_json(design.d, d.T_s(), d.plant.delay_samples)},
                      {"q", axis_json(design.q, d.T_s(), d.plant.delay_samples)}}
                     .dump(2)
              << "\n";
  } else {
    fmt::print("{}: state feedback at f_s = {:g} Hz, J = {:g} kgm2, gains: {}\n",
               d.name.empty() ? o.drive : d.name, d.rates.f_s_Hz, d.machine.J,
               kGainSourceNames[static_cast<int>(p.design.gains)]);
    fmt::print("u = -K x - K_ff T_o, normalised by K_pp = {:.4g} V; K_ff = {:.4g} 1/Nm\n",
               design.K_pp, design.K_ff);
    print_axis("d", design.d, d.T_s(), d.plant.delay_samples);
    print_axis("q", design.q, d.T_s(), d.plant.delay_samples);
  }
  return design.d.complaints.empty() && design.q.complaints.empty() ? 0 : 2;
}

double fastest_omega_e(const DriveConfig& d) {
  const Profile& profile = d.reference.in_rpm ? d.reference.speed_rpm : d.reference.omega_e_rad_s;
  double fastest = 0;
  for (const ProfileStep& step : profile.steps()) fastest = std::max(fastest, std::abs(step.value));
  return fastest * (d.reference.in_rpm ? kTwoPi / 60 * d.machine.n_p : 1);
}

// Bandwidths of the state feedback, and the largest n that the closed loop holds with them.
struct Candidate {
  double current_Hz = 0, speed_Hz = 0;
  int n_max = 0;
  bool covered = false;
  std::vector<std::string> overrides() const {
    return {"controller.kind=lqr", "controller.lqr.gains=bandwidths",
            fmt::format("controller.lqr.bandwidth_d_Hz=[{}, {}]", current_Hz, speed_Hz / 2),
            fmt::format("controller.lqr.bandwidth_q_Hz=[{}, {}, {}]", current_Hz, speed_Hz,
                        speed_Hz / 2)};
  }
};

std::vector<std::string> joined(std::vector<std::string> list,
                                const std::vector<std::string>& more) {
  list.insert(list.end(), more.begin(), more.end());
  return list;
}

// The bandwidths nearest to the defaults of this machine that hold n. Throws BadInput if none does.
Candidate bandwidths_for(const DesignOptions& o, double omega_e, int n_of_filter) {
  LqrParameters p;
  scale(p, load_drive(o.drive, o.overrides).drive());
  const double current = p.design.bandwidth_q_Hz[0], speed = p.design.bandwidth_q_Hz[1];
  Candidate best;
  for (const auto& [by_current, by_speed] : {std::pair(1.0, 1.0),
                                             {1.0, 0.5},
                                             {2.0, 1.0},
                                             {0.5, 0.5},
                                             {1.0, 0.25},
                                             {2.0, 0.5},
                                             {0.5, 0.25},
                                             {2.0, 0.25},
                                             {1.0, 0.125},
                                             {0.5, 0.125},
                                             {2.0, 0.125}}) {
    Candidate c{by_current * current, by_speed * speed};
    Config config = load_drive(o.drive, joined(o.overrides, c.overrides()));
    const auto floquet = ClosedFloquet::of(config, omega_e);
    if (!floquet) continue;
    c.covered = true;
    c.n_max = floquet->n_max(o.for_n);
    if (c.n_max >= o.for_n) return c;
    if (!best.covered || c.n_max > best.n_max) best = c;
  }
  if (!best.covered)
    throw BadInput(o.drive +
                   ": --for-n: the closed loop of this filter and controller is not predicted");
  throw BadInput(fmt::format(
      "{}: --for-n: no bandwidths found that hold n = {}: the best hold {}, the filter alone {}",
      o.drive, o.for_n, best.n_max, n_of_filter));
}

void print_for_n(const DesignOptions& o, const Candidate& c, double omega_e, int n_of_filter) {
  Config config = load_drive(o.drive, joined(o.overrides, c.overrides()));
  const DriveConfig& d = config.drive();
  LqrParameters p;
  scale(p, d);
  config.read_table("controller.lqr", [&](FieldVisitor& f) { p.fields(f); });
  const LqrDesign design = design_lqr(d.machine, d.inverter.v_dc, d.T_s(), p.design);
  fmt::print("{}: weights that hold n = {} at {:.4g} rad/s electrical, gain policy {}\n",
             d.name.empty() ? o.drive : d.name, o.for_n, omega_e,
             kGainPolicyNames[static_cast<int>(d.gain.policy)]);
  fmt::print("  closed loop stable for n = 1 to {}; the filter alone for n up to {}{}\n", o.for_n,
             n_of_filter, n_of_filter == 4 * o.for_n ? ", where the search ended" : "");
  fmt::print("  of bandwidths   current {:.4g} Hz, speed {:.4g} Hz, integral {:.4g} Hz\n",
             c.current_Hz, c.speed_Hz, c.speed_Hz / 2);
  fmt::print(
      "\n[controller.lqr]\ngains = \"weights\"\nQ_d = [{:.6g}]\nR_d = 1.0\nQ_q = [{:.6g}]\nR_q = "
      "1.0\n",
      fmt::join(design.d.Q, ", "), fmt::join(design.q.Q, ", "));
}

// Weights of the state feedback that hold a wanted n at the fastest speed of the profile.
int design_for_n(const DesignOptions& o) {
  Config config = load_drive(o.drive, o.overrides);
  const DriveConfig& d = config.drive();
  const double omega_e = fastest_omega_e(d);
  if (omega_e == 0) throw BadInput(o.drive + ": --for-n: needs a reference speed other than 0");
  const auto filter = make_filter(config);
  if (!filter->steady_state(0))
    throw BadInput(o.drive + ": --for-n: the closed loop of this filter is not predicted");
  const Steady steady{filter,  d.gain.policy, omega_e / d.machine.n_p,
                      omega_e, d.T_s(),       d.gain.speed_span / d.machine.n_p};
  const int n_of_filter = n_max_by_floquet(steady, 4 * o.for_n);
  const Candidate found = bandwidths_for(o, omega_e, n_of_filter);
  print_for_n(o, found, omega_e, n_of_filter);
  return 0;
}

int print_bandwidths(const DesignOptions& o) {
  Config config = load_drive(o.drive, o.overrides);
  const Bandwidths b = suggest_bandwidths(config);
  const DriveConfig& d = config.drive();
  if (o.json) {
    std::cout << Json{{"current_bandwidth_Hz", b.current_Hz},
                      {"current_most_Hz", b.current_most_Hz},
                      {"speed_bandwidth_Hz", b.speed_Hz},
                      {"speed_least_Hz", b.speed_least_Hz},
                      {"speed_most_Hz", b.speed_most_Hz},
                      {"filter_Hz", b.filter_Hz ? Json(*b.filter_Hz) : Json()},
                      {"K_p_As_rad", b.K_p_As_rad},
                      {"dip_rad_s", b.dip_rad_s},
                      {"dip_at_s", b.dip_at_s}}
                     .dump(2)
              << "\n";
    return 0;
  }
  const MachineParameters& m = d.machine;
  fmt::print("{}: loops of foc for J = {:.4g} kgm2, K_t = {:.4g} Nm/A, f_s = {:g} Hz\n",
             d.name.empty() ? o.drive : d.name, m.J, m.torque_constant(), d.rates.f_s_Hz);
  fmt::print("  current loop    {:.4g} Hz: 68 deg of phase margin; {:.4g} Hz leave 30 deg\n",
             b.current_Hz, b.current_most_Hz);
  fmt::print(
      "  speed loop      {:.4g} Hz; from {:.4g} Hz on rated torque makes the speed dip by 10 % of "
      "the rated speed at most\n",
      b.speed_Hz, b.speed_least_Hz);
  fmt::print(
      "                  up to {:.4g} Hz: a fifth of the current loop{}\n", b.speed_most_Hz,
      b.filter_Hz ? fmt::format(", and 0.9 of the {:.4g} Hz of the filter", *b.filter_Hz) : "");
  fmt::print(
      "  a step of rated torque: dip {:.4g} rad/s, {:.3g} ms after it; K_p = {:.4g} As/rad\n",
      b.dip_rad_s, 1e3 * b.dip_at_s, b.K_p_As_rad);
  fmt::print("\n[controller.foc]\ncurrent_bandwidth_Hz = {:.4g}\nspeed_bandwidth_Hz = {:.4g}\n",
             b.current_Hz, b.speed_Hz);
  return 0;
}

struct OrdersOptions {
  std::string run;
  int most = kMostOrders;
  bool json = false;
};

int find_orders(const OrdersOptions& o) {
  const RunLog log = read_run_log(o.run);
  const Config config = Config::parse(log.config_toml, o.run);
  const LoadOrders found = load_orders(log, config.drive().run.settle_s, o.most);
  if (found.turns == 0)
    throw BadInput(o.run + ": no whole turn with a position and an estimated load after settle_s");
  if (o.json) {
    Json list = Json::array();
    for (const auto& [N, amplitude] : found.orders)
      list.push_back({{"order", N}, {"amplitude_Nm", amplitude}});
    std::cout << Json{{"turns", found.turns}, {"noise_Nm", found.noise}, {"orders", list}}.dump(2)
              << "\n";
    return 0;
  }
  fmt::print("{} whole turns, noise {:.2g} Nm an order\n", found.turns, found.noise);
  constexpr double kSmall_percent = 0.1;
  bool small = false;
  std::vector<int> orders;
  for (const auto& [N, amplitude] : found.orders) {
    const double share = 100 * amplitude / config.drive().machine.T_rated;
    fmt::print("  order {:3}   {:.3g} Nm, {:.2g} % of the rated torque\n", N, amplitude, share);
    small = small || share < kSmall_percent;
    orders.push_back(N);
  }
  if (small)
    fmt::print(
        "orders below {:g} % of the rated torque: the steps of the encoder{} and noise that is not "
        "white make such ones\n",
        kSmall_percent,
        config.drive().sensors.encoder_counts > 0
            ? fmt::format(" ({} counts)", config.drive().sensors.encoder_counts)
            : "");
  fmt::print("\n[estimator.ekf_harmonic]\norders = [{}]\n", fmt::join(orders, ", "));
  return 0;
}

}  // namespace

void add_design_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<DesignOptions>();
  CLI::App* verb = app.add_subcommand("design", "Design a controller for a drive");
  verb->require_subcommand(1);
  CLI::App* lqr =
      verb->add_subcommand("lqr", "Design the state feedback: print gains, poles, margins");
  lqr->add_option("DRIVE", o->drive, "read this drive file or preset")->required();
  lqr->add_option("--set", o->overrides,
                  "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  CLI::Option* json = lqr->add_flag("--json", o->json, "print JSON");
  lqr->add_option("--for-n", o->for_n,
                  "print weights that hold a gain every N ticks at the fastest reference speed")
      ->check(CLI::Range(1, 500))
      ->excludes(json);
  lqr->callback([o, &exit_code] { exit_code = o->for_n > 0 ? design_for_n(*o) : design(*o); });
  auto loops = std::make_shared<DesignOptions>();
  CLI::App* bandwidths = verb->add_subcommand(
      "bandwidths", "Suggest the bandwidths of foc from J, K_t, f_s and the filter");
  bandwidths->add_option("DRIVE", loops->drive, "read this drive file or preset")->required();
  bandwidths
      ->add_option("--set", loops->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  bandwidths->add_flag("--json", loops->json, "print JSON");
  bandwidths->callback([loops, &exit_code] { exit_code = print_bandwidths(*loops); });
  auto find = std::make_shared<OrdersOptions>();
  CLI::App* orders =
      verb->add_subcommand("orders", "List the orders of an estimated load that exceed the noise");
  orders->add_option("RUN", find->run, "read this run directory or log")->required();
  orders->add_option("--most", find->most, "list at most this many orders, the largest first")
      ->check(CLI::Range(1, 200));
  orders->add_flag("--json", find->json, "print JSON");
  orders->callback([find, &exit_code] { exit_code = find_orders(*find); });
}

}  // namespace twinrate
