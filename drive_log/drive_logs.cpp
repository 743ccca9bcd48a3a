#include "drive_log/drive_logs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/config.hpp"
#include "drive_log/log_reader.hpp"
#include "drive_log/measured_files.hpp"
#include "drive_log/same_readings.hpp"
#include "import/drive_rows.hpp"
#include "trace/blocks.hpp"
#include "trace/consistency.hpp"
#include "trace/health_scan.hpp"

namespace twinrate {
namespace {

// Memory of the tracer without its program, measured with /usr/bin/time -v, 2026-11. An output is a
// sample at kOutputs_Hz with the regressors of all candidates.
constexpr double kBytesOfRow = 900, kBytesOfOutput = 9000;
constexpr double kOutputs_Hz = 1000;
constexpr double kUsableShare = 0.47;  // of the allowed memory

constexpr std::size_t kSlotRows = 256;
constexpr std::size_t kBlocks = 24;  // equal to the number of hold-out blocks of the tracer
constexpr std::size_t kMinBlockSlots = 4;

// A file after the first pass.
struct Scanned {
  std::string path;
  bool held_out = false;
  std::unique_ptr<LogReader> reader;
  Health health;
  std::vector<Slot> slots;
  std::vector<LogReader::Place> places;  // of the slots
  std::vector<double> angles;            // of their first rows
  double lowest_angle = 1e300, highest_angle = -1e300;
  RawLog raw;        // all rows; empty if they exceed the memory
  bool kept = true;  // all rows are in `raw`
  double duration_s() const {
    return slots.empty() ? 0 : slots.back().t_end - slots.front().t_begin;
  }
};

Record record_of_rows(RawLog& raw, const Scanned& log, int n_p) {
  if (log.reader->may_wrap() && log.highest_angle - log.lowest_angle <= kOneTurnRange_rad)
    unwrap_turns(raw.theta_m);
  return record_of(raw, n_p, log.health);
}

// Reads the rows of slots [first, end) again.
Record slots_of(const Scanned& log, std::size_t first, std::size_t end, int n_p) {
  RawLog raw;
  log.reader->go_to(log.places[first]);
  log.reader->next(raw, (end - first) * kSlotRows);
  // go_to() restarted the reader's count of turns: adds the turns before this place.
  const double turned = log.angles[first] - raw.theta_m.front();
  for (double& theta_m : raw.theta_m) theta_m += turned;
  return record_of_rows(raw, log, n_p);
}

Record stretch_of(const Scanned& log, int n_p, double begin_s, double end_s) {
  const auto place = [&](double t) {
    const auto after =
        std::upper_bound(log.slots.begin(), log.slots.end(), t,
                         [](double at, const Slot& slot) { return at < slot.t_begin; });
    return static_cast<std::size_t>(after - log.slots.begin());
  };
  const std::size_t first = std::max<std::size_t>(1, place(begin_s)) - 1;
  return slots_of(log, first, std::max(first + 1, place(end_s)), n_p);
}

std::vector<ReadRows> read_rows(const DriveLogs& logs) {
  const Record& record = logs.record;
  std::vector<ReadRows> files;
  for (const DriveLog& log : logs.files) {
    ReadRows& file = files.emplace_back(ReadRows{log.path, log.held_out, {}});
    for (std::size_t k = log.first; k < log.end; ++k)
      file.rows.push_back(record.i_alphabeta.empty()
                              ? reading_hash({record.theta_m[k]})
                              : reading_hash({record.i_alphabeta[k][0], record.i_alphabeta[k][1]}));
  }
  return files;
}

class Reader {
 public:
  Reader(const LogRequest& asked, const DriveConfig& drive, const ReadProgress& progress)
      : asked_(asked), drive_(drive), progress_(progress) {}

