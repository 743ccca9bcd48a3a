// How a trace tells of itself, and how it is ended from outside.
#pragma once
#include <functional>
#include <string>

namespace twinrate {

// Thrown out of a trace that is stopped.
struct TraceStopped {};

struct TraceHooks {
  std::function<void(const std::string&)> say;  // progress, one line each; may be empty
  std::function<bool()> stop;  // asked before every slow step: true ends the trace; may be empty

  bool stopped() const { return stop && stop(); }
  // Throws TraceStopped.
  void checkpoint() const {
    if (stopped()) throw TraceStopped{};
  }
  void tell(const std::string& line) const {
    if (say) say(line);
  }
};

}  // namespace twinrate
