#include "trace/shaft_search.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"

namespace twinrate {
namespace {

constexpr double kApart = 0.26;     // of the logarithm of a key: nearer starts count as one
constexpr std::size_t kPiece = 64;  // outputs in a piece
constexpr double kLeastInertia = -0.4, kMostInertia = 0.8;  // of machine.J, if it is free

std::vector<std::string> keys(const Effect& shaft) {
  std::vector<std::string> names = {"J_load_kgm2", "stiffness_Nm_rad", "damping_Nms_rad"};
  if (is_placed(shaft, Traits::Place::kGap)) names.push_back("gap_rad");
  return names;
}
Eigen::VectorXd logs(const ShaftSearch::Point& p) {
  const std::vector<std::string> names = keys(*p.shaft);
  Eigen::VectorXd x(static_cast<Eigen::Index>(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i)
    x[static_cast<Eigen::Index>(i)] = std::log(std::max(1e-12, get_key(*p.shaft, names[i])));
  return x;
}

// A copy of the shaft with other keys.
std::shared_ptr<Effect> moved(const ShaftSearch::Point& like, const Eigen::VectorXd& logs) {
  std::shared_ptr<Effect> shaft = like.shaft->clone();
  const std::vector<std::string> names = keys(*shaft);
  for (std::size_t i = 0; i < names.size(); ++i)
    set_key(*shaft, names[i], std::exp(logs[static_cast<Eigen::Index>(i)]));
  return shaft;
}

MotorSide motor_side(const Chain& chain, const Members& now, bool all) {
  std::vector<OperatingPoint> points = chain.equations().points();
  const std::size_t stride = all ? 1 : chain.sampler().stride();
  if (!all) {
    std::size_t kept = 0;
    for (std::size_t k = chain.sampler().first(); k < points.size(); k += stride)
      points[kept++] = points[k];
    points.resize(kept);
  }
  Effects loads = chain.equations().known();
  loads.insert(loads.end(), now.begin(), now.end());
  const Record& record = chain.equations().record();
  return {points, load_behind_shaft(loads, points), static_cast<double>(stride) * record.T_s, 0};
}

// The torque in the shaft at each row, between neighbouring outputs on a straight line.
std::vector<MotorSide::Measured> measured_torque(const Chain& chain, const Eigen::VectorXd& left,
                                                 const Eigen::VectorXd& acceleration, bool all,
                                                 std::size_t rows) {
  const Sampler& sampler = chain.sampler();
  const Runs& runs = sampler.torque();
  const std::size_t stride = all ? 1 : sampler.stride(), first = all ? 0 : sampler.first();
  std::vector<MotorSide::Measured> measured(rows);
  for (std::size_t n = 0; n + 1 < runs.row.size(); ++n) {
    const std::size_t from = runs.row[n], to = runs.row[n + 1];
    if (to != from + static_cast<std::size_t>(sampler.decimation())) continue;
    const auto i = static_cast<Eigen::Index>(n);
    for (std::size_t k = (from - first + stride - 1) / stride; first + k * stride <= to; ++k) {
      const double share = static_cast<double>(first + k * stride - from) /
                           static_cast<double>(sampler.decimation());
      if (k < rows)
        measured[k] = {left[i] + share * (left[i + 1] - left[i]),
                       acceleration[i] + share * (acceleration[i + 1] - acceleration[i]), true};
    }
  }
  return measured;
}

}  // namespace

ShaftSearch::ShaftSearch(const Chain& chain, const Members& now, Inertia inertia, Rows rows)
    : chain_(chain),
      all_(rows == Rows::kAll),
      free_(inertia == Inertia::kFree),
      motor_(motor_side(chain, now, all_)) {
  const Runs& runs = chain.sampler().torque();
  for (std::size_t first = 0; first + kPiece <= runs.row.size(); first += kPiece) {
    if (runs.held_out[first]) continue;
    for (std::size_t n = first; n < first + kPiece; ++n)
      outputs_.push_back(static_cast<Eigen::Index>(n));
  }
  const Sampled left = chain.residual({now.begin(), now.end()});
  const Chain::Columns of_inertia =
      chain.remembered_columns(*make_of(Traits::Family::kInertia));  // keeps them alive
  const Eigen::VectorXd& acceleration = of_inertia->front().torque;
  measured_ = measured_torque(chain, left.torque, acceleration, all_, motor_.rows());
  now_ = in_sensors(left.torque);
  if (left.noise_torque.size() > 0)
    noise_ = chain.noise().scale_torque * in_sensors(left.noise_torque);
  acceleration_ = in_sensors(acceleration);
}

Eigen::VectorXd ShaftSearch::in_sensors(const Eigen::VectorXd& torque) const {
  return chain_.noise().sensors(torque, chain_.sampler().torque())(outputs_);
}

ShaftSearch ShaftSearch::tied(double damping) const {
  ShaftSearch search = *this;
  search.motor_.tie(measured_, damping);
  return search;
}

ShaftSearch::Point ShaftSearch::at(std::shared_ptr<Effect> shaft) const {
  return at(std::vector{std::move(shaft)})[0];
}

ShaftSearch::Points ShaftSearch::at(std::vector<std::shared_ptr<Effect>> shafts) const {
  chain_.checkpoint();
  const DriveFacts& facts = chain_.equations().facts();
  Points points(shafts.size());
  std::vector<std::size_t> possible;
  std::vector<ShaftFacts> these;
  for (std::size_t s = 0; s < shafts.size(); ++s) {
    points[s].shaft = std::move(shafts[s]);
    if (!points[s].shaft->prepare(facts).empty() ||
        points[s].shaft->tracing().materiality(facts) < 1)
      continue;
    possible.push_back(s);
    points[s].shaft->describe_shaft(these.emplace_back());
  }
  constexpr std::size_t kTogether = 8;  // limits the memory
  for_each_index((these.size() + kTogether - 1) / kTogether, [&](std::size_t group) {
    const std::size_t first = group * kTogether, count = std::min(kTogether, these.size() - first);
    std::vector<std::vector<double>> T_load(count);
    motor_.along(std::span(these).subspan(first, count), T_load);
    for_each_index(count, [&](std::size_t s) {
      Point& p = points[possible[first + s]];
      p.error = error_with(these[first + s], T_load[s], p.inertia);
    });
  });
  return points;
}

double ShaftSearch::error_with(const ShaftFacts& shaft, const std::vector<double>& T_load,
                               double& inertia) const {
  const Sampler& sampler = chain_.sampler();
  const Runs& runs = sampler.torque();
  const Eigen::VectorXd left =
      now_ - in_sensors(all_ ? sampler(T_load, runs) : sampler.sparsely(T_load, runs)) +
      shaft.J_load * acceleration_;
  return error_of(left, shaft.J_load, inertia);
}

double ShaftSearch::error_of(const Eigen::VectorXd& left, double J_load, double& inertia) const {
  constexpr int kRounds = 4;
  const double J = chain_.equations().facts().machine.J;
  const double at_motor = std::clamp(1 - J_load / J, 0.0, 1.0);
  struct Piece {
    double left = 0, both = 0, acceleration = 0;  // squares and product
    double error(double j) const {
      return std::sqrt(std::max(0.0, left - 2 * j * both + j * j * acceleration));
    }
  };
  std::vector<Piece> pieces;
  constexpr auto kRows = static_cast<Eigen::Index>(kPiece);
  for (Eigen::Index first = 0; first < left.size(); first += kRows) {
    const auto y = left.segment(first, kRows), a = acceleration_.segment(first, kRows);
    const double noise = noise_.size() ? noise_.segment(first, kRows).squaredNorm() : 0;
    // Noise of y - j a: n (at_motor + j/J), n the noise with all of J at the motor.
    pieces.push_back({y.squaredNorm() + (1 - at_motor * at_motor) * noise,
                      y.dot(a) + at_motor * noise / J,
                      std::max(0.0, a.squaredNorm() - noise / (J * J))});
  }
  // The minimum of a sum of norms is that of the squares, weighted by the reciprocal norms.
  for (int round = 0; free_ && round < kRounds; ++round) {
    double both = 0, squares = 0;
    for (const Piece& p : pieces) {
      const double weight = 1 / std::max(p.error(inertia), 1e-12);
      both += weight * p.both;
      squares += weight * p.acceleration;
    }
    if (squares > 0) inertia = std::clamp(both / squares, kLeastInertia * J, kMostInertia * J);
  }
  double sum = 0;
  for (const Piece& p : pieces) sum += p.error(inertia);
  return sum;
}

namespace {

// One simplex of Nelder and Mead's method.
class Simplex {
 public:
  using Point = ShaftSearch::Point;
  Simplex(const Point& start, double first_step) : points_{start} {
    for (Eigen::Index i = 0; i < logs(start).size(); ++i) {
      Eigen::VectorXd x = logs(start);
      x[i] += first_step;
      wanted_.push_back(moved(start, x));
    }
  }

