#include "embedded/closed_run.hpp"

#include <algorithm>
#include <cmath>

#include "controller/make_controller.hpp"
#include "embedded/fixed_estimator.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {
namespace {

// A drive that has switched off is not locked.
void note_trips(const Plant& plant, std::int64_t k, const DriveConfig& drive,
                const std::function<void(const EventRecord&)>& trip) {
  for (int i = 0; i < plant.safety().event_count(); ++i) {
    const SafetyEvent& event = plant.safety().event(i);
    if (is_trip(event.reason))
      trip({.k = k,
            .t_ns = drive.t_ns(k),
            .role = static_cast<int>(Role::kPlant),
            .reason = static_cast<int>(event.reason),
            .text = text_of(event, plant.safety())});
  }
}

}  // namespace

void run_closed(Config& config, const EstimatorTick& estimator,
                const std::function<void(const ClosedTick&)>& tick,
                const std::function<void(const EventRecord&)>& trip) {
  const DriveConfig& drive = config.drive();
  Plant plant(config);
  const auto controller = make_controller(config);
  for (std::int64_t k = 0; k < drive.steps(); ++k) {
    const Measurement m = plant.sample();
    const Truth truth = plant.truth();
    const Estimate estimate = estimator(m);
    const Command command = controller->step({m, estimate, drive.reference_at(k), &truth});
    plant.take_command(command);
    plant.advance();
    note_trips(plant, k, drive, trip);
    tick({m, truth, estimate, command});
  }
}

RunLog closed_run(Config& config, const EstimatorTick& estimator) {
  RunLog log;
  run_closed(
      config, estimator,
      [&](const ClosedTick& tick) {
        log.measurement.push_back(tick.measurement);
        log.truth.push_back(tick.truth);
        log.estimate.push_back(tick.estimate);
        log.command.push_back(tick.command);
      },
      [&](const EventRecord& event) { log.events.push_back(event); });
  return log;
}

std::vector<Estimate> double_estimates(Config& config, const RunLog& log) {
  EstimatorLoop filter(config);
  std::vector<Estimate> estimates;
  estimates.reserve(log.measurement.size());
  for (const Measurement& m : log.measurement) estimates.push_back(filter.tick(m));
  return estimates;
}

double largest_angle_difference(const std::vector<Estimate>& a, const std::vector<Estimate>& b,
                                std::size_t from) {
  double largest = 0;
  for (std::size_t k = from; k < std::min(a.size(), b.size()); ++k)
    largest = std::max(largest, std::abs(wrap_pi(a[k].theta_e - b[k].theta_e)));
  return largest;
}

Estimate estimate_of(const FixedEstimate& raw, const Measurement& m, int n_p) {
  Estimate e;
  e.k = m.k;
  e.t_ns = m.t_ns;
  e.gain_seq = raw.gain_snapshot;
  e.status = raw.gain_snapshot < 0 ? kBeforeFirstGain : 0;
  e.n_x = 4;
  e.n_y = 2;
  e.x_hat[0] = std::ldexp(raw.i_alpha, -m3::kStateBits);
  e.x_hat[1] = std::ldexp(raw.i_beta, -m3::kStateBits);
  e.x_hat[2] = std::ldexp(raw.omega, -m3::kSpeedRawLog2);
  e.x_hat[3] = e.theta_e = m3::angle_of(raw.theta);
  e.omega_m = e.x_hat[2] / n_p;
  e.i_dq = park(e.x_hat.head<2>(), e.theta_e);
  return e;
}

}  // namespace twinrate
