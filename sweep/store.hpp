// points.csv of a sweep: appended as the points come, so that a killed sweep continues where it
// was.
#pragma once
#include <fstream>
#include <mutex>

#include "sweep/point.hpp"

namespace twinrate::sweep {

// Text of one row; a double is written so that it reads back as the same bits.
std::string row_of(const Point& point);
extern const char* const kPointsHeader;

// Throws BadInput with file:line. A last line without its end (the sweep was killed while it wrote)
// is left out.
std::vector<Point> read_points(const std::string& path);
// In the order of the plan, then n. Throws BadInput where a point is there twice or is not the
// plan's.
void sort_points(const Plan& plan, std::vector<Point>& points);
void write_points(const std::string& path, const std::vector<Point>& points);

// Appends whole lines, flushed one by one.
class PointFile {
 public:
  // `resume`: keeps what is there; else the file begins anew.
  PointFile(const std::string& path, bool resume);
  const std::vector<Point>& found() const { return found_; }
  void append(const Point& point);

 private:
  std::vector<Point> found_;
  std::ofstream file_;
  std::mutex mutex_;
};

}  // namespace twinrate::sweep
