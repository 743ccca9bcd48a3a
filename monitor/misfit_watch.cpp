#include "monitor/misfit_watch.hpp"

#include <fmt/format.h>

#include <cmath>

#include "trace/equations.hpp"
#include "trace/statistics.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr double kMisfitP = 1e-9;  // p-value

// The residuals of rows [first, last) with a model.
struct Residuals {
  Eigen::VectorXd d, q, torque;
  Runs electrical, mechanical;
};
Residuals residuals_of(const DriveConfig& drive, const std::deque<MeasuredRow>& rows,
                       std::size_t first, std::size_t last, const Effects& model_effects) {
  Health health;
  const RawLog raw = raw_log_of(rows, first, last);
  if (raw.t.size() < 50) return {};
  const Record record = make_record(raw, drive.machine.n_p, health, drive.sensors.encoder_counts);
  const Equations equations(record, drive.facts(), model_effects);
  const Sampler sampler(record, moving_rows(record), std::vector<char>(record.size(), 0));
  const Channels left = equations.residual({});
  return {sampler(left.d, sampler.electrical()), sampler(left.q, sampler.electrical()),
          sampler(left.torque, sampler.torque()), sampler.electrical(), sampler.torque()};
}

const char* unit_of(const std::string& name) {
  return name.starts_with("voltage") ? "V" : name.starts_with("torque") ? "Nm" : "";
}

double rms(const Eigen::VectorXd& y) {
  return y.size() > 0 ? std::sqrt(y.squaredNorm() / static_cast<double>(y.size())) : 0;
}

void append(Eigen::VectorXd& y, Runs& runs, const Eigen::VectorXd& more, const Runs& more_runs) {
  const auto before = static_cast<std::size_t>(y.size());
  y.conservativeResize(y.size() + more.size());
  y.tail(more.size()) = more;
  runs.row.insert(runs.row.end(), more_runs.row.begin(), more_runs.row.end());
  for (const std::size_t start : more_runs.start) runs.start.push_back(before + start);
}

}  // namespace

const ChannelLevel* BlockVerdict::worst() const {
  const ChannelLevel* worst = nullptr;
  for (const ChannelLevel& c : channels)
    if (!worst || c.excess > worst->excess) worst = &c;
  return worst;
}

std::string BlockVerdict::text() const {
  const ChannelLevel* w = worst();
  if (!w) return "no data to test";
  return fmt::format(
      "{} {:.3g}{}{} rms, {:.3g} times the learnt level (consistency p {:.1g}, whiteness "
      "p {:.1g})",
      w->name, w->rms, w->unit.empty() ? "" : " ", w->unit, std::sqrt(w->excess), w->consistency,
      w->whiteness);
}

MisfitWatch::MisfitWatch(const DriveConfig& drive) : drive_(drive) {}

std::map<std::string, MisfitWatch::Series> MisfitWatch::series_of(
    const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
    const std::vector<Estimate>& estimates, const Effects& model_effects) const {
  Residuals r = residuals_of(drive_, rows, first, last, model_effects);
  std::map<std::string, Series> series;
  if (r.d.size() > 0) {
    series["voltage residual d"] = {std::move(r.d), r.electrical};
    series["voltage residual q"] = {std::move(r.q), r.electrical};
  }
  if (r.torque.size() > 0) series["torque residual"] = {std::move(r.torque), r.mechanical};
  const int n_y = estimates.empty() ? 0 : estimates.back().n_y;
  for (int i = 0; i < n_y; ++i) {
    Series innovation;
    innovation.y.resize(static_cast<Eigen::Index>(estimates.size()));
    innovation.runs.start = {0};
    for (std::size_t n = 0; n < estimates.size(); ++n) {
      innovation.y[static_cast<Eigen::Index>(n)] = estimates[n].innov[i];
      innovation.runs.row.push_back(n);
    }
    series[fmt::format("innovation {}", i + 1)] = std::move(innovation);
  }
  return series;
}

void MisfitWatch::learn(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
                        const std::vector<Estimate>& estimates, const Effects& model_effects) {
  for (auto& [name, series] : series_of(rows, first, last, estimates, model_effects)) {
    Level& level = levels_[name];
    append(level.all.y, level.all.runs, series.y, series.runs);
    level.blocks.push_back(std::move(series));
  }
}

bool MisfitWatch::learnt() {
  std::erase_if(levels_, [](const auto& entry) { return rms(entry.second.all.y) == 0; });
  for (auto& [name, level] : levels_) {
    level.whitener = Whitener(level.all.y, level.all.runs);
    level.largest = 1;
    for (const Series& block : level.blocks) {
      const double size = rms(level.whitener(block.y, block.runs));
      level.largest = std::max(level.largest, size * size);
    }
    level.blocks.clear();
    level.all = {};
  }
  return !levels_.empty();
}

void MisfitWatch::accept(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
                         const std::vector<Estimate>& estimates, const Effects& model_effects) {
  for (const auto& [name, series] : series_of(rows, first, last, estimates, model_effects)) {
    const auto found = levels_.find(name);
    if (found == levels_.end() || series.y.size() == 0) continue;
    const double size = rms(found->second.whitener(series.y, series.runs));
    if (size * size < kMaxRise * found->second.largest)
      found->second.largest = std::max(found->second.largest, size * size);
  }
}

BlockVerdict MisfitWatch::test(const std::deque<MeasuredRow>& rows, std::size_t first,
                               std::size_t last, const std::vector<Estimate>& estimates,
                               const Effects& model_effects) const {
  BlockVerdict verdict;
  for (const auto& [name, series] : series_of(rows, first, last, estimates, model_effects)) {
    const auto found = levels_.find(name);
    if (found == levels_.end() || series.y.size() == 0) continue;
    const Level& level = found->second;
    const Eigen::VectorXd e = level.whitener(series.y, series.runs);
    const double power = e.squaredNorm() / level.largest;
    const auto N = static_cast<double>(e.size());
    ChannelLevel c{.name = name,
                   .unit = unit_of(name),
                   .rms = rms(series.y),
                   .excess = power / N,
                   .consistency = chi_square_tail(power, N),
                   .whiteness = whiteness_p_value(e, series.runs)};
    if (c.consistency < kMisfitP && c.excess > kMargin) verdict.fits = false;
    verdict.channels.push_back(std::move(c));
  }
  return verdict;
}

std::vector<Eigen::VectorXd> MisfitWatch::whitened(const std::deque<MeasuredRow>& rows,
                                                   std::size_t first, std::size_t last,
                                                   const Effects& model_effects) const {
  std::vector<Eigen::VectorXd> channels;
  for (const auto& [name, series] : series_of(rows, first, last, {}, model_effects)) {
    const auto found = levels_.find(name);
    if (found == levels_.end() || series.y.size() == 0) continue;
    channels.push_back(found->second.whitener(series.y, series.runs));
  }
  return channels;
}

ResidualRms residual_rms(const DriveConfig& drive, const std::deque<MeasuredRow>& rows,
                         std::size_t first, std::size_t last, const Effects& model_effects) {
  const Residuals r = residuals_of(drive, rows, first, last, model_effects);
  const double d = rms(r.d), q = rms(r.q);
  return {std::sqrt(0.5 * (d * d + q * q)), rms(r.torque)};
}

}  // namespace twinrate
