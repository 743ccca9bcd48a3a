#include "trace/dictionary.hpp"

#include <algorithm>
#include <functional>

#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr int kMostTimes = 200;  // of candidates that differ in their moment alone: memory

// Times at which something may have happened, for keys whose grid only the record can give. They
// stand in the record's stretches: between them no row tells one moment from another.
std::vector<double> times_of(const Record& record) {
  std::vector<double> times;
  const std::size_t n = record.size();
  const auto tenths = std::lround(static_cast<double>(n) * record.T_s / 0.1);
  const auto steps = static_cast<std::size_t>(std::clamp<long>(tenths, 8, kMostTimes));
  for (std::size_t j = 1; j < steps; ++j) times.push_back(record.t[n * j / steps]);
  return times;
}

// A key that is a moment of the record has no grid of its own.
bool is_moment(const TracedKey& key) {
  return !key.linear && key.grid.empty() && std::string_view(key.key) == "time_s";
}

// A gap is: beside a shaft (trace/placing.hpp).
bool searched_elsewhere(const std::vector<TracedKey>& keys) {
  return std::any_of(keys.begin(), keys.end(), [](const TracedKey& key) {
    return !key.linear && key.grid.empty() && !is_moment(key);
  });
}

// A late signal shows where it turns or jumps. Where it does neither, all that changes is noise and
// the controller's answer to it, which belong to the residual's own.
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

// Calls f for every point of the grids, with the keys set.
void over_grid(Effect& effect, const std::vector<TracedKey>& keys, std::size_t index,
               const std::function<void()>& f) {
  while (index < keys.size() && keys[index].grid.empty()) ++index;
  if (index == keys.size()) return f();
  for (double value : keys[index].grid) {
    set_key(effect, keys[index].key, value);
    over_grid(effect, keys, index + 1, f);
  }
}

// Energy of a regressor over that of its noise: with less it says nothing.
constexpr double kLeastElectrical = 3, kLeastTorque = 2;

void add(Eigen::VectorXd& a, const Eigen::VectorXd& b, double factor) {
  if (!b.size()) return;
  if (!a.size()) a.setZero(b.size());
  a += factor * b;
}

}  // namespace

void add(Sampled& a, const Sampled& b, double factor) {
  add(a.d, b.d, factor);
  add(a.q, b.q, factor);
  add(a.torque, b.torque, factor);
  add(a.noise_d, b.noise_d, factor);
  add(a.noise_q, b.noise_q, factor);
  add(a.noise_torque, b.noise_torque, factor);
}

bool has_gap(const Effect& effect) {
  ShaftFacts shaft;
  return effect.describe_shaft(shaft) && shaft.gap > 0;
}

bool holds_noise(const Effect& effect) {
  for (std::string_view kind : {"flux_harmonics", "inverter_offset"})
    if (effect.kind() == kind) return false;
  if (effect.acts_on() & (kOnFlux | kOnCurrents | kOnAngle | kOnVoltage)) return true;
  return effect.regressor_count() == 0 || effect.kind() == "inertia";
}

Sampled Chain::sampled(const Channels& clean, const Channels* noisy) const {
  Sampled s;
  const auto take = [&](const std::vector<double>& x, const std::vector<double>* x_noisy,
                        const Runs& runs, Eigen::VectorXd& value, Eigen::VectorXd& noise) {
    if (x.empty()) return;
    value = sampler_(x, runs);
    if (x_noisy) noise = sampler_(*x_noisy, runs) - value;
  };
  take(clean.d, noisy ? &noisy->d : nullptr, sampler_.electrical(), s.d, s.noise_d);
  take(clean.q, noisy ? &noisy->q : nullptr, sampler_.electrical(), s.q, s.noise_q);
  take(clean.torque, noisy ? &noisy->torque : nullptr, sampler_.torque(), s.torque, s.noise_torque);
  return s;
}

bool Chain::is_linear(const Effect& effect) const {
  constexpr std::size_t kLooks = 24;
  if (effect.regressor_count() == 0) return false;
  std::vector<double> coefficients(static_cast<std::size_t>(effect.regressor_count()));
  effect.coefficients(coefficients);
  for (double& c : coefficients) c *= 2;
  const std::shared_ptr<Effect> twice = effect.clone();
  twice->set_coefficients(coefficients);
  const std::vector<OperatingPoint>& points = equations_.points();
  for (std::size_t look = 0; look < kLooks; ++look) {
    const OperatingPoint& point = points[look * (points.size() - 1) / kLooks];
    const Contribution once = effect.at(point), both = twice->at(point);
    const auto doubled = [](double x, double y) {
      return std::abs(y - 2 * x) <= 1e-9 * std::abs(y);
    };
    if (!doubled(once.T_load, both.T_load) || !doubled(once.J, both.J)) return false;
    for (int axis = 0; axis < 2; ++axis)
      if (!doubled(once.psi_dq[axis], both.psi_dq[axis]) ||
          !doubled(once.u_dq_drop[axis], both.u_dq_drop[axis]))
        return false;
  }
  return true;
}

