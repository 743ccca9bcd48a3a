// A controller whose estimate is watched (controller/synchronism.hpp), and its reaction to a loss
// of synchronism, which lasts until a reset:
//
//   off    safe mode, zero voltage
//   stop   a current vector i_start turns on from the estimated angle, with the last estimated
//          frequency (at most that of the hand-over), which falls to zero with the acceleration of
//          the I/f ramp; the vector is then constant for t_align_s, and safe mode follows. The rotor
//          follows the vector once it is slow enough, or stays where it stalled.
//
// Watched in mode run with the angle of the estimate; another mode restarts it. Without
// synchronism.watch a controller is not wrapped.
#pragma once
#include "controller/controller.hpp"
#include "controller/startup.hpp"
#include "controller/synchronism.hpp"

namespace twinrate {

struct WatchParameters {
  SynchronismParameters synchronism;
  StartupParameters startup;
  double i_max = 0;
};

class Watched final : public Controller {
 public:
  Watched(std::unique_ptr<Controller> inner, const DriveConfig& config, const WatchParameters& p);
  std::string_view kind() const override { return inner_->kind(); }
  Command step(const ControllerInput& in) override;
  void know(const Effects& model_effects) override { inner_->know(model_effects); }
  void follow_compensation(const Profile& compensation) override {
    inner_->follow_compensation(compensation);
  }
  ControllerEvent take_event() override;
  std::string learnt() const override { return inner_->learnt(); }

 private:
  bool lost(const ControllerInput& in);
  void begin_stop(const Estimate& e);
  // One tick of the stop, or of safe mode after it.
  Command stopping(const ControllerInput& in);

  std::unique_ptr<Controller> inner_;
  const MachineParameters machine_;
  const WatchParameters p_;
  const double T_s_, advance_s_;
  Synchronism synchronism_;
  ForcedCurrent forced_;
  ControllerEvent event_;
  bool lost_ = false;
  Mode mode_ = Mode::kSafe;  // once it is lost
  double theta_e_ = 0, omega_e_ = 0, t_standing_ = 0;
};

}  // namespace twinrate
