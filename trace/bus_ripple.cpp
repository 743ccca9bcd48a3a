#include "trace/bus_ripple.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "model/effects/catalogue.hpp"
#include "trace/bus_lines.hpp"
#include "trace/bus_pictures.hpp"
#include "trace/bus_pieces.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"
#include "trace/transfer.hpp"

namespace twinrate {
namespace {

constexpr double kSlow_s = 0.1;       // averages over this time are load, drift and steps
constexpr double kLowest_Hz = 20;     // of a line
constexpr double kHighest = 0.45;     // of the sampling rate
constexpr double kWindow_s = 0.4;     // of the spectrum
constexpr double kShortest_s = 0.05;  // of that window
constexpr std::size_t kFewestBusRows = 128, kMostBusLines = 4;
constexpr double kSigmas = 8, kToBeSeen = 4;
constexpr double kSteady = 0.9;
constexpr std::size_t kPiecesOfRun = 4;
constexpr double kUnseenLow = 0.5, kUnseenHigh = 1.5;  // amplitude on held-out rows over the fitted
constexpr double kResolved = 1e-6;                     // of the bus voltage: no sensor does better
constexpr double kSag = 0.1;          // of the bus voltage at rated power: more than any bus sags
constexpr double kTimesSlope = 3;     // a resonance may raise the sag
constexpr double kPowerMoves = 0.02;  // of rated power: a smaller variation gives no slope
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

class RippleSearch {
 public:
  RippleSearch(const Record& record, const std::vector<char>& held_out, const DriveFacts& facts,
               const Effects& known, const Considered& considered)
      : record_(record), facts_(facts), held_out_(held_out), pieces_(bus_pieces(record)) {
    const double rows = kSlow_s / record.T_s;
    window_ = 2 * static_cast<std::size_t>(std::max(1.0, std::round(0.5 * rows))) + 1;
    v_ = record.v_dc;
    const Effects on_bus = acting_on(known, kOnBus);
    for (std::size_t k = 0; !on_bus.empty() && k < v_.size(); ++k)
      v_[k] -= sum_at(on_bus, {.t = record.t[k]}).v_dc;
    slow_pieces_ = pieces_;
    x_ = without_slow_part(v_, window_, pieces_);
    training_ = runs_of(pieces_, held_out_, false);
    unseen_ = runs_of(pieces_, held_out_, true);
    fitted_ = training_;
    auto unit = make_placed(Traits::Place::kBusLine);
    set_key(*unit, "amplitude_V", 1);
    smallest_ = 1 / unit->tracing().materiality(facts_);
    excluded_ = !considered(unit->kind());
  }
  BusRipple find();

 private:
  bool choose_window();
  bool add_line(std::string& note);
  double sag_bound() const;
  std::string refusal(std::size_t n) const;
  Refused transfer_refusal(std::size_t n) const;
  TracedEffect effect_of(std::size_t n) const;
  EquationError error() const;
  std::vector<double> model_of(const BusLine& line) const;
  void renew();

