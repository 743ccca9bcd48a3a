#include "bench/blind/drawn_log.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <memory>

#include "core/config.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate::blind {
namespace {

// PI current and speed control on readings.
class DrawnControl {
 public:
  explicit DrawnControl(const DrawnCase& c)
      : c_(c), m_(c.drawn.machine), T_s_(1 / c.drawn.f_s), omega_ref_(c.speed_rad_s.at(0)) {
    if (c.profile != "steady") omega_ref_ = 0;
    omega_m_ = omega_ref_;
  }

  // `ticks`: since the previous reading; 0: there is none.
  void read_angle(double theta_m, int ticks) {
    const double a = std::min(1.0, kTwoPi * c_.drawn.filter_bandwidth * T_s_);
    if (ticks > 0) omega_m_ += a * (wrap_pi(theta_m - theta_m_) / (ticks * T_s_) - omega_m_);
    theta_m_ = theta_m;
  }
  void read_currents(const Vec3& i_abc) { i_dq_ = park(clarke(i_abc), m_.n_p * theta_m_); }
  // Stator voltage for the tick after this one.
  Vec2 step(double t) {
    omega_ref_ = slew(omega_ref_, c_.speed_rad_s.at(t), c_.slew_rad_s2, T_s_);
    const Vec2 i_ref(c_.i_d_A.at(t), speed_loop());
    const double theta_e = m_.n_p * (theta_m_ + 1.5 * omega_m_ * T_s_);
    return inverse_park(current_loop(i_ref), theta_e);
  }
  double omega_m() const { return omega_m_; }
  double omega_ref() const { return omega_ref_; }

 private:
  double speed_loop() {
    const double w = kTwoPi * c_.drawn.speed_bandwidth;
    const double gain = m_.J * w / m_.torque_constant();
    const double error = omega_ref_ - omega_m_, limit = c_.drawn.i_max();
    const double wanted = gain * error + speed_sum_;
    const double i_q = std::clamp(wanted, -limit, limit);
    if (wanted == i_q || error * wanted < 0) speed_sum_ += 0.25 * w * gain * error * T_s_;
    return i_q;
  }
  Vec2 current_loop(const Vec2& i_ref) {
    const double w = kTwoPi * c_.drawn.current_bandwidth, omega_e = m_.n_p * omega_m_;
    const Vec2 error = i_ref - i_dq_;
    const Vec2 ahead(-omega_e * m_.L_q * i_dq_[1], omega_e * (m_.L_d * i_dq_[0] + m_.psi_f));
    Vec2 u = w * Vec2(m_.L_d * error[0], m_.L_q * error[1]) + current_sum_ + ahead;
    const double limit = 0.98 * c_.drawn.v_dc * std::numbers::inv_sqrt3;
    if (u.norm() <= limit) current_sum_ += w * m_.R_s * T_s_ * error;
    return u.norm() > limit ? Vec2(u * (limit / u.norm())) : u;
  }

  const DrawnCase& c_;
  const MachineParameters& m_;
  double T_s_, omega_ref_, omega_m_ = 0, speed_sum_ = 0;
  double theta_m_ = 0;
  Vec2 i_dq_ = Vec2::Zero(), current_sum_ = Vec2::Zero();
};

HiddenPoint point_of(const Truth& truth, double t) {
  return {.t = t, .theta_m = truth.theta_m, .omega_m = truth.omega_m, .i_dq = truth.i_dq};
}

// Adds the errors of the readings that the plant does not simulate.
class Readings {
 public:
  explicit Readings(const DrawnCase& c)
      : c_(c), repeats_(std::count(c.kinds.begin(), c.kinds.end(), "stale_samples") > 0) {}
  void take(const Measurement& m, const Truth& truth, Tick& tick) {
    // A repeated row repeats its noise.
    const bool again = repeats_ && m.k > 0 && m.theta_m == before_.theta_m &&
                       m.v_dc == before_.v_dc && m.i_abc == before_.i_abc;
    const auto k = static_cast<std::uint64_t>(m.k);
    if (!again) noise_ = {normal(c_.seed, 98, k), normal(c_.seed, 99, k)};
    before_ = m;
    const double angle_noise = c_.drawn.encoder_counts > 0 ? 0 : c_.drawn.angle_noise;
    tick.theta_m = wrap_turn(angle_of(m, truth) + angle_noise * noise_[0]);
    tick.v_dc = m.v_dc + c_.drawn.v_dc_noise * noise_[1];
    tick.i_abc = m.i_abc;
    if (c_.hidden.current_A)
      for (double& i : tick.i_abc) i = c_.hidden.current_A(i);
    tick.there = m.signals & kPhaseCurrents;
  }

