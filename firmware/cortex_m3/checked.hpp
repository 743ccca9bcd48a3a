// The number types of number.hpp with a check of every operation: the first result that does not
// fit its type throws Wrapped. For the host only.
#pragma once
#include <limits>
#include <stdexcept>
#include <type_traits>

#include "firmware/cortex_m3/number.hpp"

namespace twinrate::m3 {

struct Wrapped : std::runtime_error {
  using std::runtime_error::runtime_error;
};

template <class Int>
class CheckedInt {
 public:
  constexpr CheckedInt() = default;
  constexpr CheckedInt(int value) : value_(fit(value)) {}
  template <class Other>
  explicit CheckedInt(CheckedInt<Other> other) : value_(fit(other.value())) {}
  static CheckedInt of(std::int64_t value) {
    CheckedInt made;
    made.value_ = fit(value);
    return made;
  }

  Int value() const { return value_; }
  friend CheckedInt operator+(CheckedInt a, CheckedInt b) {
    CheckedInt sum;
    if (__builtin_add_overflow(a.value_, b.value_, &sum.value_)) throw Wrapped("sum wraps");
    return sum;
  }
  friend CheckedInt operator-(CheckedInt a, CheckedInt b) {
    CheckedInt difference;
    if (__builtin_sub_overflow(a.value_, b.value_, &difference.value_))
      throw Wrapped("difference wraps");
    return difference;
  }
  friend CheckedInt operator*(CheckedInt a, CheckedInt b) {
    CheckedInt product;
    if (__builtin_mul_overflow(a.value_, b.value_, &product.value_)) throw Wrapped("product wraps");
    return product;
  }
  CheckedInt operator-() const { return CheckedInt(0) - *this; }
  friend CheckedInt operator>>(CheckedInt a, int by) {
    CheckedInt shifted;
    shifted.value_ = static_cast<Int>(a.value_ >> by);
    return shifted;
  }
  friend bool operator<(CheckedInt a, CheckedInt b) { return a.value_ < b.value_; }
  friend bool operator>(CheckedInt a, CheckedInt b) { return a.value_ > b.value_; }
  friend bool operator==(CheckedInt a, CheckedInt b) { return a.value_ == b.value_; }

 private:
  static constexpr Int fit(std::int64_t value) {
    if (value > std::numeric_limits<Int>::max() || value < std::numeric_limits<Int>::min())
      throw Wrapped("number does not fit");
    return static_cast<Int>(value);
  }
  Int value_ = 0;
};

template <class Plain>
struct Checked {
  using Long = Checked<typename Plain::Long>;
  using Cell = CheckedInt<typename Plain::Cell>;
  using Word = CheckedInt<typename Plain::Word>;
  using Wide = CheckedInt<typename Plain::Wide>;
  static Wide wide(Word a) { return Wide(a); }
  static Wide product(Word a, Word b) { return wide(a) * wide(b); }
  template <int kShift>
  static Word narrow(Wide w) {
    return Word(w >> kShift);
  }
  template <int kShift>
  static uint32_t modulo(Wide w) {
    return static_cast<uint32_t>(w.value() >> kShift);
  }
  static Cell cell(Word a) { return Cell(a); }
  static Word shifted_left(Word a, int by) {
    return Word::of(static_cast<std::int64_t>(a.value()) * (std::int64_t{1} << by));
  }
  static int32_t raw(Word a) { return a.value(); }
};

using Checked32 = Checked<Plain32>;
using Checked16 = Checked<Plain16>;

}  // namespace twinrate::m3
