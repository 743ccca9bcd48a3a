#include "trace/position_judge.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

// Holding current of the rows of `ok`, less the model and the mean of the residual.
double holding_error(const PositionLog& log, const std::vector<double>& model,
                     const std::vector<char>& ok, std::size_t& rows) {
  double sum = 0, squares = 0;
  rows = 0;
  for (std::size_t k = 0; k < log.size(); ++k)
    if (ok[k]) {
      const double rest = log.i_q[k] - model[k];
      sum += rest;
      squares += rest * rest;
      ++rows;
    }
  const double n = std::max<double>(1, static_cast<double>(rows));
  return std::sqrt(std::max(0.0, squares / n - sum / n * sum / n));
}

bool has(const PositionLog& log, bool unseen) {
  return log.judges.empty() ? log.held_out == unseen : true;
}

}  // namespace

Judge::Judge(const std::vector<PositionLog>& logs, const MachineParameters& machine, double horizon,
             const TraceHooks& hooks)
    : hooks_(hooks), horizon_(horizon) {
  const bool unseen = std::any_of(logs.begin(), logs.end(), [](auto& l) { return has(l, true); });
  for (const PositionLog& log : logs)
    if (!is_quasi_static(log, machine) && has(log, unseen)) by_speed_ = true;
  for (const PositionLog& log : logs)
    if (by_speed_ == !is_quasi_static(log, machine)) logs_.push_back(&log);
  if (by_speed_ && horizon_ <= 0) horizon_ = 5 * sample_interval(*logs_.front());
  if (!by_speed_) horizon_ = 0;
}

void Judge::find_other_zeros(const Found& found) {
  if (!by_speed_) return;
  MotionModel without = found.model();
  without.holding = nullptr;
  for (const PositionLog* log : logs_)
    if (!hooks_.stopped() && !log->held_out &&
        speed_change(*log, without, horizon_).error <
            0.95 * speed_change(*log, found.model(), horizon_).error)
      other_zero_.push_back(log);
}

void Judge::add(const PositionLog& log, bool unseen, const Found& declared_of,
                const MotionModel& model, Errors& errors) const {
  if (hooks_.stopped()) return errors.add(kNoError, kNoError, kNoError, 1);
  if (by_speed_) {
    const SpeedChange before = speed_change(log, declared_of.declared(), horizon_);
    MotionModel used = model;
    if (std::find(other_zero_.begin(), other_zero_.end(), &log) != other_zero_.end())
      used.holding = nullptr;
    const SpeedChange after = speed_change(log, used, horizon_);
    errors.add(before.no_change, before.error, after.error, static_cast<double>(after.rows));
    return;
  }
  const HoldingTorque none;
  const std::vector<char> ok = holding_rows(log, 5 * declared_of.holding.lag, unseen);
  std::size_t rows = 0;
  const double before = holding_error(log, std::vector<double>(log.size(), 0), ok, rows);
  const HoldingTorque& holding = model.holding ? *model.holding : none;
  const double after =
      holding_error(log, holding_current(log, holding, declared_of.machine), ok, rows);
  errors.add(before, before, after, static_cast<double>(rows));
}

Errors Judge::over(const Found& found, const MotionModel& model, bool held_out) const {
  Errors errors;
  for (const PositionLog* log : logs_)
    if (has(*log, held_out)) add(*log, held_out, found, model, errors);
  return errors;
}

bool Judge::unseen() const {
  return std::any_of(logs_.begin(), logs_.end(), [](auto* l) { return has(*l, true); });
}

double Judge::error(const Found& found, const MotionModel& model) const {
  const Errors e = over(found, model, unseen());
  return Errors::rms(e.after, e.rows);
}

std::vector<double> Judge::rest(const PositionLog& log, const Found& found,
                                const MotionModel& model) const {
  std::vector<double> rest;
  if (by_speed_) {
    MotionModel used = model;
    if (std::find(other_zero_.begin(), other_zero_.end(), &log) != other_zero_.end())
      used.holding = nullptr;
    const SpeedChangeRows rows = speed_change_rows(log, used, horizon_);
    for (std::size_t k = 0; k < rows.t.size(); ++k)
      rest.push_back(rows.measured[k] - rows.predicted[k]);
  } else {
    const HoldingTorque none;
    const std::vector<char> ok = holding_rows(log, 5 * found.holding.lag, unseen());
    const std::vector<double> held =
        holding_current(log, model.holding ? *model.holding : none, found.machine);
    for (std::size_t k = 0; k < log.size(); ++k)
      if (ok[k]) rest.push_back(log.i_q[k] - held[k]);
  }
  double mean = 0;
  for (double x : rest) mean += x / static_cast<double>(rest.size());
  for (double& x : rest) x -= mean;
  return rest;
}

std::vector<double> Judge::votes(const Found& found, const MotionModel& with,
                                 const MotionModel& without, double silent) const {
  constexpr std::size_t kPieces = 24;
  std::vector<double> votes;
  for (const PositionLog* log : logs_) {
    if (!has(*log, unseen()) || hooks_.stopped()) continue;
    const std::vector<double> a = rest(*log, found, with), b = rest(*log, found, without);
    if (a.size() != b.size()) continue;
    for (std::size_t piece = 0; piece < kPieces; ++piece) {
      double E_with = 0, E_without = 0;
      for (std::size_t k = piece * a.size() / kPieces; k < (piece + 1) * a.size() / kPieces; ++k)
        E_with += a[k] * a[k], E_without += b[k] * b[k];
      if (E_with > 0 && E_without > 0 && std::abs(E_with - E_without) > silent * E_without)
        votes.push_back(0.5 * std::log(E_without / E_with));
    }
  }
  return votes;
}

}  // namespace twinrate
