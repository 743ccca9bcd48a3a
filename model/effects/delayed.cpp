#include "model/effects/delayed.hpp"

#include <algorithm>

#include "model/effects/tracing.hpp"

namespace twinrate {
namespace {

class Delayed final : public TraceableEffect {
 public:
  Delayed(std::shared_ptr<const Effect> effect, double from_s)
      : effect_(std::move(effect)), from_s_(from_s) {}
  std::string_view kind() const override { return effect_->kind(); }
  std::string_view meaning() const override { return effect_->meaning(); }
  int acts_on() const override { return effect_->acts_on(); }
  std::vector<std::string> signals_needed() const override {
    return effect_->tracing().signals_needed();
  }
  bool drops_by_angle() const override { return effect_->drops_by_angle(); }
  void fields(FieldVisitor& f) override {
    const std::shared_ptr<Effect> own = effect_->clone();
    own->fields(f);
    effect_ = own;
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<Delayed>(effect_->clone(), from_s_);
  }
  Vec2 current_around(const OperatingPoint& point) const override {
    return point.t < from_s_ ? Vec2(0, 0) : effect_->current_around(point);
  }
  bool behind_shaft() const override { return effect_->behind_shaft(); }
  Contribution at(const OperatingPoint& point) const override {
    return point.t < from_s_ ? Contribution{} : effect_->at(point);
  }
  int regressor_count() const override { return effect_->tracing().regressor_count(); }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    if (point.t < from_s_)
      std::fill(columns.begin(), columns.end(), Contribution{});
    else
      effect_->tracing().regressors(point, columns);
  }
  void coefficients(std::span<double> values) const override {
    effect_->tracing().coefficients(values);
  }
  double materiality(const DriveFacts& facts) const override {
    return effect_->tracing().materiality(facts);
  }

  // The check for a loss applies to the effects that are present from the start.
  Traits traits() const override {
    Traits of_effect = effect_->tracing().traits();
    of_effect.loss = Loss::kNo;
    return of_effect;
  }
  const Portrait& portrait() const override { return effect_->portrait(); }

 private:
  std::shared_ptr<const Effect> effect_;
  double from_s_;
};

}  // namespace

std::shared_ptr<const Effect> delayed(std::shared_ptr<const Effect> effect, double from_s) {
  if (from_s <= 0) return effect;
  return std::make_shared<Delayed>(std::move(effect), from_s);
}

std::string why_not_delayed(const Effect& effect) {
  ShaftFacts shaft;
  SamplingFacts sampling;
  if (effect.describe_shaft(shaft)) return "a shaft is there from the start";
  if (effect.describe_sampling(sampling)) return "the sampling is the same throughout a run";
  if (effect.acts_on() & kOnFlux) return "the machine's flux is the same throughout a run";
  return "";
}

}  // namespace twinrate
