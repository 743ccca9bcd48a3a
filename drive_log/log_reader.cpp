#include "drive_log/log_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>

#include "core/config.hpp"
#include "import/drive_rows.hpp"
#include "loop/load_drive.hpp"
#include "model/inverter.hpp"
#include "trace/measured.hpp"

namespace twinrate {
namespace {

class CsvLog final : public LogReader {
 public:
  CsvLog(const std::string& path, const ImportMap* map, bool repair, double v_dc_nominal)
      : rows_(path, map, repair), v_dc_nominal_(v_dc_nominal), v_dc_(index_of("v_dc")) {
    for (const RawColumn& c : raw_columns()) {
      std::size_t index = index_of(c.name);
      if (index == kNone && c.values == &RawLog::T_load) {
        index = index_of("torque");
        load_measured_ = index != kNone;
      }
      if (index != kNone) columns_.push_back({c.values, index});
    }
    no_angle_ = index_of("theta_m") == kNone;
    const auto has = [&](std::initializer_list<const char*> names) {
      return std::all_of(names.begin(), names.end(),
                         [&](const char* name) { return index_of(name) != kNone; });
    };
    if (has({"u_alpha", "u_beta"}) || has({"u_d", "u_q"}) || !has({"duty_a", "duty_b", "duty_c"}))
      return;
    duty_ = {index_of("duty_a"), index_of("duty_b"), index_of("duty_c")};
    std::erase_if(columns_, [](const Column& c) {  // one component alone is no voltage
      return c.values == &RawLog::u_alpha || c.values == &RawLog::u_beta;
    });
  }
  bool next(RawLog& piece, std::size_t rows) override {
    piece.clear();
    piece.path = rows_.path();
    while (piece.size() < rows && rows_.next()) {
      piece.t.push_back(rows_.t());
      for (const auto& [values, index] : columns_) (piece.*values).push_back(rows_.values()[index]);
      if (duty_) take_voltage(piece);
    }
    piece.no_angle = no_angle_;
    piece.load_measured = load_measured_;
    if (no_angle_) piece.theta_m.assign(piece.size(), 0);  // standstill
    return piece.size() > 0;
  }
  double share_read() const override { return rows_.share_read(); }
  std::vector<std::string> notes() const override { return rows_.notes(); }
  void expect_enough(std::size_t rows) const override {
    if (rows < kMinRows) fail_too_few(rows_, rows, kMinRows);
  }
  bool may_wrap() const override { return rows_.map().may_wrap(); }
  Place place() override { return rows_.place(); }
  void go_to(const Place& place) override { rows_.go_to(std::get<RowReader::Place>(place)); }

 private:
  struct Column {
    std::vector<double> RawLog::*values;
    std::size_t index;
  };
  static constexpr std::size_t kNone = SIZE_MAX;
  std::size_t index_of(const std::string& name) const {
    const auto& names = rows_.names();
    const auto found = std::find(names.begin(), names.end(), name);
    return found == names.end() ? kNone : static_cast<std::size_t>(found - names.begin());
  }
  void take_voltage(RawLog& piece) const {
    const std::vector<double>& x = rows_.values();
    const Vec2 u = mean_voltage({x[(*duty_)[0]], x[(*duty_)[1]], x[(*duty_)[2]]},
                                v_dc_ == kNone ? v_dc_nominal_ : x[v_dc_]);
    piece.u_alpha.push_back(u[0]);
    piece.u_beta.push_back(u[1]);
  }

