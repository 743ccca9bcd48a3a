#include "trace/placing.hpp"

#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr int kTriedFirst = 50, kTriedLast = 150, kFinalists = 2, kTriedTorsion = 50;
constexpr double kWorthwhile = 0.97;  // error that another descent must leave, of what it was
constexpr int kOfASort = 16;          // gaps of one width on the grid
constexpr Eigen::Index kPiece = 64;   // outputs
constexpr double kDamping = 0.1;      // ratio, where nothing is known of it
constexpr double kFirstStep = 0.15;   // of the logarithm of a key

// How much a shaft leaves of the torque that `now` leaves, as the tracer samples and whitens it.
class ShaftSearch {
 public:
  struct Point {
    std::shared_ptr<Effect> shaft;
    double error = 1e300;  // sum over pieces of their rms: a missed impact spoils one of them
  };
  ShaftSearch(const Chain& chain, const Fit& now) : chain_(chain), now_(now.y.torque) {}

  Point at(std::shared_ptr<Effect> shaft) const {
    chain_.checkpoint();
    Point p{.shaft = std::move(shaft)};
    const DriveFacts& facts = chain_.equations().facts();
    if (!p.shaft->prepare(facts).empty() || p.shaft->materiality(facts) < 1) return p;
    const Runs& runs = chain_.sampler().torque();
    const Channels x = chain_.equations().contribution(*p.shaft);
    const Eigen::VectorXd left =
        now_ - chain_.noise().torque(chain_.sampler()(x.torque, runs), runs);
    p.error = 0;
    for (Eigen::Index first = 0; first + kPiece <= left.size(); first += kPiece)
      if (!runs.held_out[static_cast<std::size_t>(first)])
        p.error += left.segment(first, kPiece).norm();
    return p;
  }
  // Nelder and Mead's simplex in the logarithms of the keys: impacts move in time with every key,
  // and slopes say little beyond the next bump.
  Point descend(const Point& start, int most) const {
    const auto n = static_cast<Eigen::Index>(logs(start).size());
    const auto last = static_cast<std::size_t>(n);
    std::vector<Point> simplex = {start};
    for (Eigen::Index i = 0; i < n; ++i) {
      Eigen::VectorXd x = logs(start);
      x[i] += kFirstStep;
      simplex.push_back(at(start, x));
    }
    const auto better = [](const Point& a, const Point& b) { return a.error < b.error; };
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

 private:
  static std::vector<std::string> keys(const Effect& shaft) {
    std::vector<std::string> names = {"J_load_kgm2", "stiffness_Nm_rad", "damping_Nms_rad"};
    if (shaft.kind() == "backlash") names.push_back("gap_rad");
    return names;
  }
  static Eigen::VectorXd logs(const Point& p) {
    const std::vector<std::string> names = keys(*p.shaft);
    Eigen::VectorXd x(static_cast<Eigen::Index>(names.size()));
    for (std::size_t i = 0; i < names.size(); ++i)
      x[static_cast<Eigen::Index>(i)] = std::log(std::max(1e-12, get_key(*p.shaft, names[i])));
    return x;
  }
  Point at(const Point& like, const Eigen::VectorXd& x) const {
    std::shared_ptr<Effect> shaft = like.shaft->clone();
    const std::vector<std::string> names = keys(*shaft);
    for (std::size_t i = 0; i < names.size(); ++i)
      set_key(*shaft, names[i], std::exp(x[static_cast<Eigen::Index>(i)]));
    return at(std::move(shaft));
  }

  const Chain& chain_;
  Eigen::VectorXd now_;
};

}  // namespace

