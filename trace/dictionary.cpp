#include "trace/dictionary.hpp"

#include <algorithm>
#include <functional>
#include <utility>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"

namespace twinrate {
namespace {

constexpr int kMostTimes = 200;  // of candidates that differ only in their moment: memory

// Times at which an event may have happened, for keys whose grid depends on the record. They are
// times of the record's stretches: between stretches no row distinguishes one moment from another.
std::vector<double> times_of(const Record& record) {
  std::vector<double> times;
  const std::size_t n = record.size();
  const auto tenths = std::lround(static_cast<double>(n) * record.T_s / 0.1);
  const auto steps = static_cast<std::size_t>(std::clamp<long>(tenths, 8, kMostTimes));
  for (std::size_t j = 1; j < steps; ++j) times.push_back(record.t[n * j / steps]);
  return times;
}

// True for a key that is a moment of the record and has no grid of its own.
bool is_moment(const TracedKey& key) {
  return !key.linear && key.grid.empty() && std::string_view(key.key) == "time_s";
}

// True for a gap, which is searched beside a shaft (trace/placing.hpp).
bool searched_elsewhere(const std::vector<TracedKey>& keys) {
  return std::any_of(keys.begin(), keys.end(), [](const TracedKey& key) {
    return !key.linear && key.grid.empty() && !is_moment(key);
  });
}

// A lag of a signal shows only if the signal turns or jumps. Otherwise only noise changes, with the
// controller's response to it, and both are part of the residual's own noise.
bool moves(const std::vector<Vec2>& x, const std::vector<char>& ok) {
  constexpr double kLeast = 0.02;
  constexpr std::size_t kMean = 10;  // rows
  double moved = 0, noise = 0;
  for (std::size_t k = 2 * kMean; k + 2 * kMean < x.size(); ++k) {
    if (!ok[k]) continue;
    noise += (x[k + 2] - 4 * x[k + 1] + 6 * x[k] - 4 * x[k - 1] + x[k - 2]).squaredNorm() / 35;
    if (k % kMean != 0) continue;
    Vec2 later = Vec2::Zero(), sooner = Vec2::Zero();
    for (std::size_t j = 1; j <= kMean; ++j) later += x[k + j], sooner += x[k - j];
    moved += (later - sooner).squaredNorm() / (kMean * kMean * kMean);
  }
  return moved > kLeast * noise;
}

// Calls f for every point of the grids, with the keys set to it.
void over_grid(Effect& effect, const std::vector<TracedKey>& keys, std::size_t index,
               const std::function<void()>& f) {
  while (index < keys.size() && keys[index].grid.empty()) ++index;
  if (index == keys.size()) return f();
  for (double value : keys[index].grid) {
    set_key(effect, keys[index].key, value);
    over_grid(effect, keys, index + 1, f);
  }
}

// A drift starts at the beginning of the log.
void start_with(const Record& record, Effect& effect) {
  const std::vector<NumericKey> keys = numeric_keys(effect);
  const auto has = [&](const char* name) {
    return std::any_of(keys.begin(), keys.end(), [&](const auto& key) { return key.key == name; });
  };
  if (has("start_s") && has("time_constant_s") && get_key(effect, "time_constant_s") > 0)
    set_key(effect, "start_s", record.begin_s.value_or(record.t.front()));
}

bool adds_to_sensor(const Effect& effect) {
  return effect.tracing().regressor_count() > 0 && (effect.acts_on() & (kOnCurrents | kOnAngle));
}

bool is_renewed(const Effect& effect) {
  return adds_to_sensor(effect) || turns_at_zero(effect) || turns_with_angle(effect);
}

// Renews sensor effects beside the `effects` in the model, except kinds that are among them.
void renew_sensors(const Chain& chain, const Effects& effects, std::vector<Candidate>& sampled) {
  constexpr double kProbe = 1e-5;  // of a coefficient
  const Sampled residual = chain.noiseless(effects);
  for (Candidate& candidate : sampled) {
    const bool there_already = std::any_of(effects.begin(), effects.end(), [&](const auto& effect) {
      return effect->kind() == candidate.effect->kind();
    });
    if (!adds_to_sensor(*candidate.effect) || there_already) continue;
    for (std::size_t r = 0; r < candidate.columns.size(); ++r) {
      std::vector<double> coefficients(candidate.columns.size(), 0.0);
      coefficients[r] = kProbe;
      const std::shared_ptr<Effect> probe = candidate.effect->clone();
      probe->tracing().set_coefficients(coefficients);
      Effects all = effects;
      all.push_back(probe);
      const Sampled there = chain.noiseless(all);
      Sampled& x = candidate.columns[r];  // its noise hardly changes
      x.d = (residual.d - there.d) / kProbe;
      x.q = (residual.q - there.q) / kProbe;
      x.torque = (residual.torque - there.torque) / kProbe;
    }
  }
}

// Renews the columns of `which` from the record less its sensor errors.
void renew_corrected(const Chain& chain, const Effects& effects, std::vector<Candidate>& sampled,
                     const std::function<bool(const Effect&)>& which) {
  const Record record = chain.equations().without_errors(effects);
  const Equations corrected(record, chain.equations().facts());
  for_each_index(sampled.size(), [&](std::size_t i) {
    Candidate& candidate = sampled[i];
    if (!which(*candidate.effect)) return;
    const std::vector<Sampled> there = chain.columns_of(corrected, *candidate.effect);
    for (std::size_t r = 0; r < there.size(); ++r) {
      candidate.columns[r].d = there[r].d;
      candidate.columns[r].q = there[r].q;
      candidate.columns[r].torque = there[r].torque;
    }
  });
}

}  // namespace

std::vector<Candidate> make_candidates(const Chain& chain,
                                       const std::function<bool(const Effect&)>& wanted) {
  const Equations& equations = chain.equations();
  std::vector<Candidate> candidates;
  const Record& record = equations.record();
  const bool u_moves = moves(record.u_alphabeta, record.electrical_ok),
             i_moves = moves(record.i_alphabeta,
                             equations.has_voltage() ? record.electrical_ok : record.motion_ok);
  for (const std::string& kind : equations.considered().kinds()) {
    const std::shared_ptr<Effect> effect = make_effect(kind);
    effect->prepare(equations.facts());  // a grid may depend on the drive
    std::vector<TracedKey> keys = effect->tracing().traced_keys();
    if (keys.empty() || searched_elsewhere(keys)) continue;
    if (effect->acts_on() == kOnBus) continue;  // it is in v_dc (trace/bus_ripple.hpp)
    if (equations.needs_missing_i_d(*effect)) continue;
    for (TracedKey& key : keys)
      if (is_moment(key)) key.grid = times_of(equations.record());
    over_grid(*effect, keys, 0, [&] {
      const std::shared_ptr<Effect> at_grid = effect->clone();
      start_with(record, *at_grid);
      if (!at_grid->prepare(equations.facts()).empty()) return;
      const int acts = at_grid->acts_on();
      if (acts == kOnSpeed) return;  // it is in no equation
      if (acts == kOnVoltage && !equations.has_voltage()) return;
      if (wanted && !wanted(*at_grid)) return;
      if (is_of(*at_grid, Traits::Family::kLag) && acts == kOnVoltage && !u_moves) return;
      if (is_of(*at_grid, Traits::Family::kLag) && acts == kOnCurrents && !i_moves) return;
      candidates.push_back({.effect = at_grid, .columns = {}});
    });
  }
  for_each_index(candidates.size(), [&](std::size_t i) {
    auto& [effect, columns] = candidates[i];
    if (effect->tracing().regressor_count() == 0)
      columns.push_back(chain.contribution(*effect));
    else
      columns = chain.columns(*effect);
  });
  return candidates;
}

bool Dictionary::renew(const Chain& chain, const Effects& effects) {
  const auto kinds = [&](auto counts) {
    std::vector<std::string_view> some;
    for (const auto& effect : effects)
      if (counts(*effect)) some.push_back(effect->kind());
    std::sort(some.begin(), some.end());
    return some;
  };
  // A constant error of the angle turns only phases. An error that is small against the fastest
  // period changes no column.
  const auto turns = [](const Effect& effect) {
    constexpr double kHighestOrder = 60, kSmallPart = 0.4;  // rad of it
    if (!(effect.acts_on() & kOnAngle)) return false;
    if (effect.tracing().traits().period.of_angle())
      return get_key(effect, "amplitude_rad") * kHighestOrder > kSmallPart;
    return is_of(effect, Traits::Family::kLag);
  };
  Beside now{.sensors = kinds([](const Effect& effect) {
               return effect.acts_on() != kOnTorque || turns_with_angle(effect);
             }),
             .at_zero = kinds([&](const Effect& effect) {
               return effect.acts_on() & kOnCurrents || turns(effect);
             }),
             .with_angle = kinds(turns)};
  if (acting_on(effects, ~kOnTorque).empty()) now.sensors.clear();
  if (now == beside) return false;
  const Beside before = std::exchange(beside, std::move(now));
  if (beside.sensors != before.sensors) renew_sensors(chain, effects, sampled);
  const bool at_zero = beside.at_zero != before.at_zero,
             with_angle = beside.with_angle != before.with_angle;
  if (at_zero || with_angle)
    renew_corrected(chain, effects, sampled, [&](const Effect& effect) {
      return (at_zero && turns_at_zero(effect)) || (with_angle && turns_with_angle(effect));
    });
  return true;
}

void Dictionary::whiten(const Chain& chain, bool renewed_only) {
  whitened.resize(sampled.size());
  for_each_index(sampled.size(), [&](std::size_t i) {
    if (renewed_only && !is_renewed(*sampled[i].effect)) return;
    whitened[i].effect = sampled[i].effect;
    whitened[i].columns.clear();
    for (const Sampled& x : sampled[i].columns) whitened[i].columns.push_back(chain.regressor(x));
  });
}

Rows::Rows(const Sampler& sampler, bool held_out) {
  const auto pieces = [&](const Runs& runs, Stretches& list, std::size_t& count) {
    for (std::size_t r = 0; r < runs.start.size(); ++r) {
      const std::size_t first = runs.start[r];
      const std::size_t end = r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size();
      if ((runs.held_out[first] != 0) != held_out) continue;
      list.emplace_back(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(end - first));
      count += end - first;
    }
  };
  pieces(sampler.electrical(), electrical_pieces_, electrical_);
  pieces(sampler.torque(), torque_pieces_, torque_);
}

Rows Rows::where(const Sampler& sampler, const std::function<bool(std::size_t)>& in) {
  Rows rows;
  const auto pieces = [&](const Runs& runs, Stretches& list, std::size_t& count) {
    for (std::size_t r = 0; r < runs.start.size(); ++r) {
      const std::size_t end = r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size();
      bool before = false;
      for (std::size_t n = runs.start[r]; n < end; ++n) {
        const bool here = in(runs.row[n]);
        if (here && !before) list.emplace_back(static_cast<Eigen::Index>(n), 0);
        if (here) ++list.back().second, ++count;
        before = here;
      }
    }
  };
  pieces(sampler.electrical(), rows.electrical_pieces_, rows.electrical_);
  pieces(sampler.torque(), rows.torque_pieces_, rows.torque_);
  return rows;
}

double Rows::dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                 const Stretches& pieces) const {
  if (!a.size() || !b.size()) return 0;
  double sum = 0;
  for (const auto& [first, count] : pieces)
    sum += a.segment(first, count).dot(b.segment(first, count));
  return sum;
}

