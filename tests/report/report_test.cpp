#include "report/report.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/channels.hpp"
#include "core/config.hpp"
#include "core/reason.hpp"
#include "report/figure.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class Report : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("twinrate-report-" + std::to_string(getpid()));
    fs::create_directories(directory_);
    config_.name = "test drive";
    config_.machine.n_p = 4;
    config_.rates.f_s_Hz = 5000;
    config_.rates.n = 5;
    config_.run.duration_s = 1;
    config_.run.settle_s = 0.2;
  }
  void TearDown() override { fs::remove_all(directory_); }

  // A run at 100 rad/s with an estimate 0.05 rad ahead, and a load of orders 6 and 24.
  RunLog made_up_run() const {
    RunLog log;
    log.path = "runs/made-up";
    log.config_toml = "name = \"test drive\"\n";
    for (std::int64_t k = 0; k < config_.steps(); ++k) {
      const double theta_m = 100 * static_cast<double>(k) * config_.T_s();
      const std::int64_t t_ns = config_.t_ns(k);
      log.truth.push_back({.k = k, .t_ns = t_ns, .omega_m = 100, .theta_m = theta_m});
      Measurement m;
      m.k = k, m.t_ns = t_ns, m.signals = kPhaseCurrents | kPosition, m.theta_m = theta_m;
      log.measurement.push_back(m);
      Estimate e;
      e.k = k, e.t_ns = t_ns, e.omega_m = 100, e.gain_seq = k / 5 * 5 - 5;
      e.theta_e = wrap_turn(4 * theta_m + 0.05);
      e.T_load = 0.02 * std::sin(6 * theta_m) + 0.01 * std::sin(24 * theta_m);
      log.estimate.push_back(e);
      Command c;
      c.k = k, c.t_ns = t_ns, c.omega_m_ref = 100;
      log.command.push_back(c);
      Gain g;
      g.k = k, g.t_ns = t_ns, g.n_x = 4, g.n_y = 2;
      g.P(3, 3) = 0.4;
      if (k % 5 == 0) log.gain.push_back(g);
    }
    return log;
  }

  std::string page_of(const std::vector<RunLog>& logs, const ReportOptions& options = {},
                      const std::vector<std::string>& manifests = {}) const {
    std::vector<RunTicks> tables;
    std::vector<Summary> summaries;
    for (const RunLog& log : logs) {
      tables.push_back(run_ticks(log));
      summaries.push_back(summarise(log, tables.back(), config_, options.angle_reference));
    }
    std::vector<ReportRun> runs;
    for (std::size_t i = 0; i < logs.size(); ++i)
      runs.push_back(
          {logs[i], tables[i], config_, summaries[i], manifests.empty() ? "" : manifests[i]});
    const std::string out = (directory_ / "page.html").string();
    write_report(runs, options, out);
    std::ostringstream text;
    text << std::ifstream(out).rdbuf();
    return text.str();
  }

  static Json content_of(const std::string& page) {
    const std::string open = "<script type=\"application/json\" id=\"content\">";
    const std::size_t from = page.find(open) + open.size();
    return Json::parse(page.substr(from, page.find("</script>", from) - from));
  }

  static std::vector<std::string> titles_of(const Json& content) {
    std::vector<std::string> titles;
    for (const Json& section : content["sections"])
      for (const Json& figure : section["figures"]) titles.push_back(figure["title"]);
    return titles;
  }

  static bool any_has(const std::vector<std::string>& titles, const std::string& part) {
    return std::any_of(titles.begin(), titles.end(), [&](const std::string& title) {
      return title.find(part) != std::string::npos;
    });
  }

  // Every figure on the page has values on an axis of the same length.
  static void expect_whole_figures(const Json& content) {
    for (const Json& section : content["sections"])
      for (const Json& figure : section["figures"]) {
        EXPECT_FALSE(figure["series"].empty()) << figure["title"];
        EXPECT_NE(figure["x_label"], "") << figure["title"];
        EXPECT_NE(figure["y_label"].get<std::string>().find('('), std::string::npos)
            << figure["title"];
        for (const Json& curve : figure["series"])
          EXPECT_EQ(curve["values"].size(), figure["x"].size()) << figure["title"];
      }
  }

  DriveConfig config_;
  fs::path directory_;
};

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

