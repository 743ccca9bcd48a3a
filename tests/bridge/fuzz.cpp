#include "tests/bridge/fuzz.hpp"

#include <algorithm>
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

// The input as pieces, a byte of length before each, closed to whole frames: it reaches what is behind
// framing and checksum.
template <class Close>
Bytes closed(const std::uint8_t* bytes, std::size_t size, Close close) {
  Bytes all;
  for (std::size_t at = 0; at < size;) {
    const std::size_t length = std::min<std::size_t>(bytes[at], size - at - 1);
    const Bytes frame = close(Bytes(bytes + at + 1, bytes + at + 1 + length));
    all.insert(all.end(), frame.begin(), frame.end());
    at += 1 + length;
  }
  return all;
}

// With its CRC, as COBS, the zero behind it.
Bytes closed_twinrate(Bytes raw) {
  const std::uint32_t crc = twp_crc32(raw.data(), raw.size());
  for (int i = 0; i < 4; ++i) raw.push_back(static_cast<std::uint8_t>(crc >> 8 * i));
  Bytes wire(raw.size() + 2 + raw.size() / 254);
  wire.resize(twp_cobs_encode(raw.data(), raw.size(), wire.data()));
  wire.push_back(0);
  return wire;
}

Bytes closed_vesc(const Bytes& payload) {
  return payload.empty() ? Bytes{} : vesc_frame(payload);
}

int twinrate_bytes(const std::uint8_t* bytes, std::size_t size) {
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

}  // namespace

int twinrate_frames(const std::uint8_t* bytes, std::size_t size) {
  const Bytes whole = closed(bytes, size, closed_twinrate);
  return twinrate_bytes(bytes, size) + twinrate_bytes(whole.data(), whole.size());
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
  const Bytes whole = closed(bytes, size, closed_vesc);
  VescHost host({}, drive()), behind({}, drive());
  return feed(host, bytes, size) + feed(behind, whole.data(), whole.size());
}

}  // namespace twinrate::fuzz
