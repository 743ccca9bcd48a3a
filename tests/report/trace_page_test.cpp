#include "report/trace_page.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "model/frames.hpp"
#include "model/random.hpp"
#include "report/trace_curves.hpp"
#include "trace/correction.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kRate_Hz = 1000, kAmplitude_Nm = 0.05;
constexpr int kRows = 8000, kOrder = 24;

// 8 s at 5 rad/s with cogging of order 24 and some noise; every fourth second kept back.
TraceResult made_up_trace() {
  TraceResult r;
  r.verdict = "traced";
  r.sentence = "The model lacks cogging.";
  r.sources = {"<b>log</b> & more.csv"};
  TracedEffect cogging{.effect = make_effect("cogging"), .equation = "mechanical"};
  cogging.parameters = {{"order", "per_rev", kOrder, {}, ""},
                        {"amplitude", "Nm", kAmplitude_Nm, 0.0001234, ""}};
  EffectView view{.channel = "torque", .without = {}, .share = {}};
  TraceSeries& s = r.series_torque;
  for (int n = 0; n < kRows; ++n) {
    const double t = n / kRate_Hz, theta_m = 5 * t;
    const double share = kAmplitude_Nm * std::sin(kOrder * theta_m),
                 e = 0.01 * normal(7, 1, static_cast<std::uint64_t>(n));
    s.t.push_back(t), s.theta_m.push_back(theta_m), s.omega_m.push_back(5);
    s.i_d.push_back(0), s.i_q.push_back(1);
    s.before.push_back(share + e), s.after.push_back(e);
    s.held_out.push_back(static_cast<int>(t) % 4 == 3);
    view.without.push_back(share + e), view.share.push_back(share);
  }
  s.rate_Hz = kRate_Hz;
  cogging.views = {view};
  r.effects = {cogging};
  r.mechanical = EquationError{.unit = "Nm", .before = {0.037, 0.039}, .after = {0.01, 0.012}};
  r.rejected = {{"eccentric_load", 3, 0.001, "explains less"}};
  r.not_identifiable = {{"iron_loss", "this record does not excite it"}};
  return r;
}

std::string page_of(const TraceResult& result) {
  const fs::path path =
      fs::temp_directory_path() / ("twinrate-trace-page-" + std::to_string(getpid()) + ".html");
  write_trace_page(result, {.drive = "</script> drive", .extended_toml = "", .n_p = 3},
                   path.string());
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  fs::remove(path);
  return text.str();
}

Json content_of(const std::string& page) {
  const std::string open = "<script type=\"application/json\" id=\"content\">";
  const std::size_t from = page.find(open) + open.size();
  return Json::parse(page.substr(from, page.find("</script>", from) - from));
}

const Json* section_with(const Json& content, const std::string& part) {
  for (const Json& section : content["sections"])
    if (section["heading"].get<std::string>().find(part) != std::string::npos) return &section;
  return nullptr;
}

TEST(TracePage, NeedsNoOtherFileAndEscapesNames) {
  const std::string page = page_of(made_up_trace());
  for (const char* foreign : {"src=", "<link", "@import", "{{PAGE}}", "<b>log", "<title></script>"})
    EXPECT_EQ(page.find(foreign), std::string::npos) << foreign;
  EXPECT_NE(page.find("<title>What the model of &lt;/script> drive lacks"), std::string::npos);
  EXPECT_EQ(content_of(page)["subtitle"], "Trace of <b>log</b> & more.csv");
}

// The row that begins with `first`, anywhere in the page.
const Json* row_of(const Json& json, const std::string& first) {
  if (json.is_array() && !json.empty() && json[0] == first) return &json;
  if (json.is_structured())
    for (const auto& item : json.items())
      if (const Json* found = row_of(item.value(), first)) return found;
  return nullptr;
}

TEST(TracePage, TheErrorsStandBeforeAndAfterOfTrainingAndOfHeldOutRows) {
  const Json content = content_of(page_of(made_up_trace()));
  const Json* row = row_of(content, "torque (Nm)");
  ASSERT_NE(row, nullptr);
  const char* const expected[] = {"0.037", "0.01", "0.039", "0.012"};
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ((*row)[i + 1], expected[i]) << i;
}

