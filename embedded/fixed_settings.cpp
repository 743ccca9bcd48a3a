#include "embedded/fixed_settings.hpp"

#include <fmt/format.h>

#include "estimator/ekf_sensorless.hpp"
#include "estimator/gain_schedule.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/scaled_tuning.hpp"

namespace twinrate {
namespace {

m3::Policy policy_of(const Config& config) {
  switch (config.drive().gain.policy) {
    case GainPolicy::kPaper:
      return m3::Policy::kPaper;
    case GainPolicy::kRotate:
      return m3::Policy::kRotate;
    case GainPolicy::kScheduled:
      return m3::Policy::kScheduled;
    default:
      throw BadInput(fmt::format(
          "{}: gain.policy: the Cortex-M3 firmware has paper, rotate and scheduled; found {}",
          config.where("gain.policy"),
          kGainPolicyNames[static_cast<int>(config.drive().gain.policy)]));
  }
}

void require(const Config& config, const std::string& key, bool holds, const std::string& allowed) {
  if (!holds)
    throw BadInput(
        fmt::format("{}: {}: the Cortex-M3 firmware needs {}", config.where(key), key, allowed));
}

void require_what_the_firmware_has(const Config& config) {
  const DriveConfig& d = config.drive();
  require(config, "estimator.kind", d.estimator.kind == "ekf_sensorless", "ekf_sensorless");
  require(config, "estimator.prediction", d.estimator.prediction == Prediction::kEuler, "euler");
  require(config, "rates.n_from", !d.locks_first(), "start");
  require(config, "start", d.start != Start::kAlignIf, "aligned or flying");
  require(config, "effect", d.model_effects().empty(), "no effect in the model");
}

m3::ScheduleTable schedule_table(Config& config) {
  const DriveConfig& drive = config.drive();
  const double fastest = m3::schedule_speed(m3::kScheduleRows - 1) / drive.machine.n_p;
  const auto schedule = GainSchedule::build(*make_filter(config), fastest);
  const m3::Units<m3::Format32> unit;
  m3::ScheduleTable table{};
  for (int row = 0; row < m3::kScheduleRows; ++row) {
    const auto K = schedule->rotor_gain(m3::schedule_speed(row) / drive.machine.n_p);
    for (int i = 0; i < 8; ++i)
      table.K[row][i] = m3::to_raw(K(i / 2, i % 2) / unit.of_state(i / 2), m3::Format32::kK);
  }
  return table;
}

}  // namespace

m3::Machine fixed_machine(Config& config) {
  const DriveConfig& drive = config.drive();
  EkfSensorlessParameters tuning;
  scale(tuning, per_unit(drive.machine, drive.inverter.v_dc, drive.T_s()), drive.machine.J,
        drive.T_s());
  config.read_table("estimator.ekf_sensorless", [&](FieldVisitor& f) { tuning.fields(f); });
  m3::Machine m{.R_s = drive.machine.R_s,
                .L = drive.machine.L_d,
                .psi_f = drive.machine.psi_f,
                .T_s = drive.T_s()};
  for (int i = 0; i < 4; ++i) {
    m.Q_diag[i] = tuning.Q_diag[i];
    m.P0_diag[i] = tuning.P0_diag[i];
  }
  for (int j = 0; j < 2; ++j) m.R_diag[j] = tuning.R_diag[j];
  m.u_max = 2.0 / 3 * drive.inverter.v_dc;
  return m;
}

m3::Settings fixed_settings(Config& config) {
  require_what_the_firmware_has(config);
  const m3::Machine machine = fixed_machine(config);
  const auto ranges = m3::check_ranges<m3::Format32>(machine);
  if (const m3::Range* range = ranges.first_that_fails())
    throw BadInput(fmt::format(
        "{}: machine: {} can reach {:.4g}, its fixed-point format holds less than {:.4g}",
        config.drive().name, range->quantity, range->bound, range->fits));
  const DriveConfig& drive = config.drive();
  const BackgroundRate rate = drive.background_rate();
  const bool flying = drive.start == Start::kFlying;
  m3::Settings s{};
  s.step = m3::step_constants(machine);
  s.covariance = m3::covariance_constants<m3::Format32>(machine);
  s.covariance16 = m3::covariance_constants<m3::Format16>(machine);
  s.omega_start = m3::to_raw(drive.machine.n_p * drive.omega_m_start(), m3::kSpeedRawLog2);
  s.theta_start = m3::angle_raw(flying ? drive.plant.theta_e_start : 0);
  s.policy = policy_of(config);
  s.n = rate.n;
  s.from = static_cast<std::int32_t>(rate.from);
  if (s.policy == m3::Policy::kScheduled) s.schedule = schedule_table(config);
  return s;
}

twp_sample sample_of(const Measurement& m) {
  twp_sample s{};
  s.signals = static_cast<std::uint16_t>(m.signals);
  for (int i = 0; i < 3; ++i) s.i_abc[i] = m.i_abc[i];
  for (int i = 0; i < 2; ++i) s.u_alphabeta[i] = m.u_alphabeta[i];
  return s;
}

}  // namespace twinrate