const std::vector<Sampled>& Chain::remembered(const Effect& effect, What what) const {
  constexpr std::size_t kMost = 40;
  const std::shared_ptr<Effect> shape = effect.clone();
  if (what == What::kColumns && is_linear(effect))
    shape->set_coefficients(
        std::vector<double>(static_cast<std::size_t>(effect.regressor_count()), 0.0));
  Remembered wanted{.what = what, .kind = effect.kind(), .keys = {}, .columns = {}};
  for (const NumericKey& key : numeric_keys(*shape)) wanted.keys.push_back(key.value);
  const auto found = std::find_if(memory_.begin(), memory_.end(), [&](const Remembered& m) {
    return m.what == what && m.kind == wanted.kind && m.keys == wanted.keys;
  });
  if (found != memory_.end()) {
    std::rotate(found, found + 1, memory_.end());
    return memory_.back().columns;
  }
  if (what == What::kColumns)
    wanted.columns = columns(effect);
  else
    wanted.columns.push_back(contribution(effect));
  if (memory_.size() == kMost) memory_.pop_front();
  memory_.push_back(std::move(wanted));
  return memory_.back().columns;
}

Sampled Chain::residual(const Effects& effects) const {
  checkpoint();
  Effects all = equations_.known();
  all.insert(all.end(), effects.begin(), effects.end());
  // What is added to a sensor changes what the others do.
  if (!acting_on(all, kOnCurrents | kOnAngle).empty()) return whole_residual(effects);
  if (declared_.torque.size() + declared_.d.size() == 0) declared_ = whole_residual({});
  Sampled s = declared_;
  for (const auto& effect : effects) {
    if (!is_linear(*effect)) {
      add(s, remembered(*effect, What::kWhole)[0], -1);
      continue;
    }
    std::vector<double> coefficients(static_cast<std::size_t>(effect->regressor_count()));
    effect->coefficients(coefficients);
    const std::vector<Sampled>& columns = remembered(*effect, What::kColumns);
    for (std::size_t r = 0; r < columns.size(); ++r) add(s, columns[r], -coefficients[r]);
  }
  return s;
}

Sampled Chain::noiseless(const Effects& effects) const {
  return sampled(equations_.residual(effects), nullptr);
}

Sampled Chain::whole_residual(const Effects& effects) const {
  Effects smooth;
  for (const auto& effect : effects)
    if (!has_gap(*effect)) smooth.push_back(effect);
  const Channels noisy = noisier_.residual(smooth);
  Sampled s = sampled(equations_.residual(smooth), &noisy);
  if (smooth.size() == effects.size()) return s;
  const Sampled all = noiseless(effects);
  s.d = all.d;
  s.q = all.q;
  s.torque = all.torque;
  return s;
}

std::vector<Sampled> Chain::columns(const Effect& effect) const {
  checkpoint();
  std::vector<Sampled> out;
  if (effect.acts_on() == kOnTorque && !holds_noise(effect)) {
    for (const auto& x : equations_.load_columns(effect, sampler_.first(), sampler_.stride())) {
      out.emplace_back();
      out.back().torque = sampler_.sparsely(x, sampler_.torque());
    }
    return out;
  }
  const std::vector<Channels> clean = equations_.columns(effect);
  std::vector<Channels> noisy;
  if (holds_noise(effect)) noisy = noisier_.columns(effect);
  for (std::size_t r = 0; r < clean.size(); ++r)
    out.push_back(sampled(clean[r], noisy.empty() ? nullptr : &noisy[r]));
  return out;
}

Sampled Chain::contribution(const Effect& effect) const {
  checkpoint();
  if (has_gap(effect)) return sampled(equations_.contribution(effect), nullptr);
  const Channels noisy = noisier_.contribution(effect);
  return sampled(equations_.contribution(effect), &noisy);
}

Sampled Chain::whitened(const Sampled& s) const {
  Sampled w;
  const auto take = [](const Whitener& whitener, const Eigen::VectorXd& x, const Runs& runs) {
    return x.size() ? whitener(x, runs) : x;
  };
  w.d = take(noise_.d, s.d, sampler_.electrical());
  w.q = take(noise_.q, s.q, sampler_.electrical());
  w.torque = take(noise_.torque, s.torque, sampler_.torque());
  w.noise_d = noise_.scale_d * take(noise_.d, s.noise_d, sampler_.electrical());
  w.noise_q = noise_.scale_q * take(noise_.q, s.noise_q, sampler_.electrical());
  w.noise_torque = noise_.scale_torque * take(noise_.torque, s.noise_torque, sampler_.torque());
  return w;
}