TEST(TracePage, ShowsTheVerdictFirst) {
  TraceResult result = made_up_trace();
  Json content = content_of(page_of(result));
  EXPECT_EQ(content["verdict"]["headline"], "The model lacks cogging.");
  EXPECT_EQ(content["verdict"]["state"], "good");
  const Json& first = content["sections"][0]["table"]["rows"][0];
  EXPECT_EQ(first[0], "cogging");
  EXPECT_EQ(first[2], "order 24 a turn, amplitude 0.05 +- 0.00012 Nm");
  result.verdict = "ambiguous";
  EXPECT_EQ(content_of(page_of(result))["verdict"]["state"], "unsure");
}

TEST(TracePage, AnAlternativeThatWasNotRefinedHasNoHeldOutGain) {
  TraceResult result = made_up_trace();
  result.rejected.push_back({"torsion", 2, std::nan(""), "explains less"});
  const Json content = content_of(page_of(result));
  const Json& considered = *section_with(content, "Alternatives considered");
  EXPECT_EQ(considered["table"]["rows"][0][3], "0.1 %");
  EXPECT_EQ(considered["table"]["rows"][1][3], "-");
  EXPECT_NE(considered["note"].get<std::string>().find("(-) the BIC is an estimate"),
            std::string::npos);
}

// Its picture is one period: 24 a turn are 15 deg, and the curve is the sine.
TEST(TracePage, DrawsTheEffectOverTheDataThatShowsIt) {
  const Json content = content_of(page_of(made_up_trace()));
  const Json* section = section_with(content, "cogging: order 24");
  ASSERT_NE(section, nullptr);
  const Json& figure = (*section)["figures"][0];
  EXPECT_GT(figure["x"].back(), 14.0);
  EXPECT_LT(figure["x"].back(), 15.0);
  ASSERT_EQ(figure["series"].size(), 3u);
  for (std::size_t i = 0; i < figure["x"].size(); ++i) {
    const double sine =
        kAmplitude_Nm * std::sin(kOrder * figure["x"][i].get<double>() * kTwoPi / 360);
    EXPECT_NEAR(figure["series"][2]["values"][i], sine, 0.002);
    EXPECT_NEAR(figure["series"][0]["values"][i], sine, 0.005);  // 5 sigma of the mean of 100
    EXPECT_NEAR(figure["series"][1]["values"][i], sine, 0.009);
  }
  for (const Json& each : content["sections"])
    for (const Json& drawn : each["figures"])
      for (const Json& curve : drawn["series"])
        EXPECT_EQ(curve["values"].size(), drawn["x"].size()) << drawn["title"];
}

// The page reports an effect that the residual does not follow.
TEST(TracePage, ReportsAnEffectThatTheResidualDoesNotFollow) {
  TraceResult r = made_up_trace();
  const auto note = [&] {
    const Json content = content_of(page_of(r));
    return (*section_with(content, "cogging: order 24"))["note"].get<std::string>();
  };
  EXPECT_EQ(note().find("do not support"), std::string::npos) << note();
  r.effects[0].views[0].without = r.series_torque.after;
  EXPECT_NE(note().find("do not support"), std::string::npos) << note();
}

TEST(TracePage, IsCompleteWithoutSeries) {
  TraceResult nothing;
  nothing.verdict = "ambiguous";
  nothing.sentence = "The record is too short.";
  const Json content = content_of(page_of(nothing));
  EXPECT_EQ(content["verdict"]["headline"], "The record is too short.");
  EXPECT_NE(section_with(content, "Effects that this record cannot show"), nullptr);
  EXPECT_EQ(section_with(content, "Residual of"), nullptr);
}

TEST(TraceCurves, BothSpectraShowTheAmplitudeOfASine) {
  const TraceResult r = made_up_trace();
  const TraceSeries& s = r.series_torque;
  const std::vector<double> orders = report::order_amplitudes(s.theta_m, s.before, 60);
  ASSERT_EQ(orders.size(), 60u);
  EXPECT_NEAR(orders[kOrder - 1], kAmplitude_Nm, 0.001);
  EXPECT_LT(orders[kOrder], 0.002);
  const report::Spectrum spectrum = report::line_spectrum(s.t, s.before, s.rate_Hz);
  const auto top = std::max_element(spectrum.amplitude.begin(), spectrum.amplitude.end());
  EXPECT_NEAR(*top, kAmplitude_Nm, 0.03 * kAmplitude_Nm);
  const auto at = static_cast<std::size_t>(top - spectrum.amplitude.begin());
  EXPECT_NEAR(spectrum.f_Hz[at], kOrder * 5 / kTwoPi, 0.7);
}

