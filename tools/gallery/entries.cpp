#include "tools/gallery/entries.hpp"

#include <algorithm>

#include "model/effects/effect.hpp"

namespace twinrate::gallery {
namespace {

// The encoder's own steps, no [[effect]].
constexpr Portrait kEncoderSteps{
    .parameters = "",
    .signal = Portrait::kTo,
    .over = Portrait::kOverTime,
    .equation =
        "theta_meas = floor(theta_m/step) step, step = 2 pi/encoder_counts; omega_m = "
        "difference/T_s",
    .shows =
        "Steps of step/T_s in the measured speed (15 rad/s here, at a true 6.3). The estimated "
        "load torque follows them by +-0.7 Nm from tick to tick, and hardly any of it is in orders "
        "1 to 60: at one turn per second the counts pass at 4096 Hz. A simple ratio of counts and "
        "ticks gives a slow beat.",
    .taken_for = "noise of the speed; `encoder_eccentricity` if the beat is slow."};

}  // namespace

std::vector<Entry> entries() {
  std::vector<Entry> all{{.name = "encoder_quantisation",
                          .meaning = "a sensor's own steps, no [[effect]]",
                          .portrait = kEncoderSteps,
                          .setting = "sensors.encoder_counts=4096"}};
  for (const std::string& kind : effect_kinds()) {
    const std::shared_ptr<Effect> effect = make_effect(kind);
    all.push_back(
        {.name = kind, .meaning = std::string(effect->meaning()), .portrait = effect->portrait()});
  }
  std::sort(all.begin(), all.end(), [](const Entry& a, const Entry& b) { return a.name < b.name; });
  return all;
}

}  // namespace twinrate::gallery
