// The MEASUREMENTs of a recorded run, one after the other in tick order: a log of any length in
// little memory. Other messages of the log are skipped.
#pragma once
#include <cstdint>
#include <deque>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <string>
#include <vector>

#include "model/signals.hpp"

namespace twinrate {

class MeasurementReader {
 public:
  // `path`: a run directory or a log file, of the drive the manifest was written for. Throws
  // BadInput: no such log, not an LCM log, messages of another type version.
  explicit MeasurementReader(const std::string& path);

  // False at the end. Throws BadInput at a message of another type version, and at the end of a log
  // that holds no message of this project.
  bool next(Measurement& m);
  // The one that comes next; null at the end.
  const Measurement* peek();
  // Of the manifest, empty where the log holds none. Known from the first measurement on.
  const std::string& config_toml() const { return config_toml_; }
  // True where the log was imported: its drive file's load was not applied.
  bool imported() const { return imported_; }
  double share_read() const;

  // The position of the next measurement, and the way back to it.
  struct Place {
    std::size_t part = 0;
    std::int64_t byte = 0;
  };
  Place place();
  void go_to(const Place& place);

 private:
  struct Entry {
    Measurement m;
    Place place;
  };
  void open(std::size_t part, std::int64_t byte);
  void fill();  // a few measurements ahead: they may come out of order
  void take(const lcm::LogEvent& event, const Place& place);

  std::string path_, suffix_, channel_, manifest_channel_;
  std::vector<std::string> parts_;
  std::vector<std::int64_t> bytes_before_;  // of each part; the last entry is their sum
  std::unique_ptr<lcm::LogFile> file_;
  std::size_t part_ = 0;
  std::deque<Entry> ahead_;
  bool found_message_ = false, imported_ = false;
  std::string config_toml_;
};

}  // namespace twinrate
