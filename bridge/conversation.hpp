// A protocol on a link: greets the drive, receives its samples, sends to it, and ends the session.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "bridge/host_protocol.hpp"
#include "bridge/link.hpp"

namespace twinrate {

class Conversation {
 public:
  // Opens the link. Throws as open_link() and make_protocol().
  Conversation(const BridgeParameters& bridge, const DriveConfig& drive);
  // Outputs off, if the host may have switched them on.
  ~Conversation();

  // Repeats the question until the drive answers. Throws MachineError after `patience_s`, BadInput
  // if the sampling rate of the drive differs from the drive file's.
  const DriveInfo& greet(bool lockstep, double patience_s);
  // From the question who the drive is to its answer, us; empty: none within `patience_ms`.
  std::optional<double> round_trip_us(double patience_ms);
  // Waits at most this long for bytes; true if some arrived.
  bool pump(double timeout_ms);
  std::optional<DriveSample> next() { return protocol_->next(); }
  void command(const DriveCommand& command);
  void off() { link_->send(protocol_->off()); }
  // The last bytes once more.
  void repeat() { link_->send(last_); }

  HostProtocol& protocol() { return *protocol_; }
  const HostProtocol& protocol() const { return *protocol_; }
  Link& link() { return *link_; }
  double silent_ms() const { return 1e-6 * static_cast<double>(now_ns() - last_heard_ns_); }
  // One line: frames, their errors, the device's clock.
  std::string account() const;
  // The same as JSON text.
  std::string to_json() const;

 private:
  void ask(const Bytes& question);
  std::string clock_text() const;

  BridgeParameters bridge_;
  double f_s_Hz_;
  std::unique_ptr<HostProtocol> protocol_;
  std::unique_ptr<Link> link_;
  Bytes last_;
  bool drove_ = false;
  std::int64_t last_heard_ns_, last_poll_ns_ = 0;
};

}  // namespace twinrate
