#include "bench/blind/blind_log.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "model/random.hpp"

namespace twinrate::blind {
namespace {

constexpr double kCount_rad = kTwoPi / (1 << 20);  // encoder
constexpr double kLsb_A = 0.009765625;             // current sensors

std::vector<std::vector<double>*> columns_of(RawLog& raw) {
  return {&raw.t,      &raw.i_a,     &raw.i_b,  &raw.i_c,   &raw.u_alpha,
          &raw.u_beta, &raw.theta_m, &raw.v_dc, &raw.T_load};
}

void leave_out_unreached(Log& log) {
  double largest = 0;
  for (const std::vector<double>* i : {&log.raw.i_a, &log.raw.i_b})
    for (double x : *i) largest = std::max(largest, std::abs(x));
  double coarsest = kLsb_A;
  for (const auto& effect : log.truth) {
    SamplingFacts facts;
    effect->describe_sampling(facts);
    coarsest = std::max(coarsest, facts.i_lsb);
  }
  std::erase_if(log.truth, [&](const auto& effect) {
    SamplingFacts facts;
    effect->describe_sampling(facts);
    return facts.i_limit > 0 && largest < facts.i_limit - coarsest / 2;
  });
}

}  // namespace

Config declared() {
  return load_drive("niewiara2020", {"machine.B_Nms=0.002", "sensors.current_sensors=2"});
}

namespace {

Config plant(const Case& which, double duration_s) {
  // The preset without its own disturbance set.
  const std::string toml = load_drive("niewiara2020").resolved_with({}) + which.effects_toml;
  return Config::parse(toml, which.name, overrides(which, duration_s));
}

}  // namespace

std::string plant_toml(const Case& which, double duration_s) {
  Config config = plant(which, duration_s);
  read_all_tables(config);
  return config.resolved();
}

Log make_log(const Case& which, double duration_s) {
  Config config = plant(which, duration_s);
  ClosedLoop loop(config);
  const DriveConfig& drive = config.drive();
  Log log{.raw = {}, .truth = drive.plant_effects()};
  RawLog& raw = log.raw;
  raw.path = which.name;
  double T_load = drive.load.T_load_Nm.at(0);
  Vec2 asked = Vec2::Zero(), before = Vec2::Zero();
  bool open = false;  // the row before waits for its voltage
  double theta_m_before = 0;
  const bool repeats = std::any_of(log.truth.begin(), log.truth.end(), [](const auto& effect) {
    SamplingFacts facts;
    effect->describe_sampling(facts);
    return facts.stale > 0;
  });
  const std::int64_t steps = drive.steps();
  for (std::int64_t k = 0; k < steps; ++k) {
    const double t_k = static_cast<double>(k) * drive.T_s();
    const TickRecord& tick = loop.step();
    const Measurement& m = tick.measurement;
    if (open) {  // what the row before was followed by; the command itself where the row is lost
      const Vec2 u = m.signals & kVoltage ? m.u_alphabeta : asked;
      raw.u_alpha.push_back(u[0]);
      raw.u_beta.push_back(u[1]);
      open = false;
    }
    asked = before;
    before = tick.command.u_alphabeta_ref;
    T_load = slew(T_load, drive.load.T_load_Nm.at(t_k), drive.load.slew_Nm_s, drive.T_s());
    if (!(m.signals & kPhaseCurrents)) continue;
    raw.t.push_back(t_k);
    raw.i_a.push_back(m.i_abc[0]);
    raw.i_b.push_back(m.i_abc[1]);
    raw.i_c.push_back(m.i_abc[2]);
    const bool stale = repeats && raw.i_a.size() > 1 &&
                       raw.i_a.back() == raw.i_a[raw.i_a.size() - 2] &&
                       raw.i_b.back() == raw.i_b[raw.i_b.size() - 2] && m.theta_m == theta_m_before;
    theta_m_before = m.theta_m;
    const auto noise = [&](std::uint64_t stream) {
      return normal(which.seed, stream, static_cast<std::uint64_t>(k));
    };
    raw.theta_m.push_back(stale ? raw.theta_m.back()
                                : m.theta_m + kCount_rad * std::round(noise(98)));
    raw.v_dc.push_back(stale ? raw.v_dc.back() : m.v_dc + 0.2 * noise(99));
    raw.T_load.push_back(T_load);
    open = true;
  }
  if (open) {
    raw.u_alpha.push_back(0);
    raw.u_beta.push_back(0);
  }
  leave_out_unreached(log);
  return log;
}

Log cached_log(const Case& which, const std::string& cache) {
  if (cache.empty()) return make_log(which);
  const std::string path = cache + "/" + which.name + ".bin";
  if (std::ifstream file(path, std::ios::binary); file) {
    Log log;
    log.raw.path = which.name;
    const Config config = Config::parse(
        Config::load("niewiara2020").resolved_with({}) + which.effects_toml, which.name);
    log.truth = config.drive().plant_effects();
    std::uint64_t n = 0;
    file.read(reinterpret_cast<char*>(&n), sizeof n);
    for (std::vector<double>* c : columns_of(log.raw)) {
      c->resize(n);
      file.read(reinterpret_cast<char*>(c->data()),
                static_cast<std::streamsize>(n * sizeof(double)));
    }
    leave_out_unreached(log);
    return log;
  }
  Log log = make_log(which);
  std::filesystem::create_directories(cache);
  std::ofstream file(path, std::ios::binary);
  const std::uint64_t n = log.raw.t.size();
  file.write(reinterpret_cast<const char*>(&n), sizeof n);
  for (std::vector<double>* c : columns_of(log.raw))
    file.write(reinterpret_cast<const char*>(c->data()),
               static_cast<std::streamsize>(n * sizeof(double)));
  return log;
}

}  // namespace twinrate::blind
