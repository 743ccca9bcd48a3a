// A log that is read one tick after the other has the figures of the log in memory.
#include "analysis/long_log.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <lcm/lcm-cpp.hpp>

#include "core/signals_io.hpp"
#include "loop/load_drive.hpp"
#include "run/simulated_run.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

class LongLogTest : public ::testing::Test {
 public:
  LongLogTest() {
    char pattern[] = "/tmp/long-log-XXXXXX";
    directory_ = mkdtemp(pattern);
  }
  ~LongLogTest() override { fs::remove_all(directory_); }
  // A run of 4000 ticks with an encoder.
  Config run(std::vector<std::string> overrides = {}) {
    overrides.insert(overrides.end(), {"run.duration_s=0.8", "run.settle_s=0.2"});
    Config config = load_drive("dilys2021", overrides);
    EXPECT_EQ(run_simulated(config, directory_, false), "");
    return config;
  }
  std::string log() const { return directory_ + "/log.lcm"; }
  // The log without TRUTH, as a real drive leaves it.
  std::string without_truth() const {
    const std::string path = directory_ + "/other.lcm";
    lcm::LogFile in(log(), "r"), out(path, "w");
    while (const lcm::LogEvent* event = in.readNextEvent())
      if (event->channel != "DRIVE_TRUTH") {
        lcm::LogEvent copy = *event;
        out.writeEvent(&copy);
      }
    return path;
  }
  static void expect_same(const std::string& path, const DriveConfig& drive) {
    const Summary whole = summarise(read_run_log(path), drive);
    const LongLog found = summarise_log(path, drive, OnDamage::kRefuse, 500);
    EXPECT_EQ(to_json(found.summary, drive), to_json(whole, drive));
    EXPECT_EQ(found.log.measurement.size(), 500u);
    EXPECT_EQ(found.log.counts[0], drive.steps());
    EXPECT_EQ(found.last_k - found.first_k, 499);
  }
  std::string directory_;
};

TEST_F(LongLogTest, FiguresWithTruthAreThoseOfTheLogInMemory) {
  Config config = run();
  expect_same(log(), config.drive());
  const LongLog found = summarise_log(log(), config.drive(), OnDamage::kRefuse, 500);
  EXPECT_EQ(found.last_k, 3999);
  EXPECT_EQ(window_of_part(found), 0) << "the part begins after settle_s";
  EXPECT_FALSE(found.log.gain.empty());
  EXPECT_EQ(found.log.estimate.back().gain_seq, read_run_log(log()).estimate.back().gain_seq);
}

TEST_F(LongLogTest, FiguresWithoutTruthAreThoseOfTheLogInMemory) {
  Config config = run({"sensors.encoder_counts=4096"});
  expect_same(without_truth(), config.drive());
}

TEST_F(LongLogTest, OfALostRunThePartIsTheOneAroundTheLoss) {
  Config config = run({"plant.fault.kind=command_missing", "plant.fault.at_s=0.3"});
  expect_same(log(), config.drive());
  const LongLog found = summarise_log(log(), config.drive(), OnDamage::kRefuse, 500);
  ASSERT_TRUE(found.summary.lost_at_s);
  const double lost_k = *found.summary.lost_at_s * config.drive().rates.f_s_Hz;
  EXPECT_NEAR(static_cast<double>(found.last_k), lost_k + 125, 2);
}

// What figures need of a tick, as numbers.
std::vector<double> numbers_of(const TickRow& row) {
  std::vector<double> all = {static_cast<double>(row.k), row.t_s};
  const auto add = [&all](auto... numbers) { (all.push_back(static_cast<double>(numbers)), ...); };
  if (const auto& m = row.measurement)
    add(m->signals, m->mode, m->i_abc[0], m->i_abc[1], m->i_abc[2], m->theta_m, m->omega_m);
  if (const auto& t = row.truth)
    add(t->finite, t->i_dq[0], t->i_dq[1], t->omega_m, t->theta_m, t->T_em, t->T_load);
  if (const auto& e = row.estimate)
    add(e->gain_seq, e->status, e->finite, e->theta_e, e->omega_m, e->T_load, e->i_dq[0],
        e->i_dq[1]);
  if (const auto& c = row.command) add(c->omega_m_ref, c->i_dq_ref[0], c->i_dq_ref[1]);
  if (const auto& g = row.gain) add(g->k, g->K41, g->K42, g->P44);
  return all;
}

// Page and summary of a simulated run are made of the ticks that the run keeps in memory.
TEST(KeptTicks, AreThoseOfTheLogThatIsReadFromItsDirectory) {
  for (const char* kind : {"ekf_sensorless", "ekf_disturbance", "active_flux"}) {
    char pattern[] = "/tmp/kept-log-XXXXXX";
    const std::string directory = mkdtemp(pattern);
    Config config = load_drive(
        "dilys2021", {"run.duration_s=0.2", "run.settle_s=0.05", "plant.fault.at_s=0.15",
                      "plant.fault.kind=command_missing", std::string("estimator.kind=") + kind});
    std::optional<LongLog> found;
    EXPECT_EQ(run_simulated(config, directory, false, make_filter, &found), "");
    const RunLog read = read_run_log(directory);
    fs::remove_all(directory);
    ASSERT_TRUE(found) << kind;
    const RunLog* kept = &found->log;
    EXPECT_EQ(kept->path, read.path);
    EXPECT_EQ(kept->session, read.session);
    EXPECT_EQ(kept->revision, read.revision);
    EXPECT_EQ(kept->config_toml, read.config_toml);
    EXPECT_EQ(kept->manifest_json, read.manifest_json);
    EXPECT_EQ(kept->counts, read.counts);
    const RunTicks ticks = run_ticks(read);
    ASSERT_EQ(found->ticks.rows.size(), ticks.rows.size());
    for (std::size_t i = 0; i < ticks.rows.size(); ++i)
      ASSERT_EQ(numbers_of(found->ticks.rows[i]), numbers_of(ticks.rows[i])) << kind << " " << i;
    EXPECT_TRUE(ticks.rows.back().gain);
    EXPECT_EQ(to_json(summarise(*kept, found->ticks, config.drive()), config.drive()),
              to_json(summarise(read, config.drive()), config.drive()));
    ASSERT_EQ(kept->events.size(), read.events.size());
    EXPECT_FALSE(read.events.empty());
    for (std::size_t i = 0; i < read.events.size(); ++i) {
      EXPECT_EQ(kept->events[i].k, read.events[i].k);
      EXPECT_EQ(kept->events[i].reason, read.events[i].reason);
      EXPECT_EQ(kept->events[i].text, read.events[i].text);
    }
  }
}

}  // namespace
}  // namespace twinrate
