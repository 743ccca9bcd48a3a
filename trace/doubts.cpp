#include "trace/doubts.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/gate.hpp"
#include "trace/keys.hpp"
#include "trace/residual_structure.hpp"
#include "trace/torque_over_sensors.hpp"
#include "trace/verdict.hpp"

namespace twinrate {
namespace {

// The equation whose residual clearly exceeds the noise of the sensors; empty: none. The noise of an angle makes a
// torque that grows with the square of the frequency and hides a slow one, so the torque is compared after the filter
// that whitens the drawn noise. Of 299 drawn logs with nothing missing 13 exceed the limit; of 14 with a visible
// effect and no claim five do.
std::string more_than_noise(const Fitter& fitter, const Fit& fit) {
  constexpr double kOverNoise = 1.25, kOverDrawnNoise = 1.6;
  const DriveFacts& facts = fitter.chain().equations().facts();
  const Sampled left = fitter.chain().residual(fit.effects());
  const auto rms = [](double square, const Eigen::VectorXd& of) {
    return std::sqrt(square / static_cast<double>(std::max<Eigen::Index>(1, of.size())));
  };
  const double torque = rms(left.torque.squaredNorm(), left.torque),
               over = torque_over_sensors(fitter.chain(), left, left.noise_torque);
  if (torque > least_torque(facts) && over > kOverDrawnNoise) return torque_in_words(torque, over);
  const double square = left.d.squaredNorm() + left.q.squaredNorm(),
               noise = left.noise_d.squaredNorm() + left.noise_q.squaredNorm();
  if (!(noise > 0) || rms(square, left.d) < least_voltage(facts) ||
      square < kOverNoise * kOverNoise * noise)
    return "";
  return fmt::format(
      "the residual of the voltage equation is {:.3g} V, {:.3g} times the noise floor",
      rms(square, left.d), std::sqrt(square / noise));
}

// On judging rows if there are any, by four standard deviations of a mean square over so many rows.
bool beats_no_change(const EquationError& e) {
  const double after = e.after.held_out > 0 ? e.after.held_out : e.after.train;
  const double scatter = std::sqrt(2 / static_cast<double>(std::max<std::size_t>(1, e.rows)));
  return e.no_change * e.no_change > (1 + Criterion{}.sigmas * scatter) * after * after;
}

}  // namespace

void doubt_nothing(const Fitter& fitter, const Fit& fit, const std::string& unconfirmed,
                   TraceResult& r) {
  const std::size_t told = r.identifiable.size(), all = told + r.not_identifiable.size();
  if (4 * told < all) {
    r.verdict = "ambiguous";
    r.sentence =
        fmt::format("Cannot tell: of {} kinds of effects {} identifiable in this record. {}", all,
                    told == 0   ? "none is"
                    : told == 1 ? fmt::format("only {} is", r.identifiable[0])
                                : fmt::format("only {} are", fmt::join(r.identifiable, ", ")),
                    kLongerRun);
    std::vector<std::string> blind;
    for (const auto& [kind, why] : r.not_identifiable) blind.push_back(kind);
    r.ambiguous.push_back({blind, "this record does not excite them",
                           "a run that varies speed, load and i_d independently (twinrate trace "
                           "--plan proposes one)"});
    return;
  }
  const std::string left = more_than_noise(fitter, fit);
  const std::string why =
      left.empty() ? unconfirmed
                   : left + (r.excluded.empty() ? ", and this record does not show the cause"
                                                : ", and no kind that is looked for explains it");
  if (why.empty()) return;
  r.verdict = "ambiguous";
  r.sentence = fmt::format("Cannot tell: {}. {}", why, kLongerRun);
}

void doubt_samples_alone(const Fitter& fitter, const Fit& fit, TraceResult& r) {
  const auto& main = r.main_equation == "electrical" ? r.electrical : r.mechanical;
  std::string why = more_than_noise(fitter, fit);
  if (why.empty() && !main) why = "no row shows how well the model predicts";
  if (why.empty() && !beats_no_change(*main))
    why = fmt::format(
        "over {:.3g} ms the model predicts no better than no change does (held-out error {:.3g} "
        "against {:.3g} {})",
        1e3 * r.horizon_s, main->after.held_out, main->no_change, main->unit);
  if (!why.empty()) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell whether the model lacks more effects than the samples show: {}. {}", why,
        r.sentence);
  } else if (const Refused* refused = refusal_to_tell(r)) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell whether the model lacks more effects than the samples show: {}. {}",
        refusal_in_words(*refused), r.sentence);
  }
}

