#include "trace/angle_zero.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/chain.hpp"
#include "trace/dictionary.hpp"
#include "trace/equations.hpp"
#include "trace/sampler.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

// Voltages d and q, one below the other; empty if there are none.
Eigen::VectorXd stacked(const Sampled& s) {
  Eigen::VectorXd both(s.d.size() + s.q.size());
  both << s.d, s.q;
  return both;
}

// Of each kind without non-linear keys: voltages of one unit of each coefficient.
std::map<std::string_view, Eigen::MatrixXd> voltages_by_kind(const Chain& chain) {
  std::map<std::string_view, Eigen::MatrixXd> by_kind;
  const auto only_linear = [](const Effect& effect) {
    const std::vector<TracedKey> keys = effect.tracing().traced_keys();
    return std::all_of(keys.begin(), keys.end(), [](const TracedKey& key) { return key.linear; });
  };
  for (const Candidate& candidate : make_candidates(chain, only_linear))
    for (const Sampled& column : candidate.columns)
      if (const Eigen::VectorXd v = stacked(column); v.size() && v.squaredNorm() > 0) {
        Eigen::MatrixXd& all = by_kind[candidate.effect->kind()];
        all.conservativeResize(v.size(), all.cols() + 1);
        all.rightCols(1) = v;
      }
  return by_kind;
}

}  // namespace

double rounding_to_nearest(const Record& whole, const DriveFacts& facts, const Effects& known) {
  constexpr double kNear = 0.25;       // of a count
  constexpr double kLeastPart = 1e-3;  // of the residual's energy, that an effect explains
  // Of a column's energy, left beside the effects before it. At constant speed all columns are alike,
  // and their difference is noise of the angle, as in the residual.
  constexpr double kCollinear = 0.05;
  constexpr double kLeastLeft = 0.5;  // of the energy of encoder_offset's column, left beside them
  // Of the energy that they leave. Seven counters that round down, beside larger effects, had an
  // offset of about half a count and at most 0.066 of the energy; simulated ones that round to the
  // nearest have 0.1 and more.
  constexpr double kLeastOfRest = 0.08;
  constexpr int kMostEffects = 5;  // beside which the offset is estimated
  const double half = whole.angle.centre;
  if (half <= 0 || !whole.has_voltage_equation()) return 0;
  const Record record = thinned(whole, rows_as_one(whole.T_s), facts.machine.n_p);
  const Equations equations(record, facts, known);
  const std::vector<char> none(record.size(), 0);
  const Sampler sampler(record, moving_rows(record), none);
  const std::string_view zero = make_of(Traits::Family::kAngleSensor)->kind();
  const Chain chain(equations, equations, equations, sampler);
  std::map<std::string_view, Eigen::MatrixXd> columns = voltages_by_kind(chain);
  Eigen::VectorXd e = stacked(chain.noiseless({}));
  const auto of_zero = columns.find(zero);
  const double alone = of_zero == columns.end() ? 0 : of_zero->second.squaredNorm();
  for (int round = 0; round < kMostEffects && !columns.empty(); ++round) {
    double most = kLeastPart * e.squaredNorm();
    auto best = columns.end();
    for (auto it = columns.begin(); it != columns.end(); ++it) {
      const Eigen::VectorXd of_e = it->second.transpose() * e;
      const double part = of_e.dot(it->second.completeOrthogonalDecomposition().solve(e));
      if (part > most) most = part, best = it;
    }
    if (best == columns.end()) return 0;
    const Eigen::MatrixXd A = std::move(best->second);
    if (best->first == zero) {
      // An estimate from the small part that the others leave is one of their errors.
      if (A.squaredNorm() < kLeastLeft * alone || most < kLeastOfRest * e.squaredNorm()) return 0;
      const double counts = A.col(0).dot(e) / A.col(0).squaredNorm() / whole.angle.lsb;
      return std::abs(counts - 0.5) < kNear ? -half : 0;
    }
    columns.erase(best);
    // The others are compared beside it, without those that it explains.
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(A);
    const Eigen::MatrixXd Q = qr.householderQ() * Eigen::MatrixXd::Identity(A.rows(), qr.rank());
    e -= Q * (Q.transpose() * e);
    for (auto it = columns.begin(); it != columns.end();) {
      const double was = it->second.squaredNorm();
      it->second -= Q * (Q.transpose() * it->second);
      it = it->second.squaredNorm() < kCollinear * was ? columns.erase(it) : std::next(it);
    }
  }
  return 0;
}

double zero_in_doubt(const Sensor& angle, int declared_counts) {
  if (angle.centre <= 0) return 0;
  return declared_counts > 0 ? angle.lsb / 2 : angle.lsb;
}

double zero_within(double in_doubt, const TraceResult& result) {
  constexpr double kSigmas = 2;
  if (in_doubt == 0) return 0;
  const auto zero = make_of(Traits::Family::kAngleSensor);
  for (const TracedEffect& e : result.effects) {
    if (e.effect->kind() != zero->kind() || e.parameters.empty()) continue;
    const TracedParameter& offset = e.parameters.front();
    if (std::abs(offset.value) < in_doubt + kSigmas * offset.sigma.value_or(0))
      return -offset.value;
  }
  return 0;
}

Record moved(const Record& record, double by) {
  Record out = record;
  for (double& theta_m : out.theta_m) theta_m += by;
  out.angle.centre = 0;
  out.angle.moved += by;
  return out;
}

}  // namespace twinrate
