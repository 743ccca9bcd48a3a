// Drive logs of any length as one record: short ones whole, long ones in blocks; equal rows from a
// plain, gzipped or wrapped file.
#include "drive_log/drive_logs.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "core/config.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"
#include "drive_log/log_reader.hpp"
#include "drive_log/measured_files.hpp"
#include "drive_log/moments.hpp"
#include "drive_log/same_readings.hpp"
#include "drive_log/trace_drive_logs.hpp"
#include "import/import_log.hpp"
#include "import/whole_log.hpp"
#include "model/effects/effect.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/keys.hpp"
#include "trace/tracer.hpp"
#include "verify/verify_logs.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

class DriveLogsTest : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-drive-logs-{}", getpid());
    fs::create_directories(directory_);
    static const RawLog kLog = simulate_synthetic({.duration_s = kSeconds});
    raw_ = kLog;
  }
  void TearDown() override { fs::remove_all(directory_); }
  // The synthetic drive as a CSV; `angle` modifies its angle.
  template <class Angle>
  std::string write(const std::string& name, Angle&& angle) const {
    std::string text = "t,i_a,i_b,u_alpha,u_beta,v_dc,torque,theta_m\n";
    for (std::size_t k = 0; k < raw_.size(); ++k)
      text += fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.12g}\n", raw_.t[k],
                          raw_.i_a[k], raw_.i_b[k], raw_.u_alpha[k], raw_.u_beta[k], raw_.v_dc[k],
                          raw_.T_load[k], angle(raw_.theta_m[k]));
    const std::string path = (directory_ / name).string();
    const gzFile out = gzopen(path.c_str(), name.ends_with(".gz") ? "wb1" : "wbT");
    gzwrite(out, text.data(), static_cast<unsigned>(text.size()));
    gzclose(out);
    return path;
  }
  static double as_it_is(double theta_m) { return theta_m; }
  DriveLogs read(LogRequest asked, double seconds_allowed) const {
    asked.memory_MiB = memory_of(seconds_allowed);
    return read_drive_logs(asked, drive_.drive());
  }
  // MiB needed for a log of that length.
  static double memory_of(double seconds) {
    return 1000 * seconds / kT_s / static_cast<double>(rows_within(1000, kT_s));
  }
  // The row of the file at time t.
  std::size_t row_at(double t) const { return static_cast<std::size_t>(std::lround(t / kT_s)); }

  static constexpr double kSeconds = 10, kAllowed = 2.5, kT_s = 1e-4;
  fs::path directory_;
  RawLog raw_;
  Config drive_ = Config::load("niewiara2020");
};

TEST_F(DriveLogsTest, AnImportedLogHasNoSignalThatTheFileHasNot) {
  std::string text = "t,i_a,i_b,theta_m\n";
  for (std::size_t k = 0; k < 3000; ++k)
    text += fmt::format("{:.9g},{:.9g},{:.9g},{:.12g}\n", raw_.t[k], raw_.i_a[k], raw_.i_b[k],
                        raw_.theta_m[k]);
  const std::string csv = (directory_ / "two.csv").string(),
                    log = (directory_ / "two.lcm").string();
  std::ofstream(csv) << text;
  import_log({.file = csv, .out = log}, {}, drive_, [](const std::string&, double) {});
  const DriveLogs logs = read({.data = {log}}, kSeconds);
  EXPECT_TRUE(logs.record.u_alphabeta.empty());
  EXPECT_TRUE(logs.record.v_dc.empty());
  EXPECT_EQ(logs.record.current_sensors, 2);
  EXPECT_NEAR((logs.record.i_alphabeta[1000] -
               clarke({raw_.i_a[1000], raw_.i_b[1000], -(raw_.i_a[1000] + raw_.i_b[1000])}))
                  .norm(),
              0, 1e-9);
}

