// The gate (trace/gate.hpp) for points: rows of a static set, means of a holding sweep, samples of
// v_dc. With fixed values of the keys in which the claims are not linear,
//
//   y = x beta + rest
//
// y: the residual of the declared model. x: columns of the claims and of nuisances beside them. The
// rules and thresholds are those of the gate, without the second rate. The rule `whole` asks:
//   - no file and channel may have a larger error with all claims than with none,
//   - the unexplained part that neighbouring rows share must be small beside the part that the
//     claims remove, where they act. Otherwise the claims may describe that part by another name.
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
  std::vector<double> lsb = {};  // step of each channel, in the unit of y; empty: no steps

  std::size_t size() const { return judges.size(); }
};

struct PointAnswer {
  Eigen::VectorXd beta;  // fitted to rows that do not judge
  std::vector<Judgement> judgements;
  std::optional<Refused> refused;  // the weakest claim that fails, and its first rule
  std::size_t weakest = 0;
};
// Tests all claims together, and each of them left out.
PointAnswer ask(const PointRows& rows, const std::vector<PointClaim>& claims,
                const Criterion& criterion = {});

// Mean square that neighbouring rows share in `rest`, and its share of the whole; 0 if noise makes
// as much (criterion.sigmas).
struct Shared {
  double power = 0, share = 0;
};
Shared shared_by_neighbours(const Eigen::VectorXd& rest, const PointRows& rows, int channel,
                            const Criterion& criterion = {});

}  // namespace twinrate
