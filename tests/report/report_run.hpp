// A made-up run and the page of it.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "report/report.hpp"

namespace twinrate {

class ReportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ =
        std::filesystem::temp_directory_path() / ("twinrate-report-" + std::to_string(getpid()));
    std::filesystem::create_directories(directory_);
    config_.name = "test drive";
    config_.machine.n_p = 4;
    config_.rates.f_s_Hz = 5000;
    config_.rates.n = 5;
    config_.run.duration_s = 1;
    config_.run.settle_s = 0.2;
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }

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

  static nlohmann::json content_of(const std::string& page) {
    const std::string open = "<script type=\"application/json\" id=\"content\">";
    const std::size_t from = page.find(open) + open.size();
    return nlohmann::json::parse(page.substr(from, page.find("</script>", from) - from));
  }

  static std::vector<std::string> titles_of(const nlohmann::json& content) {
    std::vector<std::string> titles;
    for (const nlohmann::json& section : content["sections"])
      for (const nlohmann::json& figure : section["figures"]) titles.push_back(figure["title"]);
    return titles;
  }

  static bool any_has(const std::vector<std::string>& titles, const std::string& part) {
    return std::any_of(titles.begin(), titles.end(), [&](const std::string& title) {
      return title.find(part) != std::string::npos;
    });
  }

  // Every figure on the page has values on an axis of the same length.
  static void expect_whole_figures(const nlohmann::json& content) {
    for (const nlohmann::json& section : content["sections"])
      for (const nlohmann::json& figure : section["figures"]) {
        EXPECT_FALSE(figure["series"].empty()) << figure["title"];
        EXPECT_NE(figure["x_label"], "") << figure["title"];
        EXPECT_NE(figure["y_label"].get<std::string>().find('('), std::string::npos)
            << figure["title"];
        for (const nlohmann::json& curve : figure["series"])
          EXPECT_EQ(curve["values"].size(), figure["x"].size()) << figure["title"];
      }
  }

  DriveConfig config_;
  std::filesystem::path directory_;
};

inline const nlohmann::json& section_of(const nlohmann::json& content, const std::string& heading) {
  for (const nlohmann::json& section : content["sections"])
    if (section["heading"].get<std::string>().find(heading) != std::string::npos) return section;
  throw std::runtime_error("no section " + heading);
}

}  // namespace twinrate
