#include "bench/blind/foreign_log.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>

#include "bench/blind/foreign_case.hpp"

namespace twinrate::blind {
namespace {

using Vector = ForeignPlant::Vector;
constexpr double kRoot3 = 1.7320508075688772;

// PI control of currents and speed in the frame of the readings; one tick of delay.
class ForeignControl {
 public:
  ForeignControl(const ForeignCase& f, double omega)
      : f_(f), m_(f.header.drawn.machine), omega_(omega), wanted_(omega) {}

  void read(double theta, Vector i, long k) {
    if (k > 0) {
      const double share = -std::expm1(-kTwoPi * f_.header.drawn.filter_bandwidth * T_s());
      const double ticks = static_cast<double>(std::max(1L, k - k_));
      omega_ += share * ((theta - theta_) / (ticks * T_s()) - omega_);
    }
    theta_ = theta, k_ = k;
    i_dq_ = i * std::polar(1.0, -m_.n_p * theta);
  }
  // The voltage for the tick after this one.
  Vector step(const Motion& motion, double t, Draw& d) {
    const Vector i_ref(motion.i_d(t), speed_loop(motion, t));
    const double w = kTwoPi * f_.header.drawn.current_bandwidth, omega_e = m_.n_p * omega_;
    const Vector error = i_ref - i_dq_;
    Vector u(w * m_.L_d * error.real(), w * m_.L_q * error.imag() + omega_e * m_.psi_f);
    u += sum_;
    if (f_.decoupled) u += omega_e * Vector(-m_.L_q * i_dq_.imag(), m_.L_d * i_dq_.real());
    if (f_.dither_V > 0) u += f_.dither_V * Vector(d.between(-1, 1), d.between(-1, 1));
    const double most = 0.95 * f_.header.drawn.v_dc / kRoot3;
    const double gain = f_.decoupled ? w * m_.R_s : 0.1 * w * w * m_.L_d;
    if (std::abs(u) <= most)
      sum_ += gain * T_s() * error;
    else
      u *= most / std::abs(u);
    return u * std::polar(1.0, m_.n_p * (theta_ + 1.5 * omega_ * T_s()));
  }
  double omega() const { return omega_; }
  double wanted() const { return wanted_; }

 private:
  double T_s() const { return 1 / f_.header.drawn.f_s; }
  double speed_loop(const Motion& motion, double t) {
    if (motion.turn_around > 0) {
      if (std::abs(omega_) > motion.turn_around) side_ = omega_ > 0 ? -1 : 1;
      return side_ * motion.i_q;
    }
    const double to = motion.speed(t), most = f_.header.slew_rad_s2 * T_s();
    wanted_ = motion.jumps ? wanted_ + std::clamp(to - wanted_, -most, most) : to;
    const double w = kTwoPi * f_.header.drawn.speed_bandwidth;
    const double gain = m_.J * w / m_.torque_constant(), error = wanted_ - omega_;
    const double asked = gain * error + speed_sum_;
    const double limit = std::min(0.95 * f_.header.drawn.i_range, f_.header.drawn.i_max());
    const double i_q = std::clamp(asked, -limit, limit);
    if (asked == i_q || error * asked < 0) speed_sum_ += f_.integral * w * gain * error * T_s();
    return i_q;
  }

  const ForeignCase& f_;
  const MachineParameters& m_;
  double theta_ = 0, omega_, wanted_, speed_sum_ = 0, side_ = 1;
  long k_ = 0;
  Vector i_dq_ = 0, sum_ = 0;
};

// The readings of one tick.
class ForeignReadings {
 public:
  explicit ForeignReadings(const ForeignCase& f) : f_(f) {}

  void take(const ForeignPlant& plant, double t, long k, Tick& tick) {
    past_.push_back({t, plant.theta(), plant.current()});
    if (past_.size() > kPast) past_.pop_front();
    const Vector i = at(t - f_.sensors.late_current_s).i;
    const double a = i.real(), b = -0.5 * a + 0.5 * kRoot3 * i.imag();
    const double theta = at(t - f_.sensors.late_angle_s).theta;
    Tick now = tick;
    now.i_abc = {phase(0, a, k), phase(1, b, k), phase(2, -a - b, k)};
    if (f_.header.drawn.current_sensors == 2) now.i_abc[2] = -now.i_abc[0] - now.i_abc[1];
    now.theta_m = angle(theta, k);
    now.v_dc = plant.bus_voltage(t) + f_.header.drawn.v_dc_noise * noise(3, k);
    now.there = k < kUnspoilt || chance(5, k) >= f_.sensors.missing;
    if (k > kUnspoilt && chance(6, k) < f_.sensors.stale) {
      now.i_abc = last_.i_abc;
      if (!f_.sensors.stale_currents_only) now.theta_m = last_.theta_m, now.v_dc = last_.v_dc;
    }
    tick = last_ = now;
  }

