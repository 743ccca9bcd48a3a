#include "trace/placing.hpp"

#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kRough = 1.15;  // of a row's power: more is not noise

constexpr const char* kGapKeys[] = {"gap_rad", "J_load_kgm2", "stiffness_Nm_rad",
                                    "damping_Nms_rad"};
constexpr int kStarts = 6, kTriedFirst = 40, kTriedLast = 100, kFinalists = 2;
constexpr Eigen::Index kPiece = 64;  // outputs
constexpr double kFirstStep = 0.15;  // of the logarithm of a key

// How much a gap leaves of the torque that `now` leaves, as the tracer samples and whitens it.
class GapSearch {
 public:
  struct Point {
    std::shared_ptr<Effect> gap;
    double error = 1e300;  // sum over pieces of their rms: a missed impact spoils one of them
  };
  GapSearch(const Chain& chain, const Fit& now) : chain_(chain), now_(now.y.torque) {}
  Point at(std::shared_ptr<Effect> gap) const {
    Point p{.gap = std::move(gap)};
    const DriveFacts& facts = chain_.equations().facts();
    if (!p.gap->prepare(facts).empty() || p.gap->materiality(facts) < 1) return p;
    const Runs& runs = chain_.sampler().torque();
    const Channels x = chain_.equations().contribution(*p.gap);
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
    std::vector<Point> simplex = {start};
    for (int i = 0; i < kKeys; ++i) {
      Logs x = logs(start);
      x[i] += kFirstStep;
      simplex.push_back(at(x));
    }
    const auto better = [](const Point& a, const Point& b) { return a.error < b.error; };
    for (int tried = kKeys; tried < most; ++tried) {
      std::sort(simplex.begin(), simplex.end(), better);
      Point& worst = simplex.back();
      Logs centre = Logs::Zero();
      for (int i = 0; i < kKeys; ++i) centre += logs(simplex[static_cast<std::size_t>(i)]) / kKeys;
      const Logs away = centre - logs(worst);
      if (away.cwiseAbs().maxCoeff() < 2e-4) break;
      Point next = at(centre + away);
      if (next.error < simplex[0].error) {
        Point further = at(centre + 2 * away);
        worst = further.error < next.error ? std::move(further) : std::move(next);
      } else if (next.error < simplex[kKeys - 1].error) {
        worst = std::move(next);
      } else {
        Point nearer = at(centre - 0.5 * away);
        if (nearer.error < worst.error) {
          worst = std::move(nearer);
        } else {
          for (std::size_t i = 1; i < simplex.size(); ++i)
            simplex[i] = at(0.5 * (logs(simplex[0]) + logs(simplex[i])));
          tried += kKeys;
        }
      }
    }
    return *std::min_element(simplex.begin(), simplex.end(), better);
  }

 private:
  static constexpr int kKeys = static_cast<int>(std::size(kGapKeys));
  using Logs = Eigen::Matrix<double, kKeys, 1>;
  static Logs logs(const Point& p) {
    Logs x;
    for (int i = 0; i < kKeys; ++i) x[i] = std::log(get_key(*p.gap, kGapKeys[i]));
    return x;
  }
  Point at(const Logs& x) const {
    std::shared_ptr<Effect> gap = make_effect("backlash");
    for (int i = 0; i < kKeys; ++i) set_key(*gap, kGapKeys[i], std::exp(x[i]));
    return at(std::move(gap));
  }

  const Chain& chain_;
  Eigen::VectorXd now_;
};

}  // namespace

std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect) {
  if (effect->kind() != "load_step") return effect;
  std::shared_ptr<Effect> best = effect;
  const Chain& chain = fitter.chain();
  for (double step = 0.02; step > 2e-4; step /= 5) {
    std::vector<Candidate> moments;
    const double t = get_key(*best, "time_s");
    for (int j = -6; j <= 6; ++j) {
      Candidate moment{.effect = best->clone(), .columns = {}};
      set_key(*moment.effect, "time_s", t + j * step);
      for (const Sampled& x : chain.columns(*moment.effect))
        moment.columns.push_back(chain.regressor(x));
      moments.push_back(std::move(moment));
    }
    double gain = -1e300;
    for (const Score& s : score_all(fitter, now, moments))
      if (s.effect && s.gain > gain) gain = s.gain, best = s.effect;
  }
  return best;
}

Fit search_backlash(const Fitter& fitter, const Fit& now, const Fit& shaft) {
  if (shaft.rss < kRough * static_cast<double>(fitter.training().count(shaft.y))) return shaft;
  const Effect& torsion = *shaft.members.back();
  const GapSearch search(fitter.chain(), fitter.start(with(now.members, nullptr)));
  std::vector<GapSearch::Point> grid;
  for (double gap_rad : {0.005, 0.01, 0.018, 0.028})
    for (double stiffer : {1.2, 1.8, 2.7})
      for (double share : {0.35, 0.5, 0.7, 1.0}) {
        const std::shared_ptr<Effect> gap = make_effect("backlash");
        set_key(*gap, "gap_rad", gap_rad);
        set_key(*gap, "J_load_kgm2", share * get_key(torsion, "J_load_kgm2"));
        set_key(*gap, "stiffness_Nm_rad", stiffer * get_key(torsion, "stiffness_Nm_rad"));
        set_key(*gap, "damping_Nms_rad", get_key(torsion, "damping_Nms_rad"));
        grid.push_back(search.at(gap));
      }
  const auto better = [](const auto& a, const auto& b) { return a.error < b.error; };
  std::partial_sort(grid.begin(), grid.begin() + kStarts, grid.end(), better);
  grid.resize(kStarts);
  for (GapSearch::Point& p : grid) p = search.descend(p, kTriedFirst);
  std::partial_sort(grid.begin(), grid.begin() + kFinalists, grid.end(), better);
  Fit best;
  best.rss = 1e300;
  for (int j = 0; j < kFinalists; ++j) {
    const GapSearch::Point p = search.descend(grid[static_cast<std::size_t>(j)], kTriedLast);
    Fit fit = fitter.refine(with(now.members, p.gap));
    if (fit.rss < best.rss) best = std::move(fit);
  }
  return best;
}

}  // namespace twinrate