 private:
  double angle_of(const Measurement& m, const Truth& truth) const {
    if (!c_.hidden.angle_rad) return m.theta_m;
    const double theta_m = truth.theta_m + c_.hidden.angle_rad(point_of(truth, 0));
    const double step = c_.drawn.encoder_counts > 0 ? kTwoPi / c_.drawn.encoder_counts : 0;
    return step > 0 ? std::floor(theta_m / step) * step : theta_m;
  }
  const DrawnCase& c_;
  bool repeats_;
  Measurement before_;
  Vec2 noise_ = Vec2::Zero();
};

std::vector<std::string> columns_of(const DrawnCase& c) {
  std::vector<std::string> names = {"t"};
  if (c.mode == "angle_current") return {"t", "theta_m", "i_q"};
  if (c.mode == "novolt")
    names.insert(names.end(), {"i_a", "i_b"});
  else
    names.insert(names.end(), {"u_d", "u_q", "v_dc", "i_a", "i_b"});
  if (c.drawn.current_sensors == 3 || c.mode != "novolt") names.emplace_back("i_c");
  names.emplace_back("theta_m");
  if (c.mode != "novolt") names.insert(names.end(), {"omega_m", "omega_m_ref", "i_d_ref"});
  if (c.with_load) names.emplace_back("T_load");
  return names;
}

std::vector<double> row_of(const DrawnCase& c, const std::vector<Tick>& ticks, std::size_t k) {
  const Tick& x = ticks[k];
  const double theta_e = c.drawn.machine.n_p * x.theta_m;
  if (c.mode == "angle_current") return {x.t, x.theta_m, park(clarke(x.i_abc), theta_e)[1]};
  std::vector<double> row = {x.t};
  if (c.mode != "novolt") {
    const Vec2 u_dq = park(row_voltage(c, ticks, k), theta_e);
    row.insert(row.end(), {u_dq[0], u_dq[1], x.v_dc});
  }
  row.insert(row.end(), {x.i_abc[0], x.i_abc[1]});
  if (c.drawn.current_sensors == 3 || c.mode != "novolt") row.push_back(x.i_abc[2]);
  row.push_back(x.theta_m);
  if (c.mode != "novolt") row.insert(row.end(), {x.omega_m, x.omega_ref, x.i_d_ref});
  if (c.with_load) row.push_back(x.T_load);
  return row;
}

// A limit of the converter that no row reaches does not change the log.
std::vector<std::string> shown(const DrawnCase& c, double largest) {
  const Config config = Config::parse(plant_toml(c), c.name);
  SamplingFacts facts;
  for (const auto& effect : config.drive().plant_effects()) effect->describe_sampling(facts);
  const double coarsest = std::max(c.drawn.i_lsb, facts.i_lsb);
  std::vector<std::string> kinds;
  for (const std::string& kind : c.kinds)
    if (kind != "adc_clipping" || largest >= facts.i_limit - coarsest / 2) kinds.push_back(kind);
  return kinds;
}

// The hidden voltage in stator axes, `ahead` seconds later.
Vec2 hidden_voltage(const DrawnCase& c, HiddenPoint p, double ahead) {
  if (!c.hidden.voltage_V) return Vec2::Zero();
  p.t += ahead, p.theta_m += ahead * p.omega_m;
  return inverse_park(c.hidden.voltage_V(p), c.drawn.machine.n_p * p.theta_m);
}

}  // namespace

