// Requests of the page to a drive. scope::Api checks the sender; an implementation sends the request.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace twinrate::scope {

struct SteeringReply {
  std::string role;  // the process that answered
  bool accepted = false;
  std::int64_t applied_k = -1;
  std::string text;  // reason of a refusal
};

class Steering {
 public:
  virtual ~Steering() = default;
  // Each function waits at most 1 s for the answers of the processes concerned; empty: no answer.
  using Replies = std::vector<SteeringReply>;
  // KEY=VALUE lines of core/steering.hpp, from the page that has the control.
  virtual Replies steer(const std::string& lines) = 0;
  // Takes the control of the drive: no other page or program can steer it until it is given back.
  // beat() keeps it. Without a beat it ends after steering.hold_s, and the drive stops on a ramp.
  virtual Replies take_control() = 0;
  virtual Replies give_control() = 0;
  virtual void beat() = 0;
  // stop() takes the speed reference to 0 on a ramp, start() back to its previous value.
  virtual Replies start() = 0;
  virtual Replies stop() = 0;
  virtual Replies emergency_stop() = 0;
  virtual Replies reset() = 0;
  virtual Replies add_proposed() = 0;                        // effects proposed by the monitor
  virtual Replies add_effects(const std::string& toml) = 0;  // [[effect]] tables
  virtual Replies remove_effects(const std::string& toml) = 0;
};

}  // namespace twinrate::scope
