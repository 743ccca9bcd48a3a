// Import of a recorded real motor, replayed through the disturbance filter. The data are not in the
// repository: TWINRATE_MEASURED, else ../shared/measured; without them the test is skipped with a
// message.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "analysis/order_spectrum.hpp"
#include "core/run_log.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/two_rate.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

std::string measured_directory() {
  const char* given = std::getenv("TWINRATE_MEASURED");
  return given && *given ? given : std::string(TWINRATE_SOURCE_DIR) + "/../shared/measured";
}

// Imports with the program and returns the log.
RunLog import_speed_test(const std::string& csv) {
  const fs::path out =
      fs::temp_directory_path() / ("twinrate-laas-" + std::to_string(getpid()) + ".lcm");
  const std::string command = std::string(TWINRATE_PROGRAM) + " import " + csv + " --map " +
                              TWINRATE_SOURCE_DIR + "/tools/maps/laas_speed_test.toml --out " +
                              out.string() + " >/dev/null";
  EXPECT_EQ(std::system(command.c_str()), 0);
  RunLog log = read_run_log(out.string());
  fs::remove(out);
  return log;
}

TEST(LaasCogging, LoadTorqueOfTheRealMotorPeaksAtOrder72) {
  const std::string csv = measured_directory() + "/laas_cogging/speed_test_old.csv";
  if (!fs::exists(csv))
    GTEST_SKIP() << csv << " is not on this machine: set TWINRATE_MEASURED to the measured data";
  const RunLog log = import_speed_test(csv);
  ASSERT_GT(log.measurement.size(), 15000u);

  Config config = load_drive("laas_mn4004");
  const auto filter = make_filter(config);
  FastLoop fast(filter, config.drive().gain.policy, config.drive().rates.n);
  BackgroundLoop background(filter, config.drive().gain.policy, config.drive().rates.n);
  std::vector<double> theta_m, T_load;
  for (const Measurement& m : log.measurement) {
    const Estimate e = fast.tick(m);
    EXPECT_EQ(e.n_x, 2) << "no voltages in the log: the filter must be the reduced one";
    if (is_snapshot(m.k, config.drive().rates.n)) fast.take_gain(background.step(e));
    if (m.t_ns < 2'000'000'000) continue;
    theta_m.push_back(m.theta_m);
    T_load.push_back(e.T_load);
  }

  const OrderSpectrum spectrum = order_spectrum(theta_m, T_load, 150);
  ASSERT_GT(spectrum.turns, 8);
  const auto& amplitude = spectrum.amplitude;
  const auto peak = std::max_element(amplitude.begin(), amplitude.end());
  EXPECT_EQ(peak - amplitude.begin() + 1, 72) << "24 poles and 18 slots";
  std::vector<double> sorted(amplitude);
  std::nth_element(sorted.begin(), sorted.begin() + 75, sorted.end());
  EXPECT_GT(*peak, 20 * sorted[75]) << "times the median order";
  EXPECT_GT(*peak, 0.004);
  EXPECT_LT(*peak, 0.007);
}

}  // namespace
}  // namespace twinrate
