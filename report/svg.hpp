// A figure of stacked panels as SVG text: curves, bars over orders, and a list of labelled bars.
#pragma once
#include <string>
#include <vector>

namespace twinrate::gallery {

struct Curve {
  std::string name;  // "": not in the legend
  std::string colour;
  std::vector<double> x, y;
};

struct Panel {
  std::string title, x_label;
  std::vector<Curve> curves;
  bool bars = false;       // a bar for each point; the largest are labelled with their x
  std::string empty_note;  // shown instead of the curves
};

// One line of the last panel: a bar of relative length 0 .. 1 and its label.
struct Line {
  std::string name, text;
  double length = 0;
};

std::string svg(const std::string& title, const std::vector<Panel>& panels,
                const std::string& lines_title, const std::vector<Line>& lines);

}  // namespace twinrate::gallery
