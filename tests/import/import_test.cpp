// Import of a measured CSV: fields, ticks, and one-line refusals.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>

#include "core/config.hpp"
#include "import/drive_messages.hpp"
#include "import/row_reader.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
constexpr int kRows = 300, kPolePairs = 4;
constexpr double kBus_V = 24;
constexpr double kRate_Hz = 5000, kTurnRate = 120;  // rad/s mechanical: one turn in 262 rows

class Import : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-import-{}", getpid());
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
    return (directory_ / name).string();
  }
  // Header on line 1, row k on line k + 2. `change` may rewrite a row.
  template <class Row>
  std::string csv(const std::string& header, Row row, int rows = kRows) const {
    std::string text = header + "\n";
    for (int k = 0; k < rows; ++k) text += row(k) + "\n";
    return write("log.csv", text);
  }
  std::string refusal(const std::string& path, const ImportMap* map = nullptr,
                      bool repair = false) const {
    try {
      read_drive_rows(path, map, repair);
    } catch (const BadInput& error) {
      std::string text = error.what();
      return text.starts_with(directory_.string()) ? text.substr(directory_.string().size() + 1)
                                                   : text;
    }
    return "";
  }
  fs::path directory_;
};

std::string plain_row(int k) {
  return fmt::format("{},{},{}", k / kRate_Hz, 0.5, kTurnRate * k / kRate_Hz);
}

std::vector<Measurement> measurements(const DriveRows& rows) {
  const TickGrid grid = place_on_grid(rows, kRate_Hz);
  const DriveMessages messages(rows, kPolePairs, kBus_V);
  std::vector<Measurement> list;
  for (const TickGrid::Slot& slot : grid.slots) list.push_back(messages.measurement(slot));
  return list;
}

TEST_F(Import, VoltageOfARowIsInTheNextMeasurementInTheAxesOfItsOwnRow) {
  const auto row = [](int k) {
    return fmt::format("{},{},{},{},{}", k / kRate_Hz, 0.1, 0.01 * k, 1.0 + k,
                       kTurnRate * k / kRate_Hz);
  };
  const auto list =
      measurements(read_drive_rows(csv("t,i_d,i_q,u_q,theta_m", row), nullptr, false));
  EXPECT_EQ(list[0].signals & kVoltage, 0) << "u_q alone is no voltage";

  const auto with_u_d = [&](int k) { return row(k) + ",0.25"; };
  const auto full =
      measurements(read_drive_rows(csv("t,i_d,i_q,u_q,theta_m,u_d", with_u_d), nullptr, false));
  ASSERT_EQ(full.size(), static_cast<std::size_t>(kRows));
  EXPECT_EQ(full[7].signals, kPhaseCurrents | kVoltage | kPosition);
  const double theta_e_before = kPolePairs * kTurnRate * 6 / kRate_Hz,
               theta_e = kPolePairs * kTurnRate * 7 / kRate_Hz;
  const Vec2 u_dq = park(full[7].u_alphabeta, theta_e_before),
             i_dq = park(clarke(full[7].i_abc), theta_e);
  EXPECT_NEAR(u_dq[0], 0.25, 1e-12);
  EXPECT_NEAR(u_dq[1], 1.0 + 6, 1e-12);
  EXPECT_NEAR(i_dq[0], 0.1, 1e-12);
  EXPECT_NEAR(i_dq[1], 0.07, 1e-12);
}

TEST_F(Import, DutyAndBusVoltageGiveTheMeanVoltage) {
  const auto row = [](int k) {
    return fmt::format("{},0.9,0.5,0.1,{},1", k / kRate_Hz, 20 + 0.01 * k);
  };
  const auto list = measurements(
      read_drive_rows(csv("t,duty_a,duty_b,duty_c,v_dc,omega_m", row), nullptr, false));
  EXPECT_EQ(list[5].signals, kVoltage | kBusVoltage | kSpeed);
  const double v_dc = 20.04;  // of row 4
  EXPECT_NEAR(list[5].u_alphabeta[0], 2.0 / 3 * (0.9 - 0.3) * v_dc, 1e-12);
  EXPECT_NEAR(list[5].u_alphabeta[1], 0.4 / std::sqrt(3.0) * v_dc, 1e-12);
  EXPECT_NEAR(list[5].v_dc, 20.05, 1e-12);
}

