#include "trace/noise.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>

#include "model/effects/catalogue.hpp"
#include "model/random.hpp"
#include "trace/loop_response.hpp"
#include "trace/parallel.hpp"
#include "trace/rounding.hpp"
#include "trace/signals.hpp"

namespace twinrate {
namespace {

constexpr double kResonance = 0.7;  // of the noise: shafts count if they leave less
constexpr double kLeast = 0.6, kLeastBesideShafts = 0.85;  // of the sensors' noise
constexpr std::uint64_t kSeed = 0x7261772d6e6f6973;        // differs from those of simulated drives
constexpr double kQuiet = 0.75;  // share of the record that counts as noise alone

Runs first_runs(const Runs& runs, Eigen::Index n) {
  Runs first;
  first.row.assign(runs.row.begin(), runs.row.begin() + n);
  for (std::size_t s : runs.start)
    if (s < static_cast<std::size_t>(n)) first.start.push_back(s);
  return first;
}

// The pieces of the runs with the least power, because a missing effect that acts only at times
// (impacts, transients) is not noise. `kept` receives their values.
Runs quiet_runs(const Eigen::VectorXd& x, const Runs& runs, Eigen::VectorXd& kept) {
  constexpr std::size_t kPiece = 100;
  struct Piece {
    std::size_t first, count;
    double power;
  };
  std::vector<Piece> pieces;
  const auto n = static_cast<std::size_t>(x.size());
  for (std::size_t r = 0; r < runs.start.size() && runs.start[r] < n; ++r) {
    const std::size_t end = std::min(n, r + 1 < runs.start.size() ? runs.start[r + 1] : n);
    for (std::size_t first = runs.start[r]; first + kPiece <= end; first += kPiece)
      pieces.push_back(
          {first, kPiece, x.segment(static_cast<Eigen::Index>(first), kPiece).squaredNorm()});
  }
  Runs quiet;
  if (pieces.size() < 6) {
    kept = x;
    quiet.row.assign(runs.row.begin(), runs.row.begin() + static_cast<std::ptrdiff_t>(n));
    for (std::size_t s : runs.start)
      if (s < n) quiet.start.push_back(s);
    return quiet;
  }
  std::sort(pieces.begin(), pieces.end(),
            [](const Piece& a, const Piece& b) { return a.power < b.power; });
  pieces.resize(static_cast<std::size_t>(kQuiet * static_cast<double>(pieces.size())));
  kept.resize(static_cast<Eigen::Index>(pieces.size() * kPiece));
  for (const Piece& piece : pieces) {
    quiet.start.push_back(quiet.row.size());
    kept.segment(static_cast<Eigen::Index>(quiet.row.size()), kPiece) =
        x.segment(static_cast<Eigen::Index>(piece.first), kPiece);
    for (std::size_t i = 0; i < kPiece; ++i) quiet.row.push_back(runs.row[piece.first + i]);
  }
  return quiet;
}

// Median over pieces of the power of whitened noise.
double median_power(const Eigen::VectorXd& e) {
  constexpr Eigen::Index kPiece = 100;
  std::vector<double> power;
  for (Eigen::Index first = 0; first + kPiece <= e.size(); first += kPiece)
    power.push_back(e.segment(first, kPiece).squaredNorm() / kPiece);
  if (power.empty()) return 1;
  const auto middle = power.begin() + static_cast<std::ptrdiff_t>(power.size() / 2);
  std::nth_element(power.begin(), middle, power.end());
  return *middle;
}

// Ratio of the record's own noise to the added noise, as amplitudes.
double noise_scale(const Whitener& whitener, const Eigen::VectorXd& own,
                   const Eigen::VectorXd& added, const Runs& runs) {
  if (!own.size() || added.size() < own.size()) return 1;
  const Runs first = first_runs(runs, own.size());
  const double ratio = median_power(whitener(own, first)) /
                       std::max(1e-300, median_power(whitener(added.head(own.size()), first)));
  return std::sqrt(std::clamp(ratio, 0.5, 2.0));
}

// True if a column holds hardly any noise and can be used to estimate the noise.
bool is_clean(const Eigen::VectorXd& x, const Eigen::VectorXd& noise,
              const Eigen::VectorXd& answer) {
  constexpr double kNoisy = 0.02;  // share of its energy
  return x.size() > 0 &&
         (!noise.size() || (noise + answer).squaredNorm() < kNoisy * x.squaredNorm());
}

// Rounding errors, and white noise if the fourth difference is larger than rounding alone makes.
std::vector<double> angle_errors(const Record& record, const std::vector<char>& moving) {
  constexpr double kMore = 1.2;  // if a count lasts a few rows, rounding alone makes 1.1
  const double lsb = record.angle.lsb, of_rounding = lsb / std::sqrt(12.0);
  const double all = white_noise(
      record.size(), [&](std::size_t k) { return record.theta_m[k]; }, moving);
  const double white =
      all > kMore * of_rounding ? std::sqrt(all * all - of_rounding * of_rounding) : 0;
  std::vector<double> errors =
      lsb > 0 ? drawn_rounding(record.theta_m, lsb) : std::vector<double>(record.size(), 0.0);
  for (std::size_t k = 0; k < errors.size(); ++k) errors[k] += white * normal(kSeed, 0, k);
  return errors;
}

// White noise in rotor axes, in which a current at constant torque is constant. At least the ADC's
// rounding noise.
std::vector<Vec2> current_errors(const Record& record, int n_p, double i_lsb) {
  Vec2 sigma;
  for_each_index(2, [&](std::size_t n) {
    const auto axis = static_cast<Eigen::Index>(n);
    const auto current = [&](std::size_t k) {
      return park(record.i_alphabeta[k], n_p * record.theta_m[k])[axis];
    };
    sigma[axis] = std::max(white_noise(record.size(), current, record.electrical_ok),
                           i_lsb / std::sqrt(12.0));
  });
  std::vector<Vec2> errors(record.size());
  for (std::size_t k = 0; k < record.size(); ++k)
    errors[k] = inverse_park({sigma[0] * normal(kSeed, 1, k), sigma[1] * normal(kSeed, 2, k)},
                             n_p * record.theta_m[k]);
  return errors;
}

}  // namespace

NoisierRecords add_noise(const Record& record, const DriveFacts& facts,
                         const std::vector<char>& moving, double i_lsb) {
  SensorNoise noise;
  std::optional<LoopResponse> response;
  together({
      [&] { response.emplace(record, facts.machine); },
      [&] { noise.theta_m = angle_errors(record, moving); },
      [&] {
        if (!record.i_alphabeta.empty())
          noise.i_alphabeta = current_errors(record, facts.machine.n_p, i_lsb);
      },
  });
  NoisierRecords noisier{.answered = record, .readings = record};
  together({[&] { response->add(noise, noisier.answered); }, [&] { noise.add(noisier.readings); }});
  return noisier;
}

Record with_moved_counts(const Record& record) {
  Record rounded = record;
  const std::vector<double> errors = moved_rounding(record.theta_m, record.angle.lsb);
  for (std::size_t k = 0; k < errors.size(); ++k) rounded.theta_m[k] += errors[k];
  return rounded;
}

NoiseModel NoiseFit::operator()(const Chain& chain, const Sampled& y,
                                const Dictionary& dictionary) {
  Unexplained::Columns d, q, torque, shafts;
  const auto take = [&](const Sampled& x) {
    if (is_clean(x.d, x.noise_d, x.answer_d)) d.push_back(&x.d);
    if (is_clean(x.q, x.noise_q, x.answer_q)) q.push_back(&x.q);
    if (is_clean(x.torque, x.noise_torque, x.answer_torque)) torque.push_back(&x.torque);
  };
  std::deque<Sampled> differences;  // a deque, because `take` keeps pointers
  for (const Candidate& c : dictionary.sampled) {
    if (is_placed(*c.effect, Traits::Place::kShaft) && !is_slow_shaft(*c.effect) &&
        is_clean(c.columns[0].torque, c.columns[0].noise_torque, c.columns[0].answer_torque))
      shafts.push_back(&c.columns[0].torque);
    const Traits::Noise noise = c.effect->tracing().traits().noise;
    if (noise == Traits::Noise::kMimics) continue;
    if (noise != Traits::Noise::kInSum) {
      for (const Sampled& x : c.columns) take(x);
      continue;
    }
    for (std::size_t r = 0; r + 1 < c.columns.size(); ++r) {
      add(differences.emplace_back(c.columns[r]), c.columns.back(), -1);
      take(differences.back());
    }
  }
  // The residual beside the columns, or the sensors' noise if the residual is less than a share of
  // it.
  const auto rest = [](const Unexplained& by, std::size_t columns, const Eigen::VectorXd& of,
                       const Eigen::VectorXd& sensors, double& share, double least = kLeast) {
    const Eigen::VectorXd left = by(of, static_cast<Eigen::Index>(columns));
    share = left.norm() < sensors.norm() ? left.norm() / sensors.norm() : 1;
    return left.norm() < least * sensors.norm() ? sensors : left;
  };
  NoiseModel noise;
  // A resonance resembles noise, so the shafts are columns, too. But many shafts together can
  // explain any signal, so they count only if they explain much of the noise (kResonance), and the
  // slow ones, which explain a random load as well, do not.
  const std::size_t without_shafts = torque.size();
  torque.insert(torque.end(), shafts.begin(), shafts.end());
  const auto look = [](Unexplained& by, const Unexplained::Columns& columns,
                       const Eigen::VectorXd& sensors, const Runs& runs, const AngleNoise& angle) {
    if (!by.expects() && sensors.size() > 0 && sensors.norm() > 0)
      by.expect(Whitener(angle(sensors, runs), runs, angle, 0));
    by.look_at(columns);
  };
  const Sampler& sampler = chain.sampler();
  const double T_out = sampler.decimation() * chain.equations().record().T_s;
  const AngleNoise of_sensors = AngleNoise::of(y.noise_torque, sampler.torque(), T_out);
  together({
      [&] { look(torque_, torque, y.noise_torque, sampler.torque(), of_sensors); },
      [&] { look(d_, d, y.noise_d, sampler.electrical(), {}); },
      [&] { look(q_, q, y.noise_q, sampler.electrical(), {}); },
  });
  double beside_shafts = 1;
  const Eigen::VectorXd noise_d = rest(d_, d.size(), y.d, y.noise_d, noise.share_d),
                        noise_q = rest(q_, q.size(), y.q, y.noise_q, noise.share_q),
                        less_shafts = rest(torque_, torque.size(), y.torque, y.noise_torque,
                                           beside_shafts, kLeastBesideShafts);
  Eigen::VectorXd noise_torque =
      rest(torque_, without_shafts, y.torque, y.noise_torque, noise.share_torque);
  if (less_shafts.norm() < kResonance * noise_torque.norm()) noise_torque = less_shafts;
  const auto whitener = [](const Eigen::VectorXd& x, const Runs& runs, const AngleNoise& angle) {
    if (!x.size()) return Whitener();
    Eigen::VectorXd kept, innovations;
    quiet_runs(x, runs, kept);
    const double rms = std::sqrt(kept.squaredNorm() / static_cast<double>(kept.size()));
    const Runs quiet = quiet_runs(angle(x, runs), runs, innovations);
    return Whitener(innovations, quiet, angle, rms);
  };
  noise.d = whitener(noise_d, sampler.electrical(), {});
  noise.q = whitener(noise_q, sampler.electrical(), {});
  // Uses the model with more noise at low frequencies, because the fitted columns also remove
  // low-frequency noise from the residual.
  AngleNoise angle = AngleNoise::of(noise_torque, sampler.torque(), T_out);
  if (!angle.none() && (of_sensors.none() || of_sensors.w_over_s() > angle.w_over_s()))
    angle = of_sensors;
  noise.torque = whitener(noise_torque, sampler.torque(), angle);
  noise.sensors = of_sensors;
  noise.scale_d = noise_scale(noise.d, noise_d, y.noise_d, sampler.electrical());
  noise.scale_q = noise_scale(noise.q, noise_q, y.noise_q, sampler.electrical());
  noise.scale_torque = noise_scale(noise.torque, noise_torque, y.noise_torque, sampler.torque());
  return noise;
}

}  // namespace twinrate
