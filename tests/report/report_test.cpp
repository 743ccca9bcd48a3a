#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <map>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "report/figure.hpp"
#include "tests/report/report_run.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Report = ReportTest;

TEST_F(Report, ASalientMachineHasItsStartAndItsLoadSteps) {
  EXPECT_FALSE(any_has(titles_of(content_of(page_of({made_up_run()}))), "Locus"));
  config_.machine.L_d = 1e-3;
  config_.machine.L_q = 2e-3;
  config_.load.T_load_Nm = Profile(std::vector<ProfileStep>{{0.0, 0.0}, {0.5, 0.1}});
  const Json content = content_of(page_of({made_up_run()}));
  std::vector<std::string> headings;
  for (const Json& section : content["sections"]) headings.push_back(section["heading"]);
  EXPECT_TRUE(any_has(headings, "Start"));
  EXPECT_TRUE(any_has(headings, "Load to 0.1 Nm at 0.5 s"));
  for (const char* title : {"Rotor position", "Speed", "Torque", "Locus of the current"})
    EXPECT_TRUE(any_has(titles_of(content), title)) << title;
  expect_whole_figures(content);
}

TEST_F(Report, HasTheNotesOfTheCallUnderItsHeading) {
  const Json content = content_of(page_of({made_up_run()}, {.notes = {"It starts aligned.", "b"}}));
  EXPECT_EQ(content["notes"], Json({"It starts aligned.", "b"}));
  EXPECT_FALSE(content_of(page_of({made_up_run()})).contains("notes"));
}

TEST_F(Report, NeedsNoOtherFile) {
  const std::string page = page_of({made_up_run()});
  EXPECT_EQ(page.find("src="), std::string::npos);
  EXPECT_EQ(page.find("<link"), std::string::npos);
  EXPECT_EQ(page.find("@import"), std::string::npos);
  for (const char* placeholder : {"{{TITLE}}", "{{STYLE}}", "{{UPLOT}}", "{{PAGE}}", "{{SCRIPT}}"})
    EXPECT_EQ(page.find(placeholder), std::string::npos) << placeholder;
  EXPECT_NE(page.find("var uPlot="), std::string::npos);
  EXPECT_LT(page.size(), 3u << 20);
}

TEST_F(Report, OfARunHasEveryFigure) {
  const Json content = content_of(page_of({made_up_run()}));
  EXPECT_EQ(content["title"], "test drive");
  EXPECT_EQ(content["verdict"]["state"], "locked");
  EXPECT_NE(content["verdict"]["text"].get<std::string>().find("f_b = f_s/5 = 1 kHz"),
            std::string::npos);
  EXPECT_NE(content["verdict"]["text"].get<std::string>().find("2.86 deg rms"), std::string::npos);
  const auto titles = titles_of(content);
  for (const char* part :
       {"Speed", "Angle error", "Currents", "Angle variance", "Gains on the angle",
        "(a) Rotor position", "(b) Angle error", "(c) Angle variance", "(d) Gains", "Load torque",
        "Orders of the load-torque"})
    EXPECT_TRUE(any_has(titles, part)) << part;
  expect_whole_figures(content);
}

TEST_F(Report, DrawsEachReferenceOfTheCurrentBesideItsCurrent) {
  RunLog log = made_up_run();
  for (Truth& truth : log.truth) truth.i_dq = {-1, 2};
  for (Command& command : log.command) command.i_dq_ref = {-1.25, 2.5};
  const Json content = content_of(page_of({log}));
  std::map<std::string, double> drawn;
  for (const Json& section : content["sections"])
    for (const Json& figure : section["figures"])
      for (const Json& curve : figure["series"])
        drawn.emplace(curve["name"].get<std::string>(), curve["values"].back().is_number()
                                                            ? curve["values"].back().get<double>()
                                                            : 0);
  EXPECT_EQ(drawn.at("i_d"), -1);
  EXPECT_EQ(drawn.at("i_q"), 2);
  EXPECT_EQ(drawn.at("i_d_ref"), -1.25);
  EXPECT_EQ(drawn.at("i_q_ref"), 2.5);
}

