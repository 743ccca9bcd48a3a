#include "emulator/vesc_device.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace twinrate {
namespace {

void put_int(Bytes& p, std::int64_t value, int bytes) {
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8)
    p.push_back(static_cast<std::uint8_t>(value >> shift & 0xff));
}

void put_float(Bytes& p, double value) {
  const auto x = static_cast<float>(value);
  std::uint32_t bits = 0;
  std::memcpy(&bits, &x, 4);
  put_int(p, bits, 4);
}

}  // namespace

void VescDevice::take(std::span<const std::uint8_t> bytes) {
  receiver_.receive(bytes, [this](std::span<const std::uint8_t> p) { take_payload(p); });
}

void VescDevice::take_payload(std::span<const std::uint8_t> p) {
  if (p[0] == VescHost::kGetValues) {
    const Measurement* m = drive_.sample();
    Bytes reply = {VescHost::kGetValues};
    put_int(reply, 300, 2);  // 30 degC, twice
    put_int(reply, 300, 2);
    for (int i = 0; i < 4; ++i) put_int(reply, 0, 4);  // mean currents
    put_int(reply, 0, 2);                              // duty
    put_int(reply, m ? std::llround(m->omega_m * machine_.n_p * 60 / kTwoPi) : 0, 4);
    put_int(reply, m ? std::llround(10 * m->v_dc) : 0, 2);
    sent_.push_back(vesc_frame(reply));
  }
  if (p[0] == VescHost::kSamplePrint && p.size() >= 5) {
    wanted_ = p[2] << 8 | p[3];
    burst_.clear();
  }
}

Bytes VescDevice::sample_payload(const Measurement& m) const {
  const Vec3 u_abc = inverse_clarke(m.u_alphabeta);
  Bytes p = {VescHost::kSamplePrint};
  for (int i = 0; i < 3; ++i) put_float(p, m.i_abc[i]);
  for (int i = 0; i < 3; ++i) put_float(p, u_abc[i] + 0.5 * m.v_dc);
  put_float(p, 0.5 * m.v_dc);
  put_float(p, clarke(m.i_abc).norm());
  put_float(p, 1 / options_.T_s);
  const double turns = machine_.n_p * m.theta_m / kTwoPi;
  p.push_back(0);
  p.push_back(static_cast<std::uint8_t>(VescHost::kAngleSteps * (turns - std::floor(turns))));
  return p;
}

void VescDevice::tick() {
  const Measurement* m = drive_.sample();
  if (m && wanted_ > 0) {
    burst_.push_back(vesc_frame(sample_payload(*m)));
    if (--wanted_ == 0) {
      std::move(burst_.begin(), burst_.end(), std::back_inserter(sent_));
      burst_.clear();
    }
  }
  drive_.advance(nullptr);
  ++k_;
}

}  // namespace twinrate
