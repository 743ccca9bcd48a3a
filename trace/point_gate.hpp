// The gate (trace/gate.hpp) for points: rows of a static set, means of a holding sweep, samples of
// v_dc. With the keys fixed in which the claims are not linear,
//
//   y = x beta + rest
//
// y: what the declared model leaves; x: what the claims explain, and nuisances beside them. The
// rules are those of the gate with the same thresholds; there is no second rate. Of `whole`:
//   - no file and channel may be worse with all claims than with none,
//   - what no claim explains, but neighbouring rows share, must be small beside what the claims take
//     away where they act. Else they may be that, by another name.
#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "trace/agreement.hpp"
#include "trace/gate.hpp"
#include "trace/transfer.hpp"

namespace twinrate {

struct PointClaim {
  std::string kind;
  std::vector<Eigen::Index> columns;
  double size = 0;  // over the smallest worth reporting
};

// Two parts of the rows, 0 and 1; rows in neither have -1.
struct PartsOfRows {
  const char* between;
  std::vector<signed char> part;
};

struct PointRows {
  Eigen::VectorXd y;
  Eigen::MatrixXd x;
  std::vector<char> judges;
  std::vector<int> file, channel;
  std::vector<std::size_t> piece;  // of its file
  std::vector<Eigen::Index> next;  // neighbour in the same channel; -1: none
  std::vector<PartsOfRows> parts;
  std::vector<std::string> files, channels;  // names
  std::vector<double> lsb = {};              // of each channel, as y; empty: no steps

  std::size_t size() const { return judges.size(); }
};

struct PointAnswer {
  Eigen::VectorXd beta;  // fitted to rows that do not judge
  std::vector<Judgement> judgements;
  std::optional<Refused> refused;  // the weakest of the claims that fail, the first rule it fails
  std::size_t weakest = 0;
};
// All claims together, and each left out.
PointAnswer ask(const PointRows& rows, const std::vector<PointClaim>& claims,
                const Criterion& criterion = {});

// Mean square that neighbouring rows share in `rest`, and its share of all; 0 where noise makes as
// much (criterion.sigmas).
struct Shared {
  double power = 0, share = 0;
};
Shared shared_by_neighbours(const Eigen::VectorXd& rest, const PointRows& rows, int channel,
                            const Criterion& criterion = {});

}  // namespace twinrate
