// A run log as CSV, MATLAB and MCAP file: every field has its value at its time.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <matio.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/config.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"
#include "drive_log/drive_logs.hpp"
#include "export/export_log.hpp"
#include "export/fields.hpp"
#include "export/resampler.hpp"
#include "import/whole_log.hpp"
#include "loop/load_drive.hpp"
#include "tests/export/mcap_file.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kTicks = 600, kEveryGain = 5;
constexpr std::int64_t kTick_ns = 100'000, kSession = 77;

// Formulas of the messages below.
double wave(std::int64_t k, double place) {
  return std::sin(0.013 * static_cast<double>(k) + place);
}
double turned(std::int64_t k) {
  return 0.002 * static_cast<double>(k);
}
Measurement measurement_at(std::int64_t k) {
  Measurement m;
  m.k = k;
  m.t_ns = k * kTick_ns;
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
  m.i_abc = {wave(k, 0), wave(k, 1), -wave(k, 0) - wave(k, 1)};
  m.u_alphabeta = {50 * wave(k, 2), 50 * wave(k, 3)};
  m.duty_abc = {0.5 + 0.3 * wave(k, 2), 0.5, 0.5 - 0.3 * wave(k, 2)};
  m.v_dc = 235 + wave(k, 4);
  m.theta_m = turned(k);
  m.omega_m = 20 + wave(k, 5);
  return m;
}
Estimate estimate_at(std::int64_t k) {
  Estimate e;
  e.k = k;
  e.t_ns = k * kTick_ns;
  e.gain_seq = k / kEveryGain * kEveryGain;
  e.n_x = 4;
  e.n_y = 2;
  e.theta_e = wrap_turn(3 * turned(k) + 6);
  for (int i = 0; i < 4; ++i) e.x_hat[i] = wave(k, 10 + i);
  for (int i = 0; i < 2; ++i) e.innov[i] = wave(k, 20 + i);
  return e;
}

class Export : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-export-{}", getpid());
    fs::create_directories(directory_);
    WholeLog log(path("log.lcm"));
    const Config config = load_drive("niewiara2020", {"load.T_load_Nm=0.5"});
    log.write(make_manifest(kSession, config.resolved(), "{}"), 1);
    for (std::int64_t k = 0; k < kTicks; ++k) write_tick(log, k);
    log.finish();
  }
  void TearDown() override { fs::remove_all(directory_); }
  static void write_tick(WholeLog& log, std::int64_t k) {
    const std::int64_t t_us = 2 + k * kTick_ns / 1000;
    log.write(to_wire(measurement_at(k), kSession), t_us);
    log.write(to_wire(estimate_at(k), kSession), t_us);
    if (k % kEveryGain == 0) {
      Gain g;
      g.k = k;
      g.t_ns = k * kTick_ns;
      g.n_x = 4;
      g.n_y = 2;
      g.K(3, 1) = wave(k, 30);
      log.write(to_wire(g, kSession), t_us);
    }
    log.write(
        to_wire(Reference{.k = k, .t_ns = k * kTick_ns, .omega_m_ref = 21, .i_d_ref = 0}, kSession),
        t_us);
    if (k == 300) {
      event_t e{};
      e.seq = k;
      e.t_ns = k * kTick_ns;
      e.session = kSession;
      e.reason = 3;
      e.text = "a \"quoted\"\nline";
      log.write(e, t_us);
    }
  }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  ExportRequest request(const std::string& format, const std::string& channels = "") const {
    return {.log = path("log.lcm"),
            .format = format,
            .out = path("out." + format),
            .channels = channels_of(channels),
            .compression = "none"};  // McapFile does not unpack
  }
  std::string refusal(const ExportRequest& r) const {
    try {
      export_log(r, {});
    } catch (const BadInput& error) {
      EXPECT_FALSE(fs::exists(r.out) || fs::exists(r.out + ".part")) << "nothing half-made";
      return error.what();
    }
    return "";
  }
  fs::path directory_;
};

struct Table {
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
  std::string at(std::size_t row, const std::string& name) const {
    for (std::size_t c = 0; c < header.size(); ++c)
      if (header[c] == name) return rows[row].at(c);
    return "no column " + name;
  }
  double number(std::size_t row, const std::string& name) const { return std::stod(at(row, name)); }
};

