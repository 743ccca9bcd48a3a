#include "trace/plan_blocks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model/effects/materiality.hpp"

namespace twinrate {
namespace {

constexpr double kRest = 0.1;  // s, at the end of a block

using Steps = std::vector<ProfileStep>;

// Builds a block from its beginning to its end.
class Builder {
 public:
  Builder(const Bench& bench, std::string name, std::string words) : bench_(bench) {
    block_.name = std::move(name);
    block_.words = std::move(words);
    set(block_.omega_m, 0);
    set(block_.T_load, 0);
    set(block_.i_d, 0);
  }
  Builder& speed(double omega_m) {
    if (!bench_.reverse) omega_m = std::abs(omega_m);
    // Holds until the ramp has reached the value.
    const double ramp = std::abs(omega_m - block_.omega_m.back().value) / bench_.slew;
    set(block_.omega_m, omega_m);
    return hold(ramp);
  }
  Builder& load(double T_load) {
    if (bench_.T_load_max == 0) return *this;
    const double ramp = std::abs(T_load - block_.T_load.back().value) / bench_.load_slew;
    set(block_.T_load, T_load);
    return hold(ramp);
  }
  Builder& i_d(double i_d) {
    set(block_.i_d, i_d);
    return *this;
  }
  Builder& hold(double seconds) {
    t_ += seconds;
    return *this;
  }
  // From zero to `peak` and back in `seconds`, in steps.
  template <class Set>
  Builder& triangle(double peak, double seconds, Set&& set_value) {
    const int steps = std::max(8, static_cast<int>(seconds / 0.02));
    for (int j = 1; j <= steps; ++j) {
      const double phase = static_cast<double>(j) / steps;
      set_value(peak * (1 - std::abs(2 * phase - 1)));
      hold(seconds / steps);
    }
    return *this;
  }
  PlanBlock end() {
    i_d(0).load(0);
    if (block_.omega_m.back().value != 0) speed(0);
    hold(kRest);
    block_.duration_s = std::ceil(100 * t_) / 100;
    return std::move(block_);
  }
  const PlanBlock& block() const { return block_; }
  void set_speed_now(double omega_m) {
    set(block_.omega_m, bench_.reverse ? omega_m : std::abs(omega_m));
  }