TEST_F(Import, DutyWithoutABusVoltageUsesTheNominalOneWithoutASignal) {
  const auto row = [](int k) { return fmt::format("{},0.9,0.5,0.1,1", k / kRate_Hz); };
  const auto list =
      measurements(read_drive_rows(csv("t,duty_a,duty_b,duty_c,omega_m", row), nullptr, false));
  EXPECT_EQ(list[5].signals, kVoltage | kSpeed);
  EXPECT_NEAR(list[5].u_alphabeta[0], 2.0 / 3 * (0.9 - 0.3) * kBus_V, 1e-12);
  EXPECT_NEAR(list[5].u_alphabeta[1], 0.4 / std::sqrt(3.0) * kBus_V, 1e-12);
}

TEST_F(Import, QCurrentAloneIsMarkedAndHasNoDCurrent) {
  const auto list = measurements(read_drive_rows(csv("t,i_q,theta_m", plain_row), nullptr, false));
  EXPECT_EQ(list[9].signals, kPhaseCurrents | kQCurrentOnly | kPosition);
  const Vec2 i_dq = park(clarke(list[9].i_abc), kPolePairs * list[9].theta_m);
  EXPECT_NEAR(i_dq[0], 0, 1e-12);
  EXPECT_NEAR(i_dq[1], 0.5, 1e-12);
}

TEST_F(Import, TwoPhaseCurrentsAreKeptAndGiveTheThird) {
  const DriveRows rows = read_drive_rows(
      csv("t,i_a,i_b,theta_m",
          [](int k) { return fmt::format("{},1.5,{},0.2", k / kRate_Hz, -0.25 * k); }),
      nullptr, false);
  const std::vector<Measurement> m = measurements(rows);
  EXPECT_EQ(m[8].signals, kPhaseCurrents | kPosition);
  EXPECT_EQ(m[8].i_abc, Vec3(1.5, -2, 0.5));
}

TEST_F(Import, ReadAgainFromAPlaceAnAngleHasNoTurns) {
  const std::string file =
      csv("t,enc", [](int k) { return fmt::format("{},{}", 0.001 * k, 30 * k % 100); });
  const ImportMap map =
      read_import_map(write("map.toml", "[columns]\ntheta_m = { from = \"enc\", wrap = 100 }\n"));
  RowReader reader(file, &map, false);
  const RowReader::Place begin = reader.place();
  for (int k = 0; k < 10; ++k) ASSERT_TRUE(reader.next());
  EXPECT_EQ(reader.values().front(), 270);
  reader.go_to(begin);
  ASSERT_TRUE(reader.next());
  EXPECT_EQ(reader.values().front(), 0);
}

TEST_F(Import, WrappedAnglesAreUnwrapped) {
  const auto row = [](int k) {
    return fmt::format("{},0.5,{}", k / kRate_Hz, std::fmod(kTurnRate * k / kRate_Hz, kTwoPi));
  };
  const auto wrapped = read_drive_rows(csv("t,i_q,theta_m", row), nullptr, false);
  EXPECT_NEAR(wrapped.at("theta_m", kRows - 1), kTurnRate * (kRows - 1) / kRate_Hz, 1e-4);

  const auto counts = [](int k) {
    return fmt::format("{};{}", 1000 * k / kRate_Hz, (k * 700) % 65536);
  };
  const ImportMap map = read_import_map(write("map.toml",
                                              "[columns]\ntheta_m = { from = \"enc\", wrap = "
                                              "65536, scale = 0.001 }\n[time]\nfrom = \"ms\"\n"
                                              "unit = \"ms\"\n[file]\nseparator = \";\"\n"));
  const auto encoder = read_drive_rows(csv("ms;enc", counts), &map, false);
  EXPECT_NEAR(encoder.at("theta_m", kRows - 1), 0.7 * (kRows - 1), 1e-9);
  EXPECT_NEAR(encoder.t[10], 10 / kRate_Hz, 1e-12);
}