  // Shafts whose errors the next step needs; none at the end.
  const std::vector<std::shared_ptr<Effect>>& wanted() const { return wanted_; }
  void learn(std::span<const Point> found, int most) {
    wanted_.clear();
    tried_ += static_cast<int>(found.size());
    switch (asked_) {
      case Asked::kCorners:
        points_.insert(points_.end(), found.begin(), found.end());
        break;
      case Asked::kAway:
        away_ = found[0];
        if (away_.error < points_[0].error) return ask(Asked::kFurther, 2);
        if (!(away_.error < points_[points_.size() - 2].error)) return ask(Asked::kNearer, -0.5);
        points_.back() = away_;
        break;
      case Asked::kFurther:
        --tried_;  // counts as one with the step before
        points_.back() = found[0].error < away_.error ? found[0] : away_;
        break;
      case Asked::kNearer:
        --tried_;
        if (!(found[0].error < points_.back().error)) return shrink();
        points_.back() = found[0];
    }
    reflect(most);
  }
  Point best() const {
    return *std::min_element(points_.begin(), points_.end(), ShaftSearch::better);
  }

 private:
  enum class Asked { kCorners, kAway, kFurther, kNearer };

  void ask(Asked what, double share) {
    asked_ = what;
    wanted_ = {moved(points_[0], centre_ + share * (centre_ - logs(points_.back())))};
  }
  void shrink() {
    asked_ = Asked::kCorners;
    for (std::size_t i = 1; i < points_.size(); ++i)
      wanted_.push_back(moved(points_[0], 0.5 * (logs(points_[0]) + logs(points_[i]))));
    points_.resize(1);
  }
  void reflect(int most) {
    constexpr double kArrived = 2e-4;
    std::sort(points_.begin(), points_.end(), ShaftSearch::better);
    const std::size_t last = points_.size() - 1;
    centre_ = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(last));
    for (std::size_t i = 0; i < last; ++i) centre_ += logs(points_[i]) / static_cast<double>(last);
    if (tried_ < most && (centre_ - logs(points_.back())).cwiseAbs().maxCoeff() >= kArrived)
      ask(Asked::kAway, 1);
  }