  const Record& record_;
  const DriveFacts& facts_;
  const std::vector<char>& held_out_;
  std::vector<BusPiece> pieces_, slow_pieces_, training_, unseen_, fitted_;
  std::size_t window_ = 3, size_ = 0;
  std::vector<double> v_, x_, rest_;
  double smallest_ = 1, floor_ = 0;
  bool own_clocks_ = false;  // every piece has its own phase
  bool excluded_ = false;    // the user excludes the kind
  std::vector<BusLine> lines_;
  std::vector<std::vector<double>> models_;  // of the lines, row by row
};

bool RippleSearch::choose_window() {
  std::size_t longest = 0;
  for (const BusPiece& run : training_) longest = std::max(longest, run.last - run.first);
  const double most = std::min(kWindow_s / record_.T_s, static_cast<double>(longest));
  size_ = 1;
  while (static_cast<double>(2 * size_) <= most) size_ *= 2;
  return size_ >= kFewestBusRows && static_cast<double>(size_) * record_.T_s >= kShortest_s;
}

// The line over all rows; if clocks differ, with the phase of each piece.
std::vector<double> RippleSearch::model_of(const BusLine& line) const {
  std::vector<double> y(x_.size(), 0.0);
  const double gain = high_pass_gain(line.f, window_, record_.T_s);
  for (const BusPiece& piece : pieces_) {
    double phase = line.phase();
    if (own_clocks_) {
      const std::complex<double> c = part_at(line.f, record_.t, x_, piece.first, piece.last);
      phase = std::atan2(c.real(), -c.imag());
    }
    put_sine(line.f, gain * line.amplitude(), phase, record_.t, piece.first, piece.last, y);
  }
  return y;
}

void RippleSearch::renew() {
  models_.clear();
  rest_ = x_;
  for (const BusLine& line : lines_) {
    models_.push_back(model_of(line));
    for (std::size_t k = 0; k < rest_.size(); ++k) rest_[k] -= models_.back()[k];
  }
}

// Adds the next strongest line and refines all together. False if there is none, or none with a
// steady frequency (`note`).
bool RippleSearch::add_line(std::string& note) {
  const BusSpectrum spectrum = bus_spectrum(rest_, training_, size_, record_.T_s);
  double beside = 0;
  const double lowest = std::max(kLowest_Hz, 4 * spectrum.df);
  const std::size_t bin = strongest_peak(spectrum, lowest, kHighest / record_.T_s, beside);
  if (bin == 0 || spectrum.amplitude(bin) < 0.5 * smallest_) return false;
  const double f = frequency_at(spectrum, bin);
  const auto near = [&] {
    return line_near(f, record_.t, rest_, fitted_, size_, window_, record_.T_s);
  };
  BusLine line = near();
  if (line.steady < kSteady && !own_clocks_ && pieces_.size() > 1) {
    // Several files in sequence: tries the longest alone.
    const BusPiece longest = *std::max_element(
        pieces_.begin(), pieces_.end(),
        [](const auto& a, const auto& b) { return a.last - a.first < b.last - b.first; });
    const std::vector<BusPiece> all = fitted_;
    fitted_ = runs_of({longest}, held_out_, false);
    line = near();
    own_clocks_ = line.steady >= kSteady;
    if (!own_clocks_) fitted_ = all;
  }
  const bool beside_another = std::any_of(lines_.begin(), lines_.end(), [&](const BusLine& other) {
    return std::abs(other.f - f) < 3 * spectrum.df;
  });
  if (line.steady < kSteady || beside_another) {
    if (spectrum.amplitude(bin) < smallest_) return false;
    note = fmt::format("v_dc alternates near {:.4g} Hz by {:.3g} V, but at no steady frequency", f,
                       spectrum.amplitude(bin));
    return false;
  }
  line.noise = std::sqrt(std::max(beside, std::pow(kResolved * facts_.v_dc, 2)));
  lines_.push_back(line);
  refine(record_.t, x_, fitted_, window_, record_.T_s, lines_);
  renew();
  return true;
}

// V/W: more than the bus can sag under the drive's power.
double RippleSearch::sag_bound() const {
  const double i_rated = facts_.machine.i_rated > 0 ? facts_.machine.i_rated : 7;
  const double P_rated = 1.5 * 0.8 * facts_.v_dc * std::numbers::inv_sqrt3 * i_rated;
  double n = 0, P_sum = 0, v_sum = 0, PP = 0, Pv = 0;
  for (const BusPiece& piece : slow_pieces_)
    for (std::size_t k = piece.first; k + window_ <= piece.last; k += window_) {
      double P = 0, v = 0;
      for (std::size_t j = k; j < k + window_; ++j) {
        P += 1.5 * record_.u_alphabeta[j].dot(record_.i_alphabeta[j]);
        v += v_[j];
      }
      P /= static_cast<double>(window_), v /= static_cast<double>(window_);
      ++n, P_sum += P, v_sum += v, PP += P * P, Pv += P * v;
    }
  const double variance = PP / n - std::pow(P_sum / n, 2);
  double slope = 0;
  if (n > 2 && variance > std::pow(kPowerMoves * P_rated, 2))
    slope = std::abs(Pv / n - P_sum * v_sum / (n * n)) / variance;
  return std::max(kTimesSlope * slope, kSag * facts_.v_dc / P_rated);
}

// The reason why line n is no effect; empty: it is one.
std::string RippleSearch::refusal(std::size_t n) const {
  if (excluded_) return "excluded by --exclude";
  const BusLine& line = lines_[n];
  const double A = line.amplitude();
  if (A < smallest_ || A < kSigmas * line.sigma_amplitude) return "too small";
  double product = 0, square = 0;
  for (const BusPiece& run : unseen_)
    for (std::size_t k = run.first; k < run.last; ++k) {
      product += (rest_[k] + models_[n][k]) * models_[n][k];
      square += models_[n][k] * models_[n][k];
    }
  if (square > 0 && !(product > kUnseenLow * square && product < kUnseenHigh * square))
    return fmt::format("on the hold-out it is {:.2f} times as large", product / square);
  if (!record_.has_voltage_equation()) return "";
  std::vector<double> power(x_.size(), 0.0);
  for (std::size_t k = 0; k < power.size(); ++k)
    power[k] = 1.5 * record_.u_alphabeta[k].dot(record_.i_alphabeta[k]);
  std::vector<BusPiece> pieces = slow_pieces_;
  const std::vector<double> quick = without_slow_part(power, window_, pieces);
  double P = 0, rows = 0;
  std::complex<double> sum = 0;
  for (const BusPiece& run : fitted_) {
    sum += static_cast<double>(run.last - run.first) *
           part_at(line.f, record_.t, quick, run.first, run.last);
    rows += static_cast<double>(run.last - run.first);
  }
  P = std::abs(sum) / rows / high_pass_gain(line.f, window_, record_.T_s);
  if (A > sag_bound() * P) return "";
  return fmt::format(
      "the power of the drive has {:.3g} W at this frequency, which can make the bus sag", P);
}

// The rule of transfer on the judging rows, with the line and without it, the others in both. Empty
// if the line passes, and if no row judges.
Refused RippleSearch::transfer_refusal(std::size_t n) const {
  if (unseen_.empty()) return {};
  Pieces with, without;
  for (std::size_t r = 0; r < unseen_.size(); ++r) {
    const BusPiece& run = unseen_[r];
    for (std::size_t k = run.first; k < run.last; ++k) {
      const std::size_t piece = kPiecesOfRun * (k - run.first) / (run.last - run.first);
      with[{0, kPiecesOfRun * r + piece}] += rest_[k] * rest_[k];
      without[{0, kPiecesOfRun * r + piece}] += std::pow(rest_[k] + models_[n][k], 2);
    }
  }
  const Criterion criterion;
  const Votes votes = votes_of(without, with, criterion.silent);
  Refused refused = refused_by_transfer({votes}, {}, criterion).front();
  refused.kind = make_placed(Traits::Place::kBusLine)->kind();
  refused.left = votes.judgement.p_value < criterion.chance;
  return refused;
}

TracedEffect RippleSearch::effect_of(std::size_t n) const {
  const BusLine& line = lines_[n];
  const std::shared_ptr<Effect> effect = make_placed(Traits::Place::kBusLine);
  set_key(*effect, "amplitude_V", line.amplitude());
  set_key(*effect, "frequency_Hz", line.f);
  set_key(*effect, "phase_rad", line.phase());
  effect->prepare(facts_);
  TracedEffect e{.effect = effect, .equation = "electrical"};
  e.parameters = traced_parameters(*effect, {{"amplitude_V", line.sigma_amplitude},
                                             {"frequency_Hz", line.sigma_f},
                                             {"phase_rad", line.sigma_phase}});
  const double N = static_cast<double>(rows_in(fitted_));
  const double fall = N * std::log1p(std::pow(line.amplitude() / line.noise, 2) / 2);
  e.delta_bic = 3 * std::log(N) - fall;
  e.p_value = chi_square_tail(fall, 3);
  double without = 0, with = 0;
  for (const BusPiece& run : unseen_)
    for (std::size_t k = run.first; k < run.last; ++k) {
      without += std::pow(rest_[k] + models_[n][k], 2);
      with += rest_[k] * rest_[k];
    }
  e.held_out_gain = without > 0 ? 1 - with / without : kUnknown;
  e.materiality = effect->tracing().materiality(facts_);
  return e;
}

EquationError RippleSearch::error() const {
  const auto rms = [](const std::vector<double>& y, const std::vector<BusPiece>& runs) {
    double sum = 0;
    for (const BusPiece& run : runs)
      for (std::size_t k = run.first; k < run.last; ++k) sum += y[k] * y[k];
    return rows_in(runs) > 0 ? std::sqrt(sum / static_cast<double>(rows_in(runs))) : kUnknown;
  };
  EquationError e{.unit = "V",
                  .before = {rms(x_, training_), rms(x_, unseen_)},
                  .after = {rms(rest_, training_), rms(rest_, unseen_)}};
  std::vector<double> change(x_.size(), 0.0);
  for (std::size_t k = 1; k < x_.size(); ++k) change[k] = x_[k] - x_[k - 1];
  e.no_change = rms(change, unseen_.empty() ? training_ : unseen_);
  e.noise_floor = floor_;
  e.whiteness_p_value = kUnknown;
  e.rows = rows_in(unseen_.empty() ? training_ : unseen_);
  return e;
}

BusRipple RippleSearch::find() {
  BusRipple found;
  const auto [low, high] = std::minmax_element(record_.v_dc.begin(), record_.v_dc.end());
  if (*high - *low < kResolved * facts_.v_dc) {
    found.blind = "v_dc in the log never changes: a set value, or too coarse to show a ripple";
    return found;
  }
  if (!choose_window()) {
    found.blind = "no stretch of v_dc is long enough";
    return found;
  }
  renew();
  std::string note;
  while (lines_.size() < kMostBusLines && add_line(note)) {
  }
  if (!note.empty()) found.notes.push_back(note);
  std::vector<BusLine> kept;
  for (std::size_t n = 0; n < lines_.size(); ++n) {
    std::string why = refusal(n);
    if (why.empty()) {
      Refused refused = transfer_refusal(n);
      if (refused.rule.empty()) {
        kept.push_back(lines_[n]);
        continue;
      }
      why = refused.text;
      found.refused.push_back(std::move(refused));
    }
    if (lines_[n].amplitude() >= smallest_) {
      found.notes.push_back(
          fmt::format("v_dc has a line of {:.3g} V at {:.5g} Hz that is not named: {}",
                      lines_[n].amplitude(), lines_[n].f, why));
    }
  }
  lines_ = std::move(kept);
  renew();
  const BusSpectrum left = bus_spectrum(rest_, training_, size_, record_.T_s);
  std::vector<double> powers = left.power;
  const auto middle = powers.begin() + static_cast<std::ptrdiff_t>(powers.size() / 2);
  std::nth_element(powers.begin(), middle, powers.end());
  floor_ = std::sqrt(*middle);
  const double sigma = floor_ * std::sqrt(2 / static_cast<double>(rows_in(training_)));
  if (kToBeSeen * sigma > smallest_)
    found.blind =
        fmt::format("one standard deviation is {:.2g} times the smallest size worth reporting",
                    sigma / smallest_);
  if (lines_.empty()) return found;
  found.own_clocks = own_clocks_;
  found.error = error();
  double highest = 0;
  for (std::size_t n = 0; n < lines_.size(); ++n) {
    found.effects.push_back(effect_of(n));
    found.pictures.push_back(picture_of_period(lines_[n].f, record_.t, held_out_,
                                               own_clocks_ ? fitted_ : pieces_, models_[n], rest_));
    highest = std::max(highest, lines_[n].f);
  }
  found.pictures.push_back(
      picture_of_spectra(3 * highest, bus_spectrum(x_, training_, size_, record_.T_s), left));
  return found;
}

}  // namespace

BusRipple find_bus_ripple(const Record& record, const std::vector<char>& held_out,
                          const DriveFacts& facts, const Effects& known,
                          const Considered& considered) {
  if (!record.v_dc.empty()) return RippleSearch(record, held_out, facts, known, considered).find();
  BusRipple none;
  none.blind = "v_dc is not in the log";
  return none;
}

}  // namespace twinrate
