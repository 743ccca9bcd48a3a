// The last few signals of one kind, found by their sample index: two signals of the same tick may
// arrive apart.
#pragma once
#include <array>
#include <cstdint>

namespace twinrate {

template <class Signal, std::size_t kSize = 256>
class Recent {
 public:
  void put(const Signal& signal) {
    if (signal.k < 0) return;
    ring_[static_cast<std::size_t>(signal.k) % kSize] = signal;
    empty_ = false;
  }
  bool empty() const { return empty_; }
  // Null if the signal of tick k has not arrived or is no longer kept.
  const Signal* at(std::int64_t k) const {
    if (k < 0) return nullptr;
    const Signal& signal = ring_[static_cast<std::size_t>(k) % kSize];
    return signal.k == k ? &signal : nullptr;
  }

 private:
  std::array<Signal, kSize> ring_{};
  bool empty_ = true;
};

}  // namespace twinrate
