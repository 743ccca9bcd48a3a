#include "trace/vote.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kPieces = 192;  // of a file: eight of each of its 24 blocks

const Runs& runs_with(const Sampler& sampler, Channel channel) {
  return channel == &Sampled::torque ? sampler.torque() : sampler.electrical();
}

}  // namespace

template <class F>
void JudgingRows::each(Channel channel, F&& f) const {
  const Runs& runs = runs_with(sampler_, channel);
  for (std::size_t i = 0; i < runs.row.size(); ++i)
    if (runs.held_out[i]) f(runs.row[i], static_cast<Eigen::Index>(i));
}

double JudgingRows::product(const Sampled& x, const Sampled& y, Channel channel) const {
  double sum = 0;
  if ((x.*channel).size())
    each(channel, [&](std::size_t, Eigen::Index i) { sum += (x.*channel)[i] * (y.*channel)[i]; });
  return sum;
}

void JudgingRows::add_energy(const Sampled& y, Channel channel,
                             std::map<int, double>& of_file) const {
  if ((y.*channel).size())
    each(channel, [&](std::size_t row, Eigen::Index i) {
      of_file[static_cast<int>(file_of(row))] += (y.*channel)[i] * (y.*channel)[i];
    });
}

double JudgingRows::along(const Sampled& y, const Sampled& change, const Sampled& noise,
                          const std::vector<Channel>& moved) const {
  constexpr std::size_t kMoments = 40;
  double held = 0;
  Eigen::VectorXd at_moment = Eigen::VectorXd::Zero(kMoments);
  for (Channel channel : moved) {
    std::vector<double> c, n;
    each(channel, [&](std::size_t, Eigen::Index i) {
      c.push_back((change.*channel)[i]);
      n.push_back((noise.*channel)[i]);
      held += (y.*channel)[i] * c.back();
    });
    for (std::size_t k = 0; k < kMoments; ++k)
      for (std::size_t i = 0, later = (k + 1) * c.size() / (kMoments + 1); i < c.size(); ++i) {
        at_moment[static_cast<Eigen::Index>(k)] += c[i] * n[later];
        if (++later == c.size()) later = 0;
      }
  }
  const double deviation = at_moment.norm() / std::sqrt(static_cast<double>(kMoments));
  return deviation > 0 ? held / deviation : 0;
}

double JudgingRows::steady_share(const Sampled& with, const Sampled& without,
                                 const std::vector<Channel>& moved) const {
  constexpr std::size_t kStretches = 6;  // a quarter of 24 blocks judges
  double means = 0, all = 1e-300;
  for (Channel channel : moved) {
    std::vector<double> change;
    each(channel, [&](std::size_t, Eigen::Index i) {
      change.push_back((with.*channel)[i] - (without.*channel)[i]);
    });
    const std::size_t piece = std::max<std::size_t>(1, change.size() / kStretches);
    for (std::size_t first = 0; first < change.size(); first += piece) {
      const std::size_t end = std::min(first + piece, change.size());
      double sum = 0;
      for (std::size_t k = first; k < end; ++k) sum += change[k], all += change[k] * change[k];
      means += sum * sum / static_cast<double>(end - first);
    }
  }
  return means / all;
}

JudgingRows::Energies JudgingRows::pieces(const Sampled& with, const Sampled& without,
                                          const std::vector<Channel>& moved) const {
  std::vector<RowEnergy> rows(rows_);
  std::vector<char> judges(rows_, 0);
  for (Channel channel : moved)
    each(channel, [&](std::size_t row, Eigen::Index i) {
      const double a = (with.*channel)[i], b = (without.*channel)[i];
      rows[row].with += a * a;
      rows[row].without += b * b;
      rows[row].change += (a - b) * (a - b);
      judges[row] = 1;
    });
  Energies all;
  const std::size_t count = std::max<std::size_t>(1, files_.files.size());
  for (std::size_t file = 0; file < count; ++file) add_pieces(file, rows, judges, all);
  return all;
}

