// The log that an export was made from comes back bit for bit, and files of unknown origin are
// refused in one line.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <matio.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "core/config.hpp"
#include "core/event_log.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"
#include "export/export_log.hpp"
#include "import/drive_messages.hpp"
#include "import/exported_log.hpp"
#include "import/guess.hpp"
#include "import/import_log.hpp"
#include "import/mat_file.hpp"
#include "import/whole_log.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::import_back_test {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kSession = 0x7654321076543210, kTick_ns = 100'000;
constexpr int kTicks = 300;

// Numbers with all their bits, among them zeros of both signs, subnormals and whole values.
class Numbers {
 public:
  double operator()() {
    switch (random_() % 8) {
      case 0:
        return -0.0;
      case 1:
        return 5e-324;
      case 2:
        return 1e300;
      case 3:
        return static_cast<double>(random_() % 1000);
      default:
        return std::uniform_real_distribution<double>(-1, 1)(random_);
    }
  }
  std::int64_t whole() { return static_cast<std::int64_t>(random_() >> 1); }

 private:
  std::mt19937_64 random_{7};
};

class ImportBack : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-back-{}", getpid());
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  // Every channel but ACK, with every field in use.
  void write_log() const {
    Numbers number;
    WholeLog log(path("log.lcm"));
    log.write(make_manifest(kSession, load_drive("niewiara2020").resolved(), "{}"), 1);
    for (std::int64_t k = 0; k < kTicks; ++k) {
      const std::int64_t t_us = 2 + k * kTick_ns / 1000;
      const auto send = [&](auto message) {
        message.seq = k;
        message.t_ns = k * kTick_ns + 7;
        message.session = kSession;
        message.tag = number.whole();
        if constexpr (requires { message.host_ns; }) message.host_ns = number.whole();
        log.write(message, t_us);
      };
      measurement_t m{};
      m.signals = kPhaseCurrents | kVoltage | kPosition | kSpeed;
      m.i_a_A = number();
      m.i_b_A = number();
      m.u_alpha_V = number();
      m.theta_m_rad = 0.01 * static_cast<double>(k);
      m.omega_m_rad_s = number();
      send(m);
      estimate_t e{};
      e.gain_seq = k - 1;
      e.n_x = 4;
      e.n_y = 2;
      for (int i = 0; i < 4; ++i) e.x_hat.push_back(number());
      for (int i = 0; i < 2; ++i) e.innov.push_back(number());
      send(e);
      if (k % 7 == 0) {
        gain_t g{};
        g.first_use_seq = k + 5;
        g.n_x = 4;
        g.n_y = 2;
        g.n_K = 8;
        g.n_P = 16;
        for (int i = 0; i < g.n_K; ++i) g.K.push_back(number());
        for (int i = 0; i < g.n_P; ++i) g.P.push_back(number());
        send(g);
        status_t s{};
        s.config_hash = number.whole();
        s.steps = k;
        s.state = 2;
        send(s);
      }
      if (k == 100) {
        event_t event{};
        event.reason = 3;
        event.text = "a \"quoted\"\nline, 3 \xc2\xb5s";
        event.waited_for = -1;
        send(event);
      }
      command_t c{};
      c.mode = 1;
      c.u_alpha_V = number();
      send(c);
    }
    log.finish();
  }
  struct Event {
    std::string channel;
    std::int64_t number, timestamp;
    std::string bytes;
    bool operator==(const Event&) const = default;
  };
  static std::vector<Event> events_of(const std::string& file) {
    std::vector<Event> events;
    EventLog log(file, OnDamage::kRefuse);
    while (const lcm::LogEvent* e = log.next())
      events.push_back({e->channel,
                        e->eventnum,
                        e->timestamp,
                        {static_cast<const char*>(e->data), static_cast<std::size_t>(e->datalen)}});
    return events;
  }
  ExportRequest request(const std::string& format, const std::string& compression = "zstd") const {
    return {.log = path("log.lcm"),
            .format = format,
            .out = path("out." + format),
            .compression = compression};
  }
  std::string refusal(const std::string& file) const {
    fs::remove(path("back.lcm"));
    try {
      import_exported_log(file, path("back.lcm"), {});
    } catch (const BadInput& error) {
      EXPECT_FALSE(fs::exists(path("back.lcm")));
      return error.what();
    }
    return "";
  }
  fs::path directory_;
};