const Json& section_of(const Json& content, const std::string& heading) {
  for (const Json& section : content["sections"])
    if (section["heading"].get<std::string>().find(heading) != std::string::npos) return section;
  throw std::runtime_error("no section " + heading);
}

TEST_F(Report, NamesTheOrdersOfTheLoadAndTheirSources) {
  config_.machine.n_slots = 18;  // of 4 pole pairs: poles at 8 and 24, dead time at 24
  RunLog log = made_up_run();
  for (std::size_t k = 0; k < log.estimate.size(); ++k)  // a floor of noise
    log.estimate[k].T_load += 5e-4 * std::sin(1e4 * std::sin(1.7 * static_cast<double>(k)));
  const Json content = content_of(page_of({log}));
  const Json& section = section_of(content, "its sources");
  const Json& spectrum = section["figures"].back();
  ASSERT_EQ(spectrum["bars"], true);
  const Json& amplitude = spectrum["series"][0]["values"];
  EXPECT_NEAR(amplitude[5].get<double>(), 0.02, 1e-4);
  EXPECT_NEAR(amplitude[23].get<double>(), 0.01, 1e-4);
  EXPECT_LT(amplitude[6].get<double>(), 1e-4);
  std::map<std::string, Json> rows;
  for (const Json& row : section["table"]["rows"]) rows[row[0]] = row;
  EXPECT_EQ(rows.at("24")[2],
            "dead time and flux harmonics; cogging from the poles: cannot be told apart at one "
            "speed and load");
  EXPECT_EQ(rows.at("24")[3], "yes");
  EXPECT_EQ(rows.at("6")[3], "yes");
  EXPECT_NE(rows.at("6")[2].get<std::string>().find("none in motor or inverter"),
            std::string::npos);
  EXPECT_EQ(rows.at("18")[3], "no") << "a source without a ripple";
  EXPECT_EQ(spectrum["bar_labels"][1]["text"], "24 dead time/flux+poles");
}

// Ripple of 2 rad/s (order 3) that a change of the compensation at 0.6 s cuts to a tenth.
TEST_F(Report, ReportsTheRippleBeforeAndAfterAChangeOfTheCompensation) {
  config_.controller.kind = "lqr";
  config_.controller.compensation = Profile({{0, 0}, {0.6, 1}});
  RunLog log = made_up_run();
  for (Truth& truth : log.truth)
    truth.omega_m += (truth.t_ns < 600000000 ? 2 : 0.2) * std::sin(3 * truth.theta_m);
  // A load that steps makes a dip, not a ripple: the figures begin behind it.
  config_.load.T_load_Nm = Profile({{0, 0}, {0.3, 0.5}});
  for (Truth& truth : log.truth)
    if (truth.t_ns >= 300000000)
      truth.omega_m -= 20 * std::exp(-100 * (1e-9 * static_cast<double>(truth.t_ns) - 0.3));
  const Json content = content_of(page_of({log}));
  const Json& section = section_of(content, "Speed ripple");
  EXPECT_EQ(section["figures"][0]["marks"][0]["x"], 0.6);
  EXPECT_EQ(section["figures"][0]["marks"][0]["text"], "compensation paper");
  const Json& rows = section["table"]["rows"];
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0][0], "off");
  EXPECT_EQ(rows[1][0], "paper");
  EXPECT_NEAR(std::stod(rows[0][4].get<std::string>()), std::sqrt(2), 2e-3);
  EXPECT_EQ(rows[1][5], "-20.0 dB");
  EXPECT_EQ(rows[1][7], "-20.0 dB");
  EXPECT_NEAR(std::stod(rows[0][8].get<std::string>()), 0, 0.01);  // it drifts nowhere
  const Json& orders = section_of(content, "Orders of the speed")["figures"];
  ASSERT_EQ(orders.size(), 2u);
  EXPECT_NEAR(orders[0]["series"][0]["values"][2].get<double>(), 2, 2e-3);
  EXPECT_NEAR(orders[1]["series"][0]["values"][2].get<double>(), 0.2, 2e-4);
  EXPECT_EQ(orders[0]["y_range"], orders[1]["y_range"]);
  expect_whole_figures(content);
}

