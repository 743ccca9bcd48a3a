#include "import/drive_messages.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/config.hpp"
#include "model/inverter.hpp"

namespace twinrate {

namespace {

constexpr const char* kPhaseNames[] = {"i_a", "i_b", "i_c"};

void note_spacing(const DriveRows& rows, TickGrid& grid) {
  std::vector<double> dt;
  for (std::size_t row = 1; row < rows.size(); ++row) dt.push_back(rows.t[row] - rows.t[row - 1]);
  if (dt.empty()) return;
  const auto middle = dt.begin() + static_cast<std::ptrdiff_t>(dt.size() / 2);
  std::nth_element(dt.begin(), middle, dt.end());
  grid.dt_median_s = *middle;
  grid.dt_min_s = *std::min_element(dt.begin(), dt.end());
  grid.dt_max_s = *std::max_element(dt.begin(), dt.end());
}

}  // namespace

TickGrid place_on_grid(const DriveRows& rows, double f_s_Hz) {
  TickGrid grid;
  grid.slots.reserve(rows.size());
  const auto nearest = [&](std::size_t row) {
    return row < rows.size() ? std::llround((rows.t[row] - rows.t[0]) * f_s_Hz) : INT64_MAX;
  };
  std::int64_t last = -1;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    std::int64_t k = nearest(row);
    const std::int64_t next = nearest(row + 1);
    if (k == next && last < k - 1) {
      --k;
    } else if (k == last && next > k + 1) {
      ++k;
    } else if (k <= last) {
      ++grid.crowded_out;
      continue;
    }
    grid.moved += k != nearest(row);
    grid.gaps += k > last + 1;
    grid.missing += k - last - 1;
    grid.slots.push_back({row, k});
    last = k;
  }
  note_spacing(rows, grid);
  if (static_cast<double>(grid.crowded_out) > kMaxCrowdedOut * static_cast<double>(rows.size()))
    throw BadInput(
        fmt::format("{}:{}: the rows are faster than rates.f_s_Hz = {} of the drive: {} of {} rows "
                    "have no tick; use --set rates.f_s_Hz={:.6g}",
                    rows.path, rows.line.front(), f_s_Hz, grid.crowded_out, rows.size(),
                    static_cast<double>(rows.size() - 1) / (rows.t.back() - rows.t.front())));
  return grid;
}

DriveMessages::DriveMessages(const DriveRows& rows, int n_p, double v_dc_nominal)
    : rows_(rows), n_p_(n_p), v_dc_nominal_(v_dc_nominal) {
  // i_d, i_q are in the axes of theta_m: without it they do not determine the phases.
  if (rows.has("i_a") + rows.has("i_b") + rows.has("i_c") >= 2)
    currents_ = Currents::kAbc;
  else if (has_all({"i_alpha", "i_beta"}))
    currents_ = Currents::kAlphaBeta;
  else if (has_all({"i_d", "i_q", "theta_m"}))
    currents_ = Currents::kDq;
  else if (has_all({"i_q", "theta_m"}))
    currents_ = Currents::kQOnly;
  duty_ = has_all({"duty_a", "duty_b", "duty_c"});
  if (has_all({"u_alpha", "u_beta"}))
    voltages_ = Voltages::kAlphaBeta;
  else if (has_all({"u_d", "u_q", "theta_m"}))
    voltages_ = Voltages::kDq;
  else if (duty_)
    voltages_ = Voltages::kDuty;

  if (currents_ != Currents::kNone) signals_ |= kPhaseCurrents;
  if (currents_ == Currents::kQOnly) signals_ |= kQCurrentOnly;
  if (voltages_ != Voltages::kNone) signals_ |= kVoltage;
  if (rows.has("v_dc")) signals_ |= kBusVoltage;
  if (rows.has("theta_m")) signals_ |= kPosition;
  if (rows.has("omega_m")) signals_ |= kSpeed;
  if ((signals_ & (kPhaseCurrents | kPosition | kSpeed)) == 0)
    throw BadInput(
        fmt::format("{}:1: no current (two of i_a,i_b,i_c; i_alpha,i_beta; i_d,i_q or i_q with "
                    "theta_m), angle (theta_m) or speed (omega_m) in the file",
                    rows.path));
}

bool DriveMessages::has_all(std::initializer_list<const char*> names) const {
  return std::all_of(names.begin(), names.end(), [&](const char* name) { return rows_.has(name); });
}

std::int64_t DriveMessages::t_ns(std::size_t row) const {
  return std::llround((rows_.t[row] - rows_.t[0]) * 1e9);
}