std::vector<Tick> simulate(const DrawnCase& c) {
  Config config = Config::parse(plant_toml(c), c.name);
  const DriveConfig& drive = config.drive();
  Plant plant(config);
  std::vector<Tick> ticks(static_cast<std::size_t>(drive.steps()));
  DrawnControl control(c);
  Readings readings(c);
  double T_load = drive.load.T_load_Nm.at(0);
  Vec2 unseen = Vec2::Zero(), applied_unseen = unseen;
  std::size_t last = 0;  // last tick with readings
  for (std::size_t k = 0; k < ticks.size(); ++k) {
    Tick& tick = ticks[k];
    tick.t = static_cast<double>(k) * drive.T_s();
    const Measurement m = plant.sample();
    const HiddenPoint now = point_of(plant.truth(), tick.t);
    if (k > 0) ticks[k - 1].u_alphabeta = m.u_alphabeta - applied_unseen;
    readings.take(m, plant.truth(), tick);
    if (tick.there || k == 0) {
      control.read_angle(tick.theta_m, static_cast<int>(k - last));
      control.read_currents(tick.i_abc);
      last = k;
    }
    const Vec2 u = control.step(tick.t);
    tick.omega_m = control.omega_m(), tick.omega_ref = control.omega_ref();
    T_load = slew(T_load, c.load_Nm.at(tick.t), load_slew(c), drive.T_s());
    tick.T_load = T_load, tick.i_d_ref = c.i_d_A.at(tick.t);
    Command command;
    // The voltage acts during the next tick, so it is that for the middle of that tick.
    applied_unseen = unseen;
    unseen = hidden_voltage(c, now, 1.5 * drive.T_s());
    command.k = m.k, command.u_alphabeta_ref = u + unseen;
    plant.take_command(command);
    if (c.hidden.torque_Nm) plant.follow_load(Profile({{0, T_load + c.hidden.torque_Nm(now)}}));
    plant.advance();
  }
  ticks.pop_back();  // its voltage is unknown
  return ticks;
}

Vec2 row_voltage(const DrawnCase& c, const std::vector<Tick>& ticks, std::size_t k) {
  if (!c.mean_voltage) return ticks[k].u_alphabeta;
  Vec2 sum = Vec2::Zero();
  const std::size_t end = std::min(ticks.size(), k + static_cast<std::size_t>(c.every));
  for (std::size_t j = k; j < end; ++j) sum += ticks[j].u_alphabeta;
  return sum / static_cast<double>(end - k);
}

DrawnLog log_of(const DrawnCase& c, const std::vector<Tick>& ticks) {
  DrawnLog log;
  log.columns = columns_of(c);
  for (const Tick& x : ticks) {
    log.largest_current = std::max(log.largest_current, x.i_abc.cwiseAbs().maxCoeff());
    log.largest_speed = std::max(log.largest_speed, std::abs(x.omega_m));
  }
  for (std::size_t k = 0; k < ticks.size(); k += static_cast<std::size_t>(c.every))
    if (ticks[k].there) log.rows.push_back(row_of(c, ticks, k));
  log.ran_away = !(log.largest_current < 0.99 * c.drawn.i_range &&
                   log.largest_speed < 1.5 * c.drawn.machine.omega_m_rated);
  return log;
}

DrawnLog make_log(const DrawnCase& c) {
  DrawnLog log = log_of(c, simulate(c));
  log.truth = shown(c, log.largest_current);
  return log;
}

void write_csv(const DrawnLog& log, const std::string& path) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "wb1"), gzclose);
  if (!file) throw BadInput(path + ": cannot be written");
  std::string text;
  for (const std::string& name : log.columns) text += (text.empty() ? "" : ",") + name;
  text += "\n";
  std::vector<int> digits;
  for (const std::string& name : log.columns)
    digits.push_back(name == "theta_m" || name == "t" ? 11 : 7);
  for (std::size_t k = 0; k < log.rows.size(); ++k) {
    for (std::size_t j = 0; j < digits.size(); ++j)
      fmt::format_to(std::back_inserter(text), "{}{:.{}g}", j ? "," : "", log.rows[k][j],
                     digits[j]);
    text += "\n";
    if (text.size() < (1u << 20) && k + 1 < log.rows.size()) continue;
    if (gzwrite(file.get(), text.data(), static_cast<unsigned>(text.size())) <= 0)
      throw BadInput(path + ": the disk is full");
    text.clear();
  }
}

}  // namespace twinrate::blind
