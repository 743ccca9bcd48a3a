// Keeps the lanes in use: the next point replaces a drive that has ended.
#pragma once
#include <atomic>

#include "lanes/drive.hpp"

namespace twinrate::lanes {

// The points of one call of run_lanes; the threads share `next`.
struct LaneQueue {
  const Point* points;
  PointResult* results;
  const std::size_t* order;  // indices into points
  std::size_t size;
  std::atomic<std::size_t>* next;
  const std::atomic<bool>* stop;
  std::atomic<std::size_t>* done;

  static constexpr std::size_t npos = static_cast<std::size_t>(-1);
};

// Index of the next point; npos at the end.
template <class T>
std::size_t take(const LaneQueue& q) {
  if (q.stop && q.stop->load(std::memory_order_relaxed)) return LaneQueue::npos;
  const std::size_t i = q.next->fetch_add(1, std::memory_order_relaxed);
  return i < q.size ? q.order[i] : LaneQueue::npos;
}

// One drive at rest (or flying), before its first tick: engine.cpp.
void prepare(const LaneSettings& settings, const Point& point, LaneDrive<double>& drive);

template <class T>
class LaneRunner {
 public:
  LaneRunner(const LaneSettings& settings, const LaneConstants<double>& c, const LaneQueue& queue)
      : settings_(settings), on_(lane_switches(settings)), queue_(queue) {
    for (int lane = 0; lane < T::N; ++lane) put(lane, c, c_);
  }

  template <Policy policy, bool rk4>
  void run() {
    int running = 0;
    for (int lane = 0; lane < T::N; ++lane) running += fill(lane);
    while (running > 0) {
      typename T::Mask ended;
      do ended = tick<policy, rk4>(c_, on_, drive_);
      while (!any<T>(ended));
      for (int lane = 0; lane < T::N; ++lane) {
        if (!in_lane<T>(ended, lane)) continue;
        if (index_[lane] != LaneQueue::npos) {
          report(lane);
          --running;
        }
        running += fill(lane);
      }
    }
  }

 private:
  // A lane without a point gets a drive that never ends.
  bool fill(int lane) {
    index_[lane] = take<T>(queue_);
    const bool has_point = index_[lane] != LaneQueue::npos;
    Point point = queue_.points[has_point ? index_[lane] : 0];
    LaneDrive<double> drive;
    prepare(settings_, point, drive);
    if (!has_point) drive.k_end = drive.k_settle = 1e15;
    put(lane, drive, drive_);
    return has_point;
  }
  void report(int lane) {
    LaneDrive<double> drive;
    get(lane, drive);
    PointResult& result = queue_.results[index_[lane]];
    result.locked = drive.lost == 0;
    const double count = drive.k - drive.k_settle;
    result.angle_error_rms_rad = count > 0 ? __builtin_sqrt(drive.error_square_sum / count) : 0;
    result.angle_error_max_rad = drive.error_max;
    result.lost_at_s = result.locked ? -1 : (drive.k - 1) * settings_.T_s;
    if (queue_.done) queue_.done->fetch_add(1, std::memory_order_relaxed);
  }
  // A drive is a column of LaneDrive<T>, a set of constants a column of LaneConstants<T>.

  static_assert(sizeof(LaneDrive<T>) == sizeof(LaneDrive<double>) * T::N);
  static_assert(sizeof(LaneConstants<T>) == sizeof(LaneConstants<double>) * T::N);
  template <template <class> class Rows>
  static void put(int lane, const Rows<double>& column, Rows<T>& rows) {
    for (std::size_t row = 0; row < sizeof column / 8; ++row)
      __builtin_memcpy(reinterpret_cast<char*>(&rows) + row * sizeof(T) + 8 * lane,
                       reinterpret_cast<const char*>(&column) + row * 8, 8);
  }
  void get(int lane, LaneDrive<double>& drive) const {
    for (std::size_t row = 0; row < sizeof drive / 8; ++row)
      __builtin_memcpy(reinterpret_cast<char*>(&drive) + row * 8,
                       reinterpret_cast<const char*>(&drive_) + row * sizeof(T) + 8 * lane, 8);
  }

  const LaneSettings& settings_;
  const LaneSwitches on_;
  const LaneQueue& queue_;
  LaneConstants<T> c_;
  LaneDrive<T> drive_;
  std::size_t index_[T::N];
};

template <class T, Policy policy>
void run_policy(const LaneSettings& settings, const LaneConstants<double>& c,
                const LaneQueue& queue) {
  LaneRunner<T> runner(settings, c, queue);
  if (settings.rk4)
    runner.template run<policy, true>();
  else
    runner.template run<policy, false>();
}

// All points of the queue have this policy.
template <class T>
void run_lanes(const LaneSettings& settings, const LaneConstants<double>& c, Policy policy,
               const LaneQueue& queue) {
  switch (policy) {
    case Policy::kPaper:
      return run_policy<T, Policy::kPaper>(settings, c, queue);
    case Policy::kImmediate:
      return run_policy<T, Policy::kImmediate>(settings, c, queue);
    case Policy::kExtrapolate:
      return run_policy<T, Policy::kExtrapolate>(settings, c, queue);
    case Policy::kRotate:
      return run_policy<T, Policy::kRotate>(settings, c, queue);
    case Policy::kRotorFrame:
      return run_policy<T, Policy::kRotorFrame>(settings, c, queue);
    default:
      return;
  }
}

}  // namespace twinrate::lanes