  RowReader rows_;
  std::vector<Column> columns_;
  double v_dc_nominal_;
  std::size_t v_dc_;
  bool no_angle_ = false, load_measured_ = false;   // load_measured_: by a shaft sensor
  std::optional<std::array<std::size_t, 3>> duty_;  // columns, if the voltage comes from duties
};

// A voltage is moved to the row at which it starts to act; the load is that of the config in the
// log, and of the requests that steered the run.
class RecordedRun final : public LogReader {
 public:
  RecordedRun(const std::string& path, OnDamage on_damage)
      : path_(path), measurements_(path, on_damage) {
    measurements_.peek();
    if (measurements_.config_toml().empty()) return;
    const Config config = Config::parse(measurements_.config_toml(), path);
    n_p_ = config.drive().machine.n_p;
    T_s_ = config.drive().T_s();
    if (!measurements_.imported()) load_.emplace(config.drive());
  }
  bool next(RawLog& piece, std::size_t rows) override {
    piece.clear();
    piece.path = path_;
    Measurement m;
    while (piece.size() < rows && measurements_.next(m)) {
      const Measurement* following = measurements_.peek();
      if (!following) break;
      const double T_load = load_ ? load_at(1e-9 * static_cast<double>(m.t_ns)) : 0;
      if (!columns_) choose_columns(m, *following);
      if (!columns_) continue;
      if (*columns_ & ~following->signals & kVoltage) continue;
      if (*columns_ & kVoltage && is_before_a_gap(m.k, following->k) && !measurements_.imported() &&
          !is_timed(*following))
        continue;
      append_row(piece, m, following->u_alphabeta, load_ ? &T_load : nullptr, *columns_, n_p_);
    }
    return piece.size() > 0;
  }
  double share_read() const override { return measurements_.share_read(); }
  std::vector<std::string> notes() const override {
    if (measurements_.damage().empty()) return {};
    return {measurements_.damage()};
  }
  std::string damage() const override { return measurements_.damage(); }
  void expect_enough(std::size_t rows) const override {
    if (rows < kMinRows)
      throw BadInput(fmt::format("{}: {} measurements, at least {} needed", path_, rows, kMinRows));
  }
  Place place() override { return RunPlace{measurements_.place(), load_ ? load_->now() : 0}; }
  void go_to(const Place& place) override {
    const auto& there = std::get<RunPlace>(place);
    measurements_.go_to(there.place);
    if (load_) load_->go_on_from(there.T_load);
  }

 private:
  double load_at(double t_s) {
    const std::vector<AppliedSteering>& steering = measurements_.steering();
    for (; steered_ < steering.size(); ++steered_)
      load_->steer(steering[steered_].k, steering[steered_].lines);
    return load_->at(t_s);
  }
  // If true, the next message holds the voltage of the end of the gap, not that of this row; an
  // imported message holds that of its row. A log of every nth tick has no row before a gap.
  bool is_before_a_gap(std::int64_t k, std::int64_t k_following) {
    step_ = std::min(step_, std::max<std::int64_t>(1, k_following - k));
    return k_following - k > step_;
  }
  // A sample with a time of its own, not that of its tick, holds the mean voltage since the one before.
  bool is_timed(const Measurement& m) const {
    return T_s_ > 0 && std::llabs(m.t_ns - std::llround(1e9 * T_s_ * static_cast<double>(m.k))) > 1;
  }
  // Takes the columns of the first row with currents and an angle; absent signals stay absent.
  void choose_columns(const Measurement& m, const Measurement& following) {
    constexpr int kNeeded = kPhaseCurrents | kPosition;
    if ((m.signals & kNeeded) != kNeeded) return columns_.reset();
    columns_ =
        (m.signals & (kBusVoltage | kSpeed | kQCurrentOnly)) | (following.signals & kVoltage);
  }

  std::string path_;
  MeasurementReader measurements_;
  std::optional<DeclaredLoad> load_;
  std::size_t steered_ = 0;  // requests that load_ knows
  double T_s_ = 0;
  std::int64_t step_ = INT64_MAX;  // of the tick, the least from one message to the next
  std::optional<int> columns_;
  int n_p_ = 0;
};

}  // namespace

bool is_run_log(const std::string& path) {
  return std::filesystem::is_directory(path) || path.ends_with(".lcm");
}

std::unique_ptr<LogReader> open_log(const std::string& path, const ImportMap* map, bool repair,
                                    double v_dc_nominal) {
  if (is_run_log(path))
    return std::make_unique<RecordedRun>(path, repair ? OnDamage::kSkip : OnDamage::kRefuse);
  return std::make_unique<CsvLog>(path, map, repair, v_dc_nominal);
}

}  // namespace twinrate
