// A recorded run in memory: the messages of log.lcm (and its rotated parts log-001.lcm ..), decoded
// and in tick order.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/event_log.hpp"
#include "model/signals.hpp"

namespace twinrate {

struct EventRecord {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  int role = 0;
  int reason = 0;
  std::string text;
  int waited_for = -1;  // Role of the process that did not answer
};

// A gain with its matrices at their own size: in a Gain there is room for the largest filter, 6 kB.
class GainRecord {
 public:
  GainRecord(const Gain& g)
      : k(g.k),
        first_use(g.first_use),
        n_x_(static_cast<std::int16_t>(g.n_x)),
        n_y_(static_cast<std::int16_t>(g.n_y)) {
    values_.reserve(static_cast<std::size_t>(g.n_x * (g.n_y + 1)));
    for (int row = 0; row < g.n_x; ++row)
      for (int col = 0; col < g.n_y; ++col) values_.push_back(g.K(row, col));
    for (int i = 0; i < g.n_x; ++i) values_.push_back(g.P(i, i));
  }
  std::int64_t k, first_use;
  // 0 beyond the filter's size.
  double K(int row, int col) const {
    return row < n_x_ && col < n_y_ ? values_[static_cast<std::size_t>(row * n_y_ + col)] : 0;
  }
  double P_diagonal(int i) const {
    return i < n_x_ ? values_[static_cast<std::size_t>(n_x_ * n_y_ + i)] : 0;
  }

 private:
  std::int16_t n_x_, n_y_;
  std::vector<double> values_;  // K by rows, then the diagonal of P
};

struct RunLog {
  std::string path, channel_suffix;
  std::int64_t session = 0;
  std::string revision, config_toml, manifest_json;  // empty if the log has no manifest
  std::vector<Measurement> measurement;
  std::vector<Truth> truth;
  std::vector<Estimate> estimate;
  std::vector<GainRecord> gain;
  std::vector<Reference> reference;
  std::vector<Command> command;
  std::vector<EventRecord> events;
  std::array<std::int64_t, kChannelCount> counts{};  // messages of each channel
  bool counted = false;  // manifest.json beside the log has the counts of the whole log
  std::string damage;    // the skipped damage; empty if the log is whole

  void set(const manifest_t& manifest);
};

EventRecord from_wire(const event_t& w);

// The manifest in an event of the log `path`; empty if it is none. Throws BadInput if the log was
// written with another version of the message types.
std::optional<manifest_t> decode_manifest(const void* bytes, int count, const std::string& path);

// `path`: a run directory or a log file. `channel_suffix`: of a drive that was given one; empty:
// the one the manifest was written with. Throws BadInput: no such log, no message of this project,
// damage (core/event_log.hpp).
RunLog read_run_log(const std::string& path, const std::string& channel_suffix = "",
                    OnDamage on_damage = OnDamage::kRefuse);

}  // namespace twinrate
