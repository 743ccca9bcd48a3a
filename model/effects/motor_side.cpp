#include "model/effects/motor_side.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/effects/load_mass.hpp"
#include "model/four.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMost = 2 * kLanes;  // in one go

double turned(double from, double to) {
  const double angle = to - from;
  return std::abs(angle) < kPi ? angle : wrap_pi(angle);
}

// Neighbouring rows that are not neighbours in time.
bool is_seam(const OperatingPoint& a, const OperatingPoint& b, double T_s) {
  return b.t - a.t < 0 || b.t - a.t > 2.5 * T_s;
}

bool has_load(const ShaftFacts& shaft) {
  return shaft.J_load > 0;
}

// Twist for a newton metre by which the measured torque exceeds the shaft's (MotorSide::tie).
double tied_twist(const ShaftFacts& shaft, double damping, double T_s) {
  constexpr double kLargest = 0.5;  // of the twist of that torque, at one row
  const double omega_0 = std::sqrt(shaft.stiffness / shaft.J_load);
  return std::min(kLargest, 2 * damping * omega_0 * T_s) / shaft.stiffness;
}

// Four load masses, computed like LoadMass while no contact changes; a lane with a change goes
// through LoadMass.
class FourMasses {
 public:
  FourMasses(const ShaftFacts* shafts, double T_s, double tie)
      : shafts_(shafts), h_(T_s), tied_(tie > 0) {
    for (int l = 0; l < kLanes; ++l) {
      const ShaftFacts& s = shafts[l];
      masses_.emplace_back(s, T_s, ShaftState{});
      const Oscillation whole = Oscillation::of(s, T_s);
      half_[l] = 0.5 * s.gap;
      K_[l] = s.stiffness;
      D_[l] = s.damping;
      compliance_[l] = 1 / s.stiffness;
      J_[l] = s.J_load;
      per_J_[l] = 1 / s.J_load;
      twist_[l] = tied_twist(s, tie, T_s);
      dd_[l] = whole.Phi_dd;
      dr_[l] = whole.Phi_dr;
      rd_[l] = whole.Phi_rd;
      rr_[l] = whole.Phi_rr;
    }
  }
  template <class Of>  // state of a shaft
  void set(Of of) {
    for (int l = 0; l < kLanes; ++l) set(l, of(shafts_[l]));
  }
  // Torque at the row, then on to the next (LoadMass::advance).
  inline __attribute__((always_inline)) void step(const MotorSide::Row& row, double* const* T_load,
                                                  std::size_t k) {
    const Four zero{}, one = zero + 1.0;
    FourTruths above = delta_ > half_, below = delta_ < -half_;
    Four over = K_ * (delta_ - half_), under = K_ * (delta_ + half_);
    {
      const Four damped = D_ * (row.omega_m - omega_load_);
      const Four pushed = over + damped, pulled = under + damped;
      const Four torque =
          above ? (pushed > 0.0 ? pushed : zero) : (below ? (pulled < 0.0 ? pulled : zero) : zero);
      for (int l = 0; l < kLanes; ++l) T_load[l][k] = torque[l] - row.behind;
      if (tied_) {
        delta_ += row.tied * twist_ * (row.torque + J_ * row.torque_per_inertia - torque);
        above = delta_ > half_, below = delta_ < -half_;
        over = K_ * (delta_ - half_), under = K_ * (delta_ + half_);
      }
    }
    const Four rate = row.begin - omega_load_, damped = D_ * rate;
    const FourTruths upper = above & (over + damped > 0.0), lower = below & (under + damped < 0.0),
                     on = upper | lower;
    const Four at = upper ? half_ : (lower ? -half_ : zero);
    const Four held = row.held + J_ * row.omega_rate, parting = held * per_J_;
    const Four rest = at + held * compliance_, d = delta_ - rest;
    const Four delta =
        on ? rest + dd_ * d + dr_ * rate : delta_ + h_ * rate + 0.5 * h_ * h_ * parting;
    const Four rate_end = on ? rd_ * d + rr_ * rate : rate + h_ * parting;
    const Four side = lower ? -one : one;
    const Four beyond = (delta < 0.0 ? -delta : delta) - half_;
    const Four pressing = K_ * beyond + D_ * (delta < 0.0 ? -rate_end : rate_end);
    const Four margin = on ? side * (delta - at) * K_ + side * D_ * rate_end
                           : -(pressing < beyond ? pressing : beyond);
    const FourTruths changed = margin < 0.0;
    const Four delta_before = delta_, omega_load_before = omega_load_;
    delta_ = delta;
    omega_load_ = row.begin + h_ * row.omega_rate - rate_end;
    if (!(changed[0] | changed[1] | changed[2] | changed[3])) return;
    for (int l = 0; l < kLanes; ++l) {
      if (!changed[l]) continue;
      masses_[static_cast<std::size_t>(l)].set_state({delta_before[l], omega_load_before[l]});
      masses_[static_cast<std::size_t>(l)].advance(row.begin, row.omega_rate, row.held);
      set(l, masses_[static_cast<std::size_t>(l)].state());
    }
  }

