#include "tools/trace/raw_log.hpp"

#include <filesystem>
#include <optional>

#include "core/config.hpp"
#include "core/run_log.hpp"
#include "tools/load_drive.hpp"

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
  double T_load = 0;
  for (std::size_t k = 0; k + 1 < m.size(); ++k) {
    constexpr int kNeeded = kPhaseCurrents | kPosition;
    if ((m[k].signals & kNeeded) != kNeeded) continue;  // a lost row
    raw.t.push_back(1e-9 * static_cast<double>(m[k].t_ns));
    raw.i_a.push_back(m[k].i_abc[0]);
    raw.i_b.push_back(m[k].i_abc[1]);
    raw.i_c.push_back(m[k].i_abc[2]);
    raw.u_alpha.push_back(m[k + 1].u_alphabeta[0]);
    raw.u_beta.push_back(m[k + 1].u_alphabeta[1]);
    raw.v_dc.push_back(m[k].v_dc);
    raw.theta_m.push_back(m[k].theta_m);
    raw.omega_m.push_back(m[k].omega_m);
    if (!config) continue;
    const DriveConfig& drive = config->drive();
    T_load = slew(T_load, drive.load.T_load_Nm.at(raw.t.back()), drive.load.slew_Nm_s, drive.T_s());
    raw.T_load.push_back(T_load);
  }
  return raw;
}

}  // namespace twinrate
