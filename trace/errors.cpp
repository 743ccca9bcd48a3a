#include "trace/errors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "trace/no_change.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

double rms(const Eigen::VectorXd& x, const Runs& runs, bool held_out) {
  double sum = 0, count = 0;
  for (Eigen::Index n = 0; n < x.size(); ++n)
    if ((runs.held_out[static_cast<std::size_t>(n)] != 0) == held_out) sum += x[n] * x[n], ++count;
  return count > 0 ? std::sqrt(sum / count) : 0;
}

ErrorPair rms_pair(const Eigen::VectorXd& x, const Runs& runs) {
  return {rms(x, runs, false), rms(x, runs, true)};
}

ErrorPair both_axes(const Sampled& y, const Runs& runs) {
  const ErrorPair d = rms_pair(y.d, runs), q = rms_pair(y.q, runs);
  return {std::sqrt(0.5 * (d.train * d.train + q.train * q.train)),
          std::sqrt(0.5 * (d.held_out * d.held_out + q.held_out * q.held_out))};
}

// The error on the judging rows, or on the training rows if none judges.
double shown(const ErrorPair& e, const Runs& runs) {
  const bool held = std::find(runs.held_out.begin(), runs.held_out.end(), 1) != runs.held_out.end();
  return held ? e.held_out : e.train;
}

// Residual from the noise of the sensors alone, on the rows of `shown`: the drawn noise times the
// share that the record holds. Without drawn noise: the rms of the residual for the whitening.
double noise_floor(const Eigen::VectorXd& drawn, double share, const Whitener& seen,
                   const Runs& runs) {
  return drawn.size() ? share * shown(rms_pair(drawn, runs), runs) : seen.rms();
}

// P-value of the hypothesis that the residual is noise alone. Noise is an autoregression of its
// own, which a structure in the angle, the current or time does not fit.
double whiteness(const Eigen::VectorXd& rest, const Runs& runs) {
  constexpr int kOrder = 40, kLags = 60;  // the sampler's edge needs this order
  return whiteness_p_value(Whitener(rest, runs, kOrder)(rest, runs), runs, kLags, kOrder);
}

TraceSeries series(const Chain& chain, const Runs& runs, const Eigen::VectorXd& before,
                   const Eigen::VectorXd& after) {
  TraceSeries s;
  const Equations& e = chain.equations();
  for (std::size_t n = 0; n < runs.row.size(); ++n) {
    const OperatingPoint& p = e.points()[runs.row[n]];
    s.t.push_back(p.t);
    s.theta_m.push_back(p.theta_m);
    s.omega_m.push_back(p.omega_m);
    s.i_d.push_back(p.i_dq[0]);
    s.i_q.push_back(p.i_dq[1]);
    s.before.push_back(before[static_cast<Eigen::Index>(n)]);
    s.after.push_back(after[static_cast<Eigen::Index>(n)]);
    s.held_out.push_back(runs.held_out[n]);
  }
  s.rate_Hz = 1 / (e.record().T_s * chain.sampler().decimation());
  return s;
}

}  // namespace