// MEASUREMENT(k + 1) tells the voltage of row k: without it the row has none.
TEST_F(DriveLogsTest, TheRowBeforeALostMessageIsLeftOut) {
  const std::string path = (directory_ / "gap.lcm").string();
  const auto write_every = [&](int step, std::int64_t lost) {
    WholeLog log(path);
    log.write(make_manifest(1, Config::load("dilys2021").resolved(), "{}"), 1'000'000);
    for (std::int64_t k = 0; k < 300 * step; k += step) {
      Measurement m;
      m.k = k;
      m.t_ns = 200'000 * k;
      m.signals = kPhaseCurrents | kVoltage | kPosition;
      m.u_alphabeta = {static_cast<double>(k), 0};
      if (k != lost) log.write(to_wire(m, 1), 1'000'000 + m.t_ns / 1000);
    }
    log.finish();
    RawLog rows;
    open_log(path, nullptr, false, 24)->next(rows, 1000);
    fs::remove(path);
    return rows;
  };
  const RawLog rows = write_every(1, 100);
  ASSERT_EQ(rows.size(), 297u) << "neither 99 nor 100, nor the last one";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto k = static_cast<double>(i < 99 ? i : i + 2);
    EXPECT_DOUBLE_EQ(rows.t[i], 2e-4 * k);
    EXPECT_DOUBLE_EQ(rows.u_alpha[i], k + 1);
  }
  EXPECT_EQ(write_every(2, -1).size(), 299u) << "every second tick is no gap";
}

TEST_F(DriveLogsTest, AngleAndCurrentOfAMovingRotorAreADriveLogAtAnyRate) {
  for (const std::size_t every : {2, 10, 50}) {
    std::string text = "t,theta_m,i_q\n";
    for (std::size_t k = 0; k < raw_.size(); k += every) {
      const Vec2 i = clarke({raw_.i_a[k], raw_.i_b[k], -(raw_.i_a[k] + raw_.i_b[k])});
      text += fmt::format("{:.9g},{:.12g},{:.9g}\n", raw_.t[k], raw_.theta_m[k],
                          park(i, 3 * raw_.theta_m[k])[1]);
    }
    const std::string path = (directory_ / "angle.csv").string();
    std::ofstream(path) << text;
    EXPECT_FALSE(trace_measured_files({.data = {path}}, drive_.drive(), {})) << every;
  }
}

TEST_F(DriveLogsTest, AShortLogIsReadWhole) {
  const DriveLogs logs = read({.data = {write("a.csv", as_it_is)}}, 1.2 * kSeconds);
  ASSERT_EQ(logs.record.size(), raw_.size());
  ASSERT_EQ(logs.notes.size(), 1u);
  EXPECT_NE(logs.notes[0].find("a.csv: two currents are measured"), std::string::npos)
      << logs.notes[0];
  EXPECT_EQ(logs.health.rows, raw_.size());
  EXPECT_NEAR(logs.record.theta_m.back(), raw_.theta_m.back(), 1e-9);
  EXPECT_NEAR(logs.record.T_load[1000], raw_.T_load[1000], 1e-9) << "a torque sensor is a load";
}

TEST_F(DriveLogsTest, BlocksKeepTheStartOfTheirLog) {
  for (double& t : raw_.t) t += 50;
  const DriveLogs logs = read({.data = {write("late.csv", as_it_is)}}, kAllowed);
  EXPECT_NEAR(logs.record.begin_s.value(), 50, 1e-6);
}

// The torque sensor misses a load from a moment on, and the record has a gap around it: wider than the bisected
// stretches (8 s), and narrower (1.5 s).
TEST_F(DriveLogsTest, TheMomentOfALoadStepInAGapIsFound) {
  constexpr double kStep_s = 4.3217, kTorque_Nm = 2;
  for (std::size_t k = row_at(kStep_s); k < raw_.size(); ++k) raw_.T_load[k] -= kTorque_Nm;
  const DriveLogs whole = read({.data = {write("step.csv", as_it_is)}}, 1.2 * kSeconds);
  struct Case {
    double begin, end, told;
  };
  for (const Case& c : {Case{1, 9, 8.5}, Case{3.5, 5, 3.6}}) {
    DriveLogs logs = whole;
    std::erase_if(logs.record.t, [&](double t) { return t > c.begin && t < c.end; });
    logs.files[0].end = logs.record.t.size();
    const std::shared_ptr<Effect> step = make_effect("load_step");
    set_key(*step, "torque_Nm", kTorque_Nm);
    set_key(*step, "time_s", c.told);
    TraceResult result;
    result.effects.push_back({.effect = step, .parameters = {{.name = "time", .value = c.told}}});
    find_moments(logs, drive_.drive(), result);
    EXPECT_NEAR(get_key(*result.effects[0].effect, "time_s"), kStep_s, 0.005) << c.begin;
    EXPECT_EQ(result.effects[0].parameters[0].value, get_key(*result.effects[0].effect, "time_s"));
    EXPECT_GT(result.effects[0].parameters[0].sigma.value_or(0), 0);
    EXPECT_LT(result.effects[0].parameters[0].sigma.value_or(1), 0.01);
  }
}

