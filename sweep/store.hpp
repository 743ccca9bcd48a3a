// points.csv of a sweep. Points are appended one by one, so that a killed sweep can be resumed.
#pragma once
#include <fstream>
#include <mutex>

#include "sweep/point.hpp"

namespace twinrate::sweep {

// Text of one row. A double reads back bit for bit.
std::string row_of(const Point& point);
extern const char* const kPointsHeader;

// Throws BadInput with file:line. Ignores a last line without a line end (a killed sweep).
std::vector<Point> read_points(const std::string& path);
// Sorts by the plan's searches, then n. Throws BadInput for a repeated point or a point that is not
// in the plan.
void sort_points(const Plan& plan, std::vector<Point>& points);
void write_points(const std::string& path, const std::vector<Point>& points);

// Appends lines, each flushed.
class PointFile {
 public:
  // `resume`: keeps the points of the file; else starts an empty file.
  PointFile(const std::string& path, bool resume);
  const std::vector<Point>& found() const { return found_; }
  void append(const Point& point);

 private:
  std::vector<Point> found_;
  std::ofstream file_;
  std::mutex mutex_;
};

}  // namespace twinrate::sweep
