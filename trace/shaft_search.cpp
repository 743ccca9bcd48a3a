#include "trace/shaft_search.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/shaft.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kApart = 0.26;      // of the logarithm of a key: within it, one start will do
constexpr Eigen::Index kPiece = 64;  // outputs
constexpr double kLeastInertia = -0.4, kMostInertia = 0.8;  // of machine.J, where it is free

std::vector<std::string> keys(const Effect& shaft) {
  std::vector<std::string> names = {"J_load_kgm2", "stiffness_Nm_rad", "damping_Nms_rad"};
  if (shaft.kind() == "backlash") names.push_back("gap_rad");
  return names;
}
Eigen::VectorXd logs(const ShaftSearch::Point& p) {
  const std::vector<std::string> names = keys(*p.shaft);
  Eigen::VectorXd x(static_cast<Eigen::Index>(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i)
    x[static_cast<Eigen::Index>(i)] = std::log(std::max(1e-12, get_key(*p.shaft, names[i])));
  return x;
}

}  // namespace

ShaftSearch::ShaftSearch(const Chain& chain, const Members& now, Inertia inertia, Rows rows)
    : chain_(chain),
      all_(rows == Rows::kAll),
      free_(inertia == Inertia::kFree),
      acceleration_(chain.remembered_columns(*make_effect("inertia"))[0].torque),
      points_(chain.equations().points()) {
  const Sampled left = chain.residual({now.begin(), now.end()});
  now_ = left.torque;
  noise_ = chain.noise().scale_torque * left.noise_torque;
  if (!all_) {
    const std::vector<OperatingPoint>& points = chain.equations().points();
    points_.clear();
    for (std::size_t k = chain.sampler().first(); k < points.size(); k += chain.sampler().stride())
      points_.push_back(points[k]);
  }
  Effects loads = chain.equations().known();
  loads.insert(loads.end(), now.begin(), now.end());
  behind_ = load_behind_shaft(loads, points_);
}

ShaftSearch::Point ShaftSearch::at(std::shared_ptr<Effect> shaft) const {
  chain_.checkpoint();
  Point p{.shaft = std::move(shaft)};
  const DriveFacts& facts = chain_.equations().facts();
  if (!p.shaft->prepare(facts).empty() || p.shaft->materiality(facts) < 1) return p;
  const Runs& runs = chain_.sampler().torque();
  ShaftFacts of_shaft;
  p.shaft->describe_shaft(of_shaft);
  std::vector<double> T_load(points_.size());
  const double stride = all_ ? 1 : static_cast<double>(chain_.sampler().stride());
  along_shaft(of_shaft, points_, behind_, stride * chain_.equations().record().T_s, T_load);
  const Sampler& sampler = chain_.sampler();
  const Eigen::VectorXd left = now_ -
                               (all_ ? sampler(T_load, runs) : sampler.sparsely(T_load, runs)) +
                               of_shaft.J_load * acceleration_;
  p.error = error_of(left, of_shaft.J_load, p.inertia);
  return p;
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
  for (Eigen::Index first = 0; first + kPiece <= left.size(); first += kPiece) {
    if (chain_.sampler().torque().held_out[static_cast<std::size_t>(first)]) continue;
    const auto y = left.segment(first, kPiece), a = acceleration_.segment(first, kPiece);
    const double noise = noise_.size() ? noise_.segment(first, kPiece).squaredNorm() : 0;
    // Noise of y - j a: n (at_motor + j/J), with n that of all of J.
    pieces.push_back({y.squaredNorm() + (1 - at_motor * at_motor) * noise,
                      y.dot(a) + at_motor * noise / J,
                      std::max(0.0, a.squaredNorm() - noise / (J * J))});
  }
  // A sum of norms is least where squares weighted by their reciprocals are.
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

ShaftSearch::Point ShaftSearch::at(const Point& like, const Eigen::VectorXd& x) const {
  std::shared_ptr<Effect> shaft = like.shaft->clone();
  const std::vector<std::string> names = keys(*shaft);
  for (std::size_t i = 0; i < names.size(); ++i)
    set_key(*shaft, names[i], std::exp(x[static_cast<Eigen::Index>(i)]));
  return at(std::move(shaft));
}

ShaftSearch::Point ShaftSearch::descend(const Point& start, int most, double first_step) const {
  const auto n = static_cast<Eigen::Index>(logs(start).size());
  const auto last = static_cast<std::size_t>(n);
  std::vector<Point> simplex = {start};
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::VectorXd x = logs(start);
    x[i] += first_step;
    simplex.push_back(at(start, x));
  }
  for (int tried = static_cast<int>(n); tried < most; ++tried) {
    std::sort(simplex.begin(), simplex.end(), better);
    Point& worst = simplex.back();
    Eigen::VectorXd centre = Eigen::VectorXd::Zero(n);
    for (std::size_t i = 0; i < last; ++i) centre += logs(simplex[i]) / static_cast<double>(n);
    const Eigen::VectorXd away = centre - logs(worst);
    if (away.cwiseAbs().maxCoeff() < 2e-4) break;
    Point next = at(start, centre + away);
    if (next.error < simplex[0].error) {
      Point further = at(start, centre + 2 * away);
      worst = further.error < next.error ? std::move(further) : std::move(next);
    } else if (next.error < simplex[last - 1].error) {
      worst = std::move(next);
    } else {
      Point nearer = at(start, centre - 0.5 * away);
      if (nearer.error < worst.error) {
        worst = std::move(nearer);
      } else {
        for (std::size_t i = 1; i < simplex.size(); ++i)
          simplex[i] = at(start, 0.5 * (logs(simplex[0]) + logs(simplex[i])));
        tried += static_cast<int>(n);
      }
    }
  }
  return *std::min_element(simplex.begin(), simplex.end(), better);
}

ShaftSearch::Point ShaftSearch::along_keys(Point best) const {
  constexpr double kHelps = 0.99;  // of the error before
  const Eigen::Index n = logs(best).size();
  Eigen::MatrixXd ways = Eigen::MatrixXd::Identity(n, n);
  if (n == 4) {  // a gap: what keeps the resonance, or the time of the next impact
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
      for (double step : {0.01, 0.02, 0.04, 0.08, 0.16})
        for (double signed_step : {-step, step}) {
          Point p = at(best, here + signed_step * way);
          if (better(p, best)) best = std::move(p);
        }
    }
  }
  return best;
}

// The best few, no two of them with nearly the same mass and gap.
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
