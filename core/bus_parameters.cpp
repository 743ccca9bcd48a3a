#include "core/bus_parameters.hpp"

namespace twinrate {

void BusParameters::fields(FieldVisitor& f) {
  f.number("peer_timeout_s", peer_timeout_s, 0.05, 3600,
           "longest wait for another process; beyond it the process reports and stops");
  f.number("repeat_after_ms", repeat_after_ms, 0.1, 10000,
           "lock-step: time after which an unanswered message is sent again");
  f.integer("window_ticks", window_ticks, 16, 8192,
            "lock-step: number of ticks by which the plant can lead the log");
  f.number("drop_rate", drop_rate, 0, 0.5,
           "fraction of the datagrams that each receiver drops (for tests)");
  f.boolean("pin", pin,
            "pin plant, estimator and controller to one CPU, the other processes to the others");
  f.boolean("split_ports", split_ports, "use one UDP port per link instead of one for all");
  f.boolean("filter", filter,
            "filter channels without a subscription in the kernel, before they wake a process");
  f.boolean("authenticate", authenticate,
            "launch: refuse messages without a valid tag of the run's token");
  f.boolean(
      "shared_memory", shared_memory,
      "launch, lock-step: carry the messages of a tick through shared memory; the logger sends "
      "copies over LCM");
  f.number("log_rotate_MB", log_rotate_MB, 0.1, 1e6,
           "size of a log file at which the logger begins the next one");
}

}  // namespace twinrate
