// The whole loop in one process, without a bus: the same functions in the same order as the process
// set in lock-step. One tick:
//
//   MEASUREMENT(k), TRUTH(k)
//   -> ESTIMATE(k)
//   -> GAIN(k)                    where k is a snapshot
//   -> REFERENCE(k), COMMAND(k)
#pragma once
#include <memory>

#include "controller/controller.hpp"
#include "core/config.hpp"
#include "loop/estimator_loop.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {

// Everything one tick said. `gain` is new only where has_gain.
struct TickRecord {
  Measurement measurement;
  Truth truth;
  Estimate estimate;
  Gain gain;
  bool has_gain = false;
  Reference reference;
  Command command;
  ControllerEvent event;
};

class ClosedLoop {
 public:
  // Throws BadInput where the config names an unknown filter or controller.
  explicit ClosedLoop(Config& config);
  // Runs tick k; the reference stays valid until the next step.
  const TickRecord& step();
  std::int64_t k() const { return plant_.k(); }
  // Estimator, gain and controller know the effects of `extended` from the next step on; the plant
  // stays as it is.
  void know(Config& extended);
  const Controller& controller() const { return *controller_; }

 private:
  const DriveConfig drive_;
  Plant plant_;
  EstimatorLoop estimator_;
  std::unique_ptr<Controller> controller_;
  TickRecord tick_;
};

}  // namespace twinrate