// One turn is 0.03 m: 2 pi/0.03 rad a metre, and 0.03/(2 pi) Nm a newton.
TEST_F(Import, ALinearAxisIsReadAsTheRotaryMachineThatMovesIt) {
  const auto row = [](int k) {
    return fmt::format("{},0.5,{},{},{},{}", k / kRate_Hz, k < 150 ? 0 : 0.02, 0.3, 40, 50);
  };
  const std::string file = csv("t,i_q,x,v,force,force_ref", row);
  const std::string columns = "[columns]\ni_q = \"i_q\"\nx = \"x\"\nv = \"v\"\n";
  const ImportMap map = read_import_map(
      write("map.toml",
            columns + "force = \"force\"\nforce_ref = \"force_ref\"\n[axis]\ntravel_m = 0.03\n"));
  const DriveRows turned = read_drive_rows(file, &map, false);
  EXPECT_NEAR(turned.at("theta_m", 149), 0, 1e-12);
  EXPECT_NEAR(turned.at("theta_m", 150), kTwoPi * 0.02 / 0.03, 1e-9) << "no turn is taken off";
  EXPECT_NEAR(turned.at("omega_m", 0), kTwoPi * 0.3 / 0.03, 1e-9);
  EXPECT_NEAR(turned.at("torque", 0), 40 * 0.03 / kTwoPi, 1e-9);
  EXPECT_NEAR(turned.at("torque_ref", 0), 50 * 0.03 / kTwoPi, 1e-9);

  const DriveRows plain = read_drive_rows(file, nullptr, false);  // a radius of 1 m
  EXPECT_EQ(plain.at("theta_m", 150), 0.02);
  EXPECT_EQ(plain.at("omega_m", 0), 0.3);
  EXPECT_EQ(plain.at("torque", 0), 40);
  EXPECT_EQ(plain.at("torque_ref", 0), 50);
  ASSERT_FALSE(plain.notes.empty());
  EXPECT_TRUE(plain.notes[0].starts_with(
      "x, v, force, force_ref: a linear axis, read as a rotary one of radius 1 m"))
      << plain.notes[0];

  // Beside an angle x is another column, and a map refuses both.
  const std::string both = csv(
      "t,i_q,theta_m,x", [](int k) { return fmt::format("{},0.5,{},7", k / kRate_Hz, 0.01 * k); });
  EXPECT_EQ(read_drive_rows(both, nullptr, false).at("theta_m", 5), 0.05);
  const std::string mixed = write("map.toml", columns + "torque = \"T\"\n");
  EXPECT_THROW(read_import_map(mixed), BadInput);
}

TEST_F(Import, AValueIsScaledFirstAndTheOffsetIsInTheUnitOfTheResult) {
  const ImportMap map = read_import_map(
      write("map.toml",
            "[columns]\ni_q = { from = \"i\", scale = 2.0, offset = 3.0 }\n"
            "theta_m = { from = \"enc\", wrap = 100, scale = 0.01, offset = -1.0 }\n"
            "[time]\nfrom = \"ns\"\nunit = \"ns\"\nscale = 0.5\noffset = 7.0\n"));
  const DriveRows rows = read_drive_rows(
      csv("ns,i,enc",
          [](int k) { return fmt::format("{},{},{}", 4e5 * k, 0.25 * k, (k * 30) % 100); }),
      &map, false);
  for (std::size_t k : {0u, 1u, 200u}) {
    const auto row = static_cast<double>(k);
    EXPECT_NEAR(rows.at("i_q", k), 2 * 0.25 * row + 3, 1e-12);
    EXPECT_NEAR(rows.at("theta_m", k), 0.3 * row - 1, 1e-9);
    EXPECT_NEAR(rows.t[k], 0.5 * 4e-4 * row + 7, 1e-12);
  }
}

// An encoder that counts turns is taken as it is, however far it moves in a row.
TEST_F(Import, AnAngleThatCountsItsTurnsIsNotFolded) {
  const auto rows = read_drive_rows(
      csv("t,i_q,theta_m", [](int k) { return fmt::format("{},0.5,{}", k / kRate_Hz, 4.0 * k); }),
      nullptr, false);
  EXPECT_NEAR(rows.at("theta_m", kRows - 1), 4.0 * (kRows - 1), 1e-9);
}

