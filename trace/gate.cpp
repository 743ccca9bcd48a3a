#include "trace/gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/agreement.hpp"
#include "trace/angle_error.hpp"
#include "trace/keys.hpp"
#include "trace/scale_bounds.hpp"
#include "trace/transfer.hpp"

namespace twinrate {
namespace {

constexpr double kPieces = 192;  // of a file: eight of each of its 24 blocks
constexpr double kDrawn = 1.5;   // energy: the drawn noise is known to about a third
// The controller answers noise late, and its drawn answer is late by another time: without a lag that is there
// the rows have 3.6 to 20,000 times the energy of the noise (nine drawn logs), without a false one 1.4 to 2.5 (five).
constexpr double kOfLag = 3;
// Share of what a claim changes that a scale could change. By design: a constant load has 1, a torque of each turn
// has none.
constexpr double kSteady = 0.5;

using Channel = Eigen::VectorXd Sampled::*;
constexpr std::array<Channel, 3> kChannels = {&Sampled::d, &Sampled::q, &Sampled::torque};

const Runs& runs_with(const Sampler& sampler, Channel channel) {
  return channel == &Sampled::torque ? sampler.torque() : sampler.electrical();
}

// Energies of the rows that judge, with a claim and without, and of what it changes.
struct RowEnergy {
  double with = 0, without = 0, change = 0;
};
// Of a piece: which file it is of.
struct Piece {
  int file = 0;
  RowEnergy energy;
};

class Judging {
 public:
  Judging(const Chain& whole, const JudgedFiles& files)
      : sampler_(whole.sampler()), files_(files), rows_(whole.equations().record().size()) {}

  double energy(const Sampled& y, Channel channel) const {
    double sum = 0;
    if ((y.*channel).size())
      each(channel, [&](std::size_t, Eigen::Index i) { sum += (y.*channel)[i] * (y.*channel)[i]; });
    return sum;
  }

  double product(const Sampled& x, const Sampled& y, Channel channel) const {
    double sum = 0;
    if ((x.*channel).size())
      each(channel, [&](std::size_t, Eigen::Index i) { sum += (x.*channel)[i] * (y.*channel)[i]; });
    return sum;
  }

  void add(const Sampled& y, Channel channel, std::map<int, double>& of_file) const {
    if ((y.*channel).size())
      each(channel, [&](std::size_t row, Eigen::Index i) {
        of_file[static_cast<int>(file_of(row))] += (y.*channel)[i] * (y.*channel)[i];
      });
  }

