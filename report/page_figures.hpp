// The figures of a written page (report.html of a run, a comparison or a trace) as SVG files.
//
// A page holds its figures as JSON (figure.hpp). The same points are drawn here without a browser,
// with a caption below: the drive's name as the page has it, and the command of the
// page's run, else `command`.
#pragma once
#include <string>
#include <vector>

namespace twinrate::report {

struct PageFigure {
  std::string name;  // for a file: "03-angle-error"
  std::string svg;
};

// In the order of the page. Throws BadInput: no such file, not a page of twinrate, no figure in it.
std::vector<PageFigure> figures_of_page(const std::string& path, const std::string& command);

}  // namespace twinrate::report
