// A figure of stacked panels as an SVG text: curves, bars over orders, and a list of bars with
// words.
#pragma once
#include <string>
#include <vector>

namespace twinrate::gallery {

struct Curve {
  std::string name;  // "" leaves it out of the legend
  std::string colour;
  std::vector<double> x, y;
};

struct Panel {
  std::string title, x_label;
  std::vector<Curve> curves;
  bool bars = false;            // each point a bar from zero; the largest are labelled with their x
  std::string empty_note = "";  // stands instead of the curves
};

// One line of the last panel: a bar of relative length 0 .. 1, and what it stands for.
struct Line {
  std::string name, text;
  double length = 0;
};

std::string svg(const std::string& title, const std::vector<Panel>& panels,
                const std::string& lines_title, const std::vector<Line>& lines);

}  // namespace twinrate::gallery
