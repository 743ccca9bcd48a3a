// The interface of every controller: one pure step per tick.
//
//   ESTIMATE(k), MEASUREMENT(k), REFERENCE(k) -> COMMAND(k)
//
// The plant applies COMMAND(k) one computation delay later.
#pragma once
#include <memory>
#include <string_view>
#include <vector>

#include "core/drive_config.hpp"
#include "core/reason.hpp"
#include "model/signals.hpp"

namespace twinrate {

struct ControllerInput {
  const Measurement& measurement;
  const Estimate& estimate;
  const Reference& reference;
  const Truth* truth = nullptr;  // only with controller.angle_source = "truth"
};

// An event for the user, reported once (mode changes).
struct ControllerEvent {
  Reason reason = Reason::kNone;
  const char* text = "";
};

class Controller {
 public:
  virtual ~Controller() = default;
  virtual std::string_view kind() const = 0;
  virtual Command step(const ControllerInput& in) = 0;
  // Other known effects (used_in = "model" or "both"), from the next step on; the state is kept.
  virtual void know(const Effects& /*model_effects*/) {}
  // Another profile of controller.compensation, from the next step on.
  virtual void follow_compensation(const Profile& /*compensation*/) {}
  // The mode change of the last step, if there was one.
  virtual ControllerEvent take_event() { return {}; }
  // Parameters learnt while running, as TOML tables for a drive file; "" if there are none.
  virtual std::string learnt() const { return ""; }
};

// The keys of one kind of controller, and how to make it from them.
class ControllerBuilder {
 public:
  virtual ~ControllerBuilder() = default;
  virtual void fields(FieldVisitor& f) = 0;
  // Defaults for the machine of the drive file, before fields() reads.
  virtual void scale(const DriveConfig& /*config*/) {}
  virtual std::unique_ptr<Controller> build(const DriveConfig& config) const = 0;
};

// Null if there is no such kind.
std::unique_ptr<ControllerBuilder> controller_builder(std::string_view kind);
// With the defaults of this drive.
std::unique_ptr<ControllerBuilder> controller_builder(std::string_view kind,
                                                      const DriveConfig& drive);
std::vector<std::string> controller_kinds();

}  // namespace twinrate
