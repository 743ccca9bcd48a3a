// Every channel once: its name, its message type, and its senders. ARCHITECTURE.md's table is
// checked against this one.
#pragma once
#include <array>
#include <iterator>
#include <string_view>
#include <twinrate/ack_t.hpp>
#include <twinrate/command_t.hpp>
#include <twinrate/estimate_t.hpp>
#include <twinrate/event_t.hpp>
#include <twinrate/gain_t.hpp>
#include <twinrate/manifest_t.hpp>
#include <twinrate/measurement_t.hpp>
#include <twinrate/reference_t.hpp>
#include <twinrate/reply_t.hpp>
#include <twinrate/request_t.hpp>
#include <twinrate/status_t.hpp>
#include <twinrate/truth_t.hpp>

namespace twinrate {

// Version of the messages. 4: an estimate may ask for a gain every tick (kGainEveryTick). 5: every
// message ends with a tag, those of a tick have the time on the host. Logs from the oldest one on are
// read (core/decode.hpp), another one is refused.
inline constexpr int kWireSchema = 5;
inline constexpr int kOldestWireSchema = 2;

enum class Channel : int {
  kMeasurement,
  kTruth,
  kEstimate,
  kGain,
  kReference,
  kCommand,
  kStatus,
  kEvent,
  kManifest,
  kRequest,
  kReply,
  kAck,
};
inline constexpr int kChannelCount = 12;

struct ChannelInfo {
  Channel channel;
  const char* name;
  const char* type;
  const char* from;
  const char* to;
};

// In the order of the messages of one tick of the loop; the log of a lock-step run has this order,
// too.
inline constexpr std::array<ChannelInfo, kChannelCount> kChannels = {{
    {Channel::kMeasurement, "DRIVE_MEASUREMENT", "measurement_t", "plant",
     "estimator, controller, logger"},
    {Channel::kTruth, "DRIVE_TRUTH", "truth_t", "simulated plant", "logger"},
    {Channel::kEstimate, "DRIVE_ESTIMATE", "estimate_t", "estimator", "controller, gain, logger"},
    {Channel::kGain, "DRIVE_GAIN", "gain_t", "gain", "estimator, logger"},
    {Channel::kReference, "DRIVE_REFERENCE", "reference_t", "controller or any generator",
     "controller, logger"},
    {Channel::kCommand, "DRIVE_COMMAND", "command_t", "controller", "plant, logger"},
    {Channel::kStatus, "DRIVE_STATUS", "status_t", "every process", "supervisor, logger, watch"},
    {Channel::kEvent, "DRIVE_EVENT", "event_t", "every process", "supervisor, logger, watch"},
    {Channel::kManifest, "DRIVE_MANIFEST", "manifest_t", "logger", "watch, readers of the log"},
    {Channel::kRequest, "DRIVE_REQUEST", "request_t", "supervisor, user", "every process"},
    {Channel::kReply, "DRIVE_REPLY", "reply_t", "every process", "supervisor, user, logger"},
    {Channel::kAck, "DRIVE_ACK", "ack_t", "logger", "every publisher"},
}};

constexpr const ChannelInfo& info(Channel channel) {
  return kChannels[static_cast<std::size_t>(channel)];
}

// The channel of a message type.
template <class Message>
inline constexpr Channel kChannelOf = Channel::kAck;
template <>
inline constexpr Channel kChannelOf<measurement_t> = Channel::kMeasurement;
template <>
inline constexpr Channel kChannelOf<truth_t> = Channel::kTruth;
template <>
inline constexpr Channel kChannelOf<estimate_t> = Channel::kEstimate;
template <>
inline constexpr Channel kChannelOf<gain_t> = Channel::kGain;
template <>
inline constexpr Channel kChannelOf<reference_t> = Channel::kReference;
template <>
inline constexpr Channel kChannelOf<command_t> = Channel::kCommand;
template <>
inline constexpr Channel kChannelOf<status_t> = Channel::kStatus;
template <>
inline constexpr Channel kChannelOf<event_t> = Channel::kEvent;
template <>
inline constexpr Channel kChannelOf<manifest_t> = Channel::kManifest;
template <>
inline constexpr Channel kChannelOf<request_t> = Channel::kRequest;
template <>
inline constexpr Channel kChannelOf<reply_t> = Channel::kReply;

enum class Role : int {
  kSupervisor,
  kPlant,
  kEstimator,
  kGain,
  kController,
  kLogger,
  kReplay,
  kImport,
  kMonitor,
  kBridge,
  kReference,
};
inline constexpr const char* kRoleNames[] = {"supervisor", "plant",  "estimator", "gain",
                                             "controller", "logger", "replay",    "import",
                                             "monitor",    "bridge", "reference"};

// Roles are received values: a role unknown to this program has no name.
constexpr const char* role_name(int role) {
  return role >= 0 && role < static_cast<int>(std::size(kRoleNames)) ? kRoleNames[role]
                                                                     : "unknown role";
}

enum class ProcessState : int { kStarting, kReady, kRunning, kDone, kFailed };
inline constexpr const char* kProcessStateNames[] = {"starting", "ready", "running", "done",
                                                     "failed"};

enum class RequestKind : int {
  kStart = 1,
  kStop = 2,
  kEmergencyStop = 3,
  kAddEffect = 4,     // text: [[effect]] tables; value: tick from which on, or the next one
  kAddProposed = 5,   // to the monitor: add the effects that it proposed
  kReset = 6,         // leave SAFE; value: tick from which on, or the next one
  kRemoveEffect = 7,  // text: [[effect]] tables as they were added; value: as for kAddEffect
  kSteer = 8,         // to the plant: text: KEY=VALUE lines (core/steering.hpp); value: tick, or 0
  kTakeControl = 9,   // to the plant: text: who steers from now on; value 1: the heartbeat
  kGiveControl = 10,  // to the plant: text: who steers no more
  // From the plant to the others (core/arbiter.hpp), with the number of the request that it is about.
  kPrepare = 11,  // text: of the request; value: its kind
  kApplyAt = 12,  // value: tick from which on it holds
  kDrop = 13,     // somebody refused
  kClock = 14,    // to every process: the reply has the time and the name of its host
};

}  // namespace twinrate
