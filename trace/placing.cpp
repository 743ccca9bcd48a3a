#include "trace/placing.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/shaft_search.hpp"

namespace twinrate {
namespace {

constexpr int kTriedFirst = 30, kTriedLast = 150, kTriedTorsion = 60, kTriedCloser = 60;
constexpr std::size_t kTriedOfAMass = 2, kFinalists = 3;
// Damping of the load by the measured torque (MotorSide::tie), one after the other. By design: the
// first holds the load through the impacts of the wildest drawn log, the last does not act.
constexpr double kTies[] = {0.1, 0.03, 0.01, 0.003, 0};
constexpr std::size_t kFirstTies = 3;  // of them, from which a search begins
constexpr double kNearShaft = 1.15;    // error of a gap over that of the shaft: above it, none
// Error of the best gap of the short descents, over that of the shaft: above it, none is searched
// further. Of 53 drawn logs with a gap, the claimed ones had 0.94 and less under one of the ties.
constexpr double kTiedGap = 0.98;
constexpr double kHopeless = 1.5;       // times the best error: points above it are dropped
constexpr double kFirstStep = 0.15;     // change of the logarithm of a key
constexpr double kLaterStep = 0.06;     // the same, once a shaft is near
constexpr double kWrongInertia = 0.02;  // of machine.J: a smaller correction is not fitted
constexpr double kWorthInertia = 0.9;   // and it must leave less than this share of the torque

// Inner products over the training blocks and the held-out blocks.
double dot_everywhere(const Fitter& fitter, const Sampled& a, const Sampled& b) {
  return fitter.training().dot(a, b) + fitter.held_out().dot(a, b);
}
double against_everywhere(const Fitter& fitter, const Sampled& column, const Sampled& residual) {
  return fitter.training().against(column, residual) + fitter.held_out().against(column, residual);
}

// Energy of the residual of `now` that the columns explain, on training and held-out blocks. Sets
// their coefficients.
double explained_everywhere(const Fitter& fitter, const Fit& now, const std::vector<Sampled>& x,
                            Eigen::VectorXd& coefficients) {
  const auto n = static_cast<Eigen::Index>(x.size());
  NormalEquations normal{Eigen::MatrixXd(n, n), Eigen::VectorXd(n), Eigen::VectorXd::Zero(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    normal.b[i] = against_everywhere(fitter, x[static_cast<std::size_t>(i)], now.y);
    for (Eigen::Index j = 0; j < n; ++j)
      normal.A(i, j) =
          dot_everywhere(fitter, x[static_cast<std::size_t>(i)], x[static_cast<std::size_t>(j)]);
  }
  coefficients = normal.solve(normal.usable(1));
  return coefficients.dot(normal.b);
}

// The zone around zero current that explains most, on training and held-out blocks. If the currents
// of the training blocks stay inside every zone, only the held-out blocks determine it.
std::shared_ptr<Effect> in_best_zone(const Fitter& fitter, const Fit& now, const Effect& effect) {
  constexpr const char* kZone = "linear_current_A";
  constexpr double kRounding = 1e-6;  // zones that contain all currents explain the same
  std::shared_ptr<Effect> best;
  double most = 0;
  const auto look = [&](double zone_A) {
    const std::shared_ptr<Effect> there = effect.clone();
    set_key(*there, kZone, zone_A);
    std::vector<Sampled> columns;
    for (const Sampled& x : fitter.chain().columns(*there))
      columns.push_back(fitter.chain().regressor(x));
    Eigen::VectorXd c;
    const double explained = explained_everywhere(fitter, now, columns, c);
    there->tracing().set_coefficients(std::vector<double>(c.data(), c.data() + c.size()));
    if (!(explained > (1 + kRounding) * most) || !fitter.chain().equations().possible(*there))
      return;
    most = explained;
    best = there;
  };
  for (const TracedKey& key : effect.tracing().traced_keys())
    if (std::string_view(key.key) == kZone)
      for (double zone_A : key.grid) look(zone_A);
  for (double factor : {1.3, 1.14, 1.07, 1.03}) {
    if (!best) break;
    const double zone_A = get_key(*best, kZone);
    look(zone_A * factor);
    look(zone_A / factor);
  }
  return best;
}

// Shafts with a gap; a search begins at the best `most` of them.
struct Grid {
  std::vector<std::shared_ptr<Effect>> gaps;
  std::size_t most = 1;
};

std::vector<std::shared_ptr<Effect>> copies(const std::vector<std::shared_ptr<Effect>>& effects) {
  std::vector<std::shared_ptr<Effect>> out;
  out.reserve(effects.size());
  for (const auto& effect : effects) out.push_back(effect->clone());
  return out;
}

// First near the best shaft without a gap: the gap made it softer and overdamped. A gap of any
// width with nearly all of the inertia behind such a shaft has a small error, and no descent leaves
// that region. So starts with other load inertias are tried as well.
std::vector<Grid> grids_of_gaps(const Effect& shaft, double J) {
  const std::shared_ptr<Effect> like = make_placed(Traits::Place::kGap);
  const std::vector<double> gaps = like->tracing().traced_keys().at(0).grid;
  const auto gap = [&](double gap_rad, double J_load, double stiffness, double damping) {
    const std::shared_ptr<Effect> there = like->clone();
    set_key(*there, "gap_rad", gap_rad);
    set_key(*there, "J_load_kgm2", J_load);
    set_key(*there, "stiffness_Nm_rad", stiffness);
    set_key(*there, "damping_Nms_rad", damping);
    return there;
  };
  std::vector<Grid> grids(1);
  for (double gap_rad : gaps)
    for (double stiffer : {1.2, 2.7})
      for (double share : {0.4, 0.8})
        grids[0].gaps.push_back(gap(gap_rad, share * get_key(shaft, "J_load_kgm2"),
                                    stiffer * get_key(shaft, "stiffness_Nm_rad"),
                                    get_key(shaft, "damping_Nms_rad")));
  for (double share : {0.18, 0.24, 0.32, 0.43, 0.58}) {
    Grid& grid = grids.emplace_back();
    grid.most = kTriedOfAMass;
    const double J_load = share * J;
    for (double gap_rad : gaps)
      for (double omega : {260.0, 430.0, 720.0})
        for (double ratio : {0.08, 0.22})
          grid.gaps.push_back(
              gap(gap_rad, J_load, J_load * omega * omega, 2 * ratio * J_load * omega));
  }
  return grids;
}

// The best ends of short descents from the grids, best first; at least one.
ShaftSearch::Points finalists_of(const ShaftSearch& search, const std::vector<Grid>& grids) {
  ShaftSearch::Points starts;
  for (const Grid& grid : grids)
    for (ShaftSearch::Point& p : apart(search.at(copies(grid.gaps)), grid.most))
      starts.push_back(std::move(p));
  ShaftSearch::Points finalists =
      apart(search.descend(std::move(starts), kTriedFirst, kFirstStep), kFinalists);
  const double hopeless = kHopeless * finalists.front().error;
  std::erase_if(finalists, [&](const auto& p) { return p.error > hopeless; });
  return finalists;
}

// Descends under the ties from `first` on, ever looser.
ShaftSearch::Points loosened(const ShaftSearch& untied, ShaftSearch::Points points,
                             std::size_t first) {
  for (std::size_t tie = first; tie < std::size(kTies); ++tie) {
    const ShaftSearch search = untied.tied(kTies[tie]);
    for (ShaftSearch::Point& p : points) p = search.along_keys(search.at(p.shaft));
    points = search.descend(std::move(points), kTriedLast, kLaterStep);
  }
  return points;
}

// The torque after the filter that whitens the noise of the sensors.
Eigen::VectorXd in_sensors(const Fitter& fitter, const Eigen::VectorXd& torque) {
  return fitter.chain().noise().sensors(torque, fitter.chain().sampler().torque());
}

}  // namespace

std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect) {
  const Chain& chain = fitter.chain();
  if (is_placed(*effect, Traits::Place::kShaft)) {
    const ShaftSearch search(chain, now.members, ShaftSearch::Inertia::kKnown);
    const ShaftSearch::Point found = search.descend(search.at(effect), kTriedTorsion, kFirstStep);
    const Fit there = fitter.start(with(now.members, found.shaft));
    return there.valid && there.rss < fitter.start(with(now.members, effect)).rss ? found.shaft
                                                                                  : effect;
  }
  if (turns_at_zero(*effect)) {
    const std::shared_ptr<Effect> best = in_best_zone(fitter, now, *effect);
    return best ? best : effect;
  }
  if (!is_placed(*effect, Traits::Place::kMoment)) return effect;
  // Over all blocks: a moment in a held-out block is visible only there. Behind a shaft a load step
  // also excites the resonance.
  const double T = get_key(*effect, "torque_Nm");
  Effects together = now.effects();
  together.push_back(effect);
  const bool rings = T != 0 && chain.loads_shaft(together);
  const Sampled before = rings ? chain.whitened(chain.noiseless(now.effects())) : Sampled{};
  const auto column = [&](const std::shared_ptr<Effect>& moment) {
    if (!rings) return chain.regressor(chain.columns(*moment)[0]);
    together.back() = moment;
    Sampled x;
    add(x, before, 1 / T);
    add(x, chain.whitened(chain.noiseless(together)), -1 / T);
    return x;
  };
  std::shared_ptr<Effect> best = effect, next = effect;
  for (double step = 0.08; step > 2e-4; step /= 5) {
    const double t = get_key(*best, "time_s");
    double gain = 0;
    for (int j = -6; j <= 6; ++j) {
      const std::shared_ptr<Effect> moment = best->clone();
      set_key(*moment, "time_s", t + j * step);
      const Sampled x = column(moment);
      const double b = against_everywhere(fitter, x, now.y), A = dot_everywhere(fitter, x, x);
      if (b * b > gain * A) gain = b * b / A, next = moment;
    }
    best = next;
  }
  return best;
}

std::shared_ptr<Effect> search_torsion(const Fitter& fitter, const Fit& now,
                                       const std::vector<Candidate>& candidates) {
  constexpr std::size_t kStarts = 4;
  std::vector<std::shared_ptr<Effect>> grid;
  for (const Candidate& c : candidates)
    if (is_placed(*c.effect, Traits::Place::kShaft)) grid.push_back(c.effect->clone());
  if (grid.empty()) return nullptr;
  const ShaftSearch search(fitter.chain(), now.members, ShaftSearch::Inertia::kKnown);
  ShaftSearch::Points starts = search.at(std::move(grid));
  std::sort(starts.begin(), starts.end(), ShaftSearch::better);
  starts.resize(std::min(kStarts, starts.size()));
  const ShaftSearch::Points ends = search.descend(std::move(starts), kTriedTorsion, kFirstStep);
  return std::min_element(ends.begin(), ends.end(), ShaftSearch::better)->shaft;
}

std::optional<Fit> search_backlash(const Fitter& fitter, const Fit& now, const Effect& shaft) {
  const Considered& considered = fitter.chain().equations().considered();
  if (!considered(make_placed(Traits::Place::kGap)->kind())) return std::nullopt;
  const ShaftSearch untied(fitter.chain(), now.members, ShaftSearch::Inertia::kFree);
  const std::vector<Grid> grids =
      grids_of_gaps(shaft, fitter.chain().equations().facts().machine.J);
  const double without_gap = untied.at(shaft.clone()).error;
  // Which tie the noise of the measured torque allows is not known before, so several are the first
  // once.
  std::array<ShaftSearch::Points, kFirstTies> finalists;
  for (std::size_t first = 0; first < kFirstTies; ++first)
    finalists[first] = finalists_of(untied.tied(kTies[first]), grids);
  if (std::none_of(finalists.begin(), finalists.end(), [&](const ShaftSearch::Points& points) {
        return points.front().error < kTiedGap * without_gap;
      }))
    return std::nullopt;
  ShaftSearch::Points ends;
  for (std::size_t first = 0; first < kFirstTies; ++first)
    for (ShaftSearch::Point& p : loosened(untied, std::move(finalists[first]), first))
      ends.push_back(std::move(p));
  const ShaftSearch::Point best = *std::min_element(ends.begin(), ends.end(), ShaftSearch::better);
  if (best.error > kNearShaft * without_gap) return std::nullopt;
  return search_closer(fitter, now, *best.shaft);
}

Fit search_closer(const Fitter& fitter, const Fit& now, const Effect& shaft) {
  const ShaftSearch search(fitter.chain(), now.members, ShaftSearch::Inertia::kFree,
                           ShaftSearch::Rows::kAll);
  const ShaftSearch::Point best =
      search.descend(search.along_keys(search.at(shaft.clone())), kTriedCloser, kLaterStep / 2);
  Fit gap = fitter.refine(with(now.members, best.shaft));
  const bool known = std::any_of(now.members.begin(), now.members.end(),
                                 [](const auto& m) { return is_of(*m, Traits::Family::kInertia); });
  if (known ||
      std::abs(best.inertia) < kWrongInertia * fitter.chain().equations().facts().machine.J)
    return gap;
  const std::shared_ptr<Effect> inertia = make_of(Traits::Family::kInertia);
  set_key(*inertia, "change_kgm2", best.inertia);
  Fit both = fitter.refine(with(with(now.members, inertia), best.shaft));
  const bool better = both.valid && score_of(fitter, both) < score_of(fitter, gap) &&
                      torque_energy(fitter, both) < kWorthInertia * torque_energy(fitter, gap);
  return better ? both : gap;
}

bool rings(const Effect& effect) {
  constexpr double kMostDamping = 0.35;
  const double highest = has_gap(effect) ? 200 : 120;  // Hz: impacts show stiffer shafts
  ShaftFacts s;
  if (!effect.describe_shaft(s)) return true;
  return std::sqrt(s.stiffness / s.J_load) < kTwoPi * highest &&
         s.damping < 2 * kMostDamping * std::sqrt(s.stiffness * s.J_load);
}

double torque_energy(const Fitter& fitter, const Fit& fit) {
  return in_sensors(fitter, fitter.chain().residual(fit.effects()).torque).squaredNorm();
}

double torque_by_pieces(const Fitter& fitter, const Fit& fit) {
  constexpr Eigen::Index kPiece = 64;  // outputs
  const Eigen::VectorXd left = in_sensors(fitter, fitter.chain().residual(fit.effects()).torque);
  double sum = 0;
  for (Eigen::Index first = 0; first + kPiece <= left.size(); first += kPiece)
    sum += left.segment(first, kPiece).norm();
  return sum;
}

double fall_in_sensors(const Fitter& fitter, const Fit& now, const Fit& next) {
  const Sampled was = fitter.chain().residual(now.effects()),
                is = fitter.chain().residual(next.effects());
  const auto fall = [&](Eigen::VectorXd Sampled::*part) {
    if (!(was.*part).size() || !(is.*part).size()) return 0.0;
    return std::log(in_sensors(fitter, was.*part).squaredNorm() /
                    in_sensors(fitter, is.*part).squaredNorm());
  };
  return static_cast<double>(was.torque.size()) *
         (fall(&Sampled::torque) - std::max(0.0, fall(&Sampled::noise_torque)));
}

bool leaves_more_than_noise(const Fitter& fitter, const Fit& fit) {
  constexpr double kTimes = 2;
  const Sampled left = fitter.chain().residual(fit.effects());
  if (!left.noise_torque.size()) return left.torque.size() > 0;
  return in_sensors(fitter, left.torque).squaredNorm() >
         kTimes * in_sensors(fitter, left.noise_torque).squaredNorm();
}

}  // namespace twinrate
