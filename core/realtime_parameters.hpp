// [realtime] of a drive file: the requirements of `launch --pace realtime` on the machine.
#pragma once
#include "model/fields.hpp"

namespace twinrate {

struct RealtimeParameters {
  static constexpr const char* kTable = "realtime";
  int priority = 20;
  bool lock_memory = true;
  double spin_us = 0;
  void fields(FieldVisitor& f) {
    f.integer("priority", priority, 0, 98,
              "realtime: SCHED_FIFO priority of plant, estimator and controller; gain, logger and "
              "supervisor have one less; 0: the normal scheduler");
    f.boolean("lock_memory", lock_memory,
              "realtime: touch heap and stack of the processes at their start and lock them in "
              "memory");
    f.number("spin_us", spin_us, 0, 1000,
             "realtime: time for which estimator and controller look for a message before they "
             "sleep; it takes this time of their CPU");
  }
};

}  // namespace twinrate
