#include "trace/plan_information.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/noise.hpp"

namespace twinrate {
namespace {

// True if a point of a grid stays in the thinned set.
bool kept(const TracedKey& key, double value, int n_p) {
  const std::string_view name = key.key;
  if (name == "time_constant_s") return value == 0;
  if (name != "order") return true;
  for (int order : {1, 2, 3, 2 * n_p, 6 * n_p, 12 * n_p})
    if (value == order) return true;
  return false;
}

void over_thinned(Effect& effect, const std::vector<TracedKey>& keys, std::size_t index, int n_p,
                  const std::function<void()>& f) {
  while (index < keys.size() && keys[index].grid.empty()) ++index;
  if (index == keys.size()) return f();
  for (double value : keys[index].grid) {
    if (!kept(keys[index], value, n_p)) continue;
    set_key(effect, keys[index].key, value);
    over_thinned(effect, keys, index + 1, n_p, f);
  }
}

// True for an effect at a moment that only a record can give.
bool is_of_a_moment(const std::vector<TracedKey>& keys) {
  return std::any_of(keys.begin(), keys.end(),
                     [](const TracedKey& key) { return !key.linear && key.grid.empty(); });
}

bool may_plan(const std::string& kind) {
  const std::vector<std::string>& outside = kinds_outside_the_design();
  if (std::find(outside.begin(), outside.end(), kind) != outside.end()) return false;
  const std::shared_ptr<Effect> effect = make_effect(kind);
  const std::vector<TracedKey> keys = effect->tracing().traced_keys();
  return !keys.empty() && (!is_of_a_moment(keys) || is_placed(*effect, Traits::Place::kMoment));
}

// A torque from the beginning on becomes a step at a random moment: each row has it with
// probability 1/2. The products become their expected values.
void halve(const PlanGroup& step, Information& x) {
  x.M.middleRows(step.first, step.count) *= 0.5;
  x.M.middleCols(step.first, step.count) *= 0.5;
  x.M.block(step.first, step.first, step.count, step.count) *= 2;
  x.noise.segment(step.first, step.count) *= 0.5;
}

std::vector<std::shared_ptr<Effect>> thinned_effects(const DriveFacts& facts,
                                                     const std::set<std::string>& kinds) {
  std::vector<std::shared_ptr<Effect>> all;
  for (const std::string& kind : plannable_kinds()) {
    if (!kinds.empty() && !kinds.count(kind)) continue;
    const std::shared_ptr<Effect> effect = make_effect(kind);
    effect->prepare(facts);  // a grid may depend on the drive
    const Traits traits = effect->tracing().traits();
    if (traits.place == Traits::Place::kMoment) set_key(*effect, traits.repeats.key, 0);  // halved
    over_thinned(*effect, effect->tracing().traced_keys(), 0, facts.machine.n_p, [&] {
      const std::shared_ptr<Effect> at_grid = effect->clone();
      if (at_grid->prepare(facts).empty()) all.push_back(at_grid);
    });
  }
  return all;
}

PlanGroup group_of(const std::shared_ptr<Effect>& effect, const DriveFacts& facts) {
  PlanGroup group;
  if (effect->tracing().regressor_count() > 0) {
    group.count = effect->tracing().regressor_count();
    group.size = [effect, facts](const Eigen::VectorXd& c) {
      const std::shared_ptr<Effect> sized = effect->clone();
      sized->tracing().set_coefficients(std::vector<double>(c.data(), c.data() + c.size()));
      return sized->tracing().materiality(facts);
    };
  } else {
    group.count = 1;
    group.size = [size = effect->tracing().materiality(facts)](const Eigen::VectorXd& c) {
      return size * c[0];
    };
  }
  group.smallest = smallest_of(group.size, group.count);
  return group;
}

// Outputs [first, second) within the span.
std::pair<Eigen::Index, Eigen::Index> outputs(const Runs& runs, const RowSpan& span) {
  const auto at = [&](std::size_t row) {
    return static_cast<Eigen::Index>(std::lower_bound(runs.row.begin(), runs.row.end(), row) -
                                     runs.row.begin());
  };
  return {at(span.first), at(span.last)};
}

// The Chain's inner products of one channel in one span, and the share of noise in the diagonal.
void add_channel(const std::vector<Sampled>& columns, Eigen::VectorXd Sampled::*channel,
                 Eigen::VectorXd Sampled::*noise, Eigen::VectorXd Sampled::*answer,
                 std::pair<Eigen::Index, Eigen::Index> range, Information& sum) {
  const auto P = static_cast<Eigen::Index>(columns.size());
  const Eigen::Index n = range.second - range.first;
  if (n <= 0) return;
  const auto matrix = [&](Eigen::VectorXd Sampled::*part) {
    Eigen::MatrixXd X = Eigen::MatrixXd::Zero(n, P);
    for (Eigen::Index c = 0; c < P; ++c)
      if (const Eigen::VectorXd& x = columns[static_cast<std::size_t>(c)].*part; x.size())
        X.col(c) = x.segment(range.first, n);
    return X;
  };
  const Eigen::MatrixXd X = matrix(channel), N = matrix(noise);
  const Eigen::MatrixXd crossed = N.transpose() * (N + matrix(answer)) / 2;
  const Eigen::MatrixXd share = crossed + crossed.transpose();
  sum.M += X.transpose() * X - share;
  sum.noise += share.diagonal();
  sum.rows += static_cast<double>(n);
}

Record rows_of(const Record& record, std::size_t first, std::size_t last) {
  Record piece;
  piece.source = record.source;
  piece.T_s = record.T_s;
  piece.current_sensors = record.current_sensors;
  piece.load_measured = record.load_measured;
  piece.i_q_alone = record.i_q_alone;
  piece.ticks_each = record.ticks_each;
  const auto take = [&](const auto& from, auto& to) {
    if (!from.empty())
      to.assign(from.begin() + static_cast<std::ptrdiff_t>(first),
                from.begin() + static_cast<std::ptrdiff_t>(last));
  };
  take(record.t, piece.t);
  take(record.u_alphabeta, piece.u_alphabeta);
  take(record.i_alphabeta, piece.i_alphabeta);
  take(record.theta_m, piece.theta_m);
  take(record.v_dc, piece.v_dc);
  take(record.T_load, piece.T_load);
  take(record.electrical_ok, piece.electrical_ok);
  take(record.motion_ok, piece.motion_ok);
  return piece;
}

}  // namespace

Record excerpt(const Record& record, double longest_s, double& part) {
  constexpr double kPiece_s = 2;
  const auto piece = static_cast<std::size_t>(kPiece_s / record.T_s);
  const auto pieces = static_cast<std::size_t>(longest_s / kPiece_s);
  part = 1;
  if (record.size() <= pieces * piece) return record;
  Record all = rows_of(record, 0, piece);
  for (std::size_t j = 1; j < pieces; ++j) {
    const std::size_t first = (record.size() - piece) * j / (pieces - 1);
    all.append(rows_of(record, first, first + piece));
  }
  part = static_cast<double>(all.size()) / static_cast<double>(record.size());
  return all;
}

const std::vector<std::string>& kinds_outside_the_design() {
  static const std::vector<std::string> kKinds = kinds_with([](const Traits& traits) {
    return traits.place == Traits::Place::kGap || traits.place == Traits::Place::kBusLine;
  });
  return kKinds;
}

std::vector<std::string> plannable_kinds() {
  std::vector<std::string> kinds;
  for (const std::string& kind : effect_kinds())
    if (may_plan(kind)) kinds.push_back(kind);
  return kinds;
}

std::vector<RowSpan> training_spans(const Record& record, double holdout, int n_p) {
  const std::vector<char> held_out = held_out_rows(record, holdout, n_p);
  std::vector<RowSpan> spans;
  for (std::size_t k = 0; k < held_out.size(); ++k) {
    if (held_out[k]) continue;
    if (k == 0 || held_out[k - 1]) spans.push_back({k, k});
    spans.back().last = k + 1;
  }
  return spans;
}

PlanInformation plan_information(const Record& record, const Health& health,
                                 const DriveConfig& drive, const std::set<std::string>& kinds,
                                 const std::vector<RowSpan>& spans) {
  const DriveFacts facts = drive.facts();
  const Effects known = drive.model_effects();
  const Equations equations(record, facts, known);
  const std::vector<char> moving = moving_rows(record);
  std::vector<char> piece(record.size(), 0);
  for (std::size_t s = 0; s < spans.size(); ++s)
    std::fill(piece.begin() + static_cast<std::ptrdiff_t>(spans[s].first),
              piece.begin() + static_cast<std::ptrdiff_t>(spans[s].last),
              static_cast<char>(1 + s % 2));
  const Sampler sampler(record, moving, piece);
  const NoisierRecords noisier = add_noise(record, facts, moving, health.i_lsb);
  const Equations answered(noisier.answered, facts, known),
      readings(noisier.readings, facts, known);
  Chain chain(equations, answered, readings, sampler);

  Dictionary dictionary;
  for (const auto& effect : thinned_effects(facts, kinds))
    dictionary.sampled.push_back({effect, effect->tracing().regressor_count() > 0
                                              ? chain.columns(*effect)
                                              : std::vector<Sampled>{chain.contribution(*effect)}});
  chain.set_noise(NoiseFit()(chain, chain.residual({}), dictionary));

  PlanInformation out;
  PlanCandidates& all = out.candidates;
  std::vector<Sampled> columns;
  for (const Candidate& candidate : dictionary.sampled) {
    const std::string kind(candidate.effect->kind());
    if (all.kinds.empty() || all.kinds.back() != kind) all.kinds.push_back(kind);
    PlanGroup group = group_of(candidate.effect, facts);
    group.kind = all.kinds.size() - 1;
    group.first = all.columns;
    all.columns += group.count;
    for (const Sampled& x : candidate.columns) columns.push_back(chain.regressor(x));
    all.groups.push_back(std::move(group));
  }
  for (const RowSpan& span : spans) {
    Information sum = Information::none(all.columns);
    const auto electrical = outputs(sampler.electrical(), span);
    add_channel(columns, &Sampled::d, &Sampled::noise_d, &Sampled::answer_d, electrical, sum);
    add_channel(columns, &Sampled::q, &Sampled::noise_q, &Sampled::answer_q, electrical, sum);
    add_channel(columns, &Sampled::torque, &Sampled::noise_torque, &Sampled::answer_torque,
                outputs(sampler.torque(), span), sum);
    for (const PlanGroup& g : all.groups)
      if (is_placed(*make_effect(all.kinds[g.kind]), Traits::Place::kMoment)) halve(g, sum);
    out.pieces.push_back(std::move(sum));
  }
  return out;
}

}  // namespace twinrate