double Rows::dot(const Sampled& a, const Sampled& b) const {
  return energy(a, b).sum() - noise(a, b).sum();
}

double Rows::against(const Sampled& column, const Sampled& residual) const {
  return energy(column, residual).sum() - noise_against(column, residual).sum();
}

EquationEnergy Rows::product(const Part& of_a, const Sampled& a, const Part& of_b,
                             const Sampled& b) const {
  return {
      dot(a.*of_a.d, b.*of_b.d, electrical_pieces_) + dot(a.*of_a.q, b.*of_b.q, electrical_pieces_),
      dot(a.*of_a.torque, b.*of_b.torque, torque_pieces_)};
}

EquationEnergy Rows::energy(const Sampled& a, const Sampled& b) const {
  return product(kValue, a, kValue, b);
}

EquationEnergy Rows::noise(const Sampled& a, const Sampled& b) const {
  const EquationEnergy crossed = answer(a, b), back = answer(b, a);
  return product(kNoise, a, kNoise, b) + EquationEnergy{(crossed.electrical + back.electrical) / 2,
                                                        (crossed.torque + back.torque) / 2};
}

EquationEnergy Rows::noise_against(const Sampled& column, const Sampled& residual) const {
  return product(kNoise, column, kNoise, residual) + answer(column, residual);
}

EquationEnergy Rows::answer(const Sampled& answered, const Sampled& read) const {
  return product(kAnswer, answered, kNoise, read);
}

std::size_t Rows::count(const Sampled& like) const {
  return (like.d.size() ? electrical_ : 0) + (like.q.size() ? electrical_ : 0) +
         (like.torque.size() ? torque_ : 0);
}

}  // namespace twinrate
