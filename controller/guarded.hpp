// A controller whose command is always finite.
//
// Safe mode with zero voltage, from the tick on and permanently, with an event, if
//   command_not_finite   the inner controller returns a number that is not finite
//   input_not_finite     measurement or estimate are not finite for kHoldTicks in a row; before
//                        that the inner controller decides (it repeats its last command)
// A number whose square overflows counts as not finite.
#pragma once
#include "controller/controller.hpp"

namespace twinrate {

class Guarded final : public Controller {
 public:
  static constexpr int kHoldTicks = 20;  // as many as the plant holds a voltage (plant.hold_ticks)

  explicit Guarded(std::unique_ptr<Controller> inner) : inner_(std::move(inner)) {}
  std::string_view kind() const override { return inner_->kind(); }
  Command step(const ControllerInput& in) override;
  void know(const Effects& model_effects) override { inner_->know(model_effects); }
  void follow_compensation(const Profile& compensation) override {
    inner_->follow_compensation(compensation);
  }
  ControllerEvent take_event() override;
  std::string learnt() const override { return inner_->learnt(); }

 private:
  Command safe(const ControllerInput& in) const;

  std::unique_ptr<Controller> inner_;
  bool tripped_ = false;
  int bad_inputs_ = 0;  // ticks in a row
  ControllerEvent event_;
};

}  // namespace twinrate