  DriveLogs read() {
    for (const std::string& path : asked_.data) scan(path, false);
    for (const std::string& path : asked_.held_out) scan(path, true);
    share_out();
    for (std::size_t i = 0; i < logs_.size(); ++i) add(logs_[i], shares_[i]);
    if (!asked_.held_out.empty()) expect_other_readings(read_rows(result_));
    const auto logs = std::make_shared<std::vector<Scanned>>(std::move(logs_));
    result_.stretch = [logs, files = result_.files, n_p = drive_.machine.n_p](
                          std::size_t file, double begin, double end) {
      const double offset = files[file].time_offset_s;
      Record record = stretch_of((*logs)[file], n_p, begin - offset, end - offset);
      for (double& t : record.t) t += offset;
      return record;
    };
    return std::move(result_);
  }

 private:
  void scan(const std::string& path, bool held_out);
  void add_slot(const RawLog& piece, const LogReader::Place& place, Scanned& log);
  void check_signals(const RawLog& piece) const;
  void share_out();
  void add(Scanned& log, std::size_t max_rows);
  void note_sensors(const Record& log);
  Record blocks_of(Scanned& log, std::size_t max_rows);
  void report_progress(const std::string& what, double share) const {
    if (progress_) progress_(what, share);
  }

  const LogRequest& asked_;
  const DriveConfig& drive_;
  const ReadProgress& progress_;
  std::vector<Scanned> logs_;
  std::vector<std::size_t> shares_;  // allowed rows of each log
  std::size_t rows_kept_ = 0;
  DriveLogs result_;
};

void Reader::add_slot(const RawLog& piece, const LogReader::Place& place, Scanned& log) {
  log.slots.push_back(slot_of(piece, drive_.machine.n_p));
  log.places.push_back(place);
  log.angles.push_back(piece.theta_m.front());
  const auto [lowest, highest] = std::minmax_element(piece.theta_m.begin(), piece.theta_m.end());
  log.lowest_angle = std::min(log.lowest_angle, *lowest);
  log.highest_angle = std::max(log.highest_angle, *highest);
}

void Reader::scan(const std::string& path, bool held_out) {
  const std::optional<ImportMap> map = is_run_log(path) ? std::nullopt : map_for(path, asked_.maps);
  Scanned log{.path = path, .held_out = held_out};
  log.reader = open_log(path, map ? &*map : nullptr, asked_.repair, drive_.inverter.v_dc);
  log.raw.path = path;
  HealthScan health(drive_.sensors.encoder_counts);
  RawLog piece;
  std::size_t rows = 0;
  for (LogReader::Place place = log.reader->place(); log.reader->next(piece, kSlotRows);
       place = log.reader->place()) {
    if (rows == 0) check_signals(piece);
    rows += piece.size();
    health.add(piece);
    add_slot(piece, place, log);
    if (log.kept) log.raw.append(piece);
    if (log.kept && rows_kept_ + rows > rows_within(asked_.memory_MiB, health.T_s())) {
      log.kept = false;
      log.raw = {};
    }
    if (log.slots.size() % 64 == 0) report_progress("reading " + path, log.reader->share_read());
  }
  log.reader->expect_enough(rows);
  log.health = health.health();
  if (log.kept) rows_kept_ += rows;
  for (const std::string& note : log.reader->notes()) result_.notes.push_back(note);
  if (const std::string damage = log.reader->damage(); !damage.empty())
    result_.damage.push_back(damage);
  result_.health.combine(log.health);
  logs_.push_back(std::move(log));
}

void Reader::check_signals(const RawLog& piece) const try {
  expect_signals(piece);
} catch (const std::runtime_error& error) {
  throw BadInput(error.what());
}

// Equal shares; a short log passes the unused part of its share to the longer ones.
void Reader::share_out() {
  std::vector<std::size_t> order(logs_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto rows = [&](std::size_t i) { return logs_[i].health.rows; };
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return rows(a) < rows(b); });
  shares_.resize(logs_.size());
  std::size_t left = rows_within(asked_.memory_MiB, logs_.front().health.T_s);
  for (std::size_t n = 0; n < order.size(); ++n) {
    shares_[order[n]] = std::min(rows(order[n]), left / (order.size() - n));
    left -= shares_[order[n]];
  }
}

Record Reader::blocks_of(Scanned& log, std::size_t max_rows) {
  std::size_t length = 2 * std::max(kMinBlockSlots, max_rows / kBlocks / kSlotRows);
  std::vector<Block> blocks;
  while (blocks.empty() && length > 1) {  // halves the blocks until they fit between gaps
    length /= 2;
    const std::size_t count = std::max<std::size_t>(1, max_rows / (length * kSlotRows));
    blocks = choose_blocks(log.slots, count, length, log.health.T_s);
  }
  if (blocks.empty())
    throw BadInput(
        fmt::format("{}: {} rows need more than {:.4g} MiB, and no {} successive rows are without "
                    "a gap, as a block must be; increase --memory",
                    log.path, log.health.rows, asked_.memory_MiB, kSlotRows));
  Record record;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    report_progress("reading the blocks of " + log.path,
                    static_cast<double>(b) / static_cast<double>(blocks.size()));
    record.append(slots_of(log, blocks[b].first, blocks[b].end, drive_.machine.n_p));
  }
  record.source = log.path;
  record.begin_s = log.slots.front().t_begin;
  result_.notes.push_back(fmt::format(
      "{}: {:.4g} s, {} rows; traced on {} blocks of {:.3g} s spread over the log ({:.2g} % of the "
      "rows); missing, repeated and clipped samples are counted in all rows",
      log.path, log.duration_s(), log.health.rows, blocks.size(),
      static_cast<double>(length * kSlotRows) * log.health.T_s,
      100 * static_cast<double>(record.size()) / static_cast<double>(log.health.rows)));
  return record;
}