// Bursts of 900 rows, 0.2 s apart, beyond the memory: shorter blocks, none across a gap.
TEST_F(DriveLogsTest, ALongLogInShortBurstsIsTracedInShorterBlocks) {
  for (std::size_t k = 0; k < raw_.size(); ++k) {
    const std::size_t burst = k / 900;
    raw_.t[k] += 0.2 * static_cast<double>(burst);
  }
  const DriveLogs logs = read({.data = {write("bursts.csv", as_it_is)}}, kAllowed);
  ASSERT_GT(logs.record.size(), 3000u);
  std::size_t apart = 0;
  for (std::size_t k = 1; k < logs.record.size(); ++k)
    apart += logs.record.t[k] - logs.record.t[k - 1] > 0.1;
  EXPECT_GT(apart, 5u);
}

// Angle and i_q of a drive that turns, at the control rate, are a drive log without i_d.
TEST_F(DriveLogsTest, AngleAndCurrentInMotionAreADriveLog) {
  const std::string path = (directory_ / "angle_and_current.csv").string();
  std::ofstream file(path);
  file << "t,theta_m,i_q,T_load\n";
  for (std::size_t k = 0; k < raw_.size(); ++k) {
    const Vec2 i_dq = park(clarke({raw_.i_a[k], raw_.i_b[k], raw_.i_c[k]}), 3 * raw_.theta_m[k]);
    file << fmt::format("{:.9g},{:.12g},{:.9g},{:.9g}\n", raw_.t[k], raw_.theta_m[k], i_dq[1],
                        raw_.T_load[k]);
  }
  file.close();
  EXPECT_FALSE(trace_measured_files({.data = {path}}, drive_.drive()).has_value());
  const DriveLogs logs = read({.data = {path}}, 1.2 * kSeconds);
  EXPECT_TRUE(logs.health.i_q_alone);
  EXPECT_EQ(logs.record.T_load.size(), raw_.size());
  EXPECT_FALSE(logs.record.has_voltage_equation());
}

// 3 s of voltage into a winding at rest.
TEST_F(DriveLogsTest, CurrentAndVoltageWithoutAnAngleAreALogAtStandstill) {
  const std::string path = (directory_ / "standstill.csv").string();
  std::ofstream file(path);
  file << "t,i_alpha,i_beta,u_alpha,u_beta\n";
  const double R = servo().machine.R_s + 0.35, L = servo().machine.L_d;
  double i = 0;
  for (std::uint64_t k = 0; k < 30000; ++k) {
    const double t = kT_s * static_cast<double>(k);
    const double u = 3 * std::sin(8.2 * t) * std::sin(2.3 * t) + 2 * std::sin(126 * t);
    file << fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},0\n", t, i + 0.008 * normal(51, 0, k),
                        0.008 * normal(51, 1, k), u);
    i = u / R + (i - u / R) * std::exp(-R * kT_s / L);
  }
  file.close();
  const DriveLogs logs = read({.data = {path}}, 1.2 * kSeconds);
  EXPECT_TRUE(logs.health.no_angle);
  const TraceResult r = trace_record(logs.record, servo(), logs.health, {});
  ASSERT_EQ(r.effects.size(), 1) << r.sentence;
  const TracedEffect& e = r.effects[0];
  EXPECT_TRUE(e.effect->kind() == "resistance" ||
              std::count(e.aliases.begin(), e.aliases.end(), "resistance") == 1)
      << r.sentence;
  EXPECT_FALSE(r.mechanical.has_value());
  EXPECT_EQ(r.health[0].find("no angle in the log"), 0u);
}

// The synthetic drive with duties instead of voltages, with or without v_dc.
std::string duty_log(const RawLog& raw, double v_dc_nominal, bool with_v_dc) {
  std::string text = "t,i_a,i_b,i_c,theta_m,duty_a,duty_b,duty_c";
  text += with_v_dc ? ",v_dc\n" : "\n";
  for (std::size_t k = 0; k < raw.size(); ++k) {
    const double v_dc = with_v_dc ? raw.v_dc[k] : v_dc_nominal;
    const double u_b = -0.5 * raw.u_alpha[k] + 0.5 * std::sqrt(3.0) * raw.u_beta[k];
    const double u_c = -raw.u_alpha[k] - u_b, u_zero = 7 * std::sin(0.01 * static_cast<double>(k));
    text += fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.12g}", raw.t[k], raw.i_a[k], raw.i_b[k],
                        raw.i_c[k], raw.theta_m[k]);
    for (double u : {raw.u_alpha[k], u_b, u_c})
      text += fmt::format(",{:.12g}", 0.5 + (u + u_zero) / v_dc);
    text += with_v_dc ? fmt::format(",{:.12g}\n", v_dc) : "\n";
  }
  return text;
}

