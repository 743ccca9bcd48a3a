// What the page may ask of a drive. scope::Api checks who asks; an implementation sends it.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace twinrate::scope {

struct SteeringReply {
  std::string role;  // the process that answered
  bool accepted = false;
  std::int64_t applied_k = -1;
  std::string text;  // why not
};

class Steering {
 public:
  virtual ~Steering() = default;
  // Each waits for the answers of the processes concerned, a second at most; empty: nobody answered.
  using Replies = std::vector<SteeringReply>;
  // KEY=VALUE lines of core/steering.hpp, by who has the control.
  virtual Replies steer(const std::string& lines) = 0;
  // Of the drive, not of the page: nobody else steers until it is given back. beat() keeps it; whoever
  // does not beat loses it after steering.hold_s, and the drive stops on a ramp.
  virtual Replies take_control() = 0;
  virtual Replies give_control() = 0;
  virtual void beat() = 0;
  // The speed reference goes to 0 on a ramp, and back to what it was.
  virtual Replies start() = 0;
  virtual Replies stop() = 0;
  virtual Replies emergency_stop() = 0;
  virtual Replies reset() = 0;
  virtual Replies add_proposed() = 0;                        // what the monitor proposed
  virtual Replies add_effects(const std::string& toml) = 0;  // [[effect]] tables
  virtual Replies remove_effects(const std::string& toml) = 0;
};

}  // namespace twinrate::scope