// Two speeds, each with ripple that a change of the compensation at 0.6 s cuts to a tenth.
TEST_F(Report, PutsTheRippleOfEveryCompensationAtEverySpeedOnOnePage) {
  config_.controller.kind = "lqr";
  config_.controller.compensation = Profile({{0, 0}, {0.6, 1}});
  const auto run_at = [&](double omega_m_ref, double ripple) {
    RunLog log = made_up_run();
    for (Command& command : log.command) command.omega_m_ref = omega_m_ref;
    for (Truth& truth : log.truth)
      truth.omega_m +=
          (truth.t_ns < 600000000 ? ripple : 0.1 * ripple) * std::sin(3 * truth.theta_m);
    return log;
  };
  const double omega_m_at_30rpm = 30 * kTwoPi / 60, omega_m_at_50rpm = 50 * kTwoPi / 60;
  const Json content =
      content_of(page_of({run_at(omega_m_at_50rpm, 1), run_at(omega_m_at_30rpm, 2)}));
  const Json& section = section_of(content, "Speed ripple of each compensation");
  EXPECT_EQ(section["table"]["head"], Json({"compensation", "30 rpm", "50 rpm"}));
  const Json& rows = section["table"]["rows"];
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0], Json({"off", "1.414", "0.7071"}));
  EXPECT_EQ(rows[1][0], "paper");
  EXPECT_EQ(rows[1][1], "0.1414 (-20.0 dB)");
  EXPECT_NEAR(std::stod(rows[1][2].get<std::string>()), 0.05 * std::sqrt(2), 1e-4);
  ASSERT_EQ(section["figures"].size(), 3u) << "rms over the speed, and one turn at each speed";
  EXPECT_EQ(section["figures"][0]["x"], Json({30, 50}));
  EXPECT_EQ(section["figures"][0]["series"].size(), 2u);
  expect_whole_figures(content);
}

// The same load, seen 0.035 rad (2.005 deg) later by the second run.
TEST_F(Report, ComparesTheShapeOfTheLoadOverTheAngle) {
  RunLog later = made_up_run();
  for (std::size_t k = 0; k < later.estimate.size(); ++k) {
    const double theta_m = later.truth[k].theta_m - 0.035;
    later.estimate[k].T_load = 0.02 * std::sin(6 * theta_m) + 0.01 * std::sin(24 * theta_m);
  }
  const Json content = content_of(page_of({made_up_run(), later}));
  const Json& rows = section_of(content, "over the angle")["table"]["rows"];
  EXPECT_EQ(rows[0][1], "1.000");
  const double plain = (4 * std::cos(6 * 0.035) + std::cos(24 * 0.035)) / 5;
  EXPECT_NEAR(std::stod(rows[0][2].get<std::string>()), plain, 1e-3);
  EXPECT_NE(rows[0][2].get<std::string>().find("1.000 turned by 2.0 deg"), std::string::npos)
      << rows[0][2];
}

// A ripple beyond 20 % is no loss of synchronism if the angle is that of a sensor.
TEST_F(Report, ALargeRippleIsUnevenAndNoLoss) {
  RunLog log = made_up_run();
  for (Truth& truth : log.truth) truth.omega_m += 30 * std::sin(3 * truth.theta_m);
  const Json verdict = content_of(page_of({log}))["verdict"];
  EXPECT_EQ(verdict["state"], "locked");
  EXPECT_NE(verdict["headline"].get<std::string>().find("uneven"), std::string::npos);
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