TEST_F(Report, NamesATripBeforeAnyFigure) {
  RunLog log = made_up_run();
  log.events.push_back({.k = 2500,
                        .t_ns = 500'000'000,
                        .role = static_cast<int>(Role::kController),
                        .reason = static_cast<int>(Reason::kLostSynchronism),
                        .text = "zero voltage"});
  const Json verdict = content_of(page_of({log}))["verdict"];
  EXPECT_EQ(verdict["state"], "lost");
  EXPECT_EQ(verdict["headline"],
            "Tripped: lost_synchronism at 0.5000 s, tick 2500, controller: zero voltage");
}

TEST_F(Report, OfALostRunShowsTheLoss) {
  RunLog log = made_up_run();
  for (std::size_t k = 2500; k < log.estimate.size(); ++k) {
    log.truth[k].omega_m = 100 - 0.1 * static_cast<double>(k - 2500);
    log.estimate[k].theta_e = wrap_turn(4 * log.truth[k].theta_m + 2);
  }
  const Json content = content_of(page_of({log}));
  EXPECT_EQ(content["verdict"]["state"], "lost");
  EXPECT_NE(content["verdict"]["headline"].get<std::string>().find("0.5 s"), std::string::npos);
  EXPECT_NE(content["verdict"]["text"].get<std::string>().find("crossed zero at t = 0.700"),
            std::string::npos);
  EXPECT_NEAR(content["sections"][0]["figures"][0]["marks"][0]["x"].get<double>(), 0.5, 1e-9);
  EXPECT_TRUE(any_has(titles_of(content), "(c) Speed after the loss"));
  // Five electrical turns before it and eight after, at 100 rad/s and four pole pairs.
  const Json& t = content["sections"][0]["figures"][0]["x"];
  EXPECT_NEAR(t.front().get<double>(), 0.5 - 5 * kTwoPi / 400, 1e-3);
  EXPECT_NEAR(t.back().get<double>(), 0.5 + 8 * kTwoPi / 400, 1e-3);
  expect_whole_figures(content);
}

TEST_F(Report, OmitsFiguresWithoutData) {
  RunLog measured = made_up_run();
  measured.truth.clear(), measured.gain.clear(), measured.command.clear();
  Json content = content_of(page_of({measured}));
  expect_whole_figures(content);
  EXPECT_TRUE(any_has(titles_of(content), "Angle error"));
  EXPECT_TRUE(any_has(titles_of(content), "Orders of the load-torque"));
  EXPECT_FALSE(any_has(titles_of(content), "Gains"));

  RunLog blind = measured;
  for (Measurement& m : blind.measurement) m.signals = kPhaseCurrents;
  content = content_of(page_of({blind}));
  expect_whole_figures(content);
  EXPECT_EQ(content["verdict"]["state"], "unknown");
  EXPECT_FALSE(any_has(titles_of(content), "Angle error"));

  RunLog commands_only;
  commands_only.command = made_up_run().command;
  expect_whole_figures(content_of(page_of({commands_only})));
  EXPECT_TRUE(content_of(page_of({RunLog()}))["sections"].empty());
  expect_whole_figures(content_of(page_of({RunLog(), blind, made_up_run()})));
}

TEST_F(Report, UsesTheEncoderAsReferenceOnRequest) {
  RunLog log = made_up_run();
  for (Measurement& m : log.measurement) m.theta_m += 0.0125;  // 0.05 rad electrical
  const Json content =
      content_of(page_of({log}, {.title = "", .angle_reference = AngleReference::kEncoder}));
  EXPECT_NE(content["verdict"]["text"].get<std::string>().find("from the measured one"),
            std::string::npos);
}

