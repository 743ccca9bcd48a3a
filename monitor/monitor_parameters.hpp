// [monitor] of a drive file: when a misfit is noticed and traced (monitor/live_monitor.hpp).
#pragma once
#include "model/fields.hpp"

namespace twinrate {

struct MonitorParameters {
  static constexpr const char* kTable = "monitor";
  bool enabled = false, auto_add = false;
  double learn_s = 2, block_s = 0.25, gather_s = 3, window_s = 10;

  void fields(FieldVisitor& f) {
    f.boolean("enabled", enabled, "start twinrate-monitor with the set");
    f.boolean("auto_add", auto_add,
              "add the traced effects to the running estimator and controller");
    f.number("learn_s", learn_s, 0.5, 1000,
             "time from run.settle_s on in which the monitor learns the level of the residuals");
    f.number("block_s", block_s, 0.05, 100, "length of one block");
    f.number("gather_s", gather_s, 0.5, 1000,
             "length of the data after a misfit before the first trace; their last third judges");
    f.number("window_s", window_s, 0.5, 1000,
             "length of the rolling window, the longest stretch for a trace");
  }
};

}  // namespace twinrate
