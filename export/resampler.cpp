#include "export/resampler.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/config.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kMaxRowsOfJump = 1e5;  // a gap of 1000 mean intervals may have this many rows

double angle_between(double a, double b, double share) {
  const double angle = a + share * wrap_pi(b - a);
  return a >= 0 && b >= 0 && a < kTwoPi && b < kTwoPi ? wrap_turn(angle) : angle;
}

}  // namespace

Resampler::Resampler(double rate_Hz, Layout layout, Put put)
    : rate_Hz_(rate_Hz), layout_(std::move(layout)), put_(std::move(put)) {
  has_means_ = std::any_of(layout_.numbers.begin(), layout_.numbers.end(),
                           [](const Field& f) { return f.kind == FieldKind::kMean; });
}

std::int64_t Resampler::grid_ns(std::int64_t j) const {
  return std::llround(static_cast<double>(j) * 1e9 / rate_Hz_);
}

void Resampler::start(const Sample& first) {
  next_ = static_cast<std::int64_t>(std::floor(static_cast<double>(first.t_ns) * 1e-9 * rate_Hz_));
  while (grid_ns(next_) < first.t_ns) ++next_;
}

void Resampler::take(Sample sample) {
  if (!before_) {
    start(sample);
    before_ = std::move(sample);
    return;
  }
  if (sample.t_ns <= before_->t_ns) return;
  expect_no_jump(sample.t_ns);
  if (sample.numbers.size() == before_->numbers.size())
    for (std::size_t i = 0; i < sample.numbers.size(); ++i)
      if (std::isnan(sample.numbers[i])) {
        sample.numbers[i] = before_->numbers[i];
        if (i < sample.wholes.size()) sample.wholes[i] = before_->wholes[i];
      }
  std::int64_t from_ns = before_->t_ns;
  for (;;) {
    const std::int64_t grid = grid_ns(next_), end_ns = std::min(grid, sample.t_ns);
    add_to_means(1e-9 * static_cast<double>(end_ns - from_ns));
    from_ns = end_ns;
    if (grid >= sample.t_ns) break;
    put_pending();
    pending_ = between(*before_, sample, grid);
    integral_.assign(pending_->numbers.size(), 0.0);
    ++next_;
  }
  before_ = std::move(sample);
}

// The rows written follow from the samples: one wild time stamp must not fill the disk.
void Resampler::expect_no_jump(std::int64_t t_ns) {
  const double gap_s = 1e-9 * static_cast<double>(t_ns - before_->t_ns);
  if (gap_s * rate_Hz_ > kMaxRowsOfJump && gap_s * static_cast<double>(intervals_) >= 1000 * sum_s_)
    throw BadInput(fmt::format(
        "--resample: no sample between {:.6g} and {:.6g} s; leave the gap out with --from and --to",
        1e-9 * static_cast<double>(before_->t_ns), 1e-9 * static_cast<double>(t_ns)));
  ++intervals_;
  sum_s_ += gap_s;
}

void Resampler::finish() {
  if (!before_) return;
  const bool meets = grid_ns(next_) == before_->t_ns;
  if (meets || !has_means_) put_pending();
  before_->origin = {};
  if (meets && !has_means_) put_(*before_);
  pending_.reset();
  before_.reset();
}

void Resampler::add_to_means(double seconds) {
  if (!has_means_ || !pending_ || before_->numbers.size() != integral_.size()) return;
  for (std::size_t i = 0; i < integral_.size(); ++i) integral_[i] += seconds * before_->numbers[i];
}

void Resampler::put_pending() {
  if (!pending_) return;
  if (has_means_) {
    std::size_t at = 0;
    for (std::size_t f = 0; f < layout_.numbers.size(); at += pending_->counts[f++])
      if (layout_.numbers[f].kind == FieldKind::kMean)
        pending_->numbers[at] = integral_[at] * rate_Hz_;
  }
  put_(*pending_);
}

Sample Resampler::between(const Sample& a, const Sample& b, std::int64_t t_ns) const {
  Sample s = a;
  s.t_ns = t_ns;
  s.origin = {};
  const double share = static_cast<double>(t_ns - a.t_ns) / static_cast<double>(b.t_ns - a.t_ns);
  std::size_t at = 0, there = 0;
  for (std::size_t f = 0; f < layout_.numbers.size(); ++f) {
    const double x = f < a.counts.size() && a.counts[f] == 1 ? a.numbers[at] : 0,
                 y = f < b.counts.size() && b.counts[f] == 1 ? b.numbers[there] : 0;
    if (layout_.numbers[f].kind == FieldKind::kLinear) s.numbers[at] = x + share * (y - x);
    if (layout_.numbers[f].kind == FieldKind::kAngle) s.numbers[at] = angle_between(x, y, share);
    at += a.counts[f];
    there += b.counts[f];
  }
  return s;
}

}  // namespace twinrate
