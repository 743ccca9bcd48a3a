#include "tools/trace/raw_log.hpp"

#include <filesystem>
#include <optional>

#include "core/config.hpp"
#include "core/run_log.hpp"
#include "tools/import/drive_messages.hpp"
#include "tools/load_drive.hpp"
#include "trace/measured.hpp"

namespace twinrate {

RawLog raw_log(DriveRows rows) {
  RawLog raw;
  raw.path = rows.path;
  raw.t = std::move(rows.t);
  const auto take = [&](const char* name, std::vector<double>& column) {
    const auto found = rows.columns.find(name);
    if (found != rows.columns.end()) column = std::move(found->second);
  };
  take("i_a", raw.i_a);
  take("i_b", raw.i_b);
  take("i_c", raw.i_c);
  take("i_alpha", raw.i_alpha);
  take("i_beta", raw.i_beta);
  take("i_d", raw.i_d);
  take("i_q", raw.i_q);
  take("u_alpha", raw.u_alpha);
  take("u_beta", raw.u_beta);
  take("u_d", raw.u_d);
  take("u_q", raw.u_q);
  take("v_dc", raw.v_dc);
  take("theta_m", raw.theta_m);
  take("omega_m", raw.omega_m);
  take("T_load", raw.T_load);
  if (raw.T_load.empty()) take("torque", raw.T_load);  // a torque sensor on the shaft
  take("temperature", raw.temperature);
  return raw;
}

std::vector<Measurement> measurements_of(const DriveRows& rows, const DriveConfig& drive) {
  const TickGrid grid = place_on_grid(rows, drive.rates.f_s_Hz);
  const DriveMessages messages(rows, drive.machine.n_p);
  std::vector<Measurement> measurements;
  for (const TickGrid::Slot& slot : grid.slots) measurements.push_back(messages.measurement(slot));
  return measurements;
}

bool is_run_log(const std::string& path) {
  return std::filesystem::is_directory(path) || path.ends_with(".lcm");
}

RawLog raw_log_of_run(const std::string& path) {
  const RunLog log = read_run_log(path);
  RawLog raw;
  raw.path = path;
  const auto& m = log.measurement;
  if (m.size() < kFewestRows + 1)
    throw BadInput(path + ": " + std::to_string(m.size()) + " measurements, at least " +
                   std::to_string(kFewestRows + 1) + " needed");
  std::optional<Config> config;
  if (!log.config_toml.empty()) config = Config::parse(log.config_toml, path);
  std::optional<DeclaredLoad> load;
  if (config) load.emplace(config->drive());
  for (std::size_t k = 0; k + 1 < m.size(); ++k) {
    const double T_load = load ? load->at(1e-9 * static_cast<double>(m[k].t_ns)) : 0;
    append_row(raw, m[k], m[k + 1].u_alphabeta, load ? &T_load : nullptr);
  }
  return raw;
}

}  // namespace twinrate