TEST_F(ImportBack, AnExportAsMatAndMcapIsTheLogBitForBit) {
  write_log();
  const std::vector<Event> log = events_of(path("log.lcm"));
  ASSERT_GT(log.size(), 900u);
  for (const auto& [format, compression] :
       {std::pair{"mcap", "zstd"}, {"mcap", "lz4"}, {"mcap", "none"}, {"mat", "zstd"}}) {
    fs::remove(path(std::string("out.") + format));
    fs::remove(path("back.lcm"));
    export_log(request(format, compression), {});
    ASSERT_TRUE(is_exported_log(path(std::string("out.") + format)));
    const auto counts =
        import_exported_log(path(std::string("out.") + format), path("back.lcm"), {});
    EXPECT_EQ(counts.at("ESTIMATE"), kTicks);
    const std::vector<Event> back = events_of(path("back.lcm"));
    ASSERT_EQ(back.size(), log.size()) << format << " " << compression;
    for (std::size_t i = 0; i < log.size(); ++i)
      ASSERT_EQ(back[i], log[i]) << format << " " << compression << ", event " << i;
  }
}

TEST_F(ImportBack, PackedFilesAreSmaller) {
  write_log();
  std::map<std::string, std::uintmax_t> bytes;
  for (const char* compression : {"none", "zstd", "lz4"}) {
    fs::remove(path("out.mcap"));
    export_log(request("mcap", compression), {});
    bytes[compression] = fs::file_size(path("out.mcap"));
  }
  EXPECT_LT(2 * bytes["zstd"], bytes["none"]);
  EXPECT_LT(3 * bytes["lz4"], 2 * bytes["none"]);
}

// A table has the drive log only: what a MEASUREMENT of three currents, voltage, angle, speed and
// bus voltage holds, for every tick but the first (its voltage was applied before the table) and
// the last (what is applied after it is not known).
TEST_F(ImportBack, ATableGivesTheMeasurementsBitForBit) {
  const Config config = load_drive("niewiara2020");
  const double f_s_Hz = config.drive().rates.f_s_Hz;
  const auto tick_ns = static_cast<std::int64_t>(1e9 / f_s_Hz);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> number(-1, 1);
  std::vector<Measurement> sent;
  WholeLog log(path("log.lcm"));
  log.write(make_manifest(kSession, config.resolved(), "{}"), 1);
  for (std::int64_t k = 0; k < kTicks; ++k) {
    Measurement m;
    m.k = k;
    m.t_ns = k * tick_ns;
    m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
    m.i_abc = {number(random), number(random), number(random)};
    m.u_alphabeta = {number(random), number(random)};
    m.duty_abc = {0.5 + 0.4 * number(random), 0.5, 0.5 + 0.4 * number(random)};
    m.v_dc = 300 + number(random);
    m.theta_m = 10 * number(random) + 0.1 * static_cast<double>(k);
    m.omega_m = number(random);
    log.write(to_wire(m, kSession), 2 + m.t_ns / 1000);
    sent.push_back(m);
  }
  log.finish();
  export_log(request("csv"), {});
  const DriveRows rows = read_drive_rows(path("out.csv"), nullptr, false);
  const TickGrid grid = place_on_grid(rows, f_s_Hz);
  const DriveMessages messages(rows, config.drive().machine.n_p, 300);
  ASSERT_EQ(grid.slots.size(), static_cast<std::size_t>(kTicks - 1));
  for (std::size_t i = 1; i < grid.slots.size(); ++i) {
    const Measurement back = messages.measurement(grid.slots[i]);
    const auto bytes = [](const Measurement& m) {
      const measurement_t wire = to_wire(m, kSession);
      std::string text(static_cast<std::size_t>(wire.getEncodedSize()), '\0');
      wire.encode(text.data(), 0, static_cast<int>(text.size()));
      return text;
    };
    ASSERT_EQ(bytes(back), bytes(sent[i])) << "tick " << i;
  }
}

TEST_F(ImportBack, AResampledExportIsNoLog) {
  write_log();
  for (const char* format : {"mcap", "mat"}) {
    ExportRequest resampled = request(format);
    resampled.rate_Hz = 5000;
    resampled.channels = channels_of("MEASUREMENT,ESTIMATE");
    export_log(resampled, {});
    EXPECT_NE(refusal(resampled.out).find("resampled"), std::string::npos)
        << refusal(resampled.out);
  }
}

