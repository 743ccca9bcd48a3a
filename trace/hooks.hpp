// Progress messages of a trace, and its end on request.
#pragma once
#include <chrono>
#include <functional>
#include <string>

namespace twinrate {

// Thrown when a trace is stopped.
struct TraceStopped {};

struct TraceHooks {
  std::function<void(const std::string&)> say;  // progress, one line each; may be empty
  std::function<bool()> stop;  // called before every slow step: true ends it; may be empty

  bool stopped() const { return stop && stop(); }
  // Throws TraceStopped.
  void checkpoint() const {
    if (stopped()) throw TraceStopped{};
  }
  void tell(const std::string& line) const {
    if (say) say(line);
  }
};

// Reports the duration of each step, one line each.
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