Table read_table(const std::string& path) {
  Table table;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> cells(1);
    for (char c : line)
      if (c == ',')
        cells.emplace_back();
      else
        cells.back() += c;
    if (table.header.empty())
      table.header = cells;
    else
      table.rows.push_back(cells);
  }
  return table;
}

// Names of the fields in a .lcm file: of numbers and of strings. A tag says nothing outside its run.
std::pair<std::vector<std::string>, std::vector<std::string>> declared_fields(
    const std::string& type) {
  std::pair<std::vector<std::string>, std::vector<std::string>> names;
  std::ifstream in(std::string(TWINRATE_SOURCE_DIR) + "/lcmtypes/" + type + ".lcm");
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("{")) inside = true;
    std::stringstream words(line);
    std::string kind, name;
    words >> kind >> name;
    const auto end = name.find_first_of(";[");
    if (!inside || end == std::string::npos) continue;
    name = name.substr(0, end);
    if (name == "seq" || name == "t_ns" || name == "session" || name == "tag") continue;
    (kind == "string" ? names.second : names.first).push_back(name);
  }
  return names;
}

template <class Message>
void expect_all_fields() {
  Message message{};
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  Sample sample;
  Layout layout;
  const Channel channel = kChannelOf<Message>;
  ASSERT_TRUE(read_sample(channel, bytes.data(), bytes.size(), sample, &layout));
  const auto [numbers, texts] = declared_fields(info(channel).type);
  std::vector<std::string> names;
  for (const Field& f : layout.numbers) names.push_back(f.name);
  EXPECT_FALSE(numbers.empty()) << info(channel).type;
  EXPECT_EQ(names, numbers) << info(channel).type;
  EXPECT_EQ(layout.texts, texts) << info(channel).type;
}

TEST(ExportFields, EveryFieldOfEveryMessageIsExportedInOrder) {
  expect_all_fields<measurement_t>();
  expect_all_fields<truth_t>();
  expect_all_fields<estimate_t>();
  expect_all_fields<gain_t>();
  expect_all_fields<reference_t>();
  expect_all_fields<command_t>();
  expect_all_fields<status_t>();
  expect_all_fields<event_t>();
  expect_all_fields<manifest_t>();
  expect_all_fields<request_t>();
  expect_all_fields<reply_t>();
  expect_all_fields<ack_t>();
}

TEST_F(Export, TheTableIsADriveLogWithTheVoltageAppliedFromItsRowOn) {
  const Exported done = export_log(request("csv", "ESTIMATE,DRIVE_GAIN"), {});
  EXPECT_EQ(done.streams.at(0).samples, kTicks - 1) << "after the last tick nobody knows";
  const Table table = read_table(path("out.csv"));
  ASSERT_EQ(table.rows.size(), static_cast<std::size_t>(kTicks - 1));
  EXPECT_EQ(table.header[0], "t");
  const std::size_t k = 37;
  const Measurement m = measurement_at(k), behind = measurement_at(k + 1);
  EXPECT_EQ(table.at(k, "t"), "0.0037");
  EXPECT_EQ(table.number(k, "i_b"), m.i_abc[1]) << "all digits";
  EXPECT_EQ(table.number(k, "u_beta"), behind.u_alphabeta[1]);
  EXPECT_EQ(table.number(k, "duty_a"), behind.duty_abc[0]);
  EXPECT_EQ(table.number(k, "theta_m"), m.theta_m);
  EXPECT_EQ(table.number(k, "v_dc"), m.v_dc);
  EXPECT_EQ(table.number(k, "T_load"), 0.5);
  EXPECT_EQ(table.number(k, "omega_m_ref"), 21);
  EXPECT_EQ(table.number(k, "ESTIMATE.x_hat_2"), estimate_at(k).x_hat[2]);
  EXPECT_EQ(table.at(k, "GAIN.K_7"), "") << "no snapshot at this tick";
  EXPECT_EQ(table.number(40, "GAIN.K_7"), wave(40, 30)) << "row-major: K(3, 1) of 4 x 2";
}

