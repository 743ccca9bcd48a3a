// The MEASUREMENTs of a recorded run, one after the other in tick order: a log of any length in
// little memory. Other messages of the log are skipped.
#pragma once
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "core/event_log.hpp"
#include "core/steering.hpp"
#include "model/signals.hpp"

namespace twinrate {

class MeasurementReader {
 public:
  // `path`: a run directory or a log file, of the drive the manifest was written for. Throws
  // BadInput if there is no such log.
  explicit MeasurementReader(const std::string& path, OnDamage on_damage = OnDamage::kRefuse);

  // False at the end. Throws BadInput at damage (core/event_log.hpp), and at the end of a log that
  // holds no message of this project. With kSkip, a measurement of an earlier tick is left out.
  bool next(Measurement& m);
  // The next measurement; null at the end.
  const Measurement* peek();
  // From the manifest, empty if the log has none. Known from the first measurement on.
  const std::string& config_toml() const { return config_toml_; }
  // True if the log was imported: the load of its drive file was not applied.
  bool imported() const { return imported_; }
  double share_read() const { return log_.share_read(); }
  std::string damage() const { return log_.damage(); }

  // The requests that steered the run, in the order of the log: those of the ticks up to the next
  // measurement at least. go_to() does not read one twice.
  const std::vector<AppliedSteering>& steering() const { return steering_; }

  // The position of the next measurement, and the way back to it.
  using Place = EventLog::Place;
  Place place();
  void go_to(const Place& place);

 private:
  struct Entry {
    Measurement m;
    Place place;
  };
  void fill();  // a few measurements ahead: they may come out of order
  void take(const lcm::LogEvent& event);
  void take_steering(const lcm::LogEvent& event);

  std::string path_;
  OnDamage on_damage_;
  EventLog log_;
  std::deque<Entry> ahead_;
  std::int64_t last_k_ = -1;
  std::vector<AppliedSteering> steering_;
  Place steering_read_to_{0, -1};  // of its last event
  bool found_message_ = false, imported_ = false;
  std::string config_toml_;
};

}  // namespace twinrate