// With two measured currents, estimator and tracer compute i_c = -(i_a + i_b).
void Reader::note_sensors(const Record& log) {
  if (const int counts = log.angle.counts(), declared = drive_.sensors.encoder_counts;
      declared > 0 && counts > 0 && counts != declared)
    result_.notes.push_back(
        fmt::format("{}: theta_m has {} counts a turn; the drive file has sensors.encoder_counts = "
                    "{}; those of the log are used",
                    log.source, counts, declared));
  if (log.current_sensors >= drive_.sensors.current_sensors) return;
  result_.notes.push_back(
      fmt::format("{}: two currents are measured (i_c is -(i_a + i_b) or missing); the drive file "
                  "has sensors.current_sensors = {}, set it to 2",
                  log.source, drive_.sensors.current_sensors));
}

void Reader::add(Scanned& log, std::size_t max_rows) {
  const std::size_t first = result_.record.size();
  double offset = 0;
  std::vector<Inconsistency> inconsistent;
  try {
    Record own;
    if (max_rows < log.health.rows) {
      own = blocks_of(log, max_rows);
    } else {
      if (!log.kept) log.reader->go_to(log.places.front()), log.reader->next(log.raw, SIZE_MAX);
      own = record_of_rows(log.raw, log, drive_.machine.n_p);
    }
    log.raw = {};
    note_sensors(own);
    if (logs_.size() > 1)
      inconsistent =
          inconsistencies_of_file(own, log.health, drive_.facts(), drive_.sensors.encoder_counts);
    result_.record.append(own);
    offset = result_.record.t[first] - own.t.front();
  } catch (const std::runtime_error& error) {
    throw BadInput(error.what());
  }
  result_.files.push_back({log.path, log.held_out, log.health, first, result_.record.size(), offset,
                           std::move(inconsistent)});
}

}  // namespace

std::vector<char> DriveLogs::held_out() const {
  std::vector<char> held(record.size(), 0);
  for (const DriveLog& file : files)
    for (std::size_t k = file.first; k < file.end; ++k) held[k] = file.held_out;
  return held;
}

std::size_t rows_within(double memory_MiB, double T_s) {
  const double outputs = std::min(1.0, T_s * kOutputs_Hz);  // per row
  return static_cast<std::size_t>(kUsableShare * memory_MiB * 1048576 /
                                  (kBytesOfRow + kBytesOfOutput * outputs));
}

DriveLogs read_drive_logs(const LogRequest& asked, const DriveConfig& drive,
                          const ReadProgress& progress) {
  return Reader(asked, drive, progress).read();
}

}  // namespace twinrate
