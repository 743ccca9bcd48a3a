#include "emulator/fault_options.hpp"

#include <fmt/format.h>

#include <charconv>

#include "core/config.hpp"

namespace twinrate {
namespace {

struct FaultKind {
  const char *name, *value;
  double lo, hi;
  void (*set)(FaultOptions&, double);
};

template <double LineFaults::*Member>
void on_both(FaultOptions& o, double value) {
  o.up.*Member = o.down.*Member = value;
}

constexpr FaultKind kKinds[] = {
    {"bit_errors", "share of the bits", 0, 0.1, on_both<&LineFaults::bit_errors>},
    {"lost", "share of the frames", 0, 1, on_both<&LineFaults::lost>},
    {"doubled", "share of the frames", 0, 1, on_both<&LineFaults::doubled>},
    {"reordered", "share of the frames", 0, 1, on_both<&LineFaults::reordered>},
    {"latency_ms", "of each direction", 0, 1000,
     [](FaultOptions& o, double v) { on_both<&LineFaults::latency_s>(o, 1e-3 * v); }},
    {"jitter_ms", "of each direction", 0, 1000,
     [](FaultOptions& o, double v) { on_both<&LineFaults::jitter_s>(o, 1e-3 * v); }},
    {"drift_ppm", "of the device's clock", -1000, 1000,
     [](FaultOptions& o, double v) { o.drift_ppm = v; }},
    {"reset_at_s", "device time of a restart", 0, 1e5,
     [](FaultOptions& o, double v) { o.device.reset_at_s = v; }},
    {"pulled_at_s", "time from which the cable is pulled", 0, 1e5,
     on_both<&LineFaults::pulled_at_s>},
    {"pulled_for_s", "duration of the pull", 0, 1e5, on_both<&LineFaults::pulled_for_s>},
    {"from_s", "time from which shares act", 0, 1e5, on_both<&LineFaults::from_s>},
    {"keeps_last", "1: neither lease nor off", 0, 1,
     [](FaultOptions& o, double v) { o.device.keeps_last = v != 0; }}};

std::string all_kinds() {
  std::string text;
  for (const FaultKind& kind : kKinds)
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", kind.name, kind.value);
  return text;
}

}  // namespace

FaultOptions parse_faults(const std::vector<std::string>& faults) {
  FaultOptions options;
  for (const std::string& fault : faults) {
    const auto equals = fault.find('=');
    const std::string name = fault.substr(0, equals);
    const FaultKind* found = nullptr;
    for (const FaultKind& kind : kKinds)
      if (kind.name == name) found = &kind;
    if (!found) throw BadInput(fmt::format("--fault {}: one of {} allowed", fault, all_kinds()));
    double value = 0;
    const char* end = fault.data() + fault.size();
    const char* from = equals == std::string::npos ? end : fault.data() + equals + 1;
    const auto [stop, error] = std::from_chars(from, end, value);
    if (error != std::errc() || stop != end || !(value >= found->lo && value <= found->hi))
      throw BadInput(fmt::format("--fault {}: {}, {:g} to {:g} allowed", fault, found->value,
                                 found->lo, found->hi));
    found->set(options, value);
  }
  return options;
}

std::string fault_help() {
  return "make a fault, KIND=VALUE; repeat for more: " + all_kinds();
}

}  // namespace twinrate
