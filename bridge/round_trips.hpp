// Moment at which a polled drive has read the values of its answer: the middle of the round trip.
//
// The moment is within half of the round trip of that middle. If question and answer take their
// least times in each round trip, the middle is off by a constant. The excess of a round trip over
// the shortest recent one can add to the error.
//
// An answer does not identify its question. A question after an unanswered one makes the next
// answers doubtful, until the line has been quiet for kLost_ns.
#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>

namespace twinrate {

class RoundTrips {
 public:
  static constexpr std::int64_t kLost_ns = 50'000'000;  // an answer as late will not come

  // Whether the next question may leave.
  bool may_ask(std::int64_t now_ns) const {
    if (!waiting_) return true;
    const std::int64_t since = doubtful_ ? std::max(asked_ns_, answered_ns_) : asked_ns_;
    return now_ns - since >= kLost_ns;
  }
  void asked(std::int64_t now_ns) {
    const bool quiet = doubtful_ && answered_ns_ > asked_ns_ && may_ask(now_ns);
    doubtful_ = waiting_ && !quiet;
    waiting_ = true;
    asked_ns_ = now_ns;
  }

  // Half of the shortest round trip of late: the drive reads so long after the question leaves.
  std::int64_t half_ns() const {
    return static_cast<std::int64_t>(std::max(0.0, 0.5 * shortest_ns_));
  }

  struct Moment {
    std::int64_t read_ns;  // of the host
    double within_ns;      // half of the excess over the shortest recent round trip
    double usual_ns;       // the recent median of it: a few stalls of the host do not change it
  };
  // Empty: to which question is not known.
  std::optional<Moment> answered(std::int64_t now_ns) {
    answered_ns_ = now_ns;
    if (!waiting_ || doubtful_) return {};
    waiting_ = false;
    constexpr double kForget = 1.0 / 1024;  // of the shortest, a round trip
    const auto round_ns = static_cast<double>(now_ns - asked_ns_);
    shortest_ns_ = shortest_ns_ < 0 ? round_ns : std::min(round_ns, shortest_ns_ * (1 + kForget));
    constexpr double kFollow = 1.0 / 64, kLeast_ns = 1000;
    const double within_ns = 0.5 * (round_ns - shortest_ns_);
    const double step_ns = kFollow * (usual_ns_ + kLeast_ns);
    usual_ns_ = std::max(0.0, usual_ns_ + (within_ns > usual_ns_ ? step_ns : -step_ns));
    return Moment{asked_ns_ + (now_ns - asked_ns_) / 2, within_ns, usual_ns_};
  }

 private:
  bool waiting_ = false, doubtful_ = false;
  std::int64_t asked_ns_ = 0, answered_ns_ = -1;
  double shortest_ns_ = -1, usual_ns_ = 0;
};

}  // namespace twinrate
