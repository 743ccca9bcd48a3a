// A closed loop has the same bits with every variant of the system's elementary functions, which
// glibc selects by the processor.
//
// The program runs itself again with instruction sets hidden from glibc and compares a hash of all
// messages of each loop. A hash of the library's own functions shows that its variants differ.
#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "model/random.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

constexpr const char* kPrintTo = "TWINRATE_SAME_BITS_FILE";

class Hash {
 public:
  void add(double x) { sum_ = splitmix64(sum_ ^ std::bit_cast<std::uint64_t>(x)); }
  template <class Matrix>
  void add(const Eigen::DenseBase<Matrix>& m) {
    for (Eigen::Index i = 0; i < m.size(); ++i) add(m.derived().data()[i]);
  }
  std::string text() const { return fmt::format("{:016x}", sum_); }

 private:
  std::uint64_t sum_ = 0;
};

void add_tick(Hash& hash, const ClosedLoop& loop) {
  const Measurement& m = loop.measurement();
  hash.add(m.i_abc), hash.add(m.u_alphabeta), hash.add(m.duty_abc), hash.add(m.theta_m);
  hash.add(m.omega_m), hash.add(m.v_dc), hash.add(m.theta_forced);
  const Truth& truth = loop.truth();
  hash.add(truth.i_dq), hash.add(truth.omega_m), hash.add(truth.theta_m), hash.add(truth.T_em);
  hash.add(truth.T_load);
  const Estimate& e = loop.estimate();
  hash.add(e.theta_e), hash.add(e.omega_m), hash.add(e.i_dq), hash.add(e.T_load);
  hash.add(e.x_hat), hash.add(e.innov);
  hash.add(loop.gain().K), hash.add(loop.gain().P);
  const Command& c = loop.command();
  hash.add(c.u_alphabeta_ref), hash.add(c.i_dq_ref), hash.add(c.theta_ctrl);
}

struct Pairing {
  const char* preset;
  Overrides overrides;
  const char* effects = "";
};

constexpr const char* kRubbing = R"(
[[effect]]
kind = "stribeck_friction"
torque_Nm = 0.0004
speed_rad_s = 20.0
exponent = 1.7
[[effect]]
kind = "coulomb_friction"
torque_Nm = 0.0003
[[effect]]
kind = "cogging"
order = 24
amplitude_Nm = 0.001
[[effect]]
kind = "saturation"
current_q_A = 4.0
[[effect]]
kind = "dead_time"
dead_time_s = 1e-6
shape = "atan"
)";
constexpr const char* kElastic = R"(
[[effect]]
kind = "torsion"
J_load_kgm2 = 4e-6
stiffness_Nm_rad = 1.0
[[effect]]
kind = "dc_bus_ripple"
amplitude_V = 0.5
frequency_Hz = 100.0
[[effect]]
kind = "flux_harmonics"
order = 24
amplitude_Wb = 1e-4
[[effect]]
kind = "resistance"
change_Ohm = 0.2
time_constant_s = 0.1
[[effect]]
kind = "encoder_eccentricity"
amplitude_rad = 0.01
)";

// Every filter, prediction, controller, start and policy, and effects with elementary functions.
const std::vector<Pairing> kPairings = {
    {"dilys2021", {}},
    {"dilys2021", {"estimator.prediction=rk4", "gain.policy=extrapolate"}},
    {"dilys2021", {"estimator.prediction=exact", "gain.policy=rotate"}},
    {"dilys2021", {"gain.policy=rotor_frame", "start=align_if"}},
    {"dilys2021", {"gain.policy=propagated", "rates.n=20"}},
    {"dilys2021", {"gain.policy=scheduled"}},
    {"dilys2021", {"estimator.kind=active_flux"}},
    {"dilys2021", {"estimator.kind=backemf_printed", "start=flying"}},
    {"dilys2021", {"estimator.kind=ekf_joint", "plant.inverter=switched"}},
    {"dilys2021", {"plant.saliency=fixed_axes"}},
    {"dilys2021", {"plant.engine=erk"}},
    {"dilys2021", {}, kRubbing},
    {"dilys2021", {}, kElastic},
    {"kim-ipmsm", {}},
    {"kim-ipmsm", {"estimator.kind=eemf", "estimator.prediction=exact"}},
    {"kim-ipmsm", {"estimator.kind=ekf_joint"}},
    {"niewiara2020", {}},
    {"niewiara2020", {"estimator.kind=ekf_disturbance", "controller.compensation=load"}},
    {"niewiara2020", {"estimator.kind=ekf_harmonic"}},
    {"niewiara2020", {"controller.compensation=angle_domain"}},
};

