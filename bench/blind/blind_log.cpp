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

namespace {

bool repeats_samples(const Effects& effects) {
  return std::any_of(effects.begin(), effects.end(), [](const auto& effect) {
    SamplingFacts facts;
    effect->describe_sampling(facts);
    return facts.stale > 0;
  });
}

// Writes the measurements of a run as rows of a raw log. The voltage of a row is that of the next
// measurement, or the command if that measurement is lost.
class RowWriter {
 public:
  RowWriter(std::uint64_t seed, bool repeats, RawLog& raw)
      : seed_(seed), repeats_(repeats), raw_(raw) {}

  void take(const TickRecord& tick, std::int64_t k, double t, double T_load) {
    const Measurement& m = tick.measurement;
    if (pending_) append_voltage(m.signals & kVoltage ? m.u_alphabeta : u_applied_);
    u_applied_ = u_next_;
    u_next_ = tick.command.u_alphabeta_ref;
    if (m.signals & kPhaseCurrents) append(m, k, t, T_load);
  }
  void finish() {
    if (pending_) append_voltage(Vec2::Zero());
  }

 private:
  void append_voltage(const Vec2& u) {
    raw_.u_alpha.push_back(u[0]);
    raw_.u_beta.push_back(u[1]);
    pending_ = false;
  }
  void append(const Measurement& m, std::int64_t k, double t, double T_load) {
    raw_.t.push_back(t);
    raw_.i_a.push_back(m.i_abc[0]);
    raw_.i_b.push_back(m.i_abc[1]);
    raw_.i_c.push_back(m.i_abc[2]);
    const std::size_t row = raw_.i_a.size() - 1;
    const bool stale = repeats_ && row > 0 && raw_.i_a[row] == raw_.i_a[row - 1] &&
                       raw_.i_b[row] == raw_.i_b[row - 1] && m.theta_m == theta_m_before_;
    theta_m_before_ = m.theta_m;
    const auto noise = [&](std::uint64_t stream) {
      return normal(seed_, stream, static_cast<std::uint64_t>(k));
    };
    raw_.theta_m.push_back(stale ? raw_.theta_m.back()
                                 : m.theta_m + kCount_rad * std::round(noise(98)));
    raw_.v_dc.push_back(stale ? raw_.v_dc.back() : m.v_dc + 0.2 * noise(99));
    raw_.T_load.push_back(T_load);
    pending_ = true;
  }

  std::uint64_t seed_;
  bool repeats_;
  RawLog& raw_;
  bool pending_ = false;  // the last row has no voltage yet
  Vec2 u_applied_ = Vec2::Zero(), u_next_ = Vec2::Zero();
  double theta_m_before_ = 0;
};

}  // namespace

Log make_log(const Case& which, double duration_s) {
  Config config = plant(which, duration_s);
  ClosedLoop loop(config);
  const DriveConfig& drive = config.drive();
  Log log{.raw = {}, .truth = drive.plant_effects()};
  log.raw.path = which.name;
  RowWriter rows(which.seed, repeats_samples(log.truth), log.raw);
  double T_load = drive.load.T_load_Nm.at(0);
  const std::int64_t steps = drive.steps();
  for (std::int64_t k = 0; k < steps; ++k) {
    const double t_k = static_cast<double>(k) * drive.T_s();
    const TickRecord& tick = loop.step();
    T_load = slew(T_load, drive.load.T_load_Nm.at(t_k), drive.load.slew_Nm_s, drive.T_s());
    rows.take(tick, k, t_k, T_load);
  }
  rows.finish();
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
