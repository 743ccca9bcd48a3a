#include "trace/gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "model/effects/tracing.hpp"
#include "trace/agreement.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kPieces = 96;  // of a file: four of each of its 24 blocks

using Channel = Eigen::VectorXd Sampled::*;
constexpr std::array<Channel, 3> kChannels = {&Sampled::d, &Sampled::q, &Sampled::torque};

const Runs& runs_with(const Sampler& sampler, Channel channel) {
  return channel == &Sampled::torque ? sampler.torque() : sampler.electrical();
}

// Pieces of the rows that judge, by file: the energy in each.
using Pieces = std::map<std::pair<int, std::size_t>, double>;

class Judging {
 public:
  Judging(const Chain& whole, const JudgedFiles& files) : sampler_(whole.sampler()) {
    const std::size_t n = whole.equations().record().size();
    std::vector<std::size_t> first(files.files.size() + 1, n), count(files.files.size() + 1, 0);
    for (std::size_t k = 0; k < n; ++k) {
      const auto file = file_of(files, k);
      first[file] = std::min(first[file], k);
      ++count[file];
    }
    for (Channel channel : {&Sampled::d, &Sampled::torque}) {
      const Runs& runs = runs_with(sampler_, channel);
      auto& ids = channel == &Sampled::torque ? torque_ : electrical_;
      for (std::size_t i = 0; i < runs.row.size(); ++i) {
        const std::size_t row = runs.row[i], file = file_of(files, row);
        ids.emplace_back(static_cast<int>(file), kPieces * (row - first[file]) / count[file]);
      }
    }
  }
  // Of one channel: f(piece, output) for the outputs that judge.
  template <class F>
  void each(Channel channel, F&& f) const {
    const Runs& runs = runs_with(sampler_, channel);
    const auto& ids = channel == &Sampled::torque ? torque_ : electrical_;
    for (std::size_t i = 0; i < runs.row.size(); ++i)
      if (runs.held_out[i]) f(ids[i], static_cast<Eigen::Index>(i));
  }
  void add(const Sampled& y, Channel channel, Pieces& energy) const {
    if ((y.*channel).size())
      each(channel, [&](const auto& piece, Eigen::Index i) {
        energy[piece] += (y.*channel)[i] * (y.*channel)[i];
      });
  }
  double energy(const Sampled& y, Channel channel) const {
    double sum = 0;
    if ((y.*channel).size())
      each(channel, [&](const auto&, Eigen::Index i) { sum += (y.*channel)[i] * (y.*channel)[i]; });
    return sum;
  }

 private:
  static std::size_t file_of(const JudgedFiles& files, std::size_t row) {
    return files.of_row.empty() ? 0 : static_cast<std::size_t>(files.of_row[row]);
  }
  const Sampler& sampler_;
  std::vector<std::pair<int, std::size_t>> electrical_, torque_;
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

struct Vote {
  Judgement judgement;
  bool of_voltage = false, of_torque = false;  // equations that it moves
  double mean = 0;                             // of r_b, over all pieces that vote
  std::map<int, double> worse;                 // by file: chance of pieces so much worse
  std::map<int, double> of_file;               // mean of r_b
};

Vote vote(const Judging& judging, const Sampled& with, const Sampled& without, double silent) {
  Vote out;
  Pieces left, before;
  for (Channel channel : moved_channels(judging, with, without, silent)) {
    (channel == &Sampled::torque ? out.of_torque : out.of_voltage) = true;
    judging.add(with, channel, left);
    judging.add(without, channel, before);
  }
  std::vector<double> all;
  std::map<int, std::vector<double>> by_file;
  double energy = 0, energy_before = 0;
  for (const auto& [piece, E] : before) {
    const double E_with = left[piece];
    energy += E_with;
    energy_before += E;
    if (!(E > 0) || !(E_with > 0) || std::abs(E - E_with) < silent * E) continue;
    all.push_back(0.5 * std::log(E / E_with));
    by_file[piece.first].push_back(all.back());
  }
  out.judgement.votes = static_cast<int>(all.size());
  out.judgement.p_value = signed_rank_tail(all);
  out.judgement.held_out_gain = energy_before > 0 ? 1 - energy / energy_before : 0;
  for (double r : all) out.mean += r / static_cast<double>(all.size());
  for (auto& [file, votes] : by_file) {
    for (double r : votes) out.of_file[file] += r / static_cast<double>(votes.size());
    for (double& r : votes) r = -r;
    out.worse[file] = signed_rank_tail(votes);
  }
  return out;
}

// The least that an effect leaves of a parameter of the machine, as a share, and of which.
std::pair<double, const char*> least_left(const Effect& effect, const MachineParameters& m) {
  struct Key {
    const char *change, *name;
    double whole;
  };
  const Key keys[] = {{"change_kgm2", "J", m.J},
                      {"change_Wb", "psi_f", m.psi_f},
                      {"change_Ohm", "R_s", m.R_s},
                      {"change_d_H", "L_d", m.L_d},
                      {"change_q_H", "L_q", m.L_q}};
  std::pair<double, const char*> least{1, ""};
  for (const Key& key : keys)
    if (has_key(effect, key.change) && key.whole > 0)
      if (const double left = 1 + get_key(effect, key.change) / key.whole; left < least.first)
        least = {left, key.name};
  return least;
}

}  // namespace

