#include "identify/spin.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "identify/spin_fits.hpp"

namespace twinrate {
namespace {

// The currents of a row that repeats the one before are interpolated between its neighbours, in
// turning axes. So is its angle if it repeats, too.
void mend_stale_rows(Rows& rows, int n_p) {
  for (std::size_t k = 1; k + 1 < rows.size(); ++k) {
    if (!rows[k].repeats || rows[k + 1].repeats) continue;
    Row &row = rows[k], &before = rows[k - 1], &after = rows[k + 1];
    const double half = 0.5 * n_p * (after.theta - before.theta);
    row.i = 0.5 * (inverse_park(before.i, half) + park(after.i, half));
    if (row.theta == before.theta) row.theta = 0.5 * (before.theta + after.theta);
  }
}

// Turns the currents to the time of the voltage.
void turn_currents(Rows& rows, double angle_per_speed, double T_s) {
  if (rows.size() < 2) return;
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].i = inverse_park(rows[k].i, angle_per_speed * speed_about(rows, k, T_s));
}

// A falling L_q is a saturation. A rising one is none: L_q is larger without a current along d
// (cross saturation), or R_s is not that at rest.
void note_rising_inductance(Identified& found) {
  constexpr double kSigmas = 3, kMaterial = 0.02;
  const Found& rest = found.L_q_points.front().L;
  if (found.R_s_drifts) return;
  for (const InductancePoint& p : found.L_q_points) {
    const double rise = p.L.value - rest.value;
    if (rise < kMaterial * rest.value || rise < kSigmas * std::hypot(p.L.sigma, rest.sigma))
      continue;
    found.notes.push_back(fmt::format(
        "L_q: {:.3g} mH at rest beside the holding current, {:.3g} mH turning without it, as with "
        "cross saturation, another R_s or loss of the inverter; the file has the first",
        1e3 * rest.value, 1e3 * p.L.value));
    return;
  }
}

}  // namespace

void identify_spin(Experiment& e, Identified& found) {
  e.show("run-up", 0.55);
  std::vector<SpinRun> segments = run_spin(e, found);
  e.pause();
  found.stale_share = e.stale_share();
  for (SpinRun& run : segments) {
    if (found.stale_share > 0) mend_stale_rows(run.rows, found.n_p);
    if (found.current.form != Lateness::kNone)
      turn_currents(run.rows, found.n_p * found.current.lag.value, e.T_s());
  }
  find_flux(e, segments, found);
  const auto [d, q] = fit_inductances(found.L_d_points, found.L_q_points);
  found.L_d = d.L, found.saturation_d = d.saturation;
  found.saturation_q = q.saturation;
  if (q.saturation) found.L_q = q.L;
  note_rising_inductance(found);
  find_motion(e, segments, found);
}

}  // namespace twinrate