// Ticks 100 to 102 without an angle, tick 200 without a MEASUREMENT: no rows, and four are told of.
TEST_F(Export, TicksThatTheTableCannotHoldAreCounted) {
  WholeLog log(path("holes.lcm"));
  log.write(make_manifest(kSession, load_drive("niewiara2020").resolved(), "{}"), 1);
  for (std::int64_t k = 0; k < kTicks; ++k) {
    const std::int64_t t_us = 2 + k * kTick_ns / 1000;
    Measurement m = measurement_at(k);
    if (k >= 100 && k <= 102) m.signals &= ~kPosition;
    if (k != 200) log.write(to_wire(m, kSession), t_us);
    log.write(
        to_wire(Reference{.k = k, .t_ns = k * kTick_ns, .omega_m_ref = 21, .i_d_ref = 0}, kSession),
        t_us);
  }
  log.finish();
  ExportRequest asked = request("csv");
  asked.log = path("holes.lcm");
  const Exported done = export_log(asked, {});
  EXPECT_EQ(done.left_out, 4);
  const Table table = read_table(path("out.csv"));
  ASSERT_EQ(table.rows.size(), static_cast<std::size_t>(kTicks - 1 - 4)) << "and the last tick";
  EXPECT_EQ(table.at(99, "t"), "0.0099");
  EXPECT_EQ(table.at(100, "t"), "0.0103");
  EXPECT_EQ(table.at(196, "t"), "0.0199");
  EXPECT_EQ(table.at(197, "t"), "0.0201");
  EXPECT_EQ(export_log(request("csv"), {}).left_out, 0);
}

// A realtime run on a busy machine has commands many ticks late in its log.
TEST_F(Export, ALateMessageIsInTheRowOfItsTick) {
  WholeLog log(path("late.lcm"));
  log.write(make_manifest(kSession, load_drive("niewiara2020").resolved(), "{}"), 1);
  constexpr std::int64_t kLate = 100;
  for (std::int64_t k = 0; k < kTicks + kLate; ++k) {
    const std::int64_t t_us = 2 + k * kTick_ns / 1000, of = k < 200 ? k : k - kLate;
    if (k < kTicks) log.write(to_wire(measurement_at(k), kSession), t_us);
    if (of < kTicks && (k < 100 || k >= 200)) {
      Command command;
      command.k = of, command.t_ns = of * kTick_ns;
      command.i_dq_ref = {0, static_cast<double>(of)};
      log.write(to_wire(command, kSession), t_us);
    }
  }
  log.finish();
  ExportRequest asked = request("csv");
  asked.log = path("late.lcm");
  EXPECT_EQ(export_log(asked, {}).late, 0);
  const Table table = read_table(path("out.csv"));
  for (const std::size_t k : {99u, 100u, 150u, 300u}) EXPECT_EQ(table.number(k, "i_q_ref"), k);
}

TEST_F(Export, TheTracerReadsTheSameRecordFromTheTableAndFromTheLog) {
  export_log(request("csv"), {});
  const Config config = load_drive("niewiara2020", {"load.T_load_Nm=0.5"});
  const auto record = [&](const std::string& file) {
    return read_drive_logs({.data = {path(file)}, .held_out = {}}, config.drive()).record;
  };
  const Record log = record("log.lcm"), table = record("out.csv");
  ASSERT_EQ(log.size(), static_cast<std::size_t>(kTicks - 1));
  ASSERT_EQ(table.size(), log.size());
  for (std::size_t k = 0; k < log.size(); ++k) {
    EXPECT_NEAR(table.t[k], log.t[k], 1e-12);
    EXPECT_EQ(table.u_alphabeta[k], log.u_alphabeta[k]);
    EXPECT_EQ(table.i_alphabeta[k], log.i_alphabeta[k]);
    EXPECT_EQ(table.theta_m[k], log.theta_m[k]);
    EXPECT_EQ(table.T_load[k], log.T_load[k]);
  }
}

TEST_F(Export, AnImportedLogHasNoLoadOfItsDriveFile) {
  WholeLog log(path("imported.lcm"));
  const Config config = load_drive("niewiara2020", {"load.T_load_Nm=0.5"});
  log.write(make_manifest(kSession, config.resolved(),
                          R"({"program": "twinrate import", "source": {"signals": ["duty"]}})"),
            1);
  for (std::int64_t k = 0; k < kTicks; ++k) write_tick(log, k);
  log.finish();
  ExportRequest r = request("csv");
  r.log = path("imported.lcm");
  export_log(r, {});
  EXPECT_EQ(read_table(path("out.csv")).header,
            (std::vector<std::string>{"t", "i_a", "i_b", "i_c", "u_alpha", "u_beta", "duty_a",
                                      "duty_b", "duty_c", "v_dc", "theta_m", "omega_m"}));
  EXPECT_TRUE(
      read_drive_logs({.data = {r.log}, .held_out = {}}, config.drive()).record.T_load.empty());
}

