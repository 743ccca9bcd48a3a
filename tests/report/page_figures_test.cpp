// The figures of a page as SVG: every figure, with its curves, captions and gaps.
#include "report/page_figures.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "core/config.hpp"

namespace twinrate::page_figures_test {
namespace {

namespace fs = std::filesystem;

class PageFigures : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = fs::temp_directory_path() / ("twinrate-figures-" + std::to_string(getpid()) + ".html");
  }
  void TearDown() override { fs::remove(path_); }
  std::vector<report::PageFigure> figures(const std::string& json) const {
    std::ofstream(path_) << "<html><script type=\"application/json\" id=\"content\">" << json
                         << "</script></html>";
    return report::figures_of_page(path_.string(), "twinrate figures run");
  }
  fs::path path_;
};

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++n;
  return n;
}

TEST_F(PageFigures, EachHasItsCurvesAndTheNameOfTheDrive) {
  const auto list = figures(R"json({"title": "M4 <new>", "sections": [
    {"heading": "no figures"},
    {"figures": [
      {"title": "Speed, true & estimated", "x_label": "t (s)", "y_label": "rad/s", "x": [0, 1, 2, 3],
       "series": [{"name": "true", "role": "true", "values": [1, 2, null, 4]},
                  {"name": "estimated", "role": "hat", "stepped": true, "values": [1, 2, 3, 4]}],
       "marks": [{"x": 2, "text": "load"}], "level": {"y": 3, "text": "limit"}, "shaded": [[1, 2]]},
      {"title": "Orders", "x": [1, 6], "bars": true,
       "series": [{"name": "rms", "role": "hat", "values": [0.1, 2.5]}]},
      {"title": "Error", "x": [1, 2], "log_y": true,
       "series": [{"name": "e", "role": "dots", "values": [0.01, 10], "errors": [0.001, 1]}]}]}]})json");
  ASSERT_EQ(list.size(), 3u);
  EXPECT_EQ(list[0].name, "01-speed-true-estimated");
  for (const auto& figure : list) {
    EXPECT_TRUE(figure.svg.starts_with("<svg ") && figure.svg.ends_with("</svg>\n"));
    EXPECT_NE(figure.svg.find("M4 &lt;new>. twinrate figures run"), std::string::npos);
    EXPECT_EQ(figure.svg.find("nan"), std::string::npos) << figure.svg;
    EXPECT_EQ(figure.svg.find("inf"), std::string::npos) << figure.svg;
  }
  EXPECT_NE(list[0].svg.find("Speed, true &amp; estimated"), std::string::npos);
  // The first curve has a gap: two strokes, the second begins behind it.
  const std::size_t at = list[0].svg.find("stroke=\"#b4bcc4\" stroke-width");
  const std::size_t path = list[0].svg.rfind("d=\"", at);
  EXPECT_EQ(count(list[0].svg.substr(path, at - path), "M"), 2u);
  EXPECT_NE(list[0].svg.find(">load<"), std::string::npos);
  EXPECT_NE(list[0].svg.find(">limit<"), std::string::npos);
  EXPECT_NE(list[1].svg.find(">6</text>"), std::string::npos) << "the largest bar has its order";
  EXPECT_NE(list[2].svg.find(">0.1</text>"), std::string::npos) << "powers of ten on the axis";
}

TEST_F(PageFigures, AnotherFileIsRefused) {
  EXPECT_THROW(report::figures_of_page("/no/such/page.html", ""), BadInput);
  for (const char* json :
       {"", "[]", "{}", R"({"sections": []})", R"({"sections": [{"figures": [{}]}]})",
        R"({"sections": [{"figures": [{"x": 3, "series": 7}]}]})", R"({"sections": 5})",
        R"({"sections": [7]})"})
    EXPECT_THROW(figures(json), BadInput) << json;
}

TEST_F(PageFigures, TheCommandOfTheRunStandsBesideTheName) {
  const auto list = figures(R"json({"title": "own", "command": "twinrate simulate own.toml",
    "sections": [{"figures": [{"title": "Speed", "x": [1, 2],
      "series": [{"name": "true", "role": "true", "values": [1, 2]}]}]}]})json");
  ASSERT_EQ(list.size(), 1u);
  EXPECT_NE(list[0].svg.find("own. twinrate simulate own.toml<"), std::string::npos);
}

}  // namespace
}  // namespace twinrate::page_figures_test
