#include "sweep/store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <tuple>

#include "core/output_file.hpp"

namespace twinrate::sweep {
namespace {

std::string whole_lines(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  const std::string all = text.str();
  return all.substr(0, all.rfind('\n') == std::string::npos ? 0 : all.rfind('\n') + 1);
}

Point parse_row(const std::string& line, const std::string& where) {
  std::stringstream stream(line);
  std::vector<std::string> cells;
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
  try {
    if (cells.size() != 10) throw std::invalid_argument("columns");
    Point p;
    p.search = {cells[0], std::stod(cells[2]), std::stoi(cells[6])};
    p.f_s_Hz = std::stod(cells[3]);
    p.n = std::stoi(cells[4]);
    p.locked = std::stoi(cells[7]) != 0;
    p.angle_error_rms = std::stod(cells[8]);
    p.angle_error_max = std::stod(cells[9]);
    return p;
  } catch (const std::exception&) {
    throw BadInput(fmt::format("{}: not a row of points.csv: {}", where, line));
  }
}

void write_whole(const std::string& path, const std::vector<Point>& points) {
  PartFile part(path);
  std::ofstream file(part.part_path());
  file << kPointsHeader << '\n';
  for (const Point& point : points) file << row_of(point) << '\n';
  file.close();
  if (!file) part.fail();
  part.finish();
}

}  // namespace

const char* const kPointsHeader =
    "policy,omega_e_rad_s,f_e_Hz,f_s_Hz,n,f_b_Hz,seed,locked,angle_error_rms_rad,"
    "angle_error_max_rad";

std::string row_of(const Point& p) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{}", p.search.policy, kTwoPi * p.search.f_e_Hz,
                     p.search.f_e_Hz, p.f_s_Hz, p.n, p.f_s_Hz / p.n, p.search.seed,
                     p.locked ? 1 : 0, p.angle_error_rms, p.angle_error_max);
}

std::vector<Point> read_points(const std::string& path) {
  std::stringstream text(whole_lines(path));
  std::vector<Point> points;
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (number == 1 && line != kPointsHeader)
      throw BadInput(fmt::format("{}:1: the columns are not those of points.csv", path));
    if (number > 1) points.push_back(parse_row(line, fmt::format("{}:{}", path, number)));
  }
  return points;
}

void sort_points(const Plan& plan, std::vector<Point>& points) {
  const auto place = [](const auto& list, const auto& item) {
    return std::find(list.begin(), list.end(), item) - list.begin();
  };
  const auto key = [&](const Point& p) {
    return std::make_tuple(place(plan.policies, p.search.policy),
                           place(plan.speeds_Hz, p.search.f_e_Hz), p.search.seed, p.n);
  };
  std::sort(points.begin(), points.end(),
            [&](const Point& a, const Point& b) { return key(a) < key(b); });
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Point& p = points[i];
    const std::string name = fmt::format("policy {}, {} Hz, n = {}, seed {}", p.search.policy,
                                         p.search.f_e_Hz, p.n, p.search.seed);
    if (i > 0 && key(points[i - 1]) == key(p)) throw BadInput("a point is there twice: " + name);
    if (place(plan.policies, p.search.policy) == std::ssize(plan.policies) ||
        place(plan.speeds_Hz, p.search.f_e_Hz) == std::ssize(plan.speeds_Hz) || p.search.seed < 1 ||
        p.search.seed > plan.seeds)
      throw BadInput("a point is not of this sweep: " + name);
  }
}

void write_points(const std::string& path, const std::vector<Point>& points) {
  write_whole(path, points);
}

PointFile::PointFile(const std::string& path, bool resume) {
  if (resume && std::filesystem::exists(path)) found_ = read_points(path);
  write_whole(path, found_);
  file_.open(path, std::ios::app);
}

void PointFile::append(const Point& point) {
  const std::lock_guard<std::mutex> lock(mutex_);
  file_ << row_of(point) << '\n' << std::flush;
}

}  // namespace twinrate::sweep
