// Links to processes on other hosts: clock offset, round trip and losses, measured with requests of
// kind `clock` that the supervisor sends.
//
//   s0   the request leaves, clock of the supervisor's host
//   p    the process answers, clock of its host
//   s1   the reply arrives, clock of the supervisor's host
//
//   round trip = s1 - s0
//   offset     = p - (s0 + s1)/2        of the process's clock
//   |error|   <= (s1 - s0)/2
//
// The offset is that of the shortest round trip of the last kWindow: a clock that drifts by 50 ppm
// moves 0.3 ms in it. A request without an answer after kLost_s is lost, on its way there or back.
// Source: RFC 5905, section 8.
#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "run/hop_latency.hpp"

namespace twinrate {

struct LinkFigures {
  Role role = Role::kSupervisor;
  std::string host;  // as it calls itself; "" if it never answered
  std::int64_t offset_ns = 0, error_ns = 0;
  Percentiles round_trip_us;
  std::int64_t asked = 0, lost = 0;  // round trips
  std::int64_t missed = 0;           // messages that the process missed, by their sequence numbers
};

class Links {
 public:
  static constexpr std::size_t kWindow = 64, kRoundTripsKept = 4096;
  static constexpr double kPeriod_s = 0.1, kLost_s = 1;

  explicit Links(const std::set<Role>& roles);
  // A request to be sent at `now_ns`, if one is due.
  bool due(std::int64_t now_ns) const;
  request_t ask(std::int64_t now_ns);
  void take(const reply_t& reply, std::int64_t now_ns);
  // "estimator on HOST", or "estimator".
  std::string name_of(Role role) const;
  std::vector<LinkFigures> figures(std::int64_t now_ns) const;

 private:
  struct Trip {
    std::int64_t round_ns = 0, offset_ns = 0;
  };
  struct Link {
    std::string host;
    std::deque<std::int64_t> open;  // s0 of requests without an answer yet
    std::int64_t asked = 0, answered = 0;
    std::deque<Trip> window;
    std::vector<double> round_trips_us;  // the last kRoundTripsKept
  };
  std::map<Role, Link> links_;
  std::int64_t asked_ns_ = 0;
};

}  // namespace twinrate