TEST_F(Report, ComparesRuns) {
  RunLog lost = made_up_run();
  for (std::size_t k = 2500; k < lost.estimate.size(); ++k)
    lost.estimate[k].theta_e = wrap_turn(4 * lost.truth[k].theta_m + 3);
  const Json content = content_of(page_of({made_up_run(), made_up_run(), lost}));
  ASSERT_EQ(content["comparison"]["rows"].size(), 3u);
  EXPECT_EQ(content["comparison"]["rows"][0].size(), content["comparison"]["head"].size());
  std::map<std::string, std::string> cells;
  for (std::size_t i = 0; i < content["comparison"]["head"].size(); ++i)
    cells[content["comparison"]["head"][i]] = content["comparison"]["rows"][2][i];
  EXPECT_NEAR(std::stod(cells.at("rms, deg")),
              std::sqrt((0.3 * 0.05 * 0.05 + 0.5 * 3 * 3) / 0.8) * 180 / kPi, 0.2);
  EXPECT_NEAR(std::stod(cells.at("max, deg")), 3 * 180 / kPi, 0.2);
  EXPECT_EQ(content["sections"][1]["columns"], 3);
  EXPECT_EQ(content["sections"][1]["figures"].size(), 3u);
  EXPECT_EQ(content["sections"][1]["figures"][2]["y_range"], Json::parse("[-180, 180]"));
  EXPECT_TRUE(any_has(titles_of(content), "Gain K41"));
  expect_whole_figures(content);
}

TEST_F(Report, OverlaysRunsWithTheirStepsAndNamesWhatDiffers) {
  RunLog first = made_up_run(), second = made_up_run();
  config_.reference.omega_e_rad_s = Profile(400);
  config_.load.T_load_Nm = Profile({{0, 0}, {0.5, 0.1}});
  for (Truth& truth : first.truth) truth.T_em = 0.25;
  for (std::size_t k = 2500; k < 3000; ++k) second.truth[k].omega_m = 88;  // for 0.1 s
  second.config_toml = "name = \"test drive\"\n[rates]\nn = 13\n";
  const Json content =
      content_of(page_of({first, second}, {}, {R"({"command": "twinrate simulate d.toml"})", ""}));
  const Json& steps = content["sections"][0];
  std::vector<std::string> titles;
  for (const Json& figure : steps["figures"]) {
    titles.push_back(figure["title"]);
    const std::string note = figure["note"];
    EXPECT_NE(note.find("drive test drive, twinrate simulate d.toml"), std::string::npos) << note;
    EXPECT_NE(note.find("command not recorded"), std::string::npos) << note;
    EXPECT_GE(figure["series"].size(), 2u);
  }
  EXPECT_EQ(titles,
            (std::vector<std::string>{"Speed", "Current along q", "Current along d", "Torque"}));
  ASSERT_EQ(steps["table"]["rows"].size(), 2u);
  EXPECT_EQ(steps["table"]["rows"][1][0], "load 0 to 0.1 Nm at 0.5 s");
  EXPECT_EQ(steps["table"]["rows"][0][4], "0 rad/s, 0 %");
  EXPECT_EQ(steps["table"]["rows"][1][4], "12 rad/s, 12 %");
  EXPECT_EQ(steps["table"]["rows"][1][5], "100 ms");
  const Json& differs = content["sections"].back()["table"]["rows"];
  ASSERT_EQ(differs.size(), 1u);
  EXPECT_EQ(differs[0], Json::parse(R"(["rates.n", "-", "13"])"));
}

TEST_F(Report, RunsOfTwoControllersAreNamedByThem) {
  const RunLog log = made_up_run();
  const RunTicks ticks = run_ticks(log);
  const Summary summary = summarise(log, ticks, config_);
  DriveConfig other = config_;
  config_.controller.kind = "foc", other.controller.kind = "lqr";
  const std::string out = (directory_ / "page.html").string();
  write_report({{log, ticks, config_, summary}, {log, ticks, other, summary}}, {}, out);
  std::ostringstream text;
  text << std::ifstream(out).rdbuf();
  const std::string names = content_of(text.str())["sections"][0]["figures"][0].dump();
  EXPECT_NE(names.find("\"foc, "), std::string::npos) << names.substr(0, 400);
  EXPECT_NE(names.find("\"lqr, "), std::string::npos) << names.substr(0, 400);
}