// "" where the loop did not turn: its bits would say nothing.
std::string bits_of(const Pairing& pairing) {
  Overrides overrides = pairing.overrides;
  overrides.emplace_back(kSanitized ? "run.duration_s=0.05" : "run.duration_s=0.3");
  overrides.emplace_back("run.settle_s=0.01");
  Hash hash;
  ClosedLoop loop(Config::parse(fmt::format("preset = \"{}\"\n{}", pairing.preset, pairing.effects),
                                "drive.toml", overrides));
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    add_tick(hash, loop);
  }
  return loop.truth().theta_m == 0 ? "" : hash.text();
}

std::string bits_of_the_library() {
  Hash hash;
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const volatile double x = 30 * uniform(1, 0, i), y = uniform(1, 1, i);
    hash.add(std::sin(x)), hash.add(std::cos(x)), hash.add(std::exp(-x)), hash.add(std::log(x));
    hash.add(std::atan2(y, x)), hash.add(std::tanh(y));
  }
  return hash.text();
}

using Bits = std::vector<std::string>;  // the library's, then one of each pairing

Bits bits_here() {
  Bits bits{bits_of_the_library()};
  for (const Pairing& pairing : kPairings) bits.push_back(bits_of(pairing));
  return bits;
}

// Of this program, started with these instruction sets hidden from the library.
Bits bits_without(const std::string& hidden) {
  const auto file = std::filesystem::temp_directory_path() /
                    fmt::format("twinrate_same_bits_{}{}", getpid(), hidden);
  const std::string command = fmt::format(
      "env -u GTEST_TOTAL_SHARDS {}={} GLIBC_TUNABLES=glibc.cpu.hwcaps={} {} "
      "--gtest_filter={} >/dev/null",
      kPrintTo, file.string(), hidden, std::filesystem::read_symlink("/proc/self/exe").string(),
      "SameBits.*");
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  std::ifstream in(file);
  Bits bits;
  for (std::string line; std::getline(in, line);) bits.push_back(line);
  std::filesystem::remove(file);
  return bits;
}

TEST(SameBits, OfEveryLoopWithEveryVariantOfTheSystemsFunctions) {
  const Bits here = bits_here();
  if (const char* file = std::getenv(kPrintTo)) {
    std::ofstream out(file);
    for (const std::string& line : here) out << line << "\n";
    return;
  }
  bool library_differs = false;
  for (const char* hidden : {"-FMA,-AVX2", "-AVX512F,-AVX512VL", "-FMA,-AVX2,-AVX,-SSE4_1"}) {
    const Bits there = bits_without(hidden);
    ASSERT_EQ(there.size(), here.size()) << hidden;
    library_differs = library_differs || there[0] != here[0];
    for (std::size_t i = 0; i < kPairings.size(); ++i) {
      EXPECT_NE(here[i + 1], "") << "pairing " << i << " stands still";
      EXPECT_EQ(there[i + 1], here[i + 1])
          << hidden << ", pairing " << i << ": " << kPairings[i].preset;
    }
  }
  if (!library_differs)
    GTEST_SKIP() << "equal, but so are the variants of this machine's library: nothing was shown";
}

}  // namespace
}  // namespace twinrate::test
