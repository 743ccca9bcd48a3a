// The sweep program: over the bus, with mpirun, as a Slurm array, interrupted and resumed.
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class Sweep : public ProgramTest {
 protected:
  std::vector<std::string> sweep(const std::string& out,
                                 const std::vector<std::string>& more = {}) const {
    std::vector<std::string> list = {"sweep",   "fb",      "dilys2021", "--speeds",
                                     "150,200", "--seeds", "2",         "--n-max",
                                     "20",      "--out",   path(out),   "--json"};
    list.insert(list.end(), more.begin(), more.end());
    return list;
  }
  void expect_same_result(const std::string& a, const std::string& b) const {
    for (const char* file : {"points.csv", "fbmin.csv", "why.csv", "figure.svg"}) {
      const std::string text = read_text(path(a) + "/" + file);
      EXPECT_FALSE(text.empty()) << file;
      EXPECT_EQ(text, read_text(path(b) + "/" + file)) << file;
    }
  }
};

bool on_path(const std::string& program) {
  return std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0;
}

TEST_F(Sweep, WritesTheColumnsOfTheContract) {
  const ProgramResult result = twinrate(sweep("one"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string points = read_text(path("one/points.csv"));
  EXPECT_TRUE(points.starts_with(
      "policy,omega_e_rad_s,f_e_Hz,f_s_Hz,n,f_b_Hz,seed,locked,angle_error_rms_rad,"
      "angle_error_max_rad\n"));
  EXPECT_TRUE(read_text(path("one/fbmin.csv"))
                  .starts_with("policy,f_e_Hz,n_max,f_bmin_Hz,ratio,ratio_lo,ratio_hi,capped"));
  EXPECT_GT(count_lines(result.out), 10) << "a JSON line a point";
}

TEST_F(Sweep, OverTheBusTheSamePointsComeOutBitForBit) {
  auto list = sweep("inprocess", {"--engine", "reference"});
  const auto shorten = [](std::vector<std::string> l) {
    l[4] = "200";
    l[6] = "1";
    return l;
  };
  ASSERT_EQ(twinrate(shorten(list)).exit_code, 0);
  const ProgramResult result = twinrate(shorten(sweep("lcm", {"--over", "lcm"})), 110);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(read_text(path("inprocess/points.csv")), read_text(path("lcm/points.csv")));
}

TEST_F(Sweep, TwoRanksOfMpirunGiveTheSingleSweepBitForBit) {
  if (!on_path("mpirun")) GTEST_SKIP() << "mpirun is not there (package openmpi-bin)";
  ASSERT_EQ(twinrate(sweep("single")).exit_code, 0);
  setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
  setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
  std::vector<std::string> list = {"mpirun", "-n", "2", "--oversubscribe", TWINRATE_PROGRAM};
  for (const std::string& text : sweep("mpi")) list.push_back(text);
  const ProgramResult ranks = run_program(list, 60);
  ASSERT_EQ(ranks.exit_code, 0) << ranks.err;
  EXPECT_TRUE(std::filesystem::exists(path("mpi/shard-1-of-2/points.csv")));
  const ProgramResult merged = twinrate({"sweep", "merge", path("mpi")});
  ASSERT_EQ(merged.exit_code, 0) << merged.err;
  expect_same_result("single", "mpi");
}

TEST_F(Sweep, AnInterruptedSweepKeepsItsPointsAndResumes) {
  // The reference engine: the lane engine would finish before the signal.
  const std::vector<std::string> slowly = {"--engine", "reference"};
  ASSERT_EQ(twinrate(sweep("whole", slowly)).exit_code, 0);
  std::vector<std::string> list = sweep("stopped", slowly);
  list.insert(list.begin(), "twinrate");
  Program run(list);
  ASSERT_TRUE(wait_until([&] { return count_lines(run.out()) >= 3; }));
  run.signal(SIGINT);
  const ProgramResult stopped = run.wait(20);
  EXPECT_EQ(stopped.exit_code, 1);
  EXPECT_NE(stopped.err.find("--resume"), std::string::npos) << stopped.err;
  const int there = count_lines(read_text(path("stopped/points.csv")));
  EXPECT_GE(there, 4);
  const ProgramResult resumed = twinrate(sweep("stopped", {"--engine", "reference", "--resume"}));
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_LT(count_lines(resumed.out), count_lines(read_text(path("whole/points.csv"))) - 2);
  expect_same_result("whole", "stopped");
}

TEST_F(Sweep, TheLaneEngineFindsTheLimitsOfTheReferenceAndSaysWhenItIsAnotherSweep) {
  // Speeds whose limit is not close to a whole n: there one count of the ADC would decide.
  const auto clear = [](std::vector<std::string> list) {
    list[4] = "64,100";
    return list;
  };
  ASSERT_EQ(twinrate(clear(sweep("lanes"))).exit_code, 0);
  ASSERT_EQ(twinrate(clear(sweep("reference", {"--engine", "reference"}))).exit_code, 0);
  std::istringstream lanes(read_text(path("lanes/points.csv"))),
      reference(read_text(path("reference/points.csv")));
  std::string a, b;
  int rows = 0;
  const auto verdict_of = [](const std::string& row) {  // all but the last two figures
    return row.substr(0, row.rfind(',', row.rfind(',') - 1));
  };
  while (std::getline(lanes, a) && std::getline(reference, b)) {
    EXPECT_EQ(verdict_of(a), verdict_of(b));
    ++rows;
  }
  EXPECT_GT(rows, 10);
  EXPECT_EQ(twinrate(clear(sweep("lanes", {"--engine", "reference", "--resume"}))).exit_code, 2);
}

TEST_F(Sweep, MistakesAreOneLine) {
  for (const std::vector<std::string>& more : {std::vector<std::string>{"--policies", "late"},
                                               {"--shard", "2/2"},
                                               {"--start", "cold"},
                                               {"--engine", "fast"}}) {
    const ProgramResult result = twinrate(sweep("bad", more));
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
  }
  EXPECT_EQ(twinrate({"sweep", "merge", path("nothing")}).exit_code, 2);
}

// A Slurm of one node in a directory, for the lifetime of the object.
class OneNodeSlurm {
 public:
  explicit OneNodeSlurm(std::string directory) : directory_(std::move(directory)) {
    // The namespace of the test has only 127.0.0.1, with which Slurm finds no address.
    run_program({"ip", "addr", "add", "192.0.2.1/32", "dev", "lo"}, 10);
    const ProgramResult started = run_program({TWINRATE_SLURM_NODE, "start", directory_}, 60);
    if (started.exit_code != 0) why_not_ = started.err.empty() ? "no answer" : started.err;
    setenv("SLURM_CONF", (directory_ + "/slurm.conf").c_str(), 1);
  }
  ~OneNodeSlurm() {
    run_program({TWINRATE_SLURM_NODE, "stop", directory_}, 20);
    unsetenv("SLURM_CONF");
  }
  const std::string& why_not() const { return why_not_; }

 private:
  std::string directory_, why_not_;
};

// The array script with a Slurm of one node, if its daemons can be started.
TEST_F(Sweep, ASlurmArrayGivesTheSingleSweepBitForBit) {
  const OneNodeSlurm slurm(path("node"));
  if (!slurm.why_not().empty()) GTEST_SKIP() << slurm.why_not();
  ASSERT_EQ(twinrate(sweep("single")).exit_code, 0);
  setenv("TWINRATE", TWINRATE_PROGRAM, 1);
  std::vector<std::string> list = {
      "sbatch",      "--wait",   "--array=0-1", "--output=" + path("%a.out"), TWINRATE_SLURM_SCRIPT,
      path("slurm"), "dilys2021"};
  for (const char* text : {"--speeds", "150,200", "--seeds", "2", "--n-max", "20"})
    list.emplace_back(text);
  const ProgramResult submitted = run_program(list, 110);
  ASSERT_EQ(submitted.exit_code, 0) << submitted.err;
  ASSERT_EQ(twinrate({"sweep", "merge", path("slurm")}).exit_code, 0);
  expect_same_result("single", "slurm");
}

}  // namespace
}  // namespace twinrate::test
