#include "analysis/step_response.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kRadPerRpm = kTwoPi / 60;
constexpr double kRiseFrom = 0.1, kRiseTo = 0.9;
constexpr double kSpeedBand = 0.02;     // of the step
constexpr double kDeviationBand = 0.1;  // of the largest deviation
constexpr double kNoStep = 1e-6;        // of the wanted value

// Samples after a step: times from it, speeds and references.
struct Stretch {
  std::vector<double> t_s, omega_m, reference;
};

// First time after which every |deviation| stays within `band`, empty if that is later than half
// the stretch: a ripple that leaves the band repeatedly can be inside it at the last tick by
// chance.
std::optional<double> stays_within(const Stretch& s, const std::vector<double>& deviation,
                                   double band) {
  std::size_t first = deviation.size();
  while (first > 0 && std::abs(deviation[first - 1]) <= band) --first;
  if (first == deviation.size() || s.t_s[first] > 0.5 * s.t_s.back()) return {};
  return s.t_s[first];
}

void judge_speed(const Stretch& s, StepResponse& step) {
  const double size = step.to - step.from;
  std::vector<double> missing(s.omega_m.size());
  std::optional<double> t_from, t_to;
  double excess = 0;
  for (std::size_t i = 0; i < missing.size(); ++i) {
    const double share = (s.omega_m[i] - step.from) / size;
    if (!t_from && share >= kRiseFrom) t_from = s.t_s[i];
    if (!t_to && share >= kRiseTo) t_to = s.t_s[i];
    missing[i] = 1 - share;
    excess = std::max(excess, share - 1);
  }
  if (!t_to) return;
  step.rise_s = *t_to - *t_from;
  step.overshoot = excess * std::abs(size);
  step.recovery_s = stays_within(s, missing, kSpeedBand);
}

void judge_load(const Stretch& s, StepResponse& step) {
  const double direction = step.reference < 0 ? -1 : 1;
  std::vector<double> excess(s.omega_m.size());
  for (std::size_t i = 0; i < excess.size(); ++i)
    excess[i] = direction * (s.omega_m[i] - s.reference[i]);
  const auto [least, most] = std::minmax_element(excess.begin(), excess.end());
  step.dip = std::max(0.0, -*least);
  step.overshoot = std::max(0.0, *most);
  step.recovery_s = stays_within(s, excess, kDeviationBand * std::max(*step.dip, *step.overshoot));
}

// The steps of reference and load of the drive file, by time. `omega_m_begin`: speed before the first.
std::vector<StepResponse> steps_of(const DriveConfig& config, double omega_m_begin) {
  const ReferenceParameters& r = config.reference;
  const Profile& wanted = r.in_rpm ? r.speed_rpm : r.omega_e_rad_s;
  const double unit = r.in_rpm ? kRadPerRpm : 1.0 / config.machine.n_p;
  std::vector<StepResponse> steps;
  const auto add = [&](bool of_load, double t_s, double from, double to) {
    if (std::abs(to - from) > kNoStep * std::max(std::abs(from), std::abs(to)))
      steps.push_back({of_load, t_s, from, to, unit * wanted.at(t_s), {}, {}, {}, {}});
  };
  if (!r.from_bus) {
    double from = omega_m_begin;
    for (const ProfileStep& step : wanted.steps()) {
      add(false, step.t_s, from, unit * step.value);
      from = unit * step.value;
    }
  }
  const std::vector<ProfileStep>& loads = config.load.T_load_Nm.steps();
  for (std::size_t i = 1; i < loads.size(); ++i)
    add(true, loads[i].t_s, loads[i - 1].value, loads[i].value);
  std::stable_sort(steps.begin(), steps.end(),
                   [](const auto& a, const auto& b) { return a.t_s < b.t_s; });
  return steps;
}

// The rows from the step to `end_s`. `begin_s`: time of the rows at t = 0 of the drive file.
Stretch stretch_of(TickRows rows, const std::vector<double>& omega_m, const StepResponse& step,
                   double begin_s, double end_s) {
  Stretch stretch;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double t_s = rows[i].t_s - begin_s;
    if (t_s < step.t_s || t_s >= end_s || !std::isfinite(omega_m[i])) continue;
    const double reference = rows[i].command ? rows[i].command->omega_m_ref : NAN;
    stretch.t_s.push_back(t_s - step.t_s);
    stretch.omega_m.push_back(omega_m[i]);
    stretch.reference.push_back(std::isfinite(reference) ? reference : step.reference);
  }
  return stretch;
}

}  // namespace

std::vector<StepResponse> step_responses(TickRows rows, const std::vector<double>& omega_m,
                                         const DriveConfig& config) {
  const auto first =
      std::find_if(omega_m.begin(), omega_m.end(), [](double w) { return std::isfinite(w); });
  if (first == omega_m.end()) return {};
  const std::vector<StepResponse> steps = steps_of(config, *first);
  // Of a long log there can be a part.
  const double shown_s = std::max(0.0, static_cast<double>(rows.front().k) * config.T_s());
  const double begin_s = rows.front().t_s - shown_s;
  std::vector<StepResponse> judged;
  for (StepResponse step : steps) {
    if (step.t_s < shown_s) continue;
    const auto next = std::find_if(steps.begin(), steps.end(),
                                   [&](const StepResponse& s) { return s.t_s > step.t_s; });
    const double end_s = next == steps.end() ? INFINITY : next->t_s;
    const Stretch stretch = stretch_of(rows, omega_m, step, begin_s, end_s);
    if (stretch.t_s.empty()) continue;
    step.of_load ? judge_load(stretch, step) : judge_speed(stretch, step);
    judged.push_back(step);
  }
  return judged;
}

}  // namespace twinrate
