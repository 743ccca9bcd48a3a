// Number types of the fixed-point filter, which is a template over one of them.
//
//   Cell   an element of P, K or F as it is stored
//   Word   a number in a register
//   Wide   a product, and a sum of products
//
//   Plain32   Cell, Word 32 bits, Wide 64 bits        SMULL, SMLAL
//   Plain16   Cell 16 bits, Word and Wide 32 bits     MUL, MLA
//
// checked.hpp has the same two types with a check of every operation, for the host. Signed overflow
// is undefined in C++: formats.hpp proves that it does not occur.
// Freestanding: no header but the compiler's own <stdint.h>.
#pragma once
#include <stdint.h>

#define TWINRATE_M3_INLINE inline __attribute__((always_inline))

namespace twinrate::m3 {

struct Plain32 {
  using Long = Plain32;  // where a product needs 64 bits with either type
  using Cell = int32_t;
  using Word = int32_t;
  using Wide = int64_t;
  static TWINRATE_M3_INLINE Wide product(Word a, Word b) { return static_cast<Wide>(a) * b; }
  // w / 2^kShift, rounded down.
  template <int kShift>
  static TWINRATE_M3_INLINE Word narrow(Wide w) {
    return static_cast<Word>(w >> kShift);
  }
  // The low 32 bits of w / 2^kShift: the change of an angle, modulo one turn.
  template <int kShift>
  static TWINRATE_M3_INLINE uint32_t modulo(Wide w) {
    return static_cast<uint32_t>(w >> kShift);
  }
  static TWINRATE_M3_INLINE Wide wide(Word a) { return a; }
  static TWINRATE_M3_INLINE Cell cell(Word a) { return a; }
  static TWINRATE_M3_INLINE Word shifted_left(Word a, int by) {
    return static_cast<Word>(static_cast<uint32_t>(a) << by);
  }
  static TWINRATE_M3_INLINE int32_t raw(Word a) { return a; }
};

struct Plain16 {
  using Long = Plain32;
  using Cell = int16_t;
  using Word = int32_t;
  using Wide = int32_t;
  static TWINRATE_M3_INLINE Wide product(Word a, Word b) { return a * b; }
  template <int kShift>
  static TWINRATE_M3_INLINE Word narrow(Wide w) {
    return w >> kShift;
  }
  static TWINRATE_M3_INLINE Wide wide(Word a) { return a; }
  static TWINRATE_M3_INLINE Cell cell(Word a) { return static_cast<Cell>(a); }
  static TWINRATE_M3_INLINE Word shifted_left(Word a, int by) {
    return static_cast<Word>(static_cast<uint32_t>(a) << by);
  }
  static TWINRATE_M3_INLINE int32_t raw(Word a) { return a; }
};

}  // namespace twinrate::m3