void compare_errors(const Chain& chain, const Effects& found, TraceResult& r) {
  const Sampler& sampler = chain.sampler();
  const NoiseModel& noise = chain.noise();
  const Sampled before = chain.residual({}), after = chain.residual(found),
                nothing = no_change(chain);
  r.horizon_s = chain.equations().record().T_s * sampler.decimation();
  if (before.d.size()) {
    EquationError e{.unit = "V",
                    .before = both_axes(before, sampler.electrical()),
                    .after = both_axes(after, sampler.electrical())};
    e.no_change = shown(both_axes(nothing, sampler.electrical()), sampler.electrical());
    const Runs& rows = sampler.electrical();
    e.noise_floor = std::hypot(noise_floor(after.noise_d, noise.share_d, noise.d, rows),
                               noise_floor(after.noise_q, noise.share_q, noise.q, rows)) /
                    std::sqrt(2.0);
    e.whiteness_p_value = std::min(1.0, 2 * std::min(whiteness(after.d, sampler.electrical()),
                                                     whiteness(after.q, sampler.electrical())));
    e.rows = static_cast<std::size_t>(before.d.size());
    r.electrical = e;
    r.series_d = series(chain, sampler.electrical(), before.d, after.d);
    r.series_q = series(chain, sampler.electrical(), before.q, after.q);
  }
  if (before.torque.size()) {
    EquationError e{.unit = "Nm",
                    .before = rms_pair(before.torque, sampler.torque()),
                    .after = rms_pair(after.torque, sampler.torque())};
    e.no_change = shown(rms_pair(nothing.torque, sampler.torque()), sampler.torque());
    e.noise_floor =
        noise_floor(after.noise_torque, noise.share_torque, noise.torque, sampler.torque());
    e.whiteness_p_value = whiteness(after.torque, sampler.torque());
    e.rows = static_cast<std::size_t>(before.torque.size());
    r.mechanical = e;
    r.series_torque = series(chain, sampler.torque(), before.torque, after.torque);
  }
  const auto fall = [](const std::optional<EquationError>& e) {
    return e && e->after.train > 0 ? e->before.train / e->after.train : 0;
  };
  // The main equation: the one on which all effects act or, of both, the one with the larger fall.
  const bool of_voltage = acting_on(found, ~kOnVoltage).empty(),
             of_torque = acting_on(found, ~kOnTorque).empty();
  const bool electrical = of_voltage != of_torque ? of_voltage && r.electrical
                                                  : fall(r.electrical) > fall(r.mechanical);
  r.main_equation = electrical ? "electrical" : "mechanical";
}

namespace {

std::vector<std::string> signals_of(const Record& record, bool electrical) {
  std::vector<std::string> signals = {"theta_m"};
  if (!record.i_alphabeta.empty()) signals.emplace_back("currents");
  if (electrical && !record.u_alphabeta.empty()) signals.emplace_back("voltages");
  if (electrical && !record.v_dc.empty()) signals.emplace_back("v_dc");
  if (!electrical && !record.T_load.empty()) signals.emplace_back("T_load");
  return signals;
}

// Root mean square over the outputs of a file; `judging`: over those that judge alone.
double rms_of_file(const Sampled& y, const Sampler& sampler, bool electrical,
                   const JudgedFiles& files, int file, bool judging) {
  const Runs& runs = electrical ? sampler.electrical() : sampler.torque();
  double sum = 0, count = 0;
  for (const Eigen::VectorXd* x : electrical ? std::vector{&y.d, &y.q} : std::vector{&y.torque})
    for (Eigen::Index n = 0; n < x->size(); ++n) {
      const auto at = static_cast<std::size_t>(n);
      if (judging && !runs.held_out[at]) continue;
      if (!files.of_row.empty() && files.of_row[runs.row[at]] != file) continue;
      sum += (*x)[n] * (*x)[n];
      ++count;
    }
  return count > 0 ? std::sqrt(sum / count) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

void compare_files(const Chain& chain, const Effects& found, const JudgedFiles& files,
                   TraceResult& r) {
  const bool electrical = r.main_equation == "electrical";
  const Sampled before = chain.residual({}), after = chain.residual(found),
                nothing = no_change(chain);
  const auto& main = electrical ? r.electrical : r.mechanical;
  for (std::size_t f = 0; f < files.files.size(); ++f) {
    const auto rms = [&](const Sampled& y) {
      const auto over = [&](bool judging) {
        return rms_of_file(y, chain.sampler(), electrical, files, static_cast<int>(f), judging);
      };
      const double judged = over(true);
      return std::isfinite(judged) ? judged : over(false);
    };
    const JudgedFile& file = files.files[f];
    r.files.push_back({.path = file.path,
                       .held_out = file.held_out,
                       .unit = electrical ? "V" : "Nm",
                       .rows = file.rows,
                       .no_change = rms(nothing),
                       .before = rms(before),
                       .after = rms(after),
                       .noise = main ? main->noise_floor : 0,
                       .signals = signals_of(chain.equations().record(), electrical)});
  }
}

}  // namespace twinrate