 private:
  void set(int l, const ShaftState& x) {
    delta_[l] = x.delta;
    omega_load_[l] = x.omega_load;
  }
  const ShaftFacts* shafts_;
  double h_;
  bool tied_;
  std::vector<LoadMass> masses_;
  Four half_, K_, D_, compliance_, J_, per_J_, twist_, dd_, dr_, rd_, rr_, delta_{}, omega_load_{};
};

}  // namespace

MotorSide::MotorSide(std::span<const OperatingPoint> record, std::vector<double> behind, double T_s,
                     double held)
    : T_s_(T_s), rows_(behind.size()) {
  const std::size_t N = rows_.size();
  const double of_next = 0.5 * (1 - held);
  std::vector<double> mean(N);  // speed from a row to the next
  for (std::size_t k = 0; k < N; ++k) rows_[k].behind = rows_[k].held = behind[k];
  if (N < 2) return;
  std::vector<char> seam(N, 0);  // before the row
  for (std::size_t k = 0; k + 1 < N; ++k) {
    mean[k] = turned(record[k].theta_m, record[k + 1].theta_m) / T_s;
    seam[k + 1] = is_seam(record[k], record[k + 1], T_s);
    if (!seam[k + 1]) rows_[k].held += of_next * (behind[k + 1] - behind[k]);
  }
  mean[N - 1] = mean[N - 2];
  for (std::size_t k = 0; k < N; ++k) {
    const bool start = k == 0 || (k + 1 < N && seam[k]);
    Row& row = rows_[k];
    row.omega_m = start ? mean[k] : 0.5 * (mean[k - 1] + mean[k]);
    if (!start && k + 2 < N && !seam[k + 1] && !seam[k + 2])
      row.omega_rate = (mean[k + 1] - mean[k - 1]) / (2 * T_s);
    row.begin = mean[k] - 0.5 * T_s * row.omega_rate;
    if (start) starts_.push_back(start_at(record, mean, k));
  }
}

// From polynomials through the angle's first rows: the encoder's last digit is 0.06 rad/s between
// two of them, which would set the load ringing.
MotorSide::Start MotorSide::start_at(std::span<const OperatingPoint> record,
                                     std::span<const double> mean, std::size_t row) const {
  constexpr std::size_t kRows = 20, kLeast = 8, kMostRows = kRows << 10;
  constexpr double kSure = 5;  // standard deviations of a speed
  Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
  Eigen::Vector4d b = Eigen::Vector4d::Zero();
  Start start{.row = row, .omega_m = mean[row], .over = {}};
  double angle = 0, squares = 0;
  std::size_t n = 0, next = kRows;
  const auto look = [&] {  // time in rows
    const auto parabola = A.topLeftCorner<3, 3>().ldlt();
    const Eigen::Vector3d x = parabola.solve(b.head<3>());
    const Eigen::Vector4d cubic = A.ldlt().solve(b);
    const double rows = static_cast<double>(n),
                 noise = std::max(0.0, squares - x.dot(b.head<3>())) / (rows - 3),
                 sigma = std::sqrt(noise * parabola.solve(Eigen::Vector3d::Unit(1))[1]);
    if (start.over.empty()) start.omega_m = x[1] / T_s_;
    start.over.push_back(
        {.seconds = rows * T_s_,
         .omega_m = cubic[1] / T_s_,
         .omega_rate = cubic[2] / (T_s_ * T_s_),
         .jerk = cubic[3] / (T_s_ * T_s_ * T_s_),
         .moved = std::abs(x[1]) > std::max(rows * std::abs(x[2]), kSure * sigma)});
  };
  for (; n < kMostRows && row + n < record.size(); ++n) {
    if (n > 0 && is_seam(record[row + n - 1], record[row + n], T_s_)) break;
    if (n == next) look(), next *= 2;
    const double t = static_cast<double>(n);
    const Eigen::Vector4d x(1, t, t * t / 2, t * t * t / 6);
    if (n > 0) angle += T_s_ * mean[row + n - 1];
    A += x * x.transpose();
    b += angle * x;
    squares += angle * angle;
  }
  if (n >= kLeast && (start.over.empty() || n > next / 2 + kLeast)) look();
  return start;
}

void MotorSide::tie(std::span<const Measured> measured, double damping) {
  tie_ = damping;
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    rows_[k].torque = measured[k].torque;
    rows_[k].torque_per_inertia = measured[k].torque_per_inertia;
    rows_[k].tied = measured[k].known ? 1 : 0;
  }
}

