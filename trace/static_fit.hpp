// Fits effects to a static set: points without time, each with its own operating point.
//
//   y = sum over effects of their contributions + rest
//
// y is the residual of the declared model. The keys in which an effect is not linear (a saturation
// current, a corner) are searched on a grid, with the others by least squares. From the best grid
// point all keys are refined together (Ceres). Judging points enter no fit and no choice, only the
// gate (trace/point_gate.hpp) and the reported errors.
#pragma once
#include <Eigen/Core>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"
#include "trace/hooks.hpp"

namespace twinrate {

struct SearchedKey {
  std::string key;
  double lo = 0, hi = 0;  // both above zero
};

// An effect with open keys. Its `kind` determines which term it replaces in a selection.
struct StaticTerm {
  std::shared_ptr<Effect> effect;
  std::vector<std::string> linear;
  std::vector<SearchedKey> searched;
};

// Role of a point, in the order in which the steps of a trace read the set.
enum class PointRole : char { kFits, kChooses, kJudges };

struct StaticProblem {
  DriveFacts facts;
  std::vector<OperatingPoint> points;
  std::vector<std::string> channels;  // names, e.g. psi_d, psi_q
  Eigen::MatrixXd y;                  // point x channel
  // The contribution to each channel.
  std::function<Eigen::RowVectorXd(const Contribution&, const OperatingPoint&)> observe;
  Eigen::RowVectorXd scale;                   // of each channel: errors are weighted by 1/scale
  std::vector<std::vector<double>> readings;  // of each channel
  std::vector<double> smallest;               // of each channel: a smaller residual is not reported
  std::vector<PointRole> role;
  std::vector<int> file;  // of each point; of `files`
  std::vector<std::string> files;
  // Points in the order of the set's coordinates, in lines: the last of a line has no neighbour.
  std::vector<std::size_t> order;
  std::vector<char> ends_line;     // by index in `order`
  std::vector<double> coordinate;  // both signs of it should agree
  // False: physically impossible beyond the points; not used. May be empty.
  std::function<bool(const Effects&)> possible;
  TraceHooks hooks = {};
};

struct StaticFit {
  std::vector<StaticTerm> terms;                     // with the keys set
  std::vector<std::map<std::string, double>> sigma;  // of each term, by key
  Eigen::RowVectorXd train, held_out;  // rms of the residual by channel; held out: the next role
  Eigen::MatrixXd rest;
  double cost = 0, held_out_cost = 0;  // mean square of the weighted residual
  int parameters = 0;
  bool in_range = true;  // every key is inside the range of its field, and the fit is possible

  const StaticTerm* find(std::string_view kind) const;
};

// Fits deep copies of the effects to the points up to role `last`; `terms` does not change. Throws
// TraceStopped.
StaticFit fit_static(const StaticProblem& problem, const std::vector<StaticTerm>& terms,
                     PointRole last = PointRole::kFits);

// The fit reduced to its first `count` terms, without fitting again.
StaticFit first_terms(const StaticProblem& problem, StaticFit fit, std::size_t count,
                      PointRole last);

// One column for each linear key of each term, at the present values of the searched keys. The
// channels are stacked, in units of `scale`.
Eigen::MatrixXd columns_of(const StaticProblem& problem, const std::vector<StaticTerm>& terms);
Eigen::VectorXd weighed_residual(const StaticProblem& problem);

}  // namespace twinrate