// Two logs that both begin at 0 s, and two that lie a week apart.
TEST(TraceCurves, ASpectrumOfSeveralLogsKeepsItsLine) {
  const TraceResult r = made_up_trace();
  for (double second_from_s : {0.0, 7 * 86400.0}) {
    TraceSeries s = r.series_torque;
    for (std::size_t n = 0; n < r.series_torque.t.size(); ++n) {
      s.t.push_back(second_from_s + r.series_torque.t[n]);
      s.before.push_back(r.series_torque.before[n]);
    }
    const report::Spectrum spectrum = report::line_spectrum(s.t, s.before, s.rate_Hz);
    const auto top = std::max_element(spectrum.amplitude.begin(), spectrum.amplitude.end());
    const auto at = static_cast<std::size_t>(top - spectrum.amplitude.begin());
    EXPECT_NEAR(spectrum.f_Hz[at], kOrder * 5 / kTwoPi, 0.7);
    EXPECT_GT(*top, 0.5 * kAmplitude_Nm);
    EXPECT_LT(*top, 1.1 * kAmplitude_Nm);
  }
}

TEST(TraceCurves, AnOrderSpectrumNeedsTheWholeTurn) {
  std::vector<double> theta_m, y(8000, 1.0);
  for (int n = 0; n < 8000; ++n) theta_m.push_back(3.0 * n / 8000);
  EXPECT_TRUE(report::order_amplitudes(theta_m, y, 60).empty());
}

// 0.02 Nm |i_q| with noise of 0.01 Nm: the table removes it on held-out rows, and changes almost
// nothing without structure.
TEST(CorrectionTable, HelpsOnUnseenRowsOnlyWhereThereIsStructure) {
  for (const double size : {0.02, 0.0}) {
    TraceResult r = made_up_trace();
    TraceSeries& s = r.series_torque;
    for (std::size_t i = 0; i < s.t.size(); ++i) {
      s.i_q[i] = 3 * std::sin(1.7 * s.t[i]);
      s.after[i] += size * std::abs(s.i_q[i]);
    }
    r.unexplained = {{.regressor = "i_q",
                      .share = 0.5,
                      .equation = "mechanical",
                      .channel = "torque",
                      .text = "depends on i_q"}};
    r.corrections = corrections_of(r);
    ASSERT_EQ(r.corrections.size(), 1u);
    const CorrectionTable& c = r.corrections[0];
    EXPECT_NEAR(c.at(2.0), size * 2, 0.003);
    EXPECT_NEAR(c.at(-1.0), size * 1, 0.003);
    EXPECT_NEAR(c.after.held_out, 0.01, 0.0006);
    EXPECT_NEAR(c.before.held_out / c.after.held_out, size > 0 ? 3.1 : 1, size > 0 ? 0.4 : 0.01);
  }
}

// Rows kept back say something else: the table does not know it.
TEST(CorrectionTable, IsFittedToTrainingRowsAlone) {
  TraceResult r = made_up_trace();
  TraceSeries& s = r.series_torque;
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    s.i_q[i] = 3 * std::sin(1.7 * s.t[i]);
    s.after[i] = (s.held_out[i] ? -0.05 : 0.02) * std::abs(s.i_q[i]);
  }
  r.unexplained = {{.regressor = "i_q",
                    .share = 0.5,
                    .equation = "mechanical",
                    .channel = "torque",
                    .text = "depends on i_q"}};
  const std::vector<CorrectionTable> tables = corrections_of(r);
  ASSERT_EQ(tables.size(), 1u);
  EXPECT_NEAR(tables[0].at(2), 0.04, 0.002);
  EXPECT_LT(tables[0].after.train, 0.1 * tables[0].before.train);
  EXPECT_GT(tables[0].after.held_out, 1.2 * tables[0].before.held_out);
}

}  // namespace
}  // namespace twinrate
