// Resamples a stream at the times j/rate, j whole: one time base for all streams of a log.
//
// Interpolation: FieldKind. A kMean field becomes the mean from j/rate to (j+1)/rate. A missing
// number (NaN) keeps its last value.
#pragma once
#include <functional>
#include <optional>

#include "export/fields.hpp"

namespace twinrate {

class Resampler {
 public:
  using Put = std::function<void(const Sample&)>;
  Resampler(double rate_Hz, Layout layout, Put put);

  // A sample whose time does not rise is ignored. Throws BadInput if it comes 1000 mean intervals
  // and 100,000 rows after the one before.
  void take(Sample sample);
  // Writes the last sample if its time is on the grid. Not with kMean fields: the mean after the
  // last sample is unknown.
  void finish();

 private:
  std::int64_t grid_ns(std::int64_t j) const;
  void start(const Sample& first);
  void expect_no_jump(std::int64_t t_ns);
  Sample between(const Sample& a, const Sample& b, std::int64_t t_ns) const;
  void put_pending();
  void add_to_means(double seconds);

  double rate_Hz_;
  Layout layout_;
  Put put_;
  bool has_means_ = false;
  std::optional<Sample> before_;
  std::optional<Sample> pending_;  // its means are incomplete
  std::vector<double> integral_;   // of the numbers of `pending_`
  std::int64_t next_ = 0;          // j
  std::int64_t intervals_ = 0;     // so far, and their sum
  double sum_s_ = 0;
};

}  // namespace twinrate
