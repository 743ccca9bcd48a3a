// What an effect is drawn against, chosen by its kind.
#pragma once
#include "report/trace_parts.hpp"

namespace twinrate::report {

// A picture in the making.
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

// The picture on the axis on which this kind can be seen by eye; over_share() where it has none.
Plot plot_of(const TraceResult& result, const TracedEffect& effect, const Rows& rows,
             std::size_t half);
// The picture that every kind has: the residual against the effect's own share, both smoothed over
// 2 half + 1 rows; a line of slope one.
Plot over_share(const Rows& rows, std::size_t half);

}  // namespace twinrate::report
