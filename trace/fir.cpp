#include "trace/fir.hpp"

#include "model/four.hpp"

namespace twinrate {
namespace {

// First(n): index of the first input of output n.
template <class First>
__attribute__((always_inline)) inline void filter(std::span<const double> taps, const double* x,
                                                  std::size_t count, First first, double* y) {
  for (std::size_t n = 0; n < count; ++n)
    y[n] = dot_by_fours(taps.data(), x + first(n), taps.size());
}
template <class First>
void portable(std::span<const double> taps, const double* x, std::size_t count, First first,
              double* y) {
  filter(taps, x, count, first, y);
}
template <class First>
__attribute__((target("avx2"))) void avx2(std::span<const double> taps, const double* x,
                                          std::size_t count, First first, double* y) {
  filter(taps, x, count, first, y);
}

struct Listed {
  const std::size_t* first;
  __attribute__((always_inline)) std::size_t operator()(std::size_t n) const { return first[n]; }
};
struct InARow {
  __attribute__((always_inline)) std::size_t operator()(std::size_t n) const { return n; }
};

}  // namespace

void filter_at(std::span<const double> taps, const double* x, std::span<const std::size_t> first,
               double* y) {
  has_avx2() ? avx2(taps, x, first.size(), Listed{first.data()}, y)
             : portable(taps, x, first.size(), Listed{first.data()}, y);
}

void filter_along(std::span<const double> taps, const double* x, std::size_t count, double* y) {
  has_avx2() ? avx2(taps, x, count, InARow{}, y) : portable(taps, x, count, InARow{}, y);
}

}  // namespace twinrate