TEST_F(DriveLogsTest, DutiesGiveTheRecordOfTheVoltagesTheyMake) {
  raw_ = simulate_synthetic({.duration_s = 1, .seed = 3});
  raw_.T_load.clear();
  for (const bool with_v_dc : {true, false}) {
    const std::string path = (directory_ / "duty.csv").string();
    std::ofstream(path) << duty_log(raw_, drive_.drive().inverter.v_dc, with_v_dc);
    const Record r = read({.data = {path}}, 1.2 * kSeconds).record;
    ASSERT_EQ(r.u_alphabeta.size(), raw_.size());
    EXPECT_EQ(r.v_dc.empty(), !with_v_dc) << "a bus voltage that was not measured is not claimed";
    for (std::size_t k = 0; k < raw_.size(); ++k) {
      ASSERT_NEAR(r.u_alphabeta[k][0], raw_.u_alpha[k], 1e-8);
      ASSERT_NEAR(r.u_alphabeta[k][1], raw_.u_beta[k], 1e-8);
      ASSERT_NEAR(r.t[k], raw_.t[k], 1e-12);
    }
  }
}

TEST_F(DriveLogsTest, ALongLogIsReadInBlocksAtTheirOwnTimes) {
  const auto wrapped = [](double theta_m) { return wrap_turn(theta_m); };
  for (const std::string& path :
       {write("a.csv", as_it_is), write("a.csv.gz", as_it_is), write("w.csv.gz", wrapped)}) {
    const DriveLogs logs = read({.data = {path}}, kAllowed);
    const Record& r = logs.record;
    EXPECT_EQ(logs.health.rows, raw_.size());
    EXPECT_GT(r.size(), 20000u);
    EXPECT_LE(r.size(), 25000u);
    EXPECT_LT(r.t.front(), kSeconds / 24);
    EXPECT_GT(r.t.back(), kSeconds * 23 / 24);
    ASSERT_TRUE(std::is_sorted(r.t.begin(), r.t.end()));
    int seams = 0;
    for (std::size_t k = 0; k < r.size(); ++k) {
      const std::size_t row = row_at(r.t[k]);
      ASSERT_NEAR(r.u_alphabeta[k][0], raw_.u_alpha[row], 1e-6);
      ASSERT_NEAR(r.i_alphabeta[k][0], raw_.i_a[row], 1e-6);
      // Modulo a turn: a wrapped angle has no count of turns.
      ASSERT_NEAR(wrap_pi(r.theta_m[k] - raw_.theta_m[row]), 0, 1e-8);
      if (k == 0) continue;
      if (r.t[k] - r.t[k - 1] < 1.5 * kT_s) {
        ASSERT_LT(std::abs(r.theta_m[k] - r.theta_m[k - 1]), 0.1);
        continue;
      }
      ++seams;
      EXPECT_FALSE(r.motion_ok[k] || r.motion_ok[k - 1] || r.electrical_ok[k - 1]);
    }
    EXPECT_GT(seams, 10);
    ASSERT_EQ(logs.notes.size(), 2u) << "the other one is of two sensors";
    EXPECT_NE(logs.notes[0].find("10 s, 100000 rows; traced on 24 blocks"), std::string::npos)
        << logs.notes[0];
  }
}

TEST_F(DriveLogsTest, TheSpeedsOfTheWholeLogAreInItsBlocks) {
  const DriveLogs logs = read({.data = {write("a.csv", as_it_is)}}, kAllowed);
  const auto speeds = [](const std::vector<double>& t, const std::vector<double>& theta_m) {
    double lowest = 1e300, highest = -1e300;
    for (std::size_t k = 100; k < t.size(); k += 10) {
      if (t[k] - t[k - 100] > 101 * kT_s) continue;  // across a seam
      const double omega_m = (theta_m[k] - theta_m[k - 100]) / (t[k] - t[k - 100]);
      lowest = std::min(lowest, omega_m);
      highest = std::max(highest, omega_m);
    }
    return std::pair(lowest, highest);
  };
  const auto all = speeds(raw_.t, raw_.theta_m);
  const auto used = speeds(logs.record.t, logs.record.theta_m);
  // Half a cell of the map.
  EXPECT_NEAR(used.first, all.first, 8);
  EXPECT_NEAR(used.second, all.second, 8);
}

