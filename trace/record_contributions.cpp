#include "trace/record_contributions.hpp"

#include <algorithm>

#include "model/effects/memory.hpp"
#include "model/effects/shaft.hpp"
#include "model/effects/tracing.hpp"

namespace twinrate {

bool acts_on_command(const Effect& effect) {
  return effect.tracing().traits().on_command == Traits::Answer::kYes;
}

RecordContributions::RecordContributions(const Effects& effects,
                                         const std::vector<OperatingPoint>& points,
                                         const Record& record)
    : points_(points) {
  for (const auto& effect : effects) {
    ShaftFacts shaft;
    SamplingFacts sampling;
    if (effect->describe_shaft(shaft)) {
      T_load_.emplace_back(points.size());
      along_shaft(shaft, points, load_behind_shaft(effects, points), record.T_s, 0, T_load_.back());
      J_ -= std::max(0.0, shaft.J_load);
    } else if (effect->describe_sampling(sampling)) {
      with_memory_.emplace_back(points.size());
      contributions(*effect, points, record.T_s, with_memory_.back());
      late_ |= acts_on_command(*effect);
    } else if (acts_on_command(*effect)) {
      of_the_command_.push_back(effect.get());
    } else {
      of_the_point_.push_back(effect.get());
      if (effect->drops_by_angle()) of_the_angle_.push_back(effect.get());
      if (effect->acts_on() & kOnVoltage && effect->acts_on() & kOnCurrents)
        around_winding_.push_back(effect);
    }
  }
}

Contribution RecordContributions::operator[](std::size_t k) const {
  if (around_winding_.empty()) return at(points_[k], k);
  return at(with_terminals(around_winding_, points_[k]), k);
}

Vec2 RecordContributions::drop_by_angle(std::size_t k) const {
  Vec2 drop = Vec2::Zero();
  for (const Effect* effect : of_the_angle_) drop += effect->at(points_[k]).u_dq_drop;
  return drop;
}

Vec2 RecordContributions::of_command(std::size_t k) const {
  Vec2 drop = Vec2::Zero();
  if (late_)
    for (const auto& of_one : with_memory_) drop += of_one[k].u_dq_drop;
  if (of_the_command_.empty()) return drop;
  OperatingPoint late = points_[k];
  late.u_dq -= drop;
  for (const Effect* effect : of_the_command_) drop += effect->at(late).u_dq_drop;
  return drop;
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
