// [logger] of a drive file: what a run does without its logger.
#pragma once
#include "model/fields.hpp"

namespace twinrate {

enum class OnLoss : int { kStop = 0, kGoOn = 1 };
inline constexpr const char* kOnLossNames[] = {"stop", "go_on"};

struct LoggerParameters {
  static constexpr const char* kTable = "logger";
  OnLoss on_loss = OnLoss::kStop;
  void fields(FieldVisitor& f) {
    f.choice("on_loss", on_loss, kOnLossNames,
             "realtime: the run stops or goes on if the logger ends, stops or its disk is full; in "
             "lock-step it always stops");
  }
};

}  // namespace twinrate
