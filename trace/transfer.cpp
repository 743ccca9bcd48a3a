#include "trace/transfer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "trace/statistics.hpp"

namespace twinrate {
namespace {

Refused refused(double number, std::string text, std::string file = "") {
  return {.kind = "",
          .rule = "transfer",
          .file = std::move(file),
          .number = number,
          .text = std::move(text)};
}

// A refusal because the sensors' noise explains the claim.
Refused noise(double number, std::string text) {
  Refused out = refused(number, std::move(text));
  out.rule = "sensors";
  return out;
}

Refused alone(const Votes& v, const std::vector<std::string>& files, const Criterion& criterion) {
  if (v.judgement.votes < criterion.votes)
    return refused(v.judgement.votes,
                   fmt::format("it acts in {} pieces of the held-out rows only; {} are required",
                               v.judgement.votes, criterion.votes));
  for (const auto& [file, worse] : v.worse)
    if (worse < criterion.chance)
      return refused(v.of_file.at(file), "it raises the error of the held-out rows there",
                     files.empty() ? "" : files[static_cast<std::size_t>(file)]);
  if (v.raised.chance < criterion.chance) {
    Refused out = refused(v.raised.gain,
                          fmt::format("it raises the error of the {} equation", v.raised.equation));
    out.wrong_kind = true;
    return out;
  }
  if (v.judgement.held_out_gain <= 0)
    return refused(v.judgement.held_out_gain, "it does not lower the error of the held-out rows");
  // The energy of all rows is mostly that of fast noise, which a slow torque does not resemble. On
  // 454 drawn logs with nothing missing, claims that hold no noise reached 8 standard deviations
  // along their change. Wrong claims beside other effects reach 109, and are left to the other
  // rules.
  constexpr double kAlong = 12;
  // A claim that holds noise is compared with that part of it, and must be as far above the noise
  // as below: of 66 claims of drawn logs refused here, false ones reach 58 standard deviations
  // (a lag), true ones 86 (a lag) and 1390.
  constexpr double kFarAlong = 100;
  const bool stands_out = v.along_change >= kAlong || v.along_beside_noise >= kFarAlong;
  if (v.over_noise < 1 && !stands_out)
    return noise(v.over_noise, fmt::format("without it the held-out rows have {:.2g} times the "
                                           "energy of the sensor noise: noise alone explains them",
                                           v.over_noise));
  if (v.over_noise < v.least_over_noise && !stands_out)
    return noise(
        v.over_noise,
        fmt::format(
            "without it the held-out rows have {:.2g} times the energy of the sensor noise; {:.2g} "
            "is required, because {}",
            v.over_noise, v.least_over_noise, v.least_because));
  // The response of a loop with coarse counts is known to a factor of about five (amplitude). A
  // claim far above the noise along its change is not refused all the same: in 29 drawn logs with a
  // claim refused as noise, false ones reach 70 deviations, and true ones 282 and 1010.
  constexpr double kBeyondAnswer = 30;
  // If the rows have no more energy than noise makes, known to a third, a factor of ten is needed
  // (amplitude). In drawn logs a false inductance had 73 there (53 with another cut into blocks),
  // six true claims 115 to 3650.
  constexpr double kNoiseAsWell = 1.5, kFarBeyondAnswer = 100;
  // If less than the noise is left (known to a third), a part of the claim's gain is noise, and the
  // response to it is larger than assumed. The only such log has a false inductance with 162; true
  // claims that leave as little have 13,000 and more.
  constexpr double kLessThanNoise = 1 / 1.5, kBeyondAnyAnswer = 1000;
  const double needed = v.left_over_noise < kLessThanNoise ? kBeyondAnyAnswer
                        : v.over_noise < kNoiseAsWell      ? kFarBeyondAnswer
                                                           : kBeyondAnswer;
  if (v.change_over_noise < needed && v.along_beside_noise < kFarAlong)
    return noise(
        v.change_over_noise,
        fmt::format(
            "its change has {:.2g} times the energy of the change that it makes in the sensor "
            "noise and in the controller's response to that noise; {:.0f} is required",
            v.change_over_noise, needed));
  // Without a known response (12 such drawn logs, and five with noise added to their voltage), false
  // claims have 36 standard deviations and up to 1000 times the energy, or 140 and up to 37 times;
  // true ones have 85 and 256 times and more, or 22,000 times.
  constexpr double kBesideUnknown = 60, kBeyondUnknown = 5000, kLeastUnknown = 100;
  if (v.answer_unknown && v.change_over_noise < kLeastUnknown)
    return noise(
        v.change_over_noise,
        fmt::format("its change has {:.2g} times the energy of the change that it makes in "
                    "the sensor noise; {:.0f} are required, because the controller's "
                    "response to that noise is unknown",
                    v.change_over_noise, kLeastUnknown));
  if (v.answer_unknown && v.change_over_noise < kBeyondUnknown &&
      v.along_beside_noise < kBesideUnknown)
    return noise(v.along_beside_noise,
                 fmt::format("it is {:.2g} standard deviations of the sensors' noise; {:.0f} are "
                             "required, because the controller's response to that noise is unknown",
                             v.along_beside_noise, kBesideUnknown));
  // A false cross saturation of a drawn log with nothing missing has 234 times the energy, but 1.8
  // standard deviations along its change.
  if (v.over_noise < kNoiseAsWell && std::isfinite(v.change_over_noise) &&
      v.along_beside_noise < criterion.sigmas)
    return noise(
        v.along_beside_noise,
        fmt::format("the held-out rows have {:.2g} times the energy of the sensor noise, and the "
                    "claim is {:.2g} standard deviations of that noise; {:.0f} are required",
                    v.over_noise, v.along_beside_noise, criterion.sigmas));
  // The sensors' noise is drawn, and known to a factor of two. The whole residual may come from the
  // noise of the angle, because the torque that it makes is in proportion to the inertia at the
  // motor.
  constexpr double kTimes = 2;
  const double drawn = (1 - std::exp(-2 * v.quieter)) * std::max(1.0, kTimes / v.over_noise);
  const double of_noise =
      v.along_beside_noise >= kFarAlong ? v.of_angle : std::max(v.of_angle, std::min(1.0, drawn));
  if (v.judgement.held_out_gain <= of_noise)
    return noise(v.judgement.held_out_gain,
                 fmt::format("it lowers the energy of the held-out rows by a share of {:.2g}; a "
                             "smaller sensor noise alone can lower it by {:.2g}",
                             v.judgement.held_out_gain, of_noise));
  if (v.beyond_angle <= 0)
    return noise(
        v.beyond_angle,
        fmt::format("its residual has {:.2g} times the energy that it would leave of an error of "
                    "the angle, in the mean over frequencies: such an error explains it as well",
                    std::exp(-v.beyond_angle)));
  return {};
}

Refused by_chance_refused(double p, double quieter, const Criterion& criterion) {
  if (quieter <= criterion.silent)
    return refused(
        p,
        fmt::format(
            "chance lowers the error of the held-out rows as far in a share of {:.2g} of logs", p));
  return noise(p, fmt::format("it makes the sensor noise {:.2g} times as large, and chance lowers "
                              "the error of the held-out rows further in a share of {:.2g} of logs",
                              std::exp(-quieter), p));
}

}  // namespace

Votes votes_of(const Pieces& without, const Pieces& with, double silent, double quieter) {
  Votes out;
  out.quieter = quieter;
  std::vector<double> all;
  std::map<int, std::vector<double>> by_file;
  double energy = 0, energy_before = 0;
  for (const auto& [piece, E] : without) {
    const double E_with = with.at(piece);
    energy += E_with;
    energy_before += E;
    if (!(E > 0) || !(E_with > 0) || std::abs(E - E_with) < silent * E) continue;
    const double fall = 0.5 * std::log(E / E_with);
    all.push_back(fall - quieter);
    by_file[piece.first].push_back(fall);
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

std::vector<Refused> refused_by_transfer(const std::vector<Votes>& claims,
                                         const std::vector<std::string>& files,
                                         const Criterion& criterion) {
  std::vector<Refused> out;
  std::vector<std::size_t> by_chance(claims.size());
  std::iota(by_chance.begin(), by_chance.end(), std::size_t{0});
  out.reserve(claims.size());
  for (const Votes& v : claims) out.push_back(alone(v, files, criterion));
  // Holm: the most certain of n claims must be n times as certain.
  std::sort(by_chance.begin(), by_chance.end(), [&](std::size_t a, std::size_t b) {
    return claims[a].judgement.p_value < claims[b].judgement.p_value;
  });
  bool chance = false;
  for (std::size_t i = 0; i < by_chance.size(); ++i) {
    const double p = claims[by_chance[i]].judgement.p_value;
    chance = chance || p > criterion.chance / static_cast<double>(by_chance.size() - i);
    if (chance && out[by_chance[i]].rule.empty())
      out[by_chance[i]] = by_chance_refused(p, claims[by_chance[i]].quieter, criterion);
  }
  return out;
}

}  // namespace twinrate