void doubt_unconfirmed(const std::vector<Alternative>& refused, TraceResult& r) {
  constexpr double kMuch = kTwoMissing * Fitter::kMargin;
  const auto is_linear = [](const std::string& kind) {
    return make_effect(kind)->tracing().regressor_count() > 0;
  };
  for (const Alternative& x : refused) {
    if (x.score_gain < kMuch || !is_linear(x.kind)) continue;
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell whether the model lacks more: {} would lower the BIC of the fitted rows by "
        "{:.0f}, but its refinement or the held-out rows refused it. {}",
        x.kind, x.score_gain, r.sentence);
    return;
  }
}

void doubt_beside_refused(const std::vector<Refused>& refused, TraceResult& r) {
  if (r.verdict != "traced") return;
  for (const Refused& x : refused) {
    if (!x.left || !(make_effect(x.kind)->acts_on() & ~kOnVoltage)) continue;
    r.refused.push_back(x);
    r.verdict = "ambiguous";
    r.sentence =
        fmt::format("Cannot tell: {} can act on voltage and torque; beside the voltage {}. {}",
                    x.kind, refusal_in_words(x), r.sentence);
    return;
  }
}

bool at_constant_speed(const Equations& equations) {
  constexpr double kSteady = 0.05;  // of the speed: by design
  constexpr double kOthers = 0.5;   // of the rows
  std::vector<double> speeds;
  for (const OperatingPoint& p : equations.points()) speeds.push_back(p.omega_m);
  if (speeds.empty()) return false;
  std::sort(speeds.begin(), speeds.end());
  const auto tail = static_cast<std::size_t>(kOthers / 2 * static_cast<double>(speeds.size()));
  const double lower = speeds[tail], middle = speeds[speeds.size() / 2],
               upper = speeds[speeds.size() - 1 - tail];
  return upper - lower <= kSteady * std::abs(middle);
}

std::vector<char> changing_speed(const Equations& equations, const Runs& outputs) {
  constexpr double kReach = 0.1;         // s: the noise of a constant speed repeats in less
  constexpr double kChange = 0.1;        // of the speed: by design
  constexpr std::ptrdiff_t kLooks = 10;  // on each side
  const std::vector<OperatingPoint>& points = equations.points();
  const auto step = std::max<std::ptrdiff_t>(
      1, static_cast<std::ptrdiff_t>(kReach / equations.record().T_s) / kLooks);
  std::vector<char> changes;
  for (const std::size_t row : outputs.row) {
    double least = points[row].omega_m, most = least;
    for (std::ptrdiff_t j = -kLooks; j <= kLooks; ++j) {
      const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) + j * step;
      if (at < 0 || at >= std::ssize(points)) continue;
      least = std::min(least, points[static_cast<std::size_t>(at)].omega_m);
      most = std::max(most, points[static_cast<std::size_t>(at)].omega_m);
    }
    changes.push_back(most - least > kChange * std::abs(most + least) / 2);
  }
  return changes;
}

namespace {

// The frequency at which the counts of the angle pass in the second half of the record, if the rows
// show it, or one of its first harmonics, as `f_Hz`; 0: they do not.
double counts_shown_as(double f_Hz, const Record& record) {
  constexpr int kHarmonics = 3;
  constexpr double kLines = 2;  // resolved frequencies
  const std::size_t end = record.size() - 1, begin = end / 2;
  const double T = record.t[end] - record.t[begin];
  if (record.angle.lsb == 0 || T <= 0) return 0;
  const double counts_Hz =
      std::abs(record.theta_m[end] - record.theta_m[begin]) / T / record.angle.lsb;
  for (int harmonic = 1; harmonic <= kHarmonics; ++harmonic)
    if (std::abs(std::abs(std::remainder(harmonic * counts_Hz, 1 / record.T_s)) - f_Hz) <
        kLines / T)
      return harmonic * counts_Hz;
  return 0;
}

}  // namespace

std::string doubt_of_line(const Effect& line, const Chain& chain, double i_lsb) {
  const double f_Hz = get_key(line, "frequency_Hz");
  if (f_Hz == 0 || !at_constant_speed(chain.equations())) return "";
  if (const double counts_Hz = counts_shown_as(f_Hz, chain.equations().record()); counts_Hz > 0)
    return fmt::format(
        "at constant speed, the counts of the angle pass at {:.4g} Hz, which the rows show as "
        "{:.4g} Hz: the controller responds to each",
        counts_Hz, f_Hz);
  const MachineParameters& m = chain.equations().facts().machine;
  const double half_count = chain.equations().record().angle.lsb / 2, half_step = i_lsb / 2,
               most_Nm =
                   m.J * std::pow(kTwoPi * f_Hz, 2) * half_count + m.torque_constant() * half_step;
  if (get_key(line, "amplitude_Nm") > most_Nm) return "";
  return fmt::format(
      "at constant speed, rounding by half a count and half a step of the currents can make {:.3g} "
      "Nm at that frequency",
      most_Nm);
}

}  // namespace twinrate