TEST_F(Export, FromAndToCutOnTheLogsTime) {
  ExportRequest r = request("csv");
  r.from_s = 0.0095;
  r.to_s = 0.0203;
  const Exported done = export_log(r, {});
  EXPECT_EQ(done.streams.at(0).samples, 203 - 95 + 1);
  const Table table = read_table(path("out.csv"));
  EXPECT_EQ(table.at(0, "t"), "0.0095");
  EXPECT_EQ(table.rows.back()[0], "0.0203");
}

TEST_F(Export, AnMcapReaderFindsEveryMessageThroughDataAndIndex) {
  const Exported done = export_log(request("mcap"), {});
  EXPECT_EQ(done.streams.size(), 6u) << "manifest, measurement, estimate, gain, reference, event";
  const McapFile file(path("out.mcap"));
  EXPECT_EQ(file.opcodes.front(), 1);
  EXPECT_EQ(file.opcodes.back(), 2);
  EXPECT_EQ(file.summary_begin, file.data_end + 9 + 4);
  EXPECT_EQ(file.chunks, file.chunk_indexes);
  EXPECT_EQ(file.counted, 3u * kTicks + kTicks / kEveryGain + 2);
  EXPECT_EQ(static_cast<std::uint64_t>(file.indexed), file.counted);
  const auto& estimates = file.messages.at("ESTIMATE");
  ASSERT_EQ(estimates.size(), static_cast<std::size_t>(kTicks));
  EXPECT_EQ(estimates[123].log_time, 12'300'000u);
  EXPECT_EQ(estimates[123].body["seq"], 123);
  EXPECT_EQ(estimates[123].body["theta_e_rad"].get<double>(), estimate_at(123).theta_e);
  ASSERT_EQ(estimates[123].body["x_hat"].size(), 4u);
  EXPECT_EQ(estimates[123].body["x_hat"][3].get<double>(), wave(123, 13));
  EXPECT_EQ(file.messages.at("EVENT").at(0).body["text"], "a \"quoted\"\nline");
  const Json& schema = file.schemas.at("twinrate.ESTIMATE");
  for (const auto& [name, value] : estimates[0].body.items()) {
    const std::string type = schema["properties"][name]["type"];
    EXPECT_EQ(type == "array", value.is_array()) << name;
    EXPECT_EQ(type == "string", value.is_string()) << name;
  }
}

TEST_F(Export, MatlabGetsAStructAChannelWithVectorsAndMatrices) {
  export_log(request("mat", "MEASUREMENT,ESTIMATE,GAIN,EVENT"), {});
  mat_t* file = Mat_Open(path("out.mat").c_str(), MAT_ACC_RDONLY);
  ASSERT_NE(file, nullptr);
  EXPECT_EQ(Mat_GetVersion(file), MAT_FT_MAT5);
  const auto field = [&](matvar_t* all, const char* name) {
    matvar_t* f = Mat_VarGetStructFieldByName(all, name, 0);
    EXPECT_NE(f, nullptr) << name;
    return f;
  };
  const auto element = [](const matvar_t* f, std::size_t row, std::size_t column) {
    return static_cast<const double*>(f->data)[column * f->dims[0] + row];
  };
  matvar_t* estimate = Mat_VarRead(file, "ESTIMATE");
  ASSERT_NE(estimate, nullptr);
  const matvar_t* x_hat = field(estimate, "x_hat");
  EXPECT_EQ(x_hat->dims[0], static_cast<std::size_t>(kTicks));
  EXPECT_EQ(x_hat->dims[1], 4u);
  EXPECT_EQ(element(x_hat, 200, 3), wave(200, 13));
  EXPECT_EQ(element(field(estimate, "t"), 200, 0), 0.02);
  EXPECT_EQ(element(field(estimate, "seq"), 200, 0), 200);
  EXPECT_EQ(field(estimate, "theta_e_rad")->dims[1], 1u);
  matvar_t* gain = Mat_VarRead(file, "GAIN");
  EXPECT_EQ(field(gain, "K")->dims[0], static_cast<std::size_t>(kTicks / kEveryGain));
  EXPECT_EQ(element(field(gain, "K"), 3, 7), wave(15, 30));
  matvar_t* event = Mat_VarRead(file, "EVENT");
  const matvar_t* text = Mat_VarGetCell(field(event, "text"), 0);
  EXPECT_EQ(std::string(static_cast<const char*>(text->data), text->nbytes), "a \"quoted\"\nline");
  EXPECT_EQ(Mat_VarRead(file, "REFERENCE"), nullptr) << "was not asked for";
  for (matvar_t* all : {estimate, gain, event}) Mat_VarFree(all);
  Mat_Close(file);
}

