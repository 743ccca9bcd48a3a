#include "trace/record_contributions.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "model/effects/lag.hpp"
#include "model/effects/memory.hpp"
#include "model/effects/shaft.hpp"
#include "model/effects/tracing.hpp"
#include "model/math.hpp"
#include "trace/signals.hpp"

namespace twinrate {

bool acts_on_command(const Effect& effect) {
  return effect.tracing().traits().on_command == Traits::Answer::kYes;
}

bool follows_current(const Effect& effect) {
  return is_placed(effect, Traits::Place::kZone);
}

namespace {

// Requested less acting voltage. In a record of one row for several, a voltage has no steps at the
// ends of its rows: a delayed one is on the cubic through its neighbours.
void late_voltage(const Effect& effect, const SamplingFacts& late,
                  const std::vector<OperatingPoint>& points, const Record& record,
                  std::vector<Contribution>& sums) {
  const double delay = late.delay[SamplingFacts::kVoltage];
  if (record.rows_each == 1 || delay == 0) return contributions(effect, points, record.T_s, sums);
  std::vector<Vec2> before(record.u_alphabeta.rbegin(), record.u_alphabeta.rend());
  before = ahead(before, delay, 0, record.T_s);
  HeldLowPass<Vec2> filter(late.lowpass[SamplingFacts::kVoltage], record.T_s);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Vec2 acting = filter.pass(before[points.size() - 1 - k]);
    sums[k] = {.u_dq_drop = points[k].rotor_axes(record.u_alphabeta[k] - acting)};
  }
}

}  // namespace

CurrentPath::CurrentPath(const OperatingPoint& from, const OperatingPoint& to, const Vec2& i_from,
                         const Vec2& i_to, double ticks)
    : from_(from),
      to_(to),
      i_from_(i_from),
      i_to_(i_to),
      ticks_(ticks),
      turn_e_(to.theta_e - from.theta_e) {
  if (ticks_ != 0) {
    parts_ = 2;
    return;
  }
  constexpr double kStraight = 0.15;  // rad, of an arc that is 0.3 % of its radius from its chord
  constexpr double kMost = 64;        // parts: of an angle that jumps
  const double turns = std::abs(turn_e_) / kStraight;
  if (turns > 1) parts_ = static_cast<int>(std::min(kMost, std::ceil(turns)));
}

OperatingPoint CurrentPath::edge(int j) const {
  const double share = static_cast<double>(j) / parts_;
  OperatingPoint p = j == parts_ ? to_ : from_;
  p.i_dq = i_from_ + share * (i_to_ - i_from_);
  if (j == 0 || j == parts_) return p;
  p.i_around += share * (to_.i_around - from_.i_around);
  p.theta_e += share * turn_e_;
  const auto [s, c] = math::sincos(p.theta_e);
  p.d_axis = {c, s};
  return p;
}

// Halfway through the tick that begins at an end.
OperatingPoint CurrentPath::tick(const OperatingPoint& end, const Vec2& i_dq) const {
  OperatingPoint p = end;
  p.i_dq = i_dq;
  p.theta_e += 0.5 * turn_e_ / ticks_;
  const auto [s, c] = math::sincos(p.theta_e);
  p.d_axis = {c, s};
  return p;
}

Vec2 CurrentPath::of_tick(const Vec2& drop) const {
  return inverse_park(Vec2(0.5 * length_of_mean(turn_e_, ticks_) * drop), 0.5 * turn_e_);
}

OperatingPoint CurrentPath::part(int j) const {
  if (ticks_ != 0) return j == 0 ? tick(from_, i_from_) : tick(to_, i_to_);
  const auto current = [](const OperatingPoint& p) { return p.stator_axes(p.i_terminal()); };
  OperatingPoint begin = edge(j);
  begin.i_moves = current(edge(j + 1)) - current(begin);
  return begin;
}

RecordContributions::RecordContributions(const Effects& effects,
                                         const std::vector<OperatingPoint>& points,
                                         const Record& record, std::span<const Vec2> i_path)
    : points_(points), i_path_(i_path), ticks_each_(record.ticks_each) {
  for (const auto& effect : effects) {
    ShaftFacts shaft;
    SamplingFacts sampling;
    if (effect->describe_shaft(shaft)) {
      T_load_.emplace_back(points.size());
      along_shaft(shaft, points, load_behind_shaft(effects, points), record.T_s, 0, T_load_.back());
      J_ -= std::max(0.0, shaft.J_load);
    } else if (effect->describe_sampling(sampling)) {
      with_memory_.emplace_back(points.size());
      if (acts_on_command(*effect) && !record.u_alphabeta.empty()) {
        late_voltage(*effect, sampling, points, record, with_memory_.back());
        late_ = true;
      } else {
        contributions(*effect, points, record.T_s, with_memory_.back());
      }
    } else if (acts_on_command(*effect)) {
      of_the_command_.push_back(effect.get());
    } else if (follows_current(*effect)) {
      of_the_path_.push_back(effect.get());
    } else {
      of_the_point_.push_back(effect.get());
      if (effect->drops_by_angle()) of_the_angle_.push_back(effect.get());
      if (effect->acts_on() & kOnVoltage && effect->acts_on() & kOnCurrents)
        around_winding_.push_back(effect);
    }
  }
}

Contribution RecordContributions::operator[](std::size_t k) const {
  return at(point(k), k);
}

OperatingPoint RecordContributions::point(std::size_t k) const {
  return around_winding_.empty() ? points_[k] : with_terminals(around_winding_, points_[k]);
}

Vec2 RecordContributions::drop_by_angle(std::size_t k) const {
  Vec2 drop = Vec2::Zero();
  for (const Effect* effect : of_the_angle_) drop += effect->at(points_[k]).u_dq_drop;
  return drop;
}

Vec2 RecordContributions::of_interval(std::size_t k) const {
  Vec2 drop = Vec2::Zero();
  if (late_)
    for (const auto& of_one : with_memory_) drop += of_one[k].u_dq_drop;
  if (!of_the_command_.empty()) {
    OperatingPoint late = points_[k];
    late.u_dq -= drop;
    for (const Effect* effect : of_the_command_) drop += effect->at(late).u_dq_drop;
  }
  if (of_the_path_.empty() || k + 1 >= points_.size()) return drop;
  const auto along = [&](const OperatingPoint& from, const OperatingPoint& to) {
    const bool own = i_path_.empty();
    return CurrentPath(from, to, own ? from.i_dq : i_path_[k], own ? to.i_dq : i_path_[k + 1],
                       ticks_each_)
        .mean([&](const OperatingPoint& part) {
          Vec2 sum = Vec2::Zero();
          for (const Effect* effect : of_the_path_) sum += effect->at(part).u_dq_drop;
          return sum;
        });
  };
  return drop + (around_winding_.empty() ? along(points_[k], points_[k + 1])
                                         : along(point(k), point(k + 1)));
}

Contribution RecordContributions::at(const OperatingPoint& point, std::size_t k) const {
  Contribution sum = of_the_point_.empty() ? Contribution{} : of_the_point_[0]->at(point);
  sum.J += J_;
  for (std::size_t e = 1; e < of_the_point_.size(); ++e) sum += of_the_point_[e]->at(point);
  const Vec2 drop = sum.u_dq_drop;
  for (const auto& of_one : with_memory_) sum += of_one[k];
  sum.u_dq_drop = drop;
  for (const auto& T_load : T_load_) sum.T_load += T_load[k];
  return sum;
}

}  // namespace twinrate