  // What `y` holds along `change`, in deviations of what `noise` holds along it at other moments.
  double along(const Sampled& y, const Sampled& change, const Sampled& noise,
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

  // Share of the energy of what a claim changes that the means over a few long stretches have: what a
  // scale of the equations could change as well. What turns with the rotor, or stands while it turns, has none.
  double steady_share(const Sampled& with, const Sampled& without,
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

  // Of each file as many as eight a block: each has as much of its time and of what the claim
  // changes, half and half. One that acts at a few moments speaks there.
  std::vector<Piece> pieces(const Sampled& with, const Sampled& without,
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
    std::vector<Piece> all;
    const std::size_t count = std::max<std::size_t>(1, files_.files.size());
    for (std::size_t file = 0; file < count; ++file) add_pieces(file, rows, judges, all);
    return all;
  }

 private:
  template <class F>
  void each(Channel channel, F&& f) const {
    const Runs& runs = runs_with(sampler_, channel);
    for (std::size_t i = 0; i < runs.row.size(); ++i)
      if (runs.held_out[i]) f(runs.row[i], static_cast<Eigen::Index>(i));
  }
  std::size_t file_of(std::size_t row) const {
    return files_.of_row.empty() ? 0 : static_cast<std::size_t>(files_.of_row[row]);
  }
  void add_pieces(std::size_t file, const std::vector<RowEnergy>& rows,
                  const std::vector<char>& judges, std::vector<Piece>& all) const {
    std::vector<std::size_t> judged;
    double of_file = 0, change = 0;
    for (std::size_t row = 0; row < rows_; ++row) {
      if (file_of(row) != file) continue;
      ++of_file;
      if (judges[row]) judged.push_back(row), change += rows[row].change;
    }
    if (judged.empty() || !(change > 0)) return;
    // Outputs are fewer than rows where a channel is decimated, and wanting at each seam.
    const double count = static_cast<double>(judged.size()),
                 covered = std::min(1.0, count * sampler_.decimation() / of_file),
                 pieces = std::max(1.0, std::round(kPieces * covered));
    double so_far = 0, last = -1;
    for (std::size_t row : judged) {
      const double piece = std::min(pieces - 1, std::floor(pieces * so_far));
      so_far += 0.5 * (rows[row].change / change + 1 / count);
      if (piece > last) all.push_back({.file = static_cast<int>(file), .energy = {}});
      last = piece;
      all.back().energy.with += rows[row].with;
      all.back().energy.without += rows[row].without;
    }
  }

  const Sampler& sampler_;
  const JudgedFiles& files_;
  std::size_t rows_;
};

// Channels in which the two differ by more than a silent share.
std::vector<Channel> moved_channels(const Judging& judging, const Sampled& with,
                                    const Sampled& without, double silent) {
  std::vector<Channel> moved;
  for (Channel channel : kChannels) {
    if (!(with.*channel).size()) continue;
    Sampled change;
    change.*channel = with.*channel - without.*channel;
    if (judging.energy(change, channel) > silent * judging.energy(without, channel))
      moved.push_back(channel);
  }
  return moved;
}

struct Vote : Votes {
  bool of_voltage = false, of_torque = false;  // equations that it moves
  double steady_share = 0;
};

// What the sensors' own errors make of those channels.
Sampled noise_of(const Sampled& y) {
  Sampled noise;
  noise.d = y.noise_d;
  noise.q = y.noise_q;
  noise.torque = y.noise_torque;
  return noise;
}

// What the sensors' noise and the controller's answer to it make of the voltages.
Sampled answered_noise_of(const Sampled& y) {
  Sampled noise;
  noise.d = y.noise_d;
  noise.q = y.noise_q;
  if (y.answer_d.size()) noise.d += y.answer_d;
  if (y.answer_q.size()) noise.q += y.answer_q;
  return noise;
}

// Energy of the torque that is left over that of the sensors' noise.
double torque_over_noise(const Judging& judging, const Sampled& left) {
  const double noise = judging.energy(noise_of(left), &Sampled::torque);
  return noise > 0 ? judging.energy(left, &Sampled::torque) / noise
                   : std::numeric_limits<double>::infinity();
}

// Energy of what the claim changes of the voltages, over that of what it changes of the noise in them.
double change_over_noise(const Judging& judging, const Sampled& with, const Sampled& without,
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

double along_change(const Judging& judging, const Sampled& with, const Sampled& without,
                    const std::vector<Channel>& moved) {
  Sampled change;
  for (Channel channel : moved) change.*channel = without.*channel - with.*channel;
  return judging.along(without, change, noise_of(without), moved);
}

// The same of a claim that holds noise of the sensors and of the controller's answer to it, less what that
// noise has in common with the residual's.
double along_beside_noise(const Judging& judging, const Sampled& with, const Sampled& without,
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

// No noise is in what it adds, and it cannot choose a frequency of the noise.
bool is_free_of_noise(const Effect& effect) {
  return !holds_noise(effect) && !is_placed(effect, Traits::Place::kLine);
}

Vote vote(const Judging& judging, const Sampled& with, const Sampled& without,
          const AngleErrorFall& angle, const Effect& claim, bool through_zone, double silent) {
  const std::vector<Channel> moved = moved_channels(judging, with, without, silent);
  bool of_voltage = false, of_torque = false;
  double noise_with = 0, noise_without = 0, quieter = 0, energy_without = 0;
  for (Channel channel : moved) {
    (channel == &Sampled::torque ? of_torque : of_voltage) = true;
    energy_without += judging.energy(without, channel);
    noise_with += judging.energy(noise_of(with), channel);
    noise_without += judging.energy(noise_of(without), channel);
  }
  if (noise_with > 0 && noise_without > noise_with)
    quieter = 0.5 * std::log(noise_without / noise_with);
  // Where most of what is left is noise, what else is left may be the angle's as well.
  const double left = judging.energy(without, &Sampled::torque),
               noise = judging.energy(noise_of(without), &Sampled::torque);
  const bool lighter = of_torque && angle.lighter;
  if (lighter && angle.share > 0 && angle.share < 1 && noise > left / 2)
    quieter = std::max(quieter, -0.5 * std::log(1 - angle.share));
  Pieces is, was;
  std::size_t index = 0;
  for (const auto& [file, energy] : judging.pieces(with, without, moved)) {
    is[{file, index}] = energy.with;
    was[{file, index++}] = energy.without;
  }
  Vote vote{votes_of(was, is, silent, quieter), of_voltage, of_torque};
  if (!through_zone) {
    vote.change_over_noise = change_over_noise(judging, with, without, moved);
    vote.along_beside_noise = along_beside_noise(judging, with, without, moved);
  }
  if (noise_without > 0) vote.over_noise = energy_without / noise_without;
  if (is_free_of_noise(claim) && vote.over_noise < 1)
    vote.along_change = along_change(judging, with, without, moved);
  vote.steady_share = judging.steady_share(with, without, moved);
  if (lighter) vote.of_angle = angle.share;
  // A gap is no filter of the angle: it had to explain more than the shaft without it.
  if (lighter && !has_gap(claim)) vote.beyond_angle = -angle.log_ratio;
  return vote;
}

// What an effect leaves of a parameter of the machine, and the bounds of this machine.
struct Left {
  const char* name;
  double share, least, most;
};
std::vector<Left> left_of(const Effect& effect, const MachineParameters& m) {
  const ScaleBounds& most = kThisMachine;
  const double least_left = Criterion{}.least_left;
  struct Key {
    const char *change, *name;
    double whole, least, most;
  };
  const Key keys[] = {{"change_kgm2", "J", m.J, 1 / most.lightest, most.heaviest},
                      {"change_Wb", "psi_f", m.psi_f, 1 / most.psi_f, most.psi_f},
                      {"change_Ohm", "R_s", m.R_s, 1 / most.R_s, most.R_s},
                      {"change_d_H", "L_d", m.L_d, 1 / most.L, most.L},
                      {"change_q_H", "L_q", m.L_q, 1 / most.L, most.L}};
  std::vector<Left> list;
  for (const Key& key : keys)
    if (has_key(effect, key.change) && key.whole > 0)
      list.push_back({key.name, 1 + get_key(effect, key.change) / key.whole,
                      std::max(least_left, key.least), key.most});
  // What a shaft leaves of the inertia at the motor. With nothing left the noise of an angle makes no torque.
  ShaftFacts shaft;
  if (effect.describe_shaft(shaft) && m.J > 0)
    list.push_back({"J at the motor", 1 - shaft.J_load / m.J, 1 / most.heaviest, 1});
  return list;
}

// Why an effect leaves another machine; empty: it does not.
std::string another_machine(const Effect& effect, const DriveFacts& facts, double& share) {
  for (const Left& left : left_of(effect, facts.machine)) {
    share = left.share;
    if (share < left.least || share > left.most)
      return fmt::format("it leaves {:.2g} of {}: check units, scale and K_t", share, left.name);
  }
  share = 0;
  return plausible(effect, facts) ? "" : "it is larger than a running drive can lack";
}

}  // namespace

std::pair<double, const char*> least_left(const Effect& effect, const MachineParameters& m) {
  std::pair<double, const char*> least{1, ""};
  for (const Left& left : left_of(effect, m))
    if (left.share < least.first) least = {left.share, left.name};
  return least;
}

struct Gate::Asked {
  Fit fit;
  Sampled with;
  std::vector<Fit> without_fit;
  std::vector<Vote> votes;
};

Gate::Asked Gate::ask(const Fit& fit) const {
  Asked asked{.fit = fit, .with = {}, .without_fit = {}, .votes = {}};
  const auto left_by = [&](const Fit& f) { return whole_.residual(f.effects()); };
  asked.with = whole_.whitened(left_by(fit));
  const Judging judging(whole_, files_);
  const MachineParameters& machine = whole_.equations().facts().machine;
  const double T_s = whole_.sampler().decimation() * whole_.equations().record().T_s;
  // Some 30 Ohm around a current of zero make any noise loud there; what is told there is no noise.
  const Effects& known = whole_.equations().known();
  const auto at_zero = [](const auto& effect) { return turns_at_zero(*effect); };
  const bool through_zone = std::any_of(fit.members.begin(), fit.members.end(), at_zero) ||
                            std::any_of(known.begin(), known.end(), at_zero);
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    Fit without = seen_.refine(with(fit.members, nullptr, m));
    const Sampled raw = left_by(without), left = whole_.whitened(raw);
    AngleErrorFall angle;
    if (left.torque.size())
      angle = fall_of_angle_error(fit.members, asked.with.torque, without.members, left.torque,
                                  machine, whole_.sampler().torque(), T_s);
    asked.votes.push_back(
        vote(judging, asked.with, left, angle, *fit.members[m], through_zone, criterion_.silent));
    // Which frequencies count more is no matter of noise that a lighter motor would make less.
    if (angle.lighter && asked.votes.back().of_torque)
      asked.votes.back().over_noise =
          std::min(asked.votes.back().over_noise, kDrawn * torque_over_noise(judging, raw));
    if (is_of(*fit.members[m], Traits::Family::kLag)) asked.votes.back().least_over_noise = kOfLag;
    asked.without_fit.push_back(std::move(without));
  }
  return asked;
}

// In the order of what they cost; one a member, and none for those that pass (kind empty).
std::vector<Refused> Gate::refusals(const Asked& asked) const {
  const Members& members = asked.fit.members;
  const DriveFacts& facts = whole_.equations().facts();
  std::vector<Refused> out(members.size());
  const auto refuse = [&](std::size_t m, const char* rule, const std::string& file, double number,
                          std::string text) {
    if (out[m].rule.empty())
      out[m] = {.kind = std::string(members[m]->kind()),
                .rule = rule,
                .file = file,
                .number = number,
                .text = std::move(text)};
  };
  for (std::size_t m = 0; m < members.size(); ++m) {
    double share = 0;
    if (std::string why = another_machine(*members[m], facts, share); !why.empty())
      refuse(m, "physical", "", share, std::move(why));
  }
  for (std::size_t m = 0; m < members.size(); ++m) {
    const double size = members[m]->tracing().materiality(facts);
    if (size < 1)
      refuse(m, "size", "", size, fmt::format("{:.2g} of the smallest size worth reporting", size));
    if (resolution_)
      if (const double least = resolution_(*members[m]); size < least)
        refuse(m, "sensors", "", size / least,
               fmt::format("{:.2g} of what the sensors and the rows of the log leave open",
                           size / least));
  }
  std::vector<std::string> paths;
  for (const JudgedFile& file : files_.files) paths.push_back(file.path);
  std::vector<Refused> transfer =
      refused_by_transfer({asked.votes.begin(), asked.votes.end()}, paths, criterion_);
  for (std::size_t m = 0; m < members.size(); ++m)
    if (out[m].rule.empty() && !transfer[m].rule.empty()) {
      out[m] = std::move(transfer[m]);
      out[m].kind = std::string(members[m]->kind());
    }
  if (std::all_of(out.begin(), out.end(), [](const Refused& r) { return !r.rule.empty(); }))
    return out;
  const Chain* half = half_rate_ ? &half_rate_().chain() : nullptr;
  const Parts parts(whole_, members, half);
  const Eigen::MatrixXd covariance =
      seen_.training().count(asked.fit.y) > 0 && asked.fit.J.size() == asked.fit.free.size()
          ? seen_.robust_covariance(asked.fit)
          : Eigen::MatrixXd();
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!out[m].rule.empty()) continue;
    const Agreement a = parts.of(m, criterion_.sigmas);
    if (a.kept < criterion_.kept)
      refuse(m, "agreement", "", a.kept,
             fmt::format("between {} {:.2g} of its gain is kept", a.between, a.kept));
    if (a.compared < 2) refuse(m, "agreement", "", a.compared, "no two parts of the data show it");
    ShaftFacts shaft;
    if (covariance.size() == 0 || members[m]->describe_shaft(shaft)) continue;
    const double wald = joint_wald(asked.fit, covariance, m);
    if (!(wald > 0)) continue;  // placed by hand, or told by all of its coefficients together
    const double between = 1 - a.size_ratio;  // of its size
    const double sigmas = 1 / std::hypot(1 / std::sqrt(wald), between);
    if (sigmas >= criterion_.size_sigmas || !out[m].rule.empty()) continue;
    refuse(m, "size", "", sigmas, fmt::format("{:.2g} deviations from nothing", sigmas));
    out[m].wrong_kind = true;
  }
  const auto passes = [](const Refused& r) { return r.rule.empty(); };
  if (doubts_ && std::any_of(out.begin(), out.end(), passes))
    for (const Doubt& doubt : doubts_())
      for (std::size_t m = 0; m < members.size(); ++m)
        if (((doubt.of_voltage && asked.votes[m].of_voltage) ||
             (doubt.of_torque && asked.votes[m].of_torque)) &&
            (doubt.of_frame || asked.votes[m].steady_share > kSteady))
          refuse(m, doubt.rule, "", 0, doubt.text);
  return out;
}

// All accepted together against none of them.
std::optional<Refused> Gate::whole_refusal(const Asked& asked, std::size_t& weakest) const {
  if (asked.fit.members.empty()) return std::nullopt;
  const Judging judging(whole_, files_);
  const Sampled declared = whole_.whitened(whole_.residual({}));
  const auto file_sums = [&](const Sampled& y, bool torque) {
    std::map<int, double> sums;
    for (Channel channel : kChannels)
      if ((channel == &Sampled::torque) == torque) judging.add(y, channel, sums);
    return sums;
  };
  for (const bool torque : {false, true}) {
    weakest = kNobody;
    for (std::size_t m = 0; m < asked.votes.size(); ++m)
      if ((torque ? asked.votes[m].of_torque : asked.votes[m].of_voltage) &&
          (weakest == kNobody || asked.votes[m].mean < asked.votes[weakest].mean))
        weakest = m;
    if (weakest == kNobody) continue;
    const auto was = file_sums(declared, torque), is = file_sums(asked.with, torque);
    for (const auto& [file, before] : was)
      if (const double change = is.at(file) / before - 1; change > criterion_.silent)
        return Refused{
            .kind = std::string(asked.fit.members[weakest]->kind()),
            .rule = "whole",
            .file = files_.files.empty() ? "" : files_.files[static_cast<std::size_t>(file)].path,
            .number = change,
            .text = fmt::format("all together raise the error of the {} equation",
                                torque ? "torque" : "voltage")};
  }
  return std::nullopt;
}

Passed Gate::operator()(const Members& members) const {
  Passed out;
  for (std::size_t m = 0; m < members.size(); ++m) out.kept.push_back(m);
  const auto fitted = [&](const Members& some) {
    Fit fit = seen_.refine(some, Fitter::Until::kArrived);
    return fit.valid ? fit : seen_.linearised(with(some, nullptr));
  };
  out.fit = fitted(members);
  while (!out.fit.members.empty()) {
    const Asked asked = ask(out.fit);
    const std::vector<Refused> refused = refusals(asked);
    std::size_t drop = kNobody;
    for (std::size_t m = 0; m < refused.size(); ++m)
      if (!refused[m].rule.empty() &&
          (drop == kNobody || asked.votes[m].mean < asked.votes[drop].mean))
        drop = m;
    Refused why = drop == kNobody ? Refused{} : refused[drop];
    why.wrong_kind |= why.rule == "physical" || why.rule == "agreement";
    why.left = why.rule != "size" && why.rule != "sensors" && drop != kNobody &&
               asked.votes[drop].judgement.p_value < criterion_.chance;
    if (drop == kNobody)
      if (const std::optional<Refused> whole = whole_refusal(asked, drop)) why = *whole;
    if (why.rule.empty()) {
      for (const Vote& v : asked.votes) out.judgements.push_back(v.judgement);
      return out;
    }
    out.refused.push_back(why);
    out.kept.erase(out.kept.begin() + static_cast<std::ptrdiff_t>(drop));
    out.fit = fitted(with(out.fit.members, nullptr, drop));
  }
  return out;
}

}  // namespace twinrate