struct Gate::Asked {
  Fit fit;
  Sampled with;
  std::vector<Fit> without_fit;
  std::vector<Vote> votes;
};

Gate::Asked Gate::ask(const Fit& fit) const {
  Asked asked{.fit = fit, .with = {}, .without_fit = {}, .votes = {}};
  const auto left_by = [&](const Fit& f) { return whole_.whitened(whole_.residual(f.effects())); };
  asked.with = left_by(fit);
  const Judging judging(whole_, files_);
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    Fit without = seen_.refine(with(fit.members, nullptr, m));
    asked.votes.push_back(vote(judging, asked.with, left_by(without), criterion_.silent));
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
  std::vector<std::size_t> by_chance(members.size());
  for (std::size_t m = 0; m < members.size(); ++m) {
    by_chance[m] = m;
    const double size = members[m]->tracing().materiality(facts);
    if (size < 1)
      refuse(m, "size", "", size, fmt::format("{:.2g} of the smallest size worth reporting", size));
    if (resolution_)
      if (const double least = resolution_(*members[m]); size < least)
        refuse(m, "sensors", "", size / least,
               fmt::format("{:.2g} of what the sensors alone can make", size / least));
    const Vote& v = asked.votes[m];
    if (v.judgement.votes < criterion_.votes)
      refuse(m, "transfer", "", v.judgement.votes,
             fmt::format("only {} pieces of the rows that judge show it, {} are needed",
                         v.judgement.votes, criterion_.votes));
    for (const auto& [file, worse] : v.worse)
      if (worse < criterion_.chance)
        refuse(m, "transfer",
               files_.files.empty() ? "" : files_.files[static_cast<std::size_t>(file)].path,
               v.of_file.at(file), "the error there rises with it");
    if (v.judgement.held_out_gain <= 0)
      refuse(m, "transfer", "", v.judgement.held_out_gain,
             "the error on rows that judge does not fall with it");
  }
  // Holm: the most certain of n has to be n times as certain.
  std::sort(by_chance.begin(), by_chance.end(), [&](std::size_t a, std::size_t b) {
    return asked.votes[a].judgement.p_value < asked.votes[b].judgement.p_value;
  });
  bool chance = false;
  for (std::size_t i = 0; i < by_chance.size(); ++i) {
    const double p = asked.votes[by_chance[i]].judgement.p_value;
    chance = chance || p > criterion_.chance / static_cast<double>(by_chance.size() - i);
    if (chance)
      refuse(by_chance[i], "transfer", "", p,
             fmt::format("rows that judge fall with it by chance in {:.2g} of logs", p));
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
    const double wald = largest_wald(asked.fit, covariance, m);
    if (!(wald > 0)) continue;  // placed by hand, or told by all of its coefficients together
    const double between = 1 - a.size_ratio;  // of its size
    const double sigmas = 1 / std::hypot(1 / std::sqrt(wald), between);
    if (sigmas < criterion_.size_sigmas)
      refuse(m, "size", "", sigmas, fmt::format("{:.2g} deviations from nothing", sigmas));
  }
  for (std::size_t m = 0; m < members.size(); ++m) {
    const auto [left, name] = least_left(*members[m], facts.machine);
    if (left < criterion_.least_left)
      refuse(m, "physical", "", left,
             fmt::format("it leaves {:.2g} of {}: check units, scale and K_t", left, name));
  }
  return out;
}

// All accepted together against none of them.
std::optional<Refused> Gate::whole_refusal(const Asked& asked, std::size_t& weakest) const {
  if (asked.fit.members.empty()) return std::nullopt;
  const Judging judging(whole_, files_);
  const Sampled declared = whole_.whitened(whole_.residual({}));
  const auto file_sums = [&](const Sampled& y, bool torque) {
    Pieces pieces;
    for (Channel channel : kChannels)
      if ((channel == &Sampled::torque) == torque) judging.add(y, channel, pieces);
    std::map<int, double> sums;
    for (const auto& [piece, E] : pieces) sums[piece.first] += E;
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
    return fit.valid ? fit : seen_.start(with(some, nullptr));
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