std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect) {
  const Chain& chain = fitter.chain();
  if (effect->kind() == "torsion") {
    const ShaftSearch search(chain, fitter.start(with(now.members, nullptr)));
    const ShaftSearch::Point found = search.descend(search.at(effect), kTriedTorsion);
    const auto rss = [&](const auto& e) { return fitter.start(with(now.members, e)).rss; };
    return rss(found.shaft) < rss(effect) ? found.shaft : effect;
  }
  if (effect->kind() != "load_step") return effect;
  // Where it stands in a held-out block only that block shows the moment.
  const auto all = [&](const Sampled& a, const Sampled& b) {
    return fitter.training().dot(a, b) + fitter.held_out().dot(a, b);
  };
  std::shared_ptr<Effect> best = effect, next = effect;
  for (double step = 0.08; step > 2e-4; step /= 5) {
    const double t = get_key(*best, "time_s");
    double gain = 0;
    for (int j = -6; j <= 6; ++j) {
      const std::shared_ptr<Effect> moment = best->clone();
      set_key(*moment, "time_s", t + j * step);
      const Sampled x = chain.regressor(chain.columns(*moment)[0]);
      const double b = all(x, now.y), A = all(x, x);
      if (b * b > gain * A) gain = b * b / A, next = moment;
    }
    best = next;
  }
  return best;
}

Fit search_backlash(const Fitter& fitter, const Fit& now, const Effect& torsion) {
  const ShaftSearch search(fitter.chain(), fitter.start(with(now.members, nullptr)));
  const std::vector<double> gaps = make_effect("backlash")->traced_keys().at(0).grid;
  std::vector<ShaftSearch::Point> grid;
  const auto start = [&](double gap_rad, double J_load, double stiffness, double damping) {
    const std::shared_ptr<Effect> gap = make_effect("backlash");
    set_key(*gap, "gap_rad", gap_rad);
    set_key(*gap, "J_load_kgm2", J_load);
    set_key(*gap, "stiffness_Nm_rad", stiffness);
    set_key(*gap, "damping_Nms_rad", damping);
    grid.push_back(search.at(gap));
  };
  const double J = fitter.chain().equations().facts().machine.J;
  for (double gap_rad : gaps) {
    // Near the shaft without a gap that comes nearest: the gap made it softer and overdamped.
    for (double stiffer : {1.2, 1.8, 2.7, 4.0})
      for (double share : {0.35, 0.5, 0.7, 1.0})
        start(gap_rad, share * get_key(torsion, "J_load_kgm2"),
              stiffer * get_key(torsion, "stiffness_Nm_rad"), get_key(torsion, "damping_Nms_rad"));
    // Anywhere.
    for (double omega : {120.0, 200.0, 320.0, 500.0})
      for (double share : {0.15, 0.25, 0.35, 0.5}) {
        const double J_load = share * J;
        start(gap_rad, J_load, J_load * omega * omega, 2 * kDamping * J_load * omega);
      }
  }
  const auto better = [](const auto& a, const auto& b) { return a.error < b.error; };
  // Of each gap the best of either sort: an overdamped shaft comes near with any gap, and no
  // descent leads out of there.
  std::vector<ShaftSearch::Point> starts;
  for (auto first = grid.begin(); first != grid.end(); first += kOfASort)
    starts.push_back(
        search.descend(*std::min_element(first, first + kOfASort, better), kTriedFirst));
  std::sort(starts.begin(), starts.end(), better);
  Fit best;
  best.rss = 1e300;
  for (int j = 0; j < kFinalists; ++j) {
    ShaftSearch::Point p = starts[static_cast<std::size_t>(j)];
    for (double before = 1e300; p.error < kWorthwhile * before;) {
      before = p.error;
      p = search.descend(p, kTriedLast);
    }
    Fit fit = fitter.refine(with(now.members, p.shaft));
    if (fit.rss < best.rss) best = std::move(fit);
  }
  return best;
}

bool rings(const Effect& effect) {
  constexpr double kHighest = 120, kMostDamping = 0.35;
  ShaftFacts s;
  if (!effect.describe_shaft(s)) return true;
  return std::sqrt(s.stiffness / s.J_load) < kTwoPi * kHighest &&
         s.damping < 2 * kMostDamping * std::sqrt(s.stiffness * s.J_load);
}

double plain_torque(const Fitter& fitter, const Fit& fit) {
  return fitter.chain().residual(fit.effects()).torque.squaredNorm();
}

bool leaves_more_than_noise(const Fitter& fitter, const Fit& fit) {
  constexpr double kTimes = 2;
  const Sampled left = fitter.chain().residual(fit.effects());
  return left.torque.squaredNorm() > kTimes * left.noise_torque.squaredNorm();
}

}  // namespace twinrate
