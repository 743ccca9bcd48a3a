#include "trace/suspicion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/effects/tracing.hpp"
#include "trace/dictionary.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kBlocks = 24;
constexpr std::size_t kLeastBlocks = 5;  // on each side, for a deviation from their scatter
constexpr double kSuspicious = 12;       // W for each coefficient
constexpr double kLouder = 1.3;          // power of a block over the median; below it is scatter

using Channel = Eigen::VectorXd Sampled::*;
constexpr Channel kChannels[] = {&Sampled::d, &Sampled::q, &Sampled::torque};

// X'X and X'y of one block, whitened.
struct Block {
  Eigen::MatrixXd A;
  Eigen::VectorXd g;
};

// Ends of the blocks, in rows: evenly spaced, and at each seam.
std::vector<std::size_t> edges_of(std::size_t rows, const std::vector<std::size_t>& seams) {
  std::vector<std::size_t> edges;
  for (std::size_t b = 1; b < kBlocks; ++b) {
    const std::size_t edge = rows * b / kBlocks;
    const bool at_seam = std::any_of(seams.begin(), seams.end(), [&](std::size_t seam) {
      return 4 * kBlocks * (std::max(seam, edge) - std::min(seam, edge)) < rows;
    });
    if (!at_seam) edges.push_back(edge);
  }
  edges.insert(edges.end(), seams.begin(), seams.end());
  edges.push_back(rows);
  std::sort(edges.begin(), edges.end());
  return edges;
}

class Blocks {
 public:
  Blocks(const Chain& chain, const Sampled& left, const std::vector<std::size_t>& edges)
      : chain_(chain), left_(left), edges_(edges) {}
  std::vector<Block> of(const std::vector<Sampled>& columns) const {
    const auto p = static_cast<Eigen::Index>(columns.size());
    std::vector<Block> blocks(edges_.size(),
                              {Eigen::MatrixXd::Zero(p, p), Eigen::VectorXd::Zero(p)});
    for (const Channel channel : kChannels) {
      const Eigen::VectorXd& y = left_.*channel;
      if (!y.size() || !(columns.front().*channel).size()) continue;
      const Runs& runs =
          channel == &Sampled::torque ? chain_.sampler().torque() : chain_.sampler().electrical();
      std::size_t b = 0;
      Eigen::VectorXd x(p);
      for (Eigen::Index i = 0; i < y.size(); ++i) {
        while (runs.row[static_cast<std::size_t>(i)] >= edges_[b]) ++b;
        for (Eigen::Index j = 0; j < p; ++j)
          x[j] = (columns[static_cast<std::size_t>(j)].*channel)[i];
        blocks[b].A.noalias() += x * x.transpose();
        blocks[b].g += y[i] * x;
      }
    }
    return blocks;
  }

 private:
  const Chain& chain_;
  const Sampled& left_;
  const std::vector<std::size_t>& edges_;
};

// The noise of a channel is that of its quieter half of blocks, so it excludes a later effect.
Whitener quiet_noise(const Eigen::VectorXd& y, const Runs& runs,
                     const std::vector<std::size_t>& edges) {
  std::vector<std::size_t> block(static_cast<std::size_t>(y.size()));
  std::vector<double> energy(edges.size(), 0), rows(edges.size(), 1e-12);
  for (std::size_t i = 0, b = 0; i < block.size(); ++i) {
    while (runs.row[i] >= edges[b]) ++b;
    block[i] = b;
    energy[b] += y[static_cast<Eigen::Index>(i)] * y[static_cast<Eigen::Index>(i)];
    rows[b] += 1;
  }
  for (std::size_t b = 0; b < edges.size(); ++b) energy[b] /= rows[b];
  std::vector<double> sorted = energy;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double median = sorted[sorted.size() / 2];
  Eigen::VectorXd quiet(y.size());
  Runs of_quiet;
  Eigen::Index count = 0;
  for (std::size_t i = 0, run = 0; i < block.size(); ++i) {
    const bool starts = run < runs.start.size() && runs.start[run] == i;
    run += starts;
    if (energy[block[i]] > median) continue;
    if (starts || i == 0 || energy[block[i - 1]] > median)
      of_quiet.start.push_back(static_cast<std::size_t>(count));
    of_quiet.row.push_back(runs.row[i]);
    quiet[count++] = y[static_cast<Eigen::Index>(i)];
  }
  quiet.conservativeResize(count);
  return Whitener(quiet, of_quiet);
}

// Coefficients over a subset of the blocks, and the sum of two covariances: from the scatter of the
// blocks, and from white noise.
struct Side {
  bool valid = false;
  Eigen::VectorXd b;
  Eigen::MatrixXd C;
  double explained = 0;  // g'A^-1 g
};

Side side_of(const std::vector<Block>& blocks, const std::vector<char>& in) {
  Side side;
  const Eigen::Index p = blocks.front().g.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(p, p), V = A;
  Eigen::VectorXd g = Eigen::VectorXd::Zero(p);
  double n = 0;
  for (std::size_t k = 0; k < blocks.size(); ++k)
    if (in[k]) A += blocks[k].A, g += blocks[k].g, ++n;
  const Eigen::LDLT<Eigen::MatrixXd> solver(A);
  constexpr double kIll = 1e-8;
  if (solver.info() != Eigen::Success || solver.vectorD().minCoeff() <= kIll * A.trace())
    return side;
  side.b = solver.solve(g);
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    if (!in[k]) continue;
    const Eigen::VectorXd score = blocks[k].g - blocks[k].A * side.b;
    V += score * score.transpose();
  }
  const Eigen::MatrixXd inverse = solver.solve(Eigen::MatrixXd::Identity(p, p));
  side.C = n / (n - 1) * inverse * V * inverse + inverse;
  side.explained = g.dot(side.b);
  side.valid = true;
  return side;
}

