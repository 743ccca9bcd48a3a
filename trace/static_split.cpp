#include "trace/static_split.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

struct Ranks {
  std::vector<std::size_t> rank;
  std::size_t levels = 0;
};

Ranks ranks_of(const std::vector<double>& values) {
  std::vector<double> levels(values);
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  Ranks ranks{.rank = {}, .levels = levels.size()};
  for (const double value : values)
    ranks.rank.push_back(static_cast<std::size_t>(
        std::lower_bound(levels.begin(), levels.end(), value) - levels.begin()));
  return ranks;
}

// Points in the order of the rows and columns of their grid or, if they form none, of the first
// coordinate.
void put_in_order(const Ranks& rows, const Ranks& columns, bool grid, StaticProblem& p) {
  p.order.resize(rows.rank.size());
  std::iota(p.order.begin(), p.order.end(), std::size_t{0});
  std::stable_sort(p.order.begin(), p.order.end(), [&](std::size_t a, std::size_t b) {
    if (p.file[a] != p.file[b]) return p.file[a] < p.file[b];
    if (rows.rank[a] != rows.rank[b]) return rows.rank[a] < rows.rank[b];
    return grid && columns.rank[a] < columns.rank[b];
  });
  p.ends_line.assign(p.order.size(), 0);
  for (std::size_t k = 0; k < p.order.size(); ++k) {
    const std::size_t own = p.order[k];
    p.ends_line[k] = k + 1 == p.order.size() || p.file[p.order[k + 1]] != p.file[own] ||
                     (grid && rows.rank[p.order[k + 1]] != rows.rank[own]);
  }
}

// True if each sign has at least a quarter of the points.
bool has_both_signs(const std::vector<double>& x) {
  const auto above = std::count_if(x.begin(), x.end(), [](double value) { return value > 0; });
  const auto below = std::count_if(x.begin(), x.end(), [](double value) { return value < 0; });
  return 4 * std::min(above, below) >= static_cast<long>(x.size());
}

}  // namespace

std::string split_points(const StaticSet& set, const std::vector<double>& first,
                         const std::vector<double>& second, const std::vector<char>& held_out,
                         const char* rule, StaticProblem& p) {
  p.file = set.file;
  p.files = set.files;
  if (p.file.empty()) p.file.assign(first.size(), 0);
  if (p.files.empty()) p.files = {set.path};
  const Ranks rows = ranks_of(first),
              columns = second.empty() ? Ranks{.rank = rows.rank, .levels = 0} : ranks_of(second);
  const bool grid = !second.empty() && rows.levels * columns.levels <= 2 * first.size();
  put_in_order(rows, columns, grid, p);
  p.coordinate = !second.empty() && has_both_signs(second) ? second
                 : has_both_signs(first)                   ? first
                                                           : std::vector<double>{};
  p.role.assign(first.size(), PointRole::kFits);
  for (std::size_t k = 0, left = 0; k < p.order.size(); ++k) {
    const std::size_t point = p.order[k];
    PointRole& role = p.role[point];
    if (!held_out.empty()) {
      role = held_out[point]   ? PointRole::kJudges
             : left++ % 4 == 3 ? PointRole::kChooses
                               : PointRole::kFits;
      continue;
    }
    const std::size_t row = rows.rank[point], column = columns.rank[point];
    const bool fits = grid ? (row + column) % 2 == 0 : k % 2 == 0;
    const bool judges = grid ? row % 2 == 0 : k % 4 == 1;
    role = fits ? PointRole::kFits : judges ? PointRole::kJudges : PointRole::kChooses;
  }
  return held_out.empty() ? rule : "the points given";
}

}  // namespace twinrate