Sample sample_at(double t, std::vector<double> numbers) {
  Sample s{.k = -1,
           .t_ns = std::llround(1e9 * t),
           .numbers = std::move(numbers),
           .counts = {},
           .texts = {}};
  s.counts.assign(s.numbers.size(), 1);
  return s;
}

TEST(ExportResampling, EachKindOfNumberIsInterpolatedInItsWay) {
  const Layout layout{.numbers = {{"line", FieldKind::kLinear},
                                  {"angle", FieldKind::kAngle},
                                  {"held", FieldKind::kHeld},
                                  {"mean", FieldKind::kMean}},
                      .texts = {}};
  std::vector<Sample> out;
  Resampler resampler(10, layout, [&](const Sample& s) { out.push_back(s); });
  // From 0.05 s on; the angle passes 2 pi; the mean is 1 until 0.25 s, then 5.
  resampler.take(sample_at(0.05, {0.5, kTwoPi - 0.1, 1, 1}));
  resampler.take(sample_at(0.25, {2.5, 0.3, 2, 5}));
  resampler.take(sample_at(0.45, {0.5, 0.5, 3, 9}));
  resampler.finish();
  ASSERT_EQ(out.size(), 3u) << "0.1, 0.2, 0.3 s; from 0.4 s on the mean is not known to its end";
  EXPECT_EQ(out[0].t_ns, 100'000'000);
  EXPECT_NEAR(out[0].numbers[0], 1.0, 1e-12);
  EXPECT_NEAR(wrap_pi(out[0].numbers[1]), 0.0, 1e-12)
      << "a quarter of the short way from -0.1 to 0.3";
  EXPECT_EQ(out[0].numbers[2], 1);
  EXPECT_NEAR(out[0].numbers[3], 1, 1e-12);
  EXPECT_NEAR(out[1].numbers[3], 3, 1e-12) << "half of it 1, half of it 5";
  EXPECT_NEAR(out[2].numbers[0], 2.0, 1e-12);
  EXPECT_EQ(out[2].numbers[2], 2);
  EXPECT_NEAR(out[2].numbers[3], 5, 1e-12);
}

TEST_F(Export, ResampledChannelsShareOneTimeBase) {
  ExportRequest r = request("mcap", "MEASUREMENT,GAIN");
  r.rate_Hz = 3000;
  export_log(r, {});
  const McapFile file(path("out.mcap"));
  const auto &measurement = file.messages.at("MEASUREMENT"), &gain = file.messages.at("GAIN");
  ASSERT_GT(gain.size(), 170u);
  EXPECT_EQ(measurement.size(), 180u) << "0 to 59.9 ms";
  for (std::size_t j = 0; j < gain.size(); ++j)
    ASSERT_EQ(gain[j].log_time, measurement[j].log_time);
  // Sample 8 is at 2.6667 ms.
  EXPECT_NEAR(measurement[8].body["theta_m_rad"].get<double>(), 0.002 * 80 / 3.0, 1e-8);
  EXPECT_EQ(gain[8].body["K"][7].get<double>(), wave(25, 30)) << "held";
}

TEST_F(Export, MistakesAreOneLineAndLeaveNoFile) {
  EXPECT_NE(refusal(request("csv", "EVENT")).find("--format mat or mcap"), std::string::npos);
  EXPECT_NE(refusal(request("mcap", "TRUTH")).find("no TRUTH in"), std::string::npos);
  EXPECT_NE(refusal(request("csv", "TRUTH")).find("no DRIVE_TRUTH"), std::string::npos);
  EXPECT_THROW(channels_of("MEASURMENT"), BadInput);
  ExportRequest late = request("csv");
  late.from_s = 7;
  EXPECT_NE(refusal(late).find("the log runs from 0 to 0.0598 s"), std::string::npos)
      << refusal(late);
  ExportRequest other = request("mcap");
  other.log = path("other.lcm");
  std::ofstream(other.log) << "no log at all";
  EXPECT_NE(refusal(other), "");
}

}  // namespace
}  // namespace twinrate