// True if a block of some channel exceeds the median block; else nothing begins or ends there.
bool any_louder(const Chain& chain, const Sampled& white, const std::vector<std::size_t>& edges) {
  for (const Channel channel : kChannels) {
    const Runs& runs =
        channel == &Sampled::torque ? chain.sampler().torque() : chain.sampler().electrical();
    std::vector<double> power(edges.size(), 0), rows(edges.size(), 1e-12), sorted;
    for (std::size_t i = 0, b = 0; i < static_cast<std::size_t>((white.*channel).size()); ++i) {
      while (runs.row[i] >= edges[b]) ++b;
      power[b] += std::pow((white.*channel)[static_cast<Eigen::Index>(i)], 2);
      rows[b] += 1;
    }
    for (std::size_t b = 0; b < edges.size(); ++b)
      if (rows[b] > 1) sorted.push_back(power[b] / rows[b]);
    if (sorted.empty()) continue;
    std::sort(sorted.begin(), sorted.end());
    if (sorted.back() > kLouder * sorted[sorted.size() / 2]) return true;
  }
  return false;
}

struct Suspect {
  double gain = 0;
  std::size_t row = 0;
};

// Blocks that are compared with the others: those from a moment on, or those of one file.
struct Split {
  std::vector<char> behind;
  std::size_t row = 0;  // first row of these blocks
};

std::vector<Split> splits_of(const std::vector<std::size_t>& edges,
                             const std::vector<std::size_t>& seams) {
  std::vector<Split> splits;
  const auto from = [&](std::size_t first, std::size_t end) {
    Split split{.behind = std::vector<char>(edges.size(), 0), .row = edges[first - 1]};
    std::fill(split.behind.begin() + static_cast<std::ptrdiff_t>(first),
              split.behind.begin() + static_cast<std::ptrdiff_t>(end), 1);
    const auto count = end - first;
    if (count >= kLeastBlocks && edges.size() - count >= kLeastBlocks)
      splits.push_back(std::move(split));
  };
  for (std::size_t k = 1; k < edges.size(); ++k) from(k, edges.size());
  const auto block_at = [&](std::size_t seam) {
    return static_cast<std::size_t>(std::find(edges.begin(), edges.end(), seam) - edges.begin()) +
           1;
  };
  for (std::size_t s = 0; s + 1 < seams.size(); ++s)
    from(block_at(seams[s]), block_at(seams[s + 1]));
  return splits;
}

void look(const std::vector<Block>& blocks, const std::vector<Split>& splits, Suspect& best) {
  const Side all = side_of(blocks, std::vector<char>(blocks.size(), 1));
  if (!all.valid) return;
  for (const Split& split : splits) {
    std::vector<char> others;
    for (const char in : split.behind) others.push_back(!in);
    const Side before = side_of(blocks, others), behind = side_of(blocks, split.behind);
    if (!before.valid || !behind.valid) continue;
    const double gain = before.explained + behind.explained - all.explained;
    if (gain <= best.gain) continue;
    const Eigen::VectorXd change = behind.b - before.b;
    const double W = change.dot((before.C + behind.C).ldlt().solve(change));
    if (W > kSuspicious * static_cast<double>(change.size()))
      best = {.gain = gain, .row = split.row};
  }
}

}  // namespace

std::optional<std::size_t> suspicious_row(const Record& whole, const DriveConfig& drive,
                                          const Effects& found,
                                          const std::vector<std::size_t>& seams) {
  const std::size_t rows = rows_as_one(whole.T_s);
  const Record record = thinned(whole, rows, drive.machine.n_p);
  const Equations equations(record, drive.facts(), drive.model_effects());
  const Sampler sampler(record, moving_rows(record), std::vector<char>(record.size(), 0));
  Chain chain(equations, equations, equations, sampler);
  const Sampled left = chain.residual(found);
  std::vector<std::size_t> thin_seams;
  thin_seams.reserve(seams.size());
  for (const std::size_t seam : seams) thin_seams.push_back(seam * record.size() / whole.size());
  const std::vector<std::size_t> edges = edges_of(record.size(), thin_seams);
  NoiseModel noise;
  if (left.d.size()) noise.d = quiet_noise(left.d, sampler.electrical(), edges);
  if (left.q.size()) noise.q = quiet_noise(left.q, sampler.electrical(), edges);
  if (left.torque.size()) noise.torque = quiet_noise(left.torque, sampler.torque(), edges);
  chain.set_noise(std::move(noise));
  const Sampled white = chain.whitened(left);
  if (!any_louder(chain, white, edges)) return std::nullopt;
  const Blocks blocks(chain, white, edges);
  const std::vector<Split> splits = splits_of(edges, thin_seams);
  Suspect best;
  std::vector<Candidate> candidates = make_candidates(chain, [](const Effect& effect) {
    return effect.tracing().traits().noise != Traits::Noise::kMimics && !is_shaft(effect) &&
           effect.tracing().regressor_count() > 0 && !has_key(effect, "time_s");
  });
  for_each_index(candidates.size(), [&](std::size_t i) {
    for (Sampled& column : candidates[i].columns) column = chain.whitened(column);
  });
  for (const Candidate& candidate : candidates) look(blocks.of(candidate.columns), splits, best);
  if (best.gain <= 0) return std::nullopt;
  for (std::size_t s = 0; s < seams.size(); ++s)
    if (best.row == thin_seams[s]) return seams[s];
  return best.row * whole.size() / record.size();
}

}  // namespace twinrate
