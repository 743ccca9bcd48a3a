#include "trace/whitening.hpp"

#include <algorithm>
#include <cmath>

#include "trace/fir.hpp"

namespace twinrate {
namespace {

// Calls f(first, end) for each run.
template <class F>
void for_each_run(const Runs& runs, F&& f) {
  for (std::size_t r = 0; r < runs.start.size(); ++r)
    f(static_cast<Eigen::Index>(runs.start[r]),
      static_cast<Eigen::Index>(r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size()));
}

}  // namespace

Whitener::Whitener(const Eigen::VectorXd& noise, const Runs& runs, int most) {
  Eigen::VectorXd c = Eigen::VectorXd::Zero(most + 1);
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    for (Eigen::Index lag = 0; lag <= most && lag < end - first; ++lag)
      c[lag] += noise.segment(first + lag, end - first - lag)
                    .dot(noise.segment(first, end - first - lag));
  });
  c /= std::max<double>(1, static_cast<double>(noise.size()));
  const double floor = 1e-9 * c[0] + 1e-300;
  c[0] += floor;
  Eigen::VectorXd a = Eigen::VectorXd::Zero(0);
  double power = c[0];
  const auto keep = [&] {
    sigma_.push_back(std::sqrt(std::max(power, floor)));
    taps_.emplace_back(a.size() + 1);
    taps_.back() << -a.reverse(), 1;
    taps_.back() /= sigma_.back();
  };
  keep();
  for (int order = 1; order <= most; ++order) {
    double reflection = c[order];
    for (int j = 0; j < order - 1; ++j) reflection -= a[j] * c[order - 1 - j];
    reflection /= power;
    Eigen::VectorXd next(order);
    for (int j = 0; j < order - 1; ++j) next[j] = a[j] - reflection * a[order - 2 - j];
    next[order - 1] = reflection;
    a = next;
    power *= 1 - reflection * reflection;
    keep();
  }
}

Eigen::VectorXd Whitener::operator()(const Eigen::VectorXd& y, const Runs& runs) const {
  Eigen::VectorXd e(y.size());
  const auto p = static_cast<Eigen::Index>(taps_.size()) - 1;
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    const Eigen::Index steady = std::min<Eigen::Index>(first + p, end);
    for (Eigen::Index n = first; n < steady; ++n) {
      const Eigen::Index known = n - first + 1;
      e[n] = taps_[static_cast<std::size_t>(known) - 1].dot(y.segment(first, known));
    }
    if (end > steady)
      filter_along({taps_.back().data(), taps_.size()}, y.data() + steady - p,
                   static_cast<std::size_t>(end - steady), e.data() + steady);
  });
  return e;
}

}  // namespace twinrate
