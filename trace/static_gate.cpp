#include "trace/static_gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trace/another_machine.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

using Eigen::Index;

constexpr std::size_t kPiecesOfSet = 24;  // of a file, each with points from all over the set
constexpr std::size_t kBlocksOfSet = 12;  // of all points: odd and even ones should agree

// The step between readings; 0: none. A set with steps has repeated readings.
double step_of(std::vector<double> readings) {
  std::sort(readings.begin(), readings.end());
  const double range = readings.back() - readings.front();
  std::vector<double> gaps;
  for (std::size_t k = 1; k < readings.size(); ++k)
    if (const double gap = readings[k] - readings[k - 1]; gap > 1e-9 * range) gaps.push_back(gap);
  if (gaps.empty() || 2 * gaps.size() > readings.size()) return 0;
  return *std::min_element(gaps.begin(), gaps.end());
}

// The judging piece of each point, within its file. A piece has points from all over the set, so
// that a law which fails at some places is not judged at those places alone.
std::vector<std::size_t> pieces_of(const StaticProblem& p) {
  std::vector<std::size_t> piece(p.order.size(), 0), judging(p.files.size(), 0), seen(judging);
  for (std::size_t k = 0; k < p.order.size(); ++k)
    if (p.role[k] == PointRole::kJudges) ++judging[static_cast<std::size_t>(p.file[k])];
  for (const std::size_t point : p.order)
    if (const auto f = static_cast<std::size_t>(p.file[point]); p.role[point] == PointRole::kJudges)
      piece[point] = seen[f]++ % std::min(kPiecesOfSet, judging[f]);
  return piece;
}

std::vector<PartsOfRows> parts_of(const StaticProblem& p) {
  const std::size_t n = p.order.size(), m = p.channels.size();
  PartsOfRows signs{"the two signs of the current", std::vector<signed char>(n * m, -1)};
  PartsOfRows blocks{"odd and even blocks", std::vector<signed char>(n * m, -1)};
  for (std::size_t c = 0; c < m; ++c)
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t point = p.order[k], row = c * n + point;
      blocks.part[row] = kBlocksOfSet * k / n % 2 == 1;
      if (!p.coordinate.empty() && p.coordinate[point] != 0)
        signs.part[row] = p.coordinate[point] > 0;
    }
  return p.coordinate.empty() ? std::vector{blocks} : std::vector{signs, blocks};
}

PointRows rows_of(const StaticProblem& p, const StaticFit& fit) {
  const std::size_t n = p.order.size(), m = p.channels.size();
  PointRows rows{.y = weighed_residual(p),
                 .x = columns_of(p, fit.terms),
                 .judges = {},
                 .file = {},
                 .channel = {},
                 .piece = {},
                 .next = std::vector<Index>(n * m, -1),
                 .parts = parts_of(p),
                 .files = p.files,
                 .channels = p.channels};
  const std::vector<std::size_t> piece = pieces_of(p);
  for (std::size_t c = 0; c < m; ++c) {
    for (std::size_t k = 0; k < n; ++k) {
      rows.judges.push_back(p.role[k] == PointRole::kJudges);
      rows.file.push_back(p.file[k]);
      rows.channel.push_back(static_cast<int>(c));
      rows.piece.push_back(piece[k]);
      if (!p.ends_line[k])
        rows.next[c * n + p.order[k]] = static_cast<Index>(c * n + p.order[k + 1]);
    }
    rows.lsb.push_back(step_of(p.readings[c]) / p.scale[static_cast<Index>(c)]);
  }
  return rows;
}

// The claims of the first `count` terms.
std::vector<PointClaim> claims_of(const StaticProblem& p, const StaticFit& fit, std::size_t count) {
  std::vector<PointClaim> claims;
  Index column = 0;
  for (std::size_t m = 0; m < count; ++m) {
    const StaticTerm& term = fit.terms[m];
    PointClaim claim{.kind = std::string(term.effect->kind()),
                     .columns = {},
                     .size = term.effect->tracing().materiality(p.facts)};
    for (std::size_t k = 0; k < term.linear.size(); ++k) claim.columns.push_back(column++);
    claims.push_back(std::move(claim));
  }
  return claims;
}

// A claim that leaves next to nothing of a parameter belongs to another machine.
void refuse_another_machine(const StaticProblem& p, const StaticFit& fit, PointAnswer& answer) {
  for (std::size_t m = 0; !answer.refused && m < fit.terms.size(); ++m) {
    const auto [left, name] = least_left(*fit.terms[m].effect, p.facts.machine);
    if (left >= Criterion{}.least_left) continue;
    answer.weakest = m;
    answer.refused =
        Refused{.kind = std::string(fit.terms[m].effect->kind()),
                .rule = "physical",
                .number = left,
                .left = true,
                .text = fmt::format("it leaves {:.2g} of {}: check units, scale and the drive file",
                                    left, name)};
  }
}

// The part of the residual of each channel that neighbours share, if it is worth reporting: as a
// share of the power before, and in size.
void look_at_rest(const StaticProblem& p, const PointRows& rows, StaticSelection& s) {
  constexpr double kLeastShare = 0.04;
  const Eigen::VectorXd rest = Eigen::Map<const Eigen::VectorXd>(
      Eigen::MatrixXd(s.after.rest.array().rowwise() / p.scale.array()).data(), rows.y.size());
  for (Index c = 0; c < p.y.cols(); ++c) {
    const Shared left = shared_by_neighbours(rest, rows, static_cast<int>(c));
    const double size = std::sqrt(left.power) * p.scale[c];
    const double before = p.y.col(c).squaredNorm() / static_cast<double>(p.y.rows());
    if (size * size < kLeastShare * before || size < p.smallest[static_cast<std::size_t>(c)])
      continue;
    s.left.push_back({p.channels[static_cast<std::size_t>(c)], left.share, size});
  }
}

}  // namespace

void pass_gate(const StaticProblem& p, StaticSelection& s) {
  s.constants = fit_static(p, s.before.terms, PointRole::kChooses);
  s.before = fit_static(p, {}, PointRole::kChooses);
  // Effects too small to be reported are present all the same. They are fitted beside the others,
  // so that the others do not take up their part.
  std::vector<StaticTerm> asked = s.after.terms, small;
  while (true) {
    std::vector<StaticTerm> terms = asked;
    terms.insert(terms.end(), small.begin(), small.end());
    const StaticFit fit = fit_static(p, terms, PointRole::kChooses);
    const PointRows rows = rows_of(p, fit);
    PointAnswer answer = ask(rows, claims_of(p, fit, asked.size()));
    s.after = first_terms(p, fit, asked.size(), PointRole::kChooses);
    refuse_another_machine(p, s.after, answer);
    if (!answer.refused) {
      s.judgements = std::move(answer.judgements);
      return look_at_rest(p, rows, s);
    }
    p.hooks.tell(fmt::format("{} refused: {}, {}", answer.refused->kind, answer.refused->rule,
                             answer.refused->text));
    const auto out = asked.begin() + static_cast<std::ptrdiff_t>(answer.weakest);
    if (!answer.refused->leaves_doubt()) small.push_back(*out);
    asked.erase(out);
    s.refused.push_back(std::move(*answer.refused));
  }
}

}  // namespace twinrate
