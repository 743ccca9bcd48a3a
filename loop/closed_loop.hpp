// The closed loop in one process without a bus: the functions of the lock-step process set, in the
// same order. One tick:
//
//   MEASUREMENT(k), TRUTH(k)
//   -> ESTIMATE(k)
//   -> GAIN(k)                    if k is a snapshot
//   -> REFERENCE(k), COMMAND(k)
#pragma once
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/controller.hpp"
#include "core/config.hpp"
#include "loop/estimator_loop.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {

struct PlantEvent {
  Reason reason = Reason::kNone;
  std::string text;
};

// The messages of one tick. `gain` is new only if has_gain.
struct TickRecord {
  Measurement measurement;
  Truth truth;
  Estimate estimate;
  Gain gain;
  bool has_gain = false;
  Reference reference;
  Command command;
  ControllerEvent event;
  std::vector<PlantEvent> plant_events;  // of tick measurement.k
  bool gain_every_nth = false;           // first tick after the filter's agreement with itself
};

class ClosedLoop {
 public:
  // `table`: of the filter, if the caller has it. Throws BadInput if the config names an unknown
  // filter or controller.
  explicit ClosedLoop(Config& config, const MakeFilter& make = make_filter,
                      const GainTable& table = nullptr);
  // Runs tick k. The returned reference is valid until the next step.
  const TickRecord& step();
  std::int64_t k() const { return plant_.k(); }
  // Before the first step: as Plant::begin_at.
  void begin_at(std::int64_t k, double theta_m) { plant_.begin_at(k, theta_m); }
  // Estimator, gain and controller compensate the effects of `extended` from the next step on; the
  // plant does not change.
  void know(Config& extended);
  // The drive leaves SAFE at the next step, and estimator and controller restart, as the processes
  // do. Returns "" or the reason why it cannot. The config of the constructor must still exist.
  std::string reset();
  const Controller& controller() const { return *controller_; }
  const Plant& plant() const { return plant_; }

 private:
  struct Planned {
    std::int64_t k;
    Config extended;
  };

  void restart();  // estimator and controller, as after a reset

  Config* config_;
  std::deque<Planned> planned_;      // later changes of the model by the drive file
  std::deque<std::int64_t> resets_;  // resets by the drive file
  const DriveConfig drive_;
  std::optional<Effects> known_;
  Plant plant_;
  EstimatorLoop estimator_;
  std::unique_ptr<Controller> controller_;
  TickRecord tick_;
};

}  // namespace twinrate