 private:
  static constexpr std::size_t kPast = 60;
  static constexpr long kUnspoilt = 10;  // first ticks
  struct Past {
    double t, theta;
    Vector i;
  };
  double noise(std::uint64_t stream, long k) const {
    return normal(f_.header.seed, 100 + stream, static_cast<std::uint64_t>(k));
  }
  double chance(std::uint64_t stream, long k) const {
    return uniform(f_.header.seed, 100 + stream, static_cast<std::uint64_t>(k));
  }
  Past at(double t) const {
    for (std::size_t j = past_.size() - 1; j-- > 0;)
      if (past_[j].t <= t) {
        const Past &a = past_[j], &b = past_[j + 1];
        const double share = (t - a.t) / (b.t - a.t);
        return {t, a.theta + share * (b.theta - a.theta), a.i + share * (b.i - a.i)};
      }
    return past_.front();
  }
  double phase(std::size_t which, double i, long k) const {
    const ForeignSensors& s = f_.sensors;
    double read =
        (1 + s.gain[which]) * i + s.offset_A[which] + f_.header.drawn.i_noise * noise(which, k);
    const double most = s.clip_A > 0 ? s.clip_A : f_.header.drawn.i_range;
    read = std::clamp(read, -most, most);
    return f_.header.drawn.i_lsb * std::round(read / f_.header.drawn.i_lsb);
  }
  double angle(double theta, long k) const {
    const ForeignSensors& s = f_.sensors;
    const double off = theta + s.offset_rad + s.eccentric_rad * std::sin(theta + s.eccentric_phase);
    const int counts = f_.header.drawn.encoder_counts;
    if (counts == 0) return off + f_.header.drawn.angle_noise * noise(4, k);
    return std::floor(off / kTwoPi * counts) * kTwoPi / counts;
  }

  const ForeignCase& f_;
  std::deque<Past> past_;
  Tick last_;
};

// Nothing if the loop loses the drive.
std::optional<std::vector<Tick>> run_foreign(const ForeignCase& f, const Motion& motion, Draw& d) {
  const DrawnMachine& x = f.header.drawn;
  const double T_s = 1 / x.f_s;
  ForeignPlant plant(x.machine, x.v_dc, f.plant);
  const bool moving =
      f.header.profile == "steady" || (f.before_s == 0 && !motion.jumps && !motion.turn_around);
  plant.place(d.between(0, kTwoPi), moving ? motion.speed(0) : 0);
  ForeignControl control(f, plant.omega());
  ForeignReadings sensors(f);
  std::vector<Tick> ticks;
  Vector before = 0, now = 0, next = 0;
  double T_load = 0;
  const auto n = std::lround((f.header.duration_s + f.before_s) * x.f_s);
  for (long k = 0; k < n; ++k) {
    const double since = static_cast<double>(k) * T_s, t = since - f.before_s;
    Tick tick;
    sensors.take(plant, t, k, tick);
    const Vec2 i = clarke(tick.i_abc);
    if (tick.there) control.read(tick.theta_m, Vector(i[0], i[1]), k);
    before = now, now = next;
    next = control.step(motion, since, d);
    T_load += std::clamp(motion.load(since) - T_load, -load_slew(f.header) * T_s,
                         load_slew(f.header) * T_s);
    tick.t = std::max(0.0, t), tick.T_load = T_load, tick.i_d_ref = motion.i_d(since);
    tick.omega_m = control.omega(), tick.omega_ref = control.wanted();
    tick.u_alphabeta = {now.real(), now.imag()};
    if (t > -0.5 * T_s) {
      ticks.push_back(tick);
      ticks.back().theta_m = wrap_turn(tick.theta_m);
    }
    plant.advance(t, T_s, now, before, T_load);
    const bool held = std::abs(plant.omega()) < 1.6 * x.machine.omega_m_rated &&
                      std::abs(plant.current()) < 0.98 * x.i_range;
    if (!held) return std::nullopt;
  }
  return ticks;
}

}  // namespace

std::pair<DrawnCase, DrawnLog> draw_foreign(std::uint64_t seed) {
  for (int attempt = 0;; ++attempt) {
    Draw d(seed * 7919 + 13 + 1000003 * static_cast<std::uint64_t>(attempt));
    ForeignCase f = draw_foreign_case(d, seed, attempt);
    const Motion motion = draw_motion(d, f);
    const std::optional<std::vector<Tick>> ticks = run_foreign(f, motion, d);
    if (!ticks) continue;
    DrawnLog log = log_of(f.header, *ticks);
    for (const std::string& kind : f.header.kinds)
      if (kind != "adc_clipping" || log.largest_current > f.sensors.clip_A - f.header.drawn.i_lsb)
        log.truth.push_back(kind);
    return {std::move(f.header), std::move(log)};
  }
}

}  // namespace twinrate::blind