TEST_F(DriveLogsTest, FilesShareTheMemoryAndShortOnesAreWhole) {
  const std::string path = write("long.csv", as_it_is);
  raw_ = simulate_synthetic({.duration_s = 1, .seed = 2});
  const std::string brief = write("short.csv", as_it_is);
  const DriveLogs logs = read({.data = {path}, .held_out = {brief}}, 3);
  ASSERT_EQ(logs.files.size(), 2u);
  EXPECT_EQ(logs.files[1].end - logs.files[1].first, raw_.size());
  EXPECT_NEAR(static_cast<double>(logs.files[0].end), 20000, 3000);
  const std::vector<char> held_out = logs.held_out();
  EXPECT_EQ(std::count(held_out.begin(), held_out.end(), 1),
            static_cast<std::ptrdiff_t>(raw_.size()));
  EXPECT_TRUE(held_out.back());
}

TEST_F(DriveLogsTest, VerifyReplaysTheStartAndHoldsOutRowsOutsideTrainingBlocks) {
  const LogRequest asked{.data = {write("a.csv", as_it_is)}};
  const DriveLogs logs = read(asked, kAllowed);
  std::vector<char> held_out(logs.record.size(), 0);
  LogRequest again = asked;
  again.memory_MiB = memory_of(kAllowed);
  const auto list = verify_logs(again, drive_.drive(), logs, held_out);
  ASSERT_EQ(list.size(), 1u);
  EXPECT_NEAR(static_cast<double>(list[0].record.size()), 25000, 50);
  EXPECT_NEAR(static_cast<double>(list[0].measurements.size()), 25000, 50);
  std::size_t unseen = 0;
  for (std::size_t k = 0; k < list[0].record.size(); ++k) {
    unseen += list[0].held_out[k] != 0;
    const bool traced =
        std::binary_search(logs.record.t.begin(), logs.record.t.end(), list[0].record.t[k],
                           [](double a, double b) { return a < b - 0.5 * kT_s; });
    ASSERT_EQ(list[0].held_out[k] == 0, traced) << k;
  }
  EXPECT_GT(unseen, 15000u);
  EXPECT_LT(unseen, 23000u);
}

// 0.3 s to 0.5 s of the second file are held out: its rows, at its own times.
TEST_F(DriveLogsTest, VerifyHoldsOutTheRowsOfTheSecondFileAtItsOwnTimes) {
  raw_ = simulate_synthetic({.duration_s = 1, .seed = 4});
  const LogRequest asked{.data = {write("a.csv", as_it_is), write("b.csv", as_it_is)}};
  const DriveLogs logs = read(asked, 4);
  ASSERT_EQ(logs.files.size(), 2u);
  ASSERT_EQ(logs.record.size(), 2 * raw_.size());
  std::vector<char> held_out(logs.record.size(), 0);
  for (std::size_t k = 3000; k < 5000; ++k) held_out[raw_.size() + k] = 1;
  const auto list = verify_logs(asked, drive_.drive(), logs, held_out);
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(std::count(list[0].held_out.begin(), list[0].held_out.end(), 1), 0);
  ASSERT_EQ(list[1].held_out.size(), raw_.size());
  for (std::size_t k = 0; k < raw_.size(); ++k)
    ASSERT_EQ(list[1].held_out[k] != 0, k >= 3000 && k < 5000) << k;
}

// Stretches are whole slots of 256 rows.
TEST_F(DriveLogsTest, AStretchOfTheSecondFileIsThatOfTheRecordsTime) {
  raw_ = simulate_synthetic({.duration_s = 1, .seed = 5});
  const DriveLogs logs =
      read({.data = {write("a.csv", as_it_is), write("b.csv", as_it_is)}, .held_out = {}}, 4);
  ASSERT_EQ(logs.record.size(), 2 * raw_.size());
  const std::size_t second = raw_.size();
  const double begin = logs.record.t[second + 4000], end = logs.record.t[second + 6000];
  const Record r = logs.stretch(1, begin, end);
  constexpr double kSlot_s = 256 * kT_s;
  ASSERT_FALSE(r.t.empty());
  ASSERT_LE(r.t.front(), begin + 1e-9);
  ASSERT_GT(r.t.front(), begin - kSlot_s - 1e-9);
  ASSERT_GE(r.t.back(), end - 1.5 * kT_s);
  ASSERT_LT(r.t.back(), end + kSlot_s);
  for (std::size_t k = 0; k < r.size(); ++k) {
    const std::size_t row = row_at(r.t[k] - logs.record.t[second]);
    ASSERT_NEAR(r.i_alphabeta[k][0], raw_.i_a[row], 1e-6) << k;
    ASSERT_NEAR(r.theta_m[k], raw_.theta_m[row], 1e-8) << k;
  }
}