void JudgingRows::add_pieces(std::size_t file, const std::vector<RowEnergy>& rows,
                             const std::vector<char>& judges, Energies& all) const {
  std::vector<std::size_t> judged;
  double of_file = 0, change = 0;
  for (std::size_t row = 0; row < rows_; ++row) {
    if (file_of(row) != file) continue;
    ++of_file;
    if (judges[row]) judged.push_back(row), change += rows[row].change;
  }
  if (judged.empty() || !(change > 0)) return;
  // A decimated channel has fewer outputs than rows, and each seam costs outputs.
  const double count = static_cast<double>(judged.size()),
               covered = std::min(1.0, count * sampler_.decimation() / of_file),
               pieces = std::max(1.0, std::round(kPieces * covered));
  double so_far = 0;
  for (std::size_t row : judged) {
    const double piece = std::min(pieces - 1, std::floor(pieces * so_far));
    so_far += 0.5 * (rows[row].change / change + 1 / count);
    const std::pair<int, std::size_t> key(file, piece);
    all.with[key] += rows[row].with;
    all.without[key] += rows[row].without;
  }
}

namespace {

// Channels on which the claim acts, and in which the two differ by more than the silent share. In
// the others they differ because the other effects were fitted again without the claim.
std::vector<Channel> moved_channels(const JudgingRows& judging, const Sampled& with,
                                    const Sampled& without, const Effect& claim, double silent) {
  std::vector<Channel> moved;
  for (Channel channel : kSampledChannels) {
    const int elsewhere = channel == &Sampled::torque ? kOnVoltage : kOnTorque;
    if (claim.acts_on() == elsewhere || !(with.*channel).size()) continue;
    Sampled change;
    change.*channel = with.*channel - without.*channel;
    if (judging.energy(change, channel) > silent * judging.energy(without, channel))
      moved.push_back(channel);
  }
  return moved;
}

// The noise of those channels from the sensors' own errors.
Sampled noise_of(const Sampled& y) {
  Sampled noise;
  noise.d = y.noise_d;
  noise.q = y.noise_q;
  noise.torque = y.noise_torque;
  return noise;
}

// The noise of the voltages from the sensors and the controller's response to it.
Sampled answered_noise_of(const Sampled& y) {
  Sampled noise;
  noise.d = y.noise_d;
  noise.q = y.noise_q;
  if (y.answer_d.size()) noise.d += y.answer_d;
  if (y.answer_q.size()) noise.q += y.answer_q;
  return noise;
}

// True if no response of the controller to the sensors' noise is drawn: its identified loop is
// unstable, or there are too few rows.
bool has_no_answer(const Sampled& y) {
  const auto none = [](const Eigen::VectorXd& answer) {
    return answer.size() == 0 || answer.isZero(0);
  };
  return none(y.answer_d) && none(y.answer_q);
}

// Energy of the claim's change of the voltages over that of its change of the noise in them.
double change_over_noise(const JudgingRows& judging, const Sampled& with, const Sampled& without,
                         const std::vector<Channel>& moved) {
  const Sampled noise_with = answered_noise_of(with), noise_without = answered_noise_of(without);
  double change = 0, of_noise = 0;
  for (Channel channel : moved) {
    if (channel == &Sampled::torque) continue;
    Sampled by_all, by_noise;
    by_all.*channel = with.*channel - without.*channel;
    by_noise.*channel = noise_with.*channel - noise_without.*channel;
    change += judging.energy(by_all, channel);
    of_noise += judging.energy(by_noise, channel);
  }
  return of_noise > 0 ? change / of_noise : std::numeric_limits<double>::infinity();
}

double along_change(const JudgingRows& judging, const Sampled& with, const Sampled& without,
                    const std::vector<Channel>& moved) {
  Sampled change;
  for (Channel channel : moved) change.*channel = without.*channel - with.*channel;
  return judging.along(without, change, noise_of(without), moved);
}

// The equation whose error the claim raises, of the two on which it acts.
Raised raised(const JudgingRows& judging, const Sampled& with, const Sampled& without,
              const std::vector<Channel>& moved, double silent) {
  Raised most;
  for (const bool torque : {false, true}) {
    std::vector<Channel> equation;
    for (Channel channel : moved)
      if ((channel == &Sampled::torque) == torque) equation.push_back(channel);
    const JudgingRows::Energies energies = judging.pieces(with, without, equation);
    const Votes votes = votes_of(energies.without, energies.with, silent);
    if (votes.judgement.held_out_gain >= most.gain) continue;
    most = {.equation = torque ? "torque" : "voltage", .gain = votes.judgement.held_out_gain};
    for (const auto& [file, chance] : votes.worse) most.chance = std::min(most.chance, chance);
  }
  return most;
}

// True if the claim's contribution holds no noise and it cannot fit a frequency of the noise.
bool is_free_of_noise(const Effect& effect) {
  return !holds_noise(effect) && !is_placed(effect, Traits::Place::kLine);
}

}  // namespace