  std::vector<Point> points_;
  Eigen::VectorXd centre_;  // of all points but the worst
  Point away_;
  Asked asked_ = Asked::kCorners;
  std::vector<std::shared_ptr<Effect>> wanted_;
  int tried_ = 0;
};

}  // namespace

ShaftSearch::Points ShaftSearch::descend(Points starts, int most, double first_step) const {
  std::vector<Simplex> simplices;
  simplices.reserve(starts.size());
  for (const Point& start : starts) simplices.emplace_back(start, first_step);
  while (true) {
    std::vector<std::shared_ptr<Effect>> wanted;
    for (const Simplex& s : simplices)
      wanted.insert(wanted.end(), s.wanted().begin(), s.wanted().end());
    if (wanted.empty()) break;
    const Points found = at(std::move(wanted));
    std::size_t first = 0;
    for (Simplex& s : simplices) {
      const std::size_t count = s.wanted().size();
      if (count > 0) s.learn(std::span(found).subspan(first, count), most);
      first += count;
    }
  }
  for (std::size_t s = 0; s < starts.size(); ++s) starts[s] = simplices[s].best();
  return starts;
}

ShaftSearch::Point ShaftSearch::descend(const Point& start, int most, double first_step) const {
  return descend(Points{start}, most, first_step)[0];
}

ShaftSearch::Point ShaftSearch::along_keys(Point best) const {
  constexpr double kHelps = 0.99;  // of the error before
  const Eigen::Index n = logs(best).size();
  Eigen::MatrixXd ways = Eigen::MatrixXd::Identity(n, n);
  if (n == 4) {  // a gap: also along equal resonance, or equal time of the next impact
    ways.conservativeResize(n, n + 3);
    ways.rightCols(3) << 1, 1, 0,  // J_load
        1, 1, 1,                   // stiffness
        0, 0, 0,                   // damping
        0, -1, -1;                 // gap
  }
  for (double before = 1e300; best.error < kHelps * before;) {
    before = best.error;
    for (const auto way : ways.colwise()) {
      const Eigen::VectorXd here = logs(best);
      std::vector<std::shared_ptr<Effect>> there;
      for (double step : {0.01, 0.02, 0.04, 0.08, 0.16})
        for (double signed_step : {-step, step})
          there.push_back(moved(best, here + signed_step * way));
      for (Point& p : at(std::move(there)))
        if (better(p, best)) best = std::move(p);
    }
  }
  return best;
}

// The best points, at most `most`, no two of them with nearly the same load inertia and gap.
std::vector<ShaftSearch::Point> apart(std::vector<ShaftSearch::Point> points, std::size_t most) {
  std::sort(points.begin(), points.end(), ShaftSearch::better);
  std::vector<ShaftSearch::Point> chosen;
  const auto distance = [](const Effect& a, const Effect& b, const char* key) {
    return std::abs(std::log(get_key(a, key) / get_key(b, key)));
  };
  for (const ShaftSearch::Point& p : points) {
    if (chosen.size() == most) break;
    if (std::none_of(chosen.begin(), chosen.end(), [&](const ShaftSearch::Point& c) {
          return distance(*c.shaft, *p.shaft, "J_load_kgm2") < kApart &&
                 distance(*c.shaft, *p.shaft, "gap_rad") < kApart;
        }))
      chosen.push_back(p);
  }
  return chosen;
}

}  // namespace twinrate
