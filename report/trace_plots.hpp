// The picture of an effect, chosen by its kind.
#pragma once
#include "report/trace_parts.hpp"

namespace twinrate::report {

// A picture before it is a Figure.
struct Plot {
  Points points;
  std::string title, x_label, y_label, note;
  double lo = 0, hi = 1;
  int bins = 48;
};

// The rows of one channel.
struct Rows {
  const TraceSeries& s;
  const EffectView& view;
  ChannelWords words;
  int n_p;

  std::size_t size() const { return s.t.size(); }
  double theta_e(std::size_t i) const { return n_p * s.theta_m[i]; }
};

// The picture on the axis that shows this kind best; over_share() if there is none.
Plot plot_of(const TraceResult& result, const TracedEffect& effect, const Rows& rows,
             std::size_t half);
// The default picture: the residual over the effect's share, both smoothed over 2 half + 1 rows,
// and a line of slope one.
Plot over_share(const Rows& rows, std::size_t half);

}  // namespace twinrate::report
