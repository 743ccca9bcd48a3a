// How a trace tells of itself, and how it is ended from outside.
#pragma once
#include <chrono>
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

// How long each step took, one line each.
class Laps {
 public:
  explicit Laps(std::function<void(const std::string&)> say) : say_(std::move(say)) {}
  void operator()(const std::string& step) {
    if (say_) say_(step + ": " + std::to_string(milliseconds()) + " ms");
    last_ = std::chrono::steady_clock::now();
  }

 private:
  long long milliseconds() const {
    return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now() -
                                                                 last_)
        .count();
  }
  std::function<void(const std::string&)> say_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace twinrate