TEST_F(Report, SaysHowManyEventsItsTableLeavesOutAndWhereTheyAre) {
  RunLog log = made_up_run();
  log.path = "runs/long/log.lcm";
  for (int i = 0; i < 500; ++i) log.events.push_back({.k = i, .text = "clamped"});
  EXPECT_EQ(content_of(page_of({log}))["events"].back()[3], "clamped");
  log.counts[static_cast<std::size_t>(Channel::kEvent)] = 30'000;
  const Json events = content_of(page_of({log}))["events"];
  ASSERT_EQ(events.size(), 501u);
  EXPECT_EQ(events.back()[3],
            "29500 more events are not shown: log.lcm holds all 30000, in channel DRIVE_EVENT");
}

TEST_F(Report, NoTextEndsTheScript) {
  RunLog log = made_up_run();
  log.events.push_back(
      {.k = 3, .t_ns = 600000, .role = 77, .reason = 99, .text = "</script><b>\xff"});
  const Json content = content_of(page_of({log}, {.title = "a <b> & {{PAGE}}"}));
  EXPECT_EQ(content["title"], "a <b> & {{PAGE}}");
  EXPECT_EQ(content["events"][0][1], "77");
  EXPECT_NE(content["events"][0][3].get<std::string>().find("</script><b>"), std::string::npos);
}

TEST_F(Report, HasTheCommandOfTheRun) {
  const Json manifest = {{"command", "twinrate simulate own.toml"}};
  EXPECT_EQ(content_of(page_of({made_up_run()}, {}, {manifest.dump()}))["command"],
            "twinrate simulate own.toml");
  EXPECT_FALSE(content_of(page_of({made_up_run()})).contains("command")) << "not recorded";
}

TEST_F(Report, ShowsTheLatencyOfEachHopAndTheLinksOfTheManifest) {
  const RunLog log = made_up_run();
  const RunTicks ticks = run_ticks(log);
  const Summary summary = summarise(log, ticks, config_);
  const std::string out = (directory_ / "page.html").string();
  const auto value_of = [&](const std::string& manifest, const std::string& quantity) {
    write_report({{log, ticks, config_, summary, manifest}}, {}, out);
    std::ostringstream text;
    text << std::ifstream(out).rdbuf();
    const Json content = content_of(text.str());
    for (const Json& row : content["summary"])
      if (row[0] == quantity) return row[1].get<std::string>();
    return std::string("no row");
  };
  const Json us = {{"p50", 101.2}, {"p99", 202}, {"p99_9", 303}, {"max", 404}};
  const Json manifest = {{"latency_us", {{"to_estimate", us}, {"to_command", us}, {"round", us}}},
                         {"links",
                          {{"estimator",
                            {{"host", "b"},
                             {"round_trips", 50},
                             {"round_trips_lost", 2},
                             {"messages_missed", 7},
                             {"clock_offset_us", -12},
                             {"clock_offset_error_us", 9},
                             {"round_trip_us", us}}}}},
                         {"refused_messages", 5}};
  EXPECT_EQ(value_of(manifest.dump(), "MEASUREMENT to COMMAND p50, p99, p99.9"),
            "101, 202, 303 us (largest 404)");
  EXPECT_EQ(
      value_of(manifest.dump(), "link to estimator"),
      "b: round trip p50, p99, p99.9 101, 202, 303 us (largest 404); 2 of 50 lost; 7 messages "
      "missed; clock -12 us, error below 9 us");
  EXPECT_EQ(value_of(manifest.dump(), "messages refused"), "5");
  for (const char* foreign : {"", "[]", "{\"links\": 5}", "{\"latency_us\": {\"round\": 1}}"})
    EXPECT_EQ(value_of(foreign, "link to estimator"), "no row") << foreign;
}

TEST_F(Report, RefusesAnEmptyListAndAnUnwritablePath) {
  EXPECT_THROW(write_report({}, {}, (directory_ / "page.html").string()), BadInput);
  const RunLog log = made_up_run();
  const RunTicks ticks = run_ticks(log);
  const Summary summary = summarise(log, ticks, config_);
  EXPECT_THROW(write_report({{log, ticks, config_, summary}}, {},
                            (directory_ / "no" / "page.html").string()),
               std::runtime_error);
}

}  // namespace
}  // namespace twinrate
