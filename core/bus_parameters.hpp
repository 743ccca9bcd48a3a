// [bus] of a drive file: how the processes of a drive talk, and how long they wait for each other.
#pragma once
#include "model/fields.hpp"

namespace twinrate {

struct BusParameters {
  static constexpr const char* kTable = "bus";
  double peer_timeout_s = 10, repeat_after_ms = 10;
  int window_ticks = 512;
  double drop_rate = 0;
  bool pin = true;
  bool split_ports = false;
  bool filter = true;
  bool authenticate = true;
  bool shared_memory = false;
  double log_rotate_MB = 2000;
  void fields(FieldVisitor& f);
};

}  // namespace twinrate