Vec3 DriveMessages::currents(std::size_t row) const {
  switch (currents_) {
    case Currents::kAbc: {
      Vec3 i_abc(value("i_a", row), value("i_b", row), value("i_c", row));
      for (int phase = 0; phase < 3; ++phase)
        if (!rows_.has(kPhaseNames[phase]))
          i_abc[phase] = -(i_abc[(phase + 1) % 3] + i_abc[(phase + 2) % 3]);
      return i_abc;
    }
    case Currents::kAlphaBeta:
      return inverse_clarke({value("i_alpha", row), value("i_beta", row)});
    case Currents::kDq:
    case Currents::kQOnly: {
      const double i_d = currents_ == Currents::kDq ? value("i_d", row) : 0.0;
      return inverse_clarke(inverse_park({i_d, value("i_q", row)}, theta_e(row)));
    }
    case Currents::kNone:
      break;
  }
  return Vec3::Zero();
}

Vec2 DriveMessages::voltage(std::size_t row) const {
  switch (voltages_) {
    case Voltages::kAlphaBeta:
      return {value("u_alpha", row), value("u_beta", row)};
    case Voltages::kDq:
      return inverse_park({value("u_d", row), value("u_q", row)}, theta_e(row));
    case Voltages::kDuty:
      return mean_voltage({value("duty_a", row), value("duty_b", row), value("duty_c", row)},
                          rows_.has("v_dc") ? value("v_dc", row) : v_dc_nominal_);
    case Voltages::kNone:
      break;
  }
  return Vec2::Zero();
}

Measurement DriveMessages::measurement(const TickGrid::Slot& slot) const {
  const std::size_t row = slot.row;
  const std::size_t before = row == 0 ? 0 : row - 1;
  Measurement m;
  m.k = slot.k;
  m.t_ns = t_ns(row);
  m.signals = signals_;
  m.i_abc = currents(row);
  m.u_alphabeta = voltage(before);
  if (duty_)
    m.duty_abc = {value("duty_a", before), value("duty_b", before), value("duty_c", before)};
  m.v_dc = value("v_dc", row);
  m.theta_m = value("theta_m", row);
  m.omega_m = value("omega_m", row);
  return m;
}

Reference DriveMessages::reference(const TickGrid::Slot& slot) const {
  const std::size_t row = slot.row;
  return {.k = slot.k,
          .t_ns = t_ns(row),
          .omega_m_ref = value("omega_m_ref", row),
          .i_d_ref = value("i_d_ref", row)};
}

std::vector<std::string> DriveMessages::found() const {
  std::vector<std::string> list;
  constexpr const char* kCurrentText[] = {"", "phase currents",
                                          "phase currents (from i_alpha, i_beta)",
                                          "phase currents (from i_d, i_q)", "i_q only (i_d = 0)"};
  constexpr const char* kVoltageText[] = {"", "voltage", "voltage (from u_d, u_q)",
                                          "voltage (from duty and v_dc)"};
  constexpr const char* kOnNominal = "voltage (from duty and inverter.v_dc_V of the drive)";
  std::vector<std::string> phases, missing;
  for (const char* name : kPhaseNames) (rows_.has(name) ? phases : missing).emplace_back(name);
  if (currents_ == Currents::kAbc && phases.size() == 2)
    list.push_back(fmt::format("phase currents ({0}, {1}; {2} = -({0} + {1}))", phases[0],
                               phases[1], missing[0]));
  else if (currents_ != Currents::kNone)
    list.emplace_back(kCurrentText[static_cast<int>(currents_)]);
  const bool on_nominal = voltages_ == Voltages::kDuty && !rows_.has("v_dc");
  if (voltages_ != Voltages::kNone)
    list.emplace_back(on_nominal ? kOnNominal : kVoltageText[static_cast<int>(voltages_)]);
  if (duty_) list.emplace_back("duty");
  if (rows_.has("v_dc")) list.emplace_back("v_dc");
  if (rows_.has("theta_m")) list.emplace_back("angle");
  if (rows_.has("omega_m")) list.emplace_back("speed");
  if (rows_.has("omega_m_ref")) list.emplace_back("speed reference");
  if (rows_.has("i_d_ref")) list.emplace_back("i_d reference");
  return list;
}

std::vector<std::string> DriveMessages::no_place() const {
  std::vector<std::string> used{"v_dc", "theta_m", "omega_m", "omega_m_ref", "i_d_ref"};
  const std::vector<std::string> by_current[] = {
      {}, {"i_a", "i_b", "i_c"}, {"i_alpha", "i_beta"}, {"i_d", "i_q"}, {"i_q"}};
  const std::vector<std::string> by_voltage[] = {{}, {"u_alpha", "u_beta"}, {"u_d", "u_q"}, {}};
  const auto use = [&](const std::vector<std::string>& names) {
    used.insert(used.end(), names.begin(), names.end());
  };
  use(by_current[static_cast<int>(currents_)]);
  use(by_voltage[static_cast<int>(voltages_)]);
  if (duty_) use({"duty_a", "duty_b", "duty_c"});
  std::vector<std::string> unused;
  for (const auto& [name, values] : rows_.columns)
    if (std::find(used.begin(), used.end(), name) == used.end()) unused.push_back(name);
  return unused;
}

}  // namespace twinrate
