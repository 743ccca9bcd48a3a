#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <mutex>
#include <thread>

#include "analysis/summary.hpp"
#include "estimator/make_filter.hpp"
#include "loop/closed_floquet.hpp"
#include "loop/load_drive.hpp"
#include "loop/stale_gain.hpp"
#include "sweep/figure.hpp"
#include "sweep/run.hpp"
#include "sweep/store.hpp"

namespace twinrate::sweep {
namespace {

constexpr int kMaxFloquet_n = 400, kMaxClosed_n = 100;

// One row of why.csv.
struct Reason {
  double phi_c = NAN;
  int formula = 0, floquet = 0;
  int closed = 0;      // 0: not predicted
  bool start = false;  // n_max + 1 is held, switched on at speed
  double rho_held = NAN, rho_next = NAN;
};

// Two values of n agree within one step or 15 %.
bool agree(int predicted, int measured) {
  return std::abs(predicted - measured) <= std::max(1.0, 0.15 * measured);
}

// The last n that a prediction of `l` tries.
int tried(const Limit& l) {
  return std::min(kMaxFloquet_n, 6 * l.n_max + 10);
}

// A drive without a loss up to n_max. A formula of 0 has no limit, or does not cover the filter.
std::string capped_verdict(const Limit& l, const Reason& r) {
  const bool none = r.formula == 0 && std::isfinite(r.phi_c);
  const bool by_formula = none || r.formula >= l.n_max;
  const bool by_floquet = r.floquet >= std::min(l.n_max, kMaxFloquet_n);
  if (!by_formula && !by_floquet) return "neither";
  const std::string which = by_formula && by_floquet ? "both" : by_formula ? "formula" : "Floquet";
  const bool no_limit = (!by_formula || none) && (!by_floquet || r.floquet >= tried(l));
  return which + (no_limit ? ": no limit" : ": above n_max");
}

std::string verdict(const Limit& l, const Reason& r) {
  if (l.policy == "scheduled") return r.rho_held < 1 ? "stable" : "unstable";
  if (l.capped) return capped_verdict(l, r);
  const bool by_formula = r.formula > 0 && agree(r.formula, l.n_max);
  const bool by_floquet = agree(r.floquet, l.n_max);
  if (by_formula && by_floquet) return "both";
  if (by_formula) return "formula";
  return by_floquet ? "Floquet" : "neither";
}

// The largest n of the two Floquet analyses that holds, as far as it was tried.
int predicted(const Reason& r) {
  return r.closed > 0 ? r.closed : r.floquet;
}

// The part that limits n: the start, if n_max + 1 is lost from standstill and kept when switched on
// at speed; else the part from the Floquet analyses.
std::string limited_by(const Reason& r) {
  return r.start ? "start" : limiting_part(r.floquet, r.closed, kMaxClosed_n);
}

// `config_mutex`: the closed loop reads tables of `config`, which records the read keys.
Reason explain(const Limit& l, const std::shared_ptr<const Filter>& filter, Config& config,
               std::mutex& config_mutex) {
  const DriveConfig& d = config.drive();
  GainPolicy policy{};
  for (int i = 0; kGainPolicyNames[i] != l.policy; ++i) policy = static_cast<GainPolicy>(i + 1);
  const double omega_e = kTwoPi * l.f_e_Hz;
  const Steady steady{filter,  policy,  omega_e / d.machine.n_p,
                      omega_e, d.T_s(), d.gain.speed_span / d.machine.n_p};
  Reason r;
  const bool table = !has_background(policy);
  const int limit = tried(l);
  const auto closed = [&] {
    const std::lock_guard<std::mutex> lock(config_mutex);
    return table ? std::nullopt : ClosedFloquet::of(config, steady);
  }();
  const Steady& at = closed ? closed->steady() : steady;
  r.phi_c = table ? NAN : critical_angle(at, std::max(1, l.n_max));
  r.formula = n_max_by_formula(at, limit);
  r.floquet = table ? 0 : n_max_by_floquet(at, limit);
  if (closed) r.closed = closed->n_max(std::min(limit, kMaxClosed_n));
  if (l.n_max > 0) r.rho_held = spectral_radius(at, table ? 1 : l.n_max);
  r.rho_next = table ? NAN : spectral_radius(at, l.n_max + 1);
  return r;
}

// One a limit, on all cores.
std::vector<Reason> explain_all(const std::vector<Limit>& limits,
                                const std::shared_ptr<const Filter>& filter, Config& config) {
  std::vector<Reason> reasons(limits.size());
  std::atomic<std::size_t> next = 0;
  std::exception_ptr failure;
  std::mutex failure_mutex, config_mutex;
  const auto work = [&] {
    try {
      for (std::size_t i = next++; i < limits.size(); i = next++)
        reasons[i] = explain(limits[i], filter, config, config_mutex);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex);
      failure = std::current_exception();
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
  return reasons;
}

// "130+": no loss up to 130, the last that was tried.
std::string text(int n, int tried = std::numeric_limits<int>::max()) {
  return n > 0 ? std::to_string(n) + (n >= tried ? "+" : "") : "-";
}

// A search from standstill that ends below the prediction: whether the start is the reason.
bool start_limits(const Plan& plan, const DriveConfig& base, const Limit& l, const Reason& r) {
  if (plan.start == "switched" || !plan.log.empty() || l.policy == "scheduled") return false;
  if (!l.complete || l.capped || predicted(r) <= l.n_max || agree(predicted(r), l.n_max))
    return false;
  Plan at_speed = plan;
  at_speed.start = "switched";
  return run_in_process(at_speed, base, {l.policy, l.f_e_Hz, 1}, l.n_max + 1).locked;
}

// The reason why a row is no median between two extremes, and a start that limits.
std::string remark(const Limit& l, const Reason& r) {
  if (r.start)
    return fmt::format(" (the start limits: switched on at speed n = {} holds)", l.n_max + 1);
  if (!l.complete) return " (not finished)";
  if (l.policy == "scheduled") return "";
  if (l.capped) return " (n_max is the cap)";
  if (l.seeds_capped > 0)
    return fmt::format(" (the cap ended {} of {} seeds: lo is an upper bound)", l.seeds_capped,
                       l.seeds);
  return "";
}

// "-" if there is no such number: a filter without a critical angle, a policy without n.
std::string figure(const char* format, double value) {
  return std::isnan(value) ? "-" : fmt::format(fmt::runtime(format), value);
}

void write_reasons(const std::string& path, const Plan& plan, const std::vector<Limit>& limits,
                   const std::shared_ptr<const Filter>& filter, Config& config, bool print) {
  std::ofstream file(path);
  file << "policy,f_e_Hz,n_max,phi_c_rad,n_max_formula,n_max_floquet,rho_at_n_max,rho_at_next,"
          "agrees,n_max_closed,limited_by\n";
  if (print)
    fmt::print("{:<12} {:>7} {:>6} {:>9} {:>6} {:>6}..{:<6} {:>7} {:>8} {:>6} {:>6} {:>6}  {}\n",
               "policy", "f_e Hz", "n_max", "f_bmin Hz", "ratio", "lo", "hi", "phi_c", "formula",
               "Floq.", "closed", "rho", "agrees");
  std::vector<Reason> reasons = explain_all(limits, filter, config);
  for (std::size_t i = 0; i < limits.size(); ++i)
    reasons[i].start = start_limits(plan, config.drive(), limits[i], reasons[i]);
  for (std::size_t i = 0; i < limits.size(); ++i) {
    const Limit& l = limits[i];
    const Reason& r = reasons[i];
    const std::string agrees = verdict(l, r);
    file << fmt::format("{},{},{},{},{},{},{},{},{},{},{}\n", l.policy, l.f_e_Hz, l.n_max, r.phi_c,
                        r.formula, r.floquet, r.rho_held, r.rho_next, agrees, text(r.closed),
                        limited_by(r));
    if (!print) continue;
    const bool table = l.policy == "scheduled";
    fmt::print(
        "{:<12} {:>7.4g} {:>6} {:>9} {:>6} {:>6}..{:<6} {:>7} {:>8} {:>6} {:>6} {:>6}  {}{}\n",
        l.policy, l.f_e_Hz, table ? "-" : text(l.n_max),
        figure("{:.5g}", table ? NAN : l.f_bmin_Hz()),
        figure("{:.3g}", table ? NAN : l.ratio(l.n_max)),
        figure("{:.3g}", table ? NAN : l.ratio(l.n_highest)),
        figure("{:.3g}", table ? NAN : l.ratio(l.n_lowest)), figure("{:.1f}", r.phi_c * 180 / kPi),
        text(r.formula, tried(l)), text(r.floquet, tried(l)),
        text(r.closed, std::min(tried(l), kMaxClosed_n)), figure("{:.3f}", r.rho_held), agrees,
        remark(l, r));
  }
}

}  // namespace

void write_result(const Plan& plan, const Config& config, const std::string& directory,
                  std::vector<Point> points, bool json) {
  sort_points(plan, points);
  write_points(directory + "/points.csv", points);
  const std::vector<Limit> limits = limits_of(plan, points);
  write_limits(directory + "/fbmin.csv", limits);
  const DriveConfig& d = config.drive();
  write_figure(directory + "/figure.svg", limits,
               {d.name, command_of(plan), is_motor_of_the_paper(d.machine)});
  std::vector<std::string> overrides = plan.overrides;
  if (plan.load_pu)
    overrides.push_back(fmt::format("load.T_load_Nm={}", *plan.load_pu * d.machine.T_rated));
  Config again = load_drive(plan.drive, overrides);
  const auto filter = make_filter(again);
  if (filter->steady_state(0))
    write_reasons(directory + "/why.csv", plan, limits, filter, again, !json);
  if (!json)
    fmt::print("\n{} points; {}/points.csv, fbmin.csv, figure.svg, why.csv\n", points.size(),
               directory);
}

}  // namespace twinrate::sweep
