#include "bridge/device_clock.hpp"

#include <cmath>
#include <vector>

#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate {
namespace {

// Twice the area of the triangle; positive if c is left of the line from a to b.
template <class Point>
double turn(const Point& a, const Point& b, const Point& c) {
  return static_cast<double>(b.device_us - a.device_us) *
             static_cast<double>(c.late_ns - a.late_ns) -
         static_cast<double>(b.late_ns - a.late_ns) *
             static_cast<double>(c.device_us - a.device_us);
}

}  // namespace

std::int64_t DeviceClock::take(std::uint32_t time_us, std::int64_t arrival_ns) {
  if (!begun_) {
    begun_ = true;
    first_arrival_ns_ = arrival_ns;
    block_end_us_ = kBlock_us;
    last_ = time_us;
  }
  device_us_ += twp_difference(time_us, last_);
  last_ = time_us;
  const Point point{device_us_, arrival_ns - first_arrival_ns_ - 1000 * device_us_};
  if (!block_begun_ || point.late_ns < open_.late_ns) open_ = point;
  block_begun_ = true;
  if (points_.empty()) late_at_0_ns_ = static_cast<double>(open_.late_ns);
  if (device_us_ < block_end_us_) return device_us_;
  points_.push_back(open_);
  if (points_.size() > kBlocks) points_.pop_front();
  block_end_us_ = device_us_ + kBlock_us;
  block_begun_ = false;
  fit();
  return device_us_;
}

// The lower hull by Andrew's monotone chain; of all lines below the points, its edge over their mean
// has the least sum of distances.
void DeviceClock::fit() {
  std::vector<Point> hull;
  double mean = 0;
  for (const Point& p : points_) {
    while (hull.size() >= 2 && turn(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
    hull.push_back(p);
    mean += static_cast<double>(p.device_us) / static_cast<double>(points_.size());
  }
  std::size_t right = 1;
  while (right + 1 < hull.size() && static_cast<double>(hull[right].device_us) < mean) ++right;
  if (hull.size() < 2) {
    drift_ = 0;
    late_at_0_ns_ = static_cast<double>(hull.front().late_ns);
    return;
  }
  const Point &a = hull[right - 1], &b = hull[right];
  const double slope = static_cast<double>(b.late_ns - a.late_ns) /
                       static_cast<double>(b.device_us - a.device_us);  // ns per us
  drift_ = 1e-3 * slope;
  late_at_0_ns_ = static_cast<double>(a.late_ns) - slope * static_cast<double>(a.device_us);
}

std::int64_t DeviceClock::host_ns(std::int64_t device_us) const {
  return first_arrival_ns_ + 1000 * device_us +
         std::llround(late_at_0_ns_ + 1e3 * drift_ * static_cast<double>(device_us));
}

}  // namespace twinrate