// A MATLAB file of any origin is a table for a map.
TEST_F(ImportBack, TheVectorsOfAMatFileAreReadThroughAMap) {
  std::ofstream csv(path("drive.csv"));
  csv << "t,i_q,theta_m\n";
  for (int k = 0; k < 300; ++k) csv << fmt::format("{},{},{}\n", k / 1e4, 0.1 * k, 0.01 * k);
  csv.close();
  ExportRequest asked = request("mat");
  asked.log = path("drive.csv");
  export_log(asked, {});
  EXPECT_FALSE(is_exported_log(asked.out));
  const Guess guess = guess_map({.file = asked.out, .tool = "matlab"});
  EXPECT_EQ(guess.columns.size(), 9u) << "t, seq, the origin, i_q, theta_m";
  std::ofstream(path("map.toml")) << "[columns]\ni_q = \"DRIVE_LOG.i_q\"\ntheta_m = "
                                     "\"DRIVE_LOG.theta_m\"\n[time]\nfrom = \"DRIVE_LOG.t\"\n";
  const ImportMap map = read_import_map(path("map.toml"));
  const DriveRows mat = read_drive_rows(asked.out, &map, false),
                  plain = read_drive_rows(path("drive.csv"), nullptr, false);
  EXPECT_EQ(mat.columns, plain.columns);
  EXPECT_EQ(mat.t, plain.t);
}

// As save -v7 writes it: packed variables, numbers of several types, a struct, a text.
void write_packed_mat(const std::string& file) {
  mat_t* mat = Mat_CreateVer(file.c_str(), nullptr, MAT_FT_MAT5);
  const auto put = [&](matvar_t* variable) {
    EXPECT_EQ(Mat_VarWrite(mat, variable, MAT_COMPRESSION_ZLIB), 0);
    Mat_VarFree(variable);
  };
  std::vector<double> t(300), table(600);
  std::vector<float> current(300);
  std::vector<std::int16_t> counts(300);
  std::vector<std::int8_t> gear(300, -3);
  for (int k = 0; k < 300; ++k) {
    t[k] = k / 1e4;
    table[k] = 0.5 * k;
    table[300 + k] = -k;
    current[k] = 0.25F * static_cast<float>(k);
    counts[k] = static_cast<std::int16_t>(-k);
  }
  std::size_t column[2] = {300, 1}, two[2] = {300, 2}, one[2] = {1, 1}, word[2] = {1, 5};
  put(Mat_VarCreate("t", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, column, t.data(), 0));
  put(Mat_VarCreate("i_q", MAT_C_SINGLE, MAT_T_SINGLE, 2, column, current.data(), 0));
  put(Mat_VarCreate("enc", MAT_C_INT16, MAT_T_INT16, 2, column, counts.data(), 0));
  put(Mat_VarCreate("gear", MAT_C_INT8, MAT_T_INT8, 2, column, gear.data(), 0));
  put(Mat_VarCreate("u", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, two, table.data(), 0));
  put(Mat_VarCreate("note", MAT_C_CHAR, MAT_T_UINT8, 2, word, const_cast<char*>("motor"), 0));
  const char* names[] = {"speed"};
  matvar_t* log = Mat_VarCreateStruct("log", 2, one, names, 1);
  Mat_VarSetStructFieldByName(
      log, "speed", 0, Mat_VarCreate(nullptr, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, column, t.data(), 0));
  put(log);
  EXPECT_EQ(Mat_Close(mat), 0);
}

TEST_F(ImportBack, APackedMatFileIsATableOfItsVectors) {
  write_packed_mat(path("v7.mat"));
  const MatTable table = read_mat_table(path("v7.mat"));
  std::map<std::string, std::vector<double>> columns;
  for (const MatColumn& column : table.columns) columns[column.name] = column.values;
  ASSERT_EQ(table.rows, 300u);
  ASSERT_EQ(columns.size(), 7u);
  EXPECT_EQ(columns.at("gear")[7], -3);
  EXPECT_EQ(columns.at("t")[299], 0.0299);
  EXPECT_EQ(columns.at("i_q")[7], 1.75);
  EXPECT_EQ(columns.at("enc")[7], -7);
  EXPECT_EQ(columns.at("u_1")[7], 3.5);
  EXPECT_EQ(columns.at("u_2")[7], -7);
  EXPECT_EQ(columns.at("log.speed")[299], 0.0299);
}