TEST_F(Import, GzippedFileReadsTheSame) {
  const std::string plain = csv("t,i_q,theta_m", plain_row),
                    packed = (directory_ / "log.csv.gz").string();
  std::ifstream in(plain, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  gzFile out = gzopen(packed.c_str(), "wb");
  gzwrite(out, text.data(), static_cast<unsigned>(text.size()));
  gzclose(out);
  EXPECT_EQ(read_drive_rows(packed, nullptr, false).columns,
            read_drive_rows(plain, nullptr, false).columns);
}

// Wherever it is cut: also where the text so far ends with a whole line, or a number that lacks digits.
TEST_F(Import, ACompressedFileThatIsCutOffIsRefusedAndRepairUsesTheRowsBefore) {
  const std::string plain = csv("t,i_q,theta_m", plain_row, 1000),
                    packed = (directory_ / "log.csv.gz").string();
  std::ifstream in(plain, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  gzFile out = gzopen(packed.c_str(), "wb");
  gzwrite(out, text.data(), static_cast<unsigned>(text.size()));
  gzclose(out);
  const std::string whole = [&] {
    std::ifstream file(packed, std::ios::binary);
    return std::string((std::istreambuf_iterator<char>(file)), {});
  }();
  const auto theta_m = read_drive_rows(plain, nullptr, false).columns.at("theta_m");
  for (std::size_t left_out = 1; left_out < whole.size() / 2; left_out += left_out < 9 ? 1 : 37) {
    std::ofstream(packed, std::ios::binary) << whole.substr(0, whole.size() - left_out);
    EXPECT_NE(refusal(packed).find("the compressed file is cut off here"), std::string::npos)
        << left_out << " bytes: " << refusal(packed);
    const auto kept = read_drive_rows(packed, nullptr, true).columns.at("theta_m");
    ASSERT_LT(kept.size(), theta_m.size());
    EXPECT_TRUE(std::equal(kept.begin(), kept.end(), theta_m.begin())) << left_out;
  }
}

TEST_F(Import, EachMistakeIsOneLineWithItsPlace) {
  const auto change = [](int line, const char* text) {
    return [=](int k) { return k + 2 == line ? std::string(text) : plain_row(k); };
  };
  const char* header = "t,i_q,theta_m";
  EXPECT_EQ(refusal(csv(header, change(22, "0.004,abc,1"))),
            "log.csv:22: i_q: a number needed, found \"abc\"");
  EXPECT_EQ(refusal(csv(header, change(22, "0.004,nan,1"))),
            "log.csv:22: i_q: a finite number needed, found \"nan\"");
  EXPECT_EQ(refusal(csv(header, change(22, "0.001,1,1"))),
            "log.csv:22: time decreases from 0.0038 s to 0.001 s; it must increase");
  EXPECT_EQ(refusal(csv(header, change(22, "90000.004,1,1"))),
            "log.csv:22: time jumps by 1.04 days from 0.0038 s to 90000.004 s; at most one day "
            "between two rows is allowed");
  EXPECT_EQ(refusal(csv(header, change(22, "0.004,1"))),
            "log.csv:22: 2 of 3 fields; every row needs all of them");
  EXPECT_EQ(refusal(csv(header, plain_row, 199)), "log.csv:200: 199 rows, at least 200 needed");
  EXPECT_EQ(refusal(csv(header, plain_row, 200)), "");
  const auto percent = [](int k) { return fmt::format("{},0.5,50,0.5,1", k / kRate_Hz); };
  EXPECT_EQ(refusal(csv("t,duty_a,duty_b,duty_c,omega_m", percent)),
            "log.csv:2: duty_b: 0 to 1 allowed, found 50");
  EXPECT_EQ(refusal(csv("time,i_q,theta_m", plain_row)),
            "log.csv:1: missing column \"t\"; the file has time, i_q, theta_m");
  EXPECT_EQ(refusal((directory_ / "none.csv").string()), "none.csv: no such file");
  fs::create_directory(directory_ / "day.csv");
  EXPECT_EQ(refusal((directory_ / "day.csv").string()),
            "day.csv: is a directory; a file is needed");
}

// The tracer's windows are of seconds: rows of another unit of time made it crash or run on for ever.
TEST_F(Import, RowsCloserThanAMicrosecondAndNumbersWhoseSquareIsInfiniteAreRefused) {
  const auto every = [](double interval_s) {
    return [interval_s](int k) { return fmt::format("{},0.5,{}", k * interval_s, 0.01 * k); };
  };
  for (const double interval_s : {1e-7, 1e-12, 1e-300})
    EXPECT_EQ(
        refusal(csv("t,i_q,theta_m", every(interval_s))),
        fmt::format("log.csv:201: rows {:g} s apart; at least 1e-06 s allowed: is t in seconds?",
                    interval_s));
  EXPECT_EQ(refusal(csv("t,i_q,theta_m", every(1e-6))), "");
  const auto huge = [](int k) { return k == 50 ? std::string("0.01,1e308,1") : plain_row(k); };
  EXPECT_EQ(refusal(csv("t,i_q,theta_m", huge)),
            "log.csv:52: i_q: -1e+100 to 1e+100 allowed, found \"1e308\"");
}

TEST_F(Import, SetsWithoutTimeAreReadAsTheyAre) {
  const std::string set = csv(
      "i_b,u_b", [](int k) { return fmt::format("{},{}", 0.01 * k, 0.02 * k); }, 30);
  EXPECT_FALSE(holds_time(set, nullptr));
  const DriveRows rows = read_static_rows(set, nullptr, false);
  EXPECT_EQ(rows.size(), 30u);
  EXPECT_TRUE(rows.t.empty());
  EXPECT_DOUBLE_EQ(rows.at("u_b", 29), 0.58);
  EXPECT_TRUE(holds_time(csv("t,i_q,theta_m", plain_row), nullptr));
  const ImportMap map = read_import_map(write("map.toml", "[columns]\ni_b = \"i\"\nu_b = \"u\"\n"));
  const std::string foreign = csv(
      "i,u", [](int k) { return fmt::format("{},1", k); }, 25);
  EXPECT_FALSE(holds_time(foreign, &map));
  EXPECT_EQ(read_static_rows(foreign, &map, false).at("i_b", 3), 3);
  try {
    read_static_rows(csv(
                         "i_b,u_b", [](int) { return std::string("0,0"); }, 19),
                     nullptr, false);
    ADD_FAILURE() << "19 rows are too few";
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("at least 20"), std::string::npos) << error.what();
  }
}

TEST_F(Import, RepairLeavesATruncatedLastLineAndRepeatedSamplesOut) {
  const auto cut = [](int k) { return k == kRows - 1 ? std::string("0.0598,0.") : plain_row(k); };
  const std::string truncated = csv("t,i_q,theta_m", cut);
  EXPECT_EQ(refusal(truncated),
            "log.csv:301: truncated last line: 2 of 3 fields; --repair skips it");
  const DriveRows repaired = read_drive_rows(truncated, nullptr, true);
  EXPECT_EQ(repaired.size(), static_cast<std::size_t>(kRows - 1));
  EXPECT_EQ(repaired.notes, std::vector<std::string>{"truncated last line 301 skipped"});

  // Cut inside the last number: all fields are there.
  const auto rows = [](const std::string& last) {
    std::string text = "t,i_q,theta_m\n";
    for (int k = 0; k < kRows; ++k) text += fmt::format("{},0.5,{:.6f}\n", k / kRate_Hz, 0.01 * k);
    return text + fmt::format("{},0.5,{}", kRows / kRate_Hz, last);
  };
  EXPECT_NE(refusal(write("cut.csv", rows("3")))
                .find("it has no line end, and its last field is shorter"),
            std::string::npos);
  EXPECT_EQ(read_drive_rows(write("cut.csv", rows("3")), nullptr, true).size(),
            static_cast<std::size_t>(kRows));
  EXPECT_EQ(read_drive_rows(write("whole.csv", rows("3.000000")), nullptr, false).size(),
            static_cast<std::size_t>(kRows + 1));

  const auto twice = [](int k) { return plain_row(k > 50 ? k - 1 : k); };
  const std::string repeated = csv("t,i_q,theta_m", twice);
  EXPECT_TRUE(refusal(repeated).starts_with("log.csv:53: time repeats at 0.01 s"));
  EXPECT_EQ(read_drive_rows(repeated, nullptr, true).size(), static_cast<std::size_t>(kRows - 1));
  const auto back = [](int k) { return plain_row(k > 50 ? k - 2 : k); };
  EXPECT_NE(refusal(csv("t,i_q,theta_m", back), nullptr, true), "")
      << "time going back is not repaired";
}

TEST_F(Import, UnusedColumnsAreNotedWithTheCanonicalNameInLowerCase) {
  const auto row = [](int k) { return plain_row(k) + ",1,2,3"; };
  const std::string path = csv("t,i_q,theta_m,T_Load,speed,note", row);
  EXPECT_EQ(read_drive_rows(path, nullptr, false).notes,
            (std::vector<std::string>{"T_Load: not a column of a drive log; did you mean T_load?",
                                      "speed, note: not columns of a drive log, ignored"}));
  const ImportMap map = read_import_map(write("map.toml", "[columns]\ni_q = \"i_q\"\n"));
  EXPECT_TRUE(read_drive_rows(path, &map, false).notes.empty()) << "the map chose";
}

TEST_F(Import, MapMistakesNameTheMapsLine) {
  const auto map_refusal = [&](const std::string& text) {
    try {
      read_import_map(write("map.toml", text));
    } catch (const BadInput& error) {
      return std::string(error.what()).substr(directory_.string().size() + 1);
    }
    return std::string();
  };
  EXPECT_TRUE(map_refusal("[columns]\ni_x = \"a\"\n")
                  .starts_with("map.toml:2: columns.i_x: unknown column; known: t, i_a"));
  EXPECT_EQ(map_refusal("[columns]\ni_q = { from = \"a\", scal = 2 }\n"),
            "map.toml:2: columns.i_q.scal: unknown key; known here: from, scale, offset, wrap");
  EXPECT_EQ(map_refusal("[columns]\ni_q = \"a\"\n[time]\nunit = \"h\"\n"),
            "map.toml:4: time.unit: one of s, ms, us, ns allowed");
  EXPECT_EQ(map_refusal("[columns]\ni_q = \"a\"\n[file]\nseparator = \",\"\ndecimal = \",\"\n"),
            "map.toml:3: file: separator and decimal must differ");
}

DriveRows rows_at(const std::vector<double>& t) {
  DriveRows rows;
  rows.path = "log.csv";
  rows.t = t;
  for (std::size_t i = 0; i < t.size(); ++i) rows.line.push_back(static_cast<int>(i) + 2);
  return rows;
}

std::vector<std::int64_t> ticks_of(const TickGrid& grid) {
  std::vector<std::int64_t> k;
  for (const TickGrid::Slot& slot : grid.slots) k.push_back(slot.k);
  return k;
}

TEST(TickGridTest, JitterKeepsItsTicksAndGapsLeaveThemEmpty) {
  const TickGrid grid = place_on_grid(rows_at({0, 0.0011, 0.0019, 0.0031, 0.0070, 0.0080}), 1000);
  EXPECT_EQ(ticks_of(grid), (std::vector<std::int64_t>{0, 1, 2, 3, 7, 8}));
  EXPECT_EQ(grid.gaps, 1);
  EXPECT_EQ(grid.missing, 3);
  EXPECT_EQ(grid.moved, 0);
  EXPECT_NEAR(grid.dt_max_s, 0.0039, 1e-12);
}

TEST(TickGridTest, TwoRowsInATickUseTheFreeNeighbourAndMoveNoOtherRow) {
  // The pair at 2.6 and 3.4: tick 2 is free for the first. The pair at 6.0 and 6.4: only tick 7 is
  // free.
  const TickGrid grid = place_on_grid(
      rows_at({0, 0.001, 0.0026, 0.0034, 0.004, 0.005, 0.0060, 0.0064, 0.008, 0.009}), 1000);
  EXPECT_EQ(ticks_of(grid), (std::vector<std::int64_t>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(grid.moved, 2);

  // A burst after a stall: rows without a tick are dropped, and the next row is on its own tick.
  std::vector<double> t;
  t.reserve(206);
  for (int k = 0; k < 200; ++k) t.push_back(0.001 * k);
  for (double late : {0.2045, 0.2047, 0.2049, 0.2051, 0.206, 0.207}) t.push_back(late);
  const TickGrid burst = place_on_grid(rows_at(t), 1000);
  EXPECT_EQ(ticks_of(burst).back(), 207);
  EXPECT_EQ(burst.crowded_out, 2);
}

TEST(TickGridTest, RowsFasterThanTheDriveAreRefusedWithTheRateThatFits) {
  std::vector<double> t;
  t.reserve(300);
  for (int k = 0; k < 300; ++k) t.push_back(k / 2000.0);
  try {
    place_on_grid(rows_at(t), 1000);
    FAIL() << "accepted";
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("use --set rates.f_s_Hz=2000"), std::string::npos)
        << error.what();
  }
}

}  // namespace
}  // namespace twinrate