TEST_F(DriveLogsTest, AMistakeInTheFileIsOneLineWithItsPlace) {
  const std::string path = write("a.csv", as_it_is);
  std::fstream file(path, std::ios::in | std::ios::out);
  std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto broken = text.find("\n4.0001,");
  file.seekp(static_cast<std::streamoff>(broken + 1));
  file << "x";
  file.close();
  try {
    read({.data = {path}}, kAllowed);
    ADD_FAILURE() << "accepted";
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("a.csv:40003: t: a number needed, found \"x.0001\""),
              std::string::npos)
        << error.what();
  }
}

// Rows at rest are the same in any run.
TEST(SameReadings, ARunAtRestHasNotTheReadingsOfAnother) {
  std::vector<std::uint64_t> fitted(2000, reading_hash({0, 0})), other = fitted;
  for (std::size_t k = 0; k < 700; ++k) {
    fitted[k] = reading_hash({static_cast<double>(k), 0});
    other[k] = reading_hash({0, static_cast<double>(k + 1)});
  }
  EXPECT_FALSE(has_the_readings_of(fitted, other));
  EXPECT_TRUE(has_the_readings_of(fitted, fitted));
}

// A copy under another name judges with the rows that were fitted.
// The scales of both files together fit no unit.
TEST_F(DriveLogsTest, AFileInAnotherUnitIsNamed) {
  const RawLog all = raw_;
  const auto part = [&](std::size_t first) {
    raw_ = all;
    raw_.drop_first(first);
    for (const RawColumn& column : raw_columns())
      if (auto& values = raw_.*column.values; !values.empty()) values.resize(row_at(2));
    raw_.t.resize(row_at(2));
  };
  part(0);
  const std::string good = write("good.csv", as_it_is);
  part(row_at(3));
  const std::string other = write("other.csv", as_it_is),
                    degrees =
                        write("degrees.csv", [](double theta_m) { return theta_m * 360 / kTwoPi; });
  for (const DriveLog& file : read({.data = {good, other}}, kSeconds).files)
    EXPECT_TRUE(file.inconsistent.empty()) << file.path;
  for (const LogRequest& asked : {LogRequest{.data = {good, degrees}, .held_out = {}},
                                  LogRequest{.data = {good}, .held_out = {degrees}}}) {
    const DriveLogs logs = read(asked, kSeconds);
    const TraceResult r = trace_drive_logs(logs, held_out_rows(logs, 0.25, 4), drive_.drive(), {});
    EXPECT_EQ(r.verdict, "inconsistent") << r.sentence;
    EXPECT_TRUE(r.sentence.starts_with(degrees + " and the drive file do not belong together: "))
        << r.sentence;
    ASSERT_FALSE(r.inconsistent.empty());
    EXPECT_EQ(r.inconsistent[0].hint, "degrees?");
    EXPECT_EQ(r.inconsistent[0].file, degrees);
  }
}

TEST_F(DriveLogsTest, ACopyOfAFittedFileIsNoHoldOut) {
  const std::string own = write("own.csv", as_it_is), copy = write("copy.csv.gz", as_it_is);
  const auto held_out = [&](const std::string& path) {
    return read({.data = {own}, .held_out = {path}, .maps = {}}, kSeconds);
  };
  try {
    held_out(copy);
    ADD_FAILURE() << "a copy was accepted";
  } catch (const BadInput& refused) {
    EXPECT_NE(std::string(refused.what()).find("copy.csv.gz: has the readings of "),
              std::string::npos)
        << refused.what();
  }
  raw_ = simulate_synthetic({.duration_s = kSeconds, .seed = 2});
  EXPECT_NO_THROW(held_out(write("other.csv", as_it_is)));
}

}  // namespace
}  // namespace twinrate