// Bytes of a file are changed, cut out, doubled, or the file ends early: it is read or refused in
// one line, and memory stays bounded.
class Mutations : public ImportBack {
 protected:
  static constexpr int kMutations = 500;
  static std::string read(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  std::string mutated(std::string bytes) {
    const auto at = [&](std::size_t size) { return random_() % std::max<std::size_t>(size, 1); };
    for (std::uint64_t n = 1 + random_() % 4; n > 0; --n) {
      const std::size_t place =
          at(random_() % 2 ? bytes.size() : std::min<std::size_t>(bytes.size(), 600));
      switch (random_() % 5) {
        case 0:
          bytes[place] = static_cast<char>(random_());
          break;
        case 1:
          bytes[place] = static_cast<char>(random_() % 2 ? 0xff : 0x7f);
          break;
        case 2:
          bytes.erase(place, 1 + at(16));
          break;
        case 3:
          bytes.insert(place, bytes.substr(at(bytes.size()), at(64)));
          break;
        default:
          if (random_() % 4 == 0) bytes.resize(std::max<std::size_t>(place, 1));
      }
      if (bytes.empty()) bytes = "x";
    }
    return bytes;
  }
  // Returns how many were refused.
  template <class Use>
  int refused(const std::string& original, const std::string& name, Use use) {
    const std::string bytes = read(original);
    int count = 0;
    for (int i = 0; i < kMutations; ++i) {
      std::ofstream(path(name), std::ios::binary) << mutated(bytes);
      fs::remove(path("back.lcm"));
      try {
        use(path(name));
      } catch (const BadInput& error) {
        const std::string line = error.what();
        EXPECT_EQ(line.find('\n'), std::string::npos) << line;
        EXPECT_LT(line.size(), 2000u);
        ++count;
      }
    }
    return count;
  }
  static long peak_MB() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss / 1024;
  }
  std::mt19937_64 random_{11};
};

TEST_F(Mutations, OfAnMcapFile) {
  write_log();
  const long before_MB = peak_MB();
  for (const char* compression : {"zstd", "none"}) {
    fs::remove(path("out.mcap"));
    ExportRequest short_log = request("mcap", compression);
    short_log.to_s = 0.004;
    export_log(short_log, {});
    const int count = refused(path("out.mcap"), "mutated.mcap", [&](const std::string& file) {
      import_exported_log(file, path("back.lcm"), {});
    });
    EXPECT_GT(count, kMutations / 2) << "the check sums find most";
  }
  EXPECT_LT(peak_MB() - before_MB, 700) << "a chunk of 256 MB at most, and the record it stands in";
}

TEST_F(Mutations, OfAMatFile) {
  write_log();
  ExportRequest short_log = request("mat");
  short_log.to_s = 0.004;
  export_log(short_log, {});
  const long before_MB = peak_MB();
  const int count = refused(path("out.mat"), "mutated.mat", [&](const std::string& file) {
    if (is_exported_log(file))
      import_exported_log(file, path("back.lcm"), {});
    else
      guess_map({.file = file});
  });
  EXPECT_GT(count, kMutations / 3);
  write_packed_mat(path("v7.mat"));
  const int packed = refused(path("v7.mat"), "mutated.mat",
                             [&](const std::string& file) { guess_map({.file = file}); });
  EXPECT_GT(packed, kMutations / 2) << "a packed variable has a check sum";
  EXPECT_LT(peak_MB() - before_MB, 700);
}

TEST_F(Mutations, OfACsvFile) {
  std::ofstream csv(path("drive.csv"));
  csv << "time_s,iq_A,theta_m [rad],speed (rpm),\n";
  for (int k = 0; k < 210; ++k) csv << fmt::format("{},{},{},1500,\n", 1e-4 * k, 0.1 * k, 0.01 * k);
  csv.close();
  const long before_MB = peak_MB();
  const int count = refused(path("drive.csv"), "mutated.csv", [&](const std::string& file) {
    const Guess guess = guess_map({.file = file});
    fs::remove(path("map.toml"));
    std::ofstream(path("map.toml")) << map_toml(guess, "");
    const ImportMap map = read_import_map(path("map.toml"));
    import_log({.file = file, .map = path("map.toml"), .out = path("back.lcm")}, map,
               load_drive("niewiara2020"), [](const std::string&, double) {});
  });
  EXPECT_GT(count, kMutations / 3);
  EXPECT_LT(peak_MB() - before_MB, 200);
}

}  // namespace
}  // namespace twinrate::import_back_test
