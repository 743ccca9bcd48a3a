// Numbers of a figure as its page holds them.
#include "report/figure.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace twinrate {
namespace {

using Json = nlohmann::json;

TEST(Figure, ANumberIsTheNearestOneWithFiveDigits) {
  report::Figure figure;
  report::Series curve{"values", "hat", {0, -0.0, 1, 400, 1e-300, 1e300, 99999.5, 0.99999501}};
  curve.values.reserve(5000);
  // The middle of two decimals is no double: the exact value decides.
  for (const double middle : {1.00005, 2.00015, 81235.5, 3.14145e-7, 1.23455e12, 9.99995})
    for (const double value : {std::nextafter(middle, 0), middle, std::nextafter(middle, 1e99)})
      curve.values.push_back(value), curve.values.push_back(-value);
  for (int i = 0; i < 4000; ++i) curve.values.push_back(std::sin(i) * std::pow(10, i % 60 - 30));
  const std::vector<double> values = curve.values;
  figure.x = values;
  figure.add(curve);
  const Json json = Json::parse(report::text_of(report::to_json(figure)));
  for (std::size_t i = 0; i < values.size(); ++i) {
    EXPECT_EQ(json["series"][0]["values"][i], std::stod(fmt::format("{:.4e}", values[i])));
    EXPECT_EQ(json["x"][i], std::stod(fmt::format("{:.8e}", values[i])));
  }
}

TEST(Figure, ThinningKeepsPeaksAndGaps) {
  report::Figure figure;
  report::Series curve{"angle error", "hat", std::vector<double>(100000, 0.25)};
  curve.values[54321] = 40;
  curve.values[54400] = -7;
  for (std::size_t i = 80000; i < 90000; ++i)
    curve.values[i] = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 100000; ++i) figure.x.push_back(i * 1e-4);
  figure.add(curve);
  const Json json = Json::parse(report::text_of(report::to_json(figure, 2000)));
  const Json& values = json["series"][0]["values"];
  ASSERT_EQ(values.size(), 2000u);
  EXPECT_EQ(values.size(), json["x"].size());
  EXPECT_NE(std::find(values.begin(), values.end(), 40), values.end());
  EXPECT_NE(std::find(values.begin(), values.end(), -7), values.end());
  EXPECT_NEAR(static_cast<double>(std::count(values.begin(), values.end(), nullptr)), 200, 2);
}

}  // namespace
}  // namespace twinrate