 private:
  void set(Steps& steps, double value) {
    const double t = std::round(1e4 * t_) / 1e4;
    if (!steps.empty() && steps.back().t_s >= t)
      steps.back().value = value;
    else if (steps.empty() || steps.back().value != value)
      steps.push_back({t, value});
  }
  const Bench& bench_;
  PlanBlock block_;
  double t_ = 0;
};

std::string rpm(double omega_m) {
  return fmt::format("{:.4g} rpm", std::abs(omega_m) * 60 / kTwoPi);
}

// Constant speed, forwards and backwards.
PlanBlock plateaus(const Bench& b, const char* name, double omega_m, double seconds) {
  return Builder(b, name, fmt::format("{} forwards and backwards, no load", rpm(omega_m)))
      .speed(omega_m)
      .hold(seconds)
      .speed(-omega_m)
      .hold(seconds)
      .end();
}

PlanBlock loaded(const Bench& b, const char* name, double omega_m, double T, double step_s) {
  return Builder(
             b, name,
             fmt::format("{} forwards and backwards, load steps of {:.3g} Nm braking and driving",
                         rpm(omega_m), T))
      .speed(omega_m)
      .hold(0.5 * step_s)
      .load(T)
      .hold(step_s)
      .load(-T)
      .hold(step_s)
      .load(0)
      .speed(-omega_m)
      .load(-T)
      .hold(step_s)
      .load(0.5 * T)
      .hold(step_s)
      .end();
}

PlanBlock field(const Bench& b, const char* name, double omega_m, double i_d, double T) {
  Builder builder(b, name,
                  fmt::format("{} with i_d steps of {:.3g} A{}", rpm(omega_m), i_d,
                              T > 0 ? fmt::format(" under {:.3g} Nm", T) : ""));
  builder.speed(omega_m).load(T).hold(0.15);
  for (double share : {-1.0, 0.5, -0.5, 1.0}) builder.i_d(share * i_d).hold(0.16);
  return builder.end();
}

PlanBlock rest_steps(const Bench& b, const char* name, double i_d) {
  Builder builder(b, name, fmt::format("at rest, i_d steps of both signs up to {:.3g} A", i_d));
  builder.hold(0.1);
  for (double share : {0.05, -0.05, 0.15, -0.15, 0.4, -0.4, 1.0, -1.0})
    builder.i_d(share * i_d).hold(0.12);
  return builder.end();
}

PlanBlock current_sweep(const Bench& b, const char* name, double omega_m, double i_d) {
  Builder builder(b, name,
                  fmt::format("{}, i_d swept slowly to {:.3g} A of both signs", rpm(omega_m), i_d));
  builder.speed(omega_m).hold(0.05);
  const auto set = [&](double value) { builder.i_d(value); };
  builder.triangle(i_d, 0.7, set).triangle(-i_d, 0.7, set);
  return builder.end();
}

PlanBlock speed_sweep(const Bench& b, const char* name, double omega_m, double seconds) {
  Builder builder(b, name, fmt::format("slow triangle to {} and back, both ways", rpm(omega_m)));
  const auto set = [&](double value) { builder.set_speed_now(value); };
  builder.triangle(omega_m, seconds, set).triangle(-omega_m, seconds, set);
  return builder.end();
}

PlanBlock reversals(const Bench& b, const char* name, double omega_m, int count) {
  Builder builder(b, name, fmt::format("{} reversals between +- {}", count, rpm(omega_m)));
  for (int j = 0; j < count; ++j) builder.speed(j % 2 ? -omega_m : omega_m).hold(0.04);
  return builder.end();
}

PlanBlock load_sweep(const Bench& b, const char* name, double omega_m, double T) {
  Builder builder(b, name,
                  fmt::format("{}, load swept slowly to {:.3g} Nm of both signs", rpm(omega_m), T));
  builder.speed(omega_m).hold(0.05);
  const auto set = [&](double value) { builder.load(value); };
  builder.triangle(T, 0.7, set).triangle(-T, 0.7, set);
  return builder.end();
}

double rated_torque(const MachineParameters& m) {
  return m.T_rated > 0 ? m.T_rated : m.torque_constant() * m.i_rated;
}

}  // namespace

Bench bench_of(const DriveConfig& drive, double i_limit) {
  const DriveFacts facts = drive.facts();
  const MachineParameters& m = facts.machine;
  constexpr double kOfVoltage = 0.8, kOfTorque = 0.5, kOfLoad = 0.6, kRampUp = 0.05;
  constexpr double kElectricalStep = 0.5;  // rad a sampling interval
  Bench b;
  const double fastest = kOfVoltage * facts.v_dc * std::numbers::inv_sqrt3 / (m.n_p * m.psi_f);
  const double followed = kElectricalStep * drive.rates.f_s_Hz / m.n_p;
  b.omega_m_max = std::min({rated_speed(facts), fastest, followed});
  const double K_t = m.torque_constant();
  b.i_max = m.i_rated > 0 ? m.i_rated : rated_torque(m) > 0 ? rated_torque(m) / K_t : i_limit;
  if (i_limit > 0) b.i_max = std::min(b.i_max, 0.95 * i_limit);
  const double T = std::min(rated_torque(m) > 0 ? rated_torque(m) : 1e300, K_t * b.i_max);
  b.T_load_max = kOfLoad * T;
  b.slew = kOfTorque * T / m.J;
  b.load_slew = T / kRampUp;
  return b;
}

std::vector<PlanBlock> building_blocks(const Bench& b) {
  const double fast = b.omega_m_max, medium = 0.4 * fast, slow = 0.1 * fast, crawl = 0.02 * fast;
  const double T = b.T_load_max, i_d = 0.5 * b.i_max;
  std::vector<PlanBlock> blocks = {
      rest_steps(b, "rest i_d", 0.8 * b.i_max),
      plateaus(b, "crawl", crawl, 0.6),
      plateaus(b, "slow", slow, 0.4),
      plateaus(b, "medium", medium, 0.4),
      plateaus(b, "fast", fast, 0.4),
      reversals(b, "reversals", 0.25 * fast, 6),
      reversals(b, "small reversals", 0.05 * fast, 10),
      speed_sweep(b, "speed sweep", 0.6 * fast, 1.0),
      field(b, "slow i_d", slow, i_d, 0),
      field(b, "medium i_d", medium, i_d, 0),
      field(b, "fast i_d", 0.8 * fast, i_d, 0),
      current_sweep(b, "slow i_d sweep", slow, 0.8 * b.i_max),
  };
  if (T > 0) {
    blocks.push_back(loaded(b, "crawl load", crawl, T, 0.35));
    blocks.push_back(loaded(b, "slow load", slow, T, 0.25));
    blocks.push_back(loaded(b, "medium load", medium, T, 0.25));
    blocks.push_back(loaded(b, "fast load", 0.9 * fast, 0.7 * T, 0.25));
    blocks.push_back(load_sweep(b, "slow load sweep", slow, T));
    blocks.push_back(field(b, "slow load i_d", slow, i_d, 0.6 * T));
    blocks.push_back(field(b, "medium load i_d", medium, i_d, 0.6 * T));
  }
  return blocks;
}

PlanProfile assemble(const std::vector<PlanBlock>& blocks, const std::vector<std::size_t>& order) {
  PlanProfile p;
  const auto add = [&](Steps& all, const Steps& own) {
    for (const ProfileStep& step : own)
      if (all.empty() || all.back().value != step.value)
        all.push_back({p.duration_s + step.t_s, step.value});
  };
  for (std::size_t b : order) {
    p.start_s.push_back(p.duration_s);
    add(p.omega_m, blocks[b].omega_m);
    add(p.T_load, blocks[b].T_load);
    add(p.i_d, blocks[b].i_d);
    p.duration_s += blocks[b].duration_s;
  }
  return p;
}

}  // namespace twinrate
