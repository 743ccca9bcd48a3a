// The rotor's mechanical angle for a controller.
//
//   theta_m = that of the position sensor   if the filter uses it, or angle_source = "measured"
//   theta_m = the true one                  angle_source = "truth"
//   theta_m = theta_e/n_p, counted on       else: the estimate starts in pole pair 0, so effects
//                                           whose order is no multiple of n_p fit one start in n_p
#pragma once
#include "controller/controller.hpp"

namespace twinrate {

class MechanicalAngle {
 public:
  MechanicalAngle(AngleSource source, int n_p) : source_(source), n_p_(n_p) {}
  // One tick; `theta_e` is the angle that the controller works with.
  double step(const ControllerInput& in, double theta_e) {
    if (source_ == AngleSource::kTruth) return in.truth->theta_m;
    if (source_ == AngleSource::kMeasured || in.estimate.status & kMeasuredAngle)
      return in.measurement.theta_m;
    theta_m_ += wrap_pi(theta_e - n_p_ * theta_m_) / n_p_;
    return theta_m_;
  }

 private:
  AngleSource source_;
  int n_p_;
  double theta_m_ = 0;
};

// The estimated load is fed forward; "paper" is its name in Niewiara 2020.
inline bool feeds_load(Compensation c) {
  return c == Compensation::kPaper || c == Compensation::kLoad;
}

}  // namespace twinrate
