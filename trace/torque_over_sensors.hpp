// Ratio of the torque residual to the noise of the sensors.
#pragma once
#include <string>

#include "trace/chain.hpp"

namespace twinrate {

// Rms of the torque residual over that of `noise` and of the torque's uncertainty between rows, all
// after the filter that whitens `noise`. The noise of an angle makes a torque that grows with the
// square of the frequency; without the filter it would hide a slow torque. 0 if the residual or the
// noise is absent. The drawn noise of the readings is white, apart from the rounding of counts: an angle that the
// drive filters has a larger ratio, too.
// `of_impacts`: change of the torque of a shaft with a gap by noise of the readings, which moves its
// impacts (Chain::impacts_noise); empty without such a shaft.
double torque_over_sensors(const Chain& chain, const Sampled& left, const Eigen::VectorXd& noise,
                           const Eigen::VectorXd& of_impacts = {});
// The ratio as a message, with the plain rms of the residual in Nm.
std::string torque_in_words(double rms, double over);

}  // namespace twinrate