double along_beside_noise(const JudgingRows& judging, const Sampled& with, const Sampled& without,
                          const std::vector<Channel>& moved) {
  const Sampled answered = answered_noise_of(without), answered_with = answered_noise_of(with);
  Sampled change, noise = noise_of(without), own = noise_of(with);
  noise.d = answered.d, noise.q = answered.q;
  own.d = answered_with.d, own.q = answered_with.q;
  for (Channel channel : moved) {
    change.*channel = without.*channel - with.*channel;
    own.*channel = noise.*channel - own.*channel;
  }
  double held = 0, shared = 0;
  for (Channel channel : moved) {
    held += judging.product(without, change, channel);
    shared += judging.product(noise, own, channel);
  }
  const double along = judging.along(without, change, noise, moved);
  return held > 0 ? along * (held - std::abs(shared)) / held : 0;
}

Vote vote(const JudgingRows& judging, const Sampled& with, const Sampled& without,
          const AngleErrorFall& angle, const Effect& claim, bool through_zone, bool in_sensors,
          double silent) {
  const std::vector<Channel> moved = moved_channels(judging, with, without, claim, silent);
  bool of_voltage = false, of_torque = false;
  double noise_with = 0, noise_without = 0, quieter = 0, energy_without = 0, energy_with = 0;
  for (Channel channel : moved) {
    (channel == &Sampled::torque ? of_torque : of_voltage) = true;
    energy_without += judging.energy(without, channel);
    energy_with += judging.energy(with, channel);
    noise_with += judging.energy(noise_of(with), channel);
    noise_without += judging.energy(noise_of(without), channel);
  }
  if (noise_with > 0 && noise_without > noise_with)
    quieter = 0.5 * std::log(noise_without / noise_with);
  // If most of the residual is noise, the remainder may come from the angle as well.
  const double left = judging.energy(without, &Sampled::torque),
               noise = judging.energy(noise_of(without), &Sampled::torque);
  const bool lighter = of_torque && angle.lighter;
  const double of_angle = has_gap(claim) ? std::max(angle.share, angle.loose) : angle.share;
  if (lighter && of_angle > 0 && of_angle < 1 && noise > left / 2)
    quieter = std::max(quieter, -0.5 * std::log(1 - of_angle));
  // In the sensors' own noise, that noise is a known share of the energy. Otherwise the whitening
  // may have made all of it look like noise.
  constexpr double kTimes = 2;  // factor of energy to which the drawn noise is known
  if (in_sensors && energy_without > kTimes * noise_without)
    quieter =
        -0.5 * std::log1p(-kTimes * noise_without / energy_without * (1 - std::exp(-2 * quieter)));
  const JudgingRows::Energies pieces = judging.pieces(with, without, moved);
  Vote vote{votes_of(pieces.without, pieces.with, silent, quieter), of_voltage, of_torque};
  if (of_voltage && of_torque) {
    const double of_all = energy_without - energy_with,
                 in_torque = judging.energy(without, &Sampled::torque) -
                             judging.energy(with, &Sampled::torque);
    vote.torque_share = of_all > 0 ? in_torque / of_all : 1;
    vote.raised = raised(judging, with, without, moved, silent);
  }
  if (!through_zone) {
    vote.change_over_noise = change_over_noise(judging, with, without, moved);
    vote.along_beside_noise = along_beside_noise(judging, with, without, moved);
    vote.answer_unknown = of_voltage && has_no_answer(without);
  }
  if (noise_without > 0) {
    vote.over_noise = energy_without / noise_without;
    vote.left_over_noise = energy_with / noise_without;
  }
  if (is_free_of_noise(claim) && vote.over_noise < 1)
    vote.along_change = along_change(judging, with, without, moved);
  vote.steady_share = judging.steady_share(with, without, moved);
  if (lighter) vote.of_angle = of_angle;
  // A gap is no filter of the angle: it had to explain more than the shaft without it.
  if (lighter && !has_gap(claim)) vote.beyond_angle = -angle.log_ratio;
  return vote;
}

}  // namespace twinrate
