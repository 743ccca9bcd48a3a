// [logger] of a drive file: the reaction of a run to the loss of its logger.
#pragma once
#include "model/fields.hpp"

namespace twinrate {

// kRestart: as kGoOn, and the log continues in its next part.
enum class OnLoss : int { kStop = 0, kGoOn = 1, kRestart = 2 };
inline constexpr const char* kOnLossNames[] = {"stop", "go_on", "restart"};

struct LoggerParameters {
  static constexpr const char* kTable = "logger";
  OnLoss on_loss = OnLoss::kStop;
  void fields(FieldVisitor& f) {
    f.choice(
        "on_loss", on_loss, kOnLossNames,
        "realtime: the run stops, goes on, or goes on and starts the logger again if it ends; one "
        "that hangs or whose disk is full is not started again; in lock-step the run stops");
  }
};

}  // namespace twinrate