Sampled Chain::regressor(const Sampled& column) const {
  Sampled w = whitened(column);
  const auto mute = [](Eigen::VectorXd& value, Eigen::VectorXd& noise, double least) {
    if (!noise.size() || value.squaredNorm() > (1 + least) * noise.squaredNorm()) return;
    value.setZero();
    noise.setZero();
  };
  mute(w.d, w.noise_d, kLeastElectrical);
  mute(w.q, w.noise_q, kLeastElectrical);
  mute(w.torque, w.noise_torque, kLeastTorque);
  return w;
}

std::vector<Candidate> make_candidates(const Chain& chain) {
  const Equations& equations = chain.equations();
  std::vector<Candidate> candidates;
  const Record& record = equations.record();
  const bool u_moves = moves(record.u_alphabeta, record.electrical_ok),
             i_moves = moves(record.i_alphabeta, record.electrical_ok);
  for (const std::string& kind : effect_kinds()) {
    const std::shared_ptr<Effect> effect = make_effect(kind);
    effect->prepare(equations.facts());  // a grid may depend on the drive
    std::vector<TracedKey> keys = effect->traced_keys();
    if (keys.empty() || searched_elsewhere(keys)) continue;
    const bool electrical_only = !(effect->acts_on() & ~(kOnVoltage | kOnBus));
    if (electrical_only && !equations.has_voltage()) continue;
    for (TracedKey& key : keys)
      if (is_moment(key)) key.grid = times_of(equations.record());
    over_grid(*effect, keys, 0, [&] {
      const std::shared_ptr<Effect> at_grid = effect->clone();
      if (!at_grid->prepare(equations.facts()).empty()) return;
      const int acts = at_grid->acts_on();
      if (kind == "signal_lag" && acts == kOnVoltage && !u_moves) return;
      if (kind == "signal_lag" && acts == kOnCurrents && !i_moves) return;
      Candidate candidate{.effect = at_grid, .columns = {}};
      if (at_grid->regressor_count() == 0) {
        candidate.columns.push_back(chain.contribution(*at_grid));
      } else {
        candidate.columns = chain.columns(*at_grid);
      }
      candidates.push_back(std::move(candidate));
    });
  }
  return candidates;
}

void Dictionary::renew(const Chain& chain, const Effects& beside) {
  constexpr double kProbe = 1e-5;  // of a coefficient
  const Sampled residual = chain.noiseless(beside);
  for (Candidate& candidate : sampled) {
    const bool adds = candidate.effect->regressor_count() > 0;
    if (!adds || !(candidate.effect->acts_on() & (kOnCurrents | kOnAngle))) continue;
    for (std::size_t r = 0; r < candidate.columns.size(); ++r) {
      std::vector<double> coefficients(candidate.columns.size(), 0.0);
      coefficients[r] = kProbe;
      const std::shared_ptr<Effect> probe = candidate.effect->clone();
      probe->set_coefficients(coefficients);
      Effects all = beside;
      all.push_back(probe);
      const Sampled there = chain.noiseless(all);
      Sampled& x = candidate.columns[r];  // its noise hardly changes
      x.d = (residual.d - there.d) / kProbe;
      x.q = (residual.q - there.q) / kProbe;
      x.torque = (residual.torque - there.torque) / kProbe;
    }
  }
}

void Dictionary::whiten(const Chain& chain) {
  whitened.resize(sampled.size());
  for (std::size_t i = 0; i < sampled.size(); ++i) {
    whitened[i].effect = sampled[i].effect;
    whitened[i].columns.clear();
    for (const Sampled& x : sampled[i].columns) whitened[i].columns.push_back(chain.regressor(x));
  }
}

Rows::Rows(const Sampler& sampler, bool held_out) {
  const auto pieces = [&](const Runs& runs, auto& list, std::size_t& count) {
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

double Rows::dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                 const std::vector<std::pair<Eigen::Index, Eigen::Index>>& pieces) const {
  if (!a.size() || !b.size()) return 0;
  double sum = 0;
  for (const auto& [first, count] : pieces)
    sum += a.segment(first, count).dot(b.segment(first, count));
  return sum;
}

double Rows::dot(const Sampled& a, const Sampled& b) const {
  return dot(a.d, b.d, electrical_pieces_) + dot(a.q, b.q, electrical_pieces_) +
         dot(a.torque, b.torque, torque_pieces_) - noise(a, b);
}

NoiseEnergy Rows::noise_energy(const Sampled& a, const Sampled& b) const {
  return {
      dot(a.noise_d, b.noise_d, electrical_pieces_) + dot(a.noise_q, b.noise_q, electrical_pieces_),
      dot(a.noise_torque, b.noise_torque, torque_pieces_)};
}

std::size_t Rows::count(const Sampled& like) const {
  return (like.d.size() ? electrical_ : 0) + (like.q.size() ? electrical_ : 0) +
         (like.torque.size() ? torque_ : 0);
}

}  // namespace twinrate
