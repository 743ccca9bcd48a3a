// Ripple and load over the angle on the page of a run.
#include <cmath>
#include <map>

#include "tests/report/report_run.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::json;
using Report = ReportTest;

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

}  // namespace
}  // namespace twinrate
