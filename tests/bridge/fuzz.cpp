#include "tests/bridge/fuzz.hpp"

#include <cassert>
#include <cmath>

#include "bridge/moteus_host.hpp"
#include "bridge/twinrate_host.hpp"
#include "bridge/vesc_host.hpp"

namespace twinrate::fuzz {
namespace {

DriveConfig drive() {
  DriveConfig d;
  d.rates.f_s_Hz = 1000;
  d.machine.n_p = 4;
  return d;
}

// All samples; their number is bounded by the input.
template <class Host>
int feed(Host& host, const std::uint8_t* bytes, std::size_t size) {
  host.hello(false);
  host.asked(0);
  host.poll(0);
  host.take({bytes, size / 2}, 1'000'000);
  host.poll(2'000'000);
  host.asked(2'000'000);
  host.take({bytes + size / 2, size - size / 2}, 3'000'000);
  std::size_t samples = 0;
  while (host.next()) ++samples;
  assert(samples <= size);
  host.poll(3'000'000'000);
  return 0;
}

}  // namespace

int twinrate_frames(const std::uint8_t* bytes, std::size_t size) {
  TwinrateHost host(true);
  // A whole frame is written again to a frame that reads the same.
  twp_receiver receiver{};
  for (std::size_t i = 0; i < size; ++i) {
    twp_frame f{}, again{};
    if (twp_receive(&receiver, bytes[i], &f) != TWP_FRAME) continue;
    std::uint8_t wire[TWP_MAX_WIRE];
    const std::size_t n = twp_write(&f, wire);
    assert(n > 1 && n <= TWP_MAX_WIRE);
    assert(twp_read(wire, n - 1, &again) == TWP_FRAME);
  }
  return feed(host, bytes, size);
}

int moteus_lines(const std::uint8_t* bytes, std::size_t size) {
  MoteusHost host({}, drive()), listening({.mode = BridgeMode::kListen}, drive());
  feed(listening, bytes, size);
  return feed(host, bytes, size);
}

int moteus_registers(const std::uint8_t* bytes, std::size_t size) {
  const MoteusFrame frame = parse_moteus({bytes, size});
  assert(frame.writes.size() + frame.replies.size() <= size);
  return 0;
}

int moteus_burst(const std::uint8_t* bytes, std::size_t size) {
  MoteusBurst host({}, drive());
  return feed(host, bytes, size);
}

int vesc_frames(const std::uint8_t* bytes, std::size_t size) {
  VescHost host({}, drive());
  return feed(host, bytes, size);
}

}  // namespace twinrate::fuzz
