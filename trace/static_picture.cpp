#include "trace/static_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace twinrate {
namespace {

struct Axis {
  std::string label;
  std::vector<double> x;
};

Axis axis_of(const StaticProblem& p, Eigen::Index channel, StaticKind kind) {
  const Eigen::Index along = kind == StaticKind::kFluxMap ? channel : 0;
  Axis axis{.label = kind != StaticKind::kFluxMap ? "current of the phase (A)"
                     : channel == 0               ? "i_d (A)"
                                                  : "i_q (A)"};
  for (const OperatingPoint& point : p.points) axis.x.push_back(point.i_dq[along]);
  return axis;
}

// The residual at the points, in ascending order of x.
TracePicture picture(const StaticTrace& trace, const Axis& axis, Eigen::Index channel) {
  const StaticSelection& s = trace.selection;
  TracePicture picture;
  std::vector<std::size_t> order(axis.x.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return axis.x[i] < axis.x[j]; });
  for (const std::size_t i : order) {
    const auto row = static_cast<Eigen::Index>(i);
    picture.x.push_back(axis.x[i]);
    picture.before.push_back(s.before.rest(row, channel));
    picture.after.push_back(s.after.rest(row, channel));
    picture.held_out.push_back(trace.problem.role[i] == PointRole::kJudges);
  }
  picture.x_label = axis.label;
  return picture;
}

}  // namespace

std::vector<TracePicture> static_pictures(const StaticTrace& trace, StaticKind kind) {
  std::vector<TracePicture> pictures;
  const char* unit = kind == StaticKind::kFluxMap ? "Wb" : "V";
  for (Eigen::Index c = 0; c < trace.problem.y.cols(); ++c) {
    const std::string& name = trace.problem.channels[static_cast<std::size_t>(c)];
    TracePicture one = picture(trace, axis_of(trace.problem, c, kind), c);
    one.title = fmt::format("What is left of {}", name);
    one.y_label = fmt::format("{} ({})", name, unit);
    pictures.push_back(std::move(one));
  }
  return pictures;
}

}  // namespace twinrate
