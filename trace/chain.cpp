#include "trace/chain.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"
#include "trace/record_contributions.hpp"

namespace twinrate {
namespace {

// Energy of a regressor over that of its noise; with less it is of no use.
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
  add(a.answer_d, b.answer_d, factor);
  add(a.answer_q, b.answer_q, factor);
  add(a.answer_torque, b.answer_torque, factor);
}

bool has_gap(const Effect& effect) {
  ShaftFacts shaft;
  return effect.describe_shaft(shaft) && shaft.gap > 0;
}

bool is_shaft(const Effect& effect) {
  ShaftFacts shaft;
  return effect.describe_shaft(shaft);
}

bool changes_inertia(const Effect& effect) {
  return is_shaft(effect) || is_of(effect, Traits::Family::kInertia);
}

bool is_slow_shaft(const Effect& effect) {
  constexpr double kSlow = 10;  // Hz, of the load at a motor at rest
  ShaftFacts s;
  return effect.describe_shaft(s) && std::sqrt(s.stiffness / s.J_load) < kTwoPi * kSlow;
}

bool is_of_shaft(const Effect& effect) {
  return effect.behind_shaft() || is_shaft(effect);
}

bool turns_with_angle(const Effect& effect) {
  return effect.tracing().traits().period.of_angle() &&
         !(effect.acts_on() & (kOnCurrents | kOnAngle));
}

bool turns_at_zero(const Effect& effect) {
  return is_placed(effect, Traits::Place::kZone);
}

bool holds_noise(const Effect& effect) {
  return effect.tracing().traits().noise != Traits::Noise::kNone;
}

Sampled Chain::sampled(const Channels& clean) const {
  Sampled s;
  if (!clean.d.empty()) s.d = sampler_(clean.d, sampler_.electrical());
  if (!clean.q.empty()) s.q = sampler_(clean.q, sampler_.electrical());
  if (!clean.torque.empty()) s.torque = sampler_(clean.torque, sampler_.torque());
  return s;
}

Sampled Chain::sampled(const Channels& clean, const Channels& read,
                       const Channels& answered) const {
  Sampled s, noisy, answer;
  together({[&] { s = sampled(clean); }, [&] { noisy = sampled(read); },
            [&] { answer = sampled(answered); }});
  s.noise_d = noisy.d - s.d;
  s.noise_q = noisy.q - s.q;
  s.noise_torque = noisy.torque - s.torque;
  s.answer_d = answer.d - noisy.d;
  s.answer_q = answer.q - noisy.q;
  s.answer_torque = answer.torque - noisy.torque;
  return s;
}

bool Chain::is_linear(const Effect& effect) const {
  constexpr std::size_t kLooks = 24;
  if (effect.tracing().regressor_count() == 0) return false;
  std::vector<double> coefficients(static_cast<std::size_t>(effect.tracing().regressor_count()));
  effect.tracing().coefficients(coefficients);
  for (double& c : coefficients) c *= 2;
  const std::shared_ptr<Effect> twice = effect.clone();
  twice->tracing().set_coefficients(coefficients);
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

Chain::Columns Chain::recall(Remembered wanted,
                             const std::function<std::vector<Sampled>()>& make) const {
  constexpr std::size_t kMost = 40;
  {
    const std::lock_guard lock(memory_mutex_);
    const auto found = std::find_if(memory_.begin(), memory_.end(), [&](const Remembered& m) {
      return m.what == wanted.what && m.keys == wanted.keys;
    });
    if (found != memory_.end()) {
      std::rotate(found, found + 1, memory_.end());
      return memory_.back().columns;
    }
  }
  wanted.columns = std::make_shared<const std::vector<Sampled>>(make());
  const Columns made = wanted.columns;
  const std::lock_guard lock(memory_mutex_);
  if (memory_.size() == kMost) memory_.pop_front();
  memory_.push_back(std::move(wanted));
  return made;
}

Chain::Remembered Chain::shape_of(const char* what, const Effect& effect) const {
  const std::shared_ptr<Effect> shape = effect.clone();
  if (is_linear(effect))
    shape->tracing().set_coefficients(
        std::vector<double>(static_cast<std::size_t>(effect.tracing().regressor_count()), 0.0));
  return {what + std::string(effect.kind()), key_values(*shape), {}};
}

Chain::Columns Chain::remembered_columns(const Effect& effect) const {
  return recall(shape_of("columns of ", effect), [&] { return columns(effect); });
}

bool Chain::commands(const Effects& effects) const {
  const auto count = [](const Effects& some) {
    return std::count_if(some.begin(), some.end(),
                         [](const auto& effect) { return acts_on_command(*effect); });
  };
  return count(effects) + count(equations_.known()) > 1;
}

bool Chain::loads_shaft(const Effects& effects) const {
  ShaftFacts facts;
  bool shaft = false, load = false;
  for (const Effects* some : {&effects, &equations_.known()})
    for (const auto& effect : *some) {
      shaft |= effect->describe_shaft(facts);
      load |= effect->behind_shaft();
    }
  return shaft && load;
}

Sampled Chain::residual(const Effects& effects) const {
  checkpoint();
  Effects all = equations_.known();
  all.insert(all.end(), effects.begin(), effects.end());
  // The contributions of all effects do not simply add up. A sensor error changes those of the
  // others; an error of a current does not change those of loads. Effects on the command act in
  // sequence, and a load acts through its shaft.
  const bool currents = !acting_on(all, kOnCurrents).empty();
  const bool angle = !acting_on(all, kOnAngle).empty();
  const bool several = commands(effects), loaded = loads_shaft(effects);
  Effects together;
  Remembered wanted{.what = "residual of", .keys = {}, .columns = {}};
  for (const auto& effect : effects) {
    if (!angle && (!currents || effect->acts_on() == kOnTorque) &&
        !(several && acts_on_command(*effect)) && !(loaded && is_of_shaft(*effect)))
      continue;
    together.push_back(effect);
    wanted.what += " " + std::string(effect->kind());
    const std::vector<double> keys = key_values(*effect);
    wanted.keys.insert(wanted.keys.end(), keys.begin(), keys.end());
  }
  Sampled s = recall(std::move(wanted), [&] {
                return std::vector<Sampled>{whole_residual(together)};
              })->front();
  for (const auto& effect : effects) {
    if (std::find(together.begin(), together.end(), effect) != together.end()) continue;
    if (!is_linear(*effect)) {
      add(s,
          recall({"whole " + std::string(effect->kind()), key_values(*effect), {}},
                 [&] { return std::vector<Sampled>{contribution_to_fit(*effect)}; })
              ->front(),
          -1);
      continue;
    }
    std::vector<double> coefficients(static_cast<std::size_t>(effect->tracing().regressor_count()));
    effect->tracing().coefficients(coefficients);
    const Columns columns = remembered_columns(*effect);
    for (std::size_t r = 0; r < columns->size(); ++r) add(s, (*columns)[r], -coefficients[r]);
  }
  return s;
}

Sampled Chain::noiseless(const Effects& effects) const {
  return sampled(equations_.residual(effects));
}

Sampled Chain::rounding(const Effects& effects) const {
  if (!moved_counts_) return {};
  checkpoint();
  const Record record = moved_counts_();
  const Equations moved(record, equations_.facts(), equations_.known());
  const Sampled clean = noiseless(effects), rounded = sampled(moved.residual(effects));
  Sampled noise;
  noise.noise_d = rounded.d - clean.d;
  noise.noise_q = rounded.q - clean.q;
  noise.noise_torque = rounded.torque - clean.torque;
  return noise;
}

Eigen::VectorXd Chain::impacts_noise(const Effects& effects) const {
  const auto gap =
      std::find_if(effects.begin(), effects.end(), [](const auto& e) { return has_gap(*e); });
  if (gap == effects.end()) return {};
  checkpoint();
  Channels clean, read;
  together({[&] { clean = equations_.contribution(**gap); },
            [&] { read = readings_.contribution(**gap); }});
  return sampled(read).torque - sampled(clean).torque;
}

Sampled Chain::contribution_to_fit(const Effect& effect) const {
  if (!is_of_shaft(effect) || has_gap(effect)) return contribution(effect);
  checkpoint();
  Channels clean, read;
  together({[&] { clean = equations_.contribution(effect); },
            [&] { read = readings_.contribution(effect); }});
  Sampled s = sampled(clean, read, read);
  s.answer_torque = {};
  return s;
}

Sampled Chain::whole_residual(const Effects& effects) const {
  Effects smooth;
  for (const auto& effect : effects)
    if (!has_gap(*effect)) smooth.push_back(effect);
  Channels clean, read, answered;
  together({[&] { clean = equations_.residual(smooth, Equations::Undone::kKept); },
            [&] { read = readings_.residual(smooth); },
            [&] { answered = answered_.residual(smooth); }});
  Sampled s = sampled(clean, read, answered);
  if (std::any_of(effects.begin(), effects.end(), [](const auto& e) { return is_shaft(*e); }))
    s.answer_torque = {};
  if (smooth.size() == effects.size()) return s;
  const Sampled all = noiseless(effects);
  s.d = all.d;
  s.q = all.q;
  s.torque = all.torque;
  return s;
}

std::vector<Sampled> Chain::columns(const Effect& effect) const {
  if (!holds_noise(effect)) return columns_of(equations_, effect);
  checkpoint();
  std::vector<Sampled> out;
  const bool at_zero = turns_at_zero(effect);
  std::vector<Channels> clean, read, of_answered;
  together({[&] { clean = equations_.columns(effect); }, [&] { read = readings_.columns(effect); },
            [&] {
              if (!at_zero) of_answered = answered_.columns(effect);
            }});
  const std::vector<Channels>& answered = at_zero ? read : of_answered;
  for (std::size_t r = 0; r < clean.size(); ++r)
    out.push_back(sampled(clean[r], read[r], answered[r]));
  return out;
}

std::vector<Sampled> Chain::columns_of(const Equations& equations, const Effect& effect) const {
  checkpoint();
  std::vector<Sampled> out;
  const std::string order_key = effect.tracing().traits().period.order_key;
  const bool slow = order_key.empty() || sampler_.slow_enough(get_key(effect, order_key));
  if (effect.acts_on() == kOnTorque && !holds_noise(effect) && slow) {
    for (const auto& x : equations.load_columns(effect, sampler_.first(), sampler_.stride())) {
      out.emplace_back();
      out.back().torque = sampler_.sparsely(x, sampler_.torque());
    }
    return out;
  }
  for (const Channels& clean : equations.columns(effect)) out.push_back(sampled(clean));
  return out;
}

Sampled Chain::contribution(const Effect& effect) const {
  checkpoint();
  if (has_gap(effect)) return sampled(equations_.contribution(effect));
  Channels clean, read, answered;
  together({[&] { clean = equations_.contribution(effect); },
            [&] { read = readings_.contribution(effect); },
            [&] { answered = answered_.contribution(effect); }});
  return sampled(clean, read, answered);
}

// If no row of a channel was seen, its noise is unknown, and the channel is left out.
Sampled Chain::whitened(const Sampled& s) const {
  Sampled w;
  const auto take = [](const Whitener& whitener, const Eigen::VectorXd& x, const Runs& runs) {
    return whitener.none() ? Eigen::VectorXd() : x.size() ? whitener(x, runs) : x;
  };
  const Runs &electrical = sampler_.electrical(), &torque = sampler_.torque();
  together({[&] {
              w.torque = take(noise_.torque, s.torque, torque);
              w.noise_torque = noise_.scale_torque * take(noise_.torque, s.noise_torque, torque);
              w.answer_torque = noise_.scale_torque * take(noise_.torque, s.answer_torque, torque);
            },
            [&] {
              w.d = take(noise_.d, s.d, electrical);
              w.noise_d = noise_.scale_d * take(noise_.d, s.noise_d, electrical);
              w.answer_d = noise_.scale_d * take(noise_.d, s.answer_d, electrical);
            },
            [&] {
              w.q = take(noise_.q, s.q, electrical);
              w.noise_q = noise_.scale_q * take(noise_.q, s.noise_q, electrical);
              w.answer_q = noise_.scale_q * take(noise_.q, s.answer_q, electrical);
            }});
  return w;
}

Sampled Chain::in_sensors(const Sampled& s) const {
  Sampled w = whitened(s);
  const Runs& runs = sampler_.torque();
  const Sampled declared = residual({});
  if (!declared.noise_torque.size()) return w;
  const Eigen::VectorXd noise = noise_.sensors(declared.noise_torque, runs);
  const double rms = noise_.scale_torque * noise.norm() /
                     std::sqrt(static_cast<double>(std::max<Eigen::Index>(1, noise.size())));
  if (!(rms > 0)) return w;
  if (s.torque.size()) w.torque = noise_.sensors(s.torque, runs) / rms;
  if (s.noise_torque.size())
    w.noise_torque = noise_.scale_torque / rms * noise_.sensors(s.noise_torque, runs);
  w.answer_torque = {};
  return w;
}

Sampled Chain::regressor(const Sampled& column) const {
  Sampled w = whitened(column);
  const auto mute = [](Eigen::VectorXd& value, Eigen::VectorXd& noise, Eigen::VectorXd& answer,
                       double least) {
    if (!noise.size()) return;
    const double share =
        noise.squaredNorm() + (answer.size() ? std::max(0.0, noise.dot(answer)) : 0);
    if (value.squaredNorm() > (1 + least) * share) return;
    value.setZero();
    noise.setZero();
    answer.setZero();
  };
  mute(w.d, w.noise_d, w.answer_d, kLeastElectrical);
  mute(w.q, w.noise_q, w.answer_q, kLeastElectrical);
  mute(w.torque, w.noise_torque, w.answer_torque, kLeastTorque);
  return w;
}

}  // namespace twinrate