// The cubic over at least a period of the load against a held motor, which leaves its ringing out.
// A motor that begins to turn at the first row is no faster than its acceleration makes it in the
// time of a parabola, and its load is at rest.
ShaftState MotorSide::at_start(const ShaftFacts& shaft, const Start& start) const {
  constexpr double kShort = 0.25;  // of a period: in a longer time an acceleration may end
  const double period = kTwoPi * std::sqrt(shaft.J_load / shaft.stiffness),
               behind = rows_[start.row].behind;
  const Start::Motion* motion = nullptr;
  bool moved = false;
  for (const Start::Motion& m : start.over) {
    if (!motion || m.seconds <= kShort * period) moved |= m.moved;
    motion = &m;
    if (m.seconds >= period) break;
  }
  if (!moved) return shaft_at_rest(shaft, start.omega_m, behind);
  return shaft_at_rest(shaft, motion->omega_m - shaft.J_load / shaft.stiffness * motion->jerk,
                       behind + shaft.J_load * motion->omega_rate);
}

void MotorSide::along(const ShaftFacts& shaft, std::span<double> T_load) const {
  const std::size_t N = rows();
  if (N < 2 || !has_load(shaft)) {
    std::fill(T_load.begin(), T_load.end(), 0.0);
    return;
  }
  LoadMass load(shaft, T_s_, {});
  const double twist = tied_twist(shaft, tie_, T_s_);
  auto start = starts_.begin();
  for (std::size_t k = 0; k < N; ++k) {
    if (start != starts_.end() && start->row == k) load.set_state(at_start(shaft, *start++));
    const Row& row = rows_[k];
    const double torque = load.torque(row.omega_m);
    T_load[k] = torque - row.behind;
    if (tie_ > 0) {
      const ShaftState x = load.state();
      load.set_state({x.delta + row.tied * twist *
                                    (row.torque + shaft.J_load * row.torque_per_inertia - torque),
                      x.omega_load});
    }
    load.advance(row.begin, row.omega_rate, row.held);
  }
}

std::vector<ShaftState> MotorSide::load_mass(const ShaftFacts& shaft) const {
  std::vector<ShaftState> states(rows());
  LoadMass load(shaft, T_s_, {});
  auto start = starts_.begin();
  for (std::size_t k = 0; k < rows(); ++k) {
    if (start != starts_.end() && start->row == k) load.set_state(at_start(shaft, *start++));
    states[k] = load.state();
    load.advance(rows_[k].begin, rows_[k].omega_rate, rows_[k].held);
  }
  return states;
}

// Two groups of four do not wait for each other.
inline __attribute__((always_inline)) void MotorSide::eight(const ShaftFacts* shafts,
                                                            double* const* T_load) const {
  FourMasses a(shafts, T_s_, tie_), b(shafts + kLanes, T_s_, tie_);
  auto start = starts_.begin();
  for (std::size_t k = 0; k < rows(); ++k) {
    if (start != starts_.end() && start->row == k) {
      const auto rest = [&](const ShaftFacts& shaft) { return at_start(shaft, *start); };
      a.set(rest);
      b.set(rest);
      ++start;
    }
    a.step(rows_[k], T_load, k);
    b.step(rows_[k], T_load + kLanes, k);
  }
}

inline __attribute__((always_inline)) void MotorSide::four(const ShaftFacts* shafts,
                                                           double* const* T_load) const {
  FourMasses a(shafts, T_s_, tie_);
  auto start = starts_.begin();
  for (std::size_t k = 0; k < rows(); ++k) {
    if (start != starts_.end() && start->row == k) {
      a.set([&](const ShaftFacts& shaft) { return at_start(shaft, *start); });
      ++start;
    }
    a.step(rows_[k], T_load, k);
  }
}

void MotorSide::portable(const ShaftFacts* shafts, std::size_t count, double* const* T_load) const {
  count > kLanes ? eight(shafts, T_load) : four(shafts, T_load);
}

__attribute__((target("avx2"))) void MotorSide::avx2(const ShaftFacts* shafts, std::size_t count,
                                                     double* const* T_load) const {
  count > kLanes ? eight(shafts, T_load) : four(shafts, T_load);
}

void MotorSide::along(std::span<const ShaftFacts> shafts,
                      std::span<std::vector<double>> T_load) const {
  std::vector<std::size_t> with_gap;
  for (std::size_t s = 0; s < shafts.size(); ++s) {
    T_load[s].resize(rows());
    if (rows() > 1 && has_load(shafts[s]) && shafts[s].gap > 0)
      with_gap.push_back(s);
    else
      along(shafts[s], T_load[s]);
  }
  std::vector<double> unused;
  for (std::size_t first = 0; first < with_gap.size(); first += kMost) {
    const std::size_t count = std::min<std::size_t>(kMost, with_gap.size() - first);
    if (count == 1) {
      along(shafts[with_gap[first]], T_load[with_gap[first]]);
      continue;
    }
    ShaftFacts these[kMost];
    double* out[kMost];
    unused.resize(rows());
    for (std::size_t l = 0; l < kMost; ++l) {
      these[l] = shafts[with_gap[first + std::min(l, count - 1)]];
      out[l] = l < count ? T_load[with_gap[first + l]].data() : unused.data();
    }
    has_avx2() ? avx2(these, count, out) : portable(these, count, out);
  }
}

}  // namespace twinrate
