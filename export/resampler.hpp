// Samples of one stream at the times j/rate, j whole: all streams of a log on one time base.
//
// Between two samples: FieldKind. A mean from sample to sample becomes the mean from j/rate to
// (j+1)/rate. A number that is missing (not a number) keeps its last value.
#pragma once
#include <functional>
#include <optional>

#include "export/fields.hpp"

namespace twinrate {

class Resampler {
 public:
  using Put = std::function<void(const Sample&)>;
  Resampler(double rate_Hz, Layout layout, Put put);

  void take(Sample sample);  // times rise; others are passed by
  // The last one, where a time of the grid meets it. The stretch behind it has no mean: with such
  // fields the last whole one was the last.
  void finish();

 private:
  std::int64_t grid_ns(std::int64_t j) const;
  void start(const Sample& first);
  Sample between(const Sample& a, const Sample& b, std::int64_t t_ns) const;
  void put_pending();
  void add_to_means(double seconds);

  double rate_Hz_;
  Layout layout_;
  Put put_;
  bool has_means_ = false;
  std::optional<Sample> before_;
  std::optional<Sample> pending_;  // whose means are not whole yet
  std::vector<double> integral_;   // of the numbers of `pending_`
  std::int64_t next_ = 0;          // j
};

}  // namespace twinrate
