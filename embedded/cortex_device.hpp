// The emulated Cortex-M3 with the loop image (firmware/cortex_m3/image/loop_image.cpp), in
// lock-step: SAMPLE(k) -> Answer(k). It is a process of its own, which the destructor ends.
#pragma once
#include <sys/types.h>

#include <memory>
#include <string>

#include "embedded/fixed_estimator.hpp"
#include "embedded/scratch.hpp"
#include "firmware/cortex_m3/link.hpp"

namespace twinrate {

enum class CortexLink : int { kSemihosting = 0, kUart = 1 };
inline constexpr const char* kCortexLinkNames[] = {"semihosting", "uart"};

class CortexDevice {
 public:
  // `period_s`: period of the control interrupt in the time of the processor, at 31.25e6
  // instructions a second (qemu -icount shift=5). Throws MachineError if the emulator or the image
  // is missing. `sends_gains`: the answers contain the gains of its background.
  CortexDevice(const m3::Settings& settings, CortexLink link, double period_s,
               bool sends_gains = false);
  ~CortexDevice();
  CortexDevice(const CortexDevice&) = delete;
  CortexDevice& operator=(const CortexDevice&) = delete;

  // Throws MachineError if the processor does not answer within 20 s.
  const m3::Answer& tick(const Measurement& m);
  // The answer without a tick: fetches a gain that was finished after the last answer.
  const m3::Answer& ask(std::int64_t k);
  // The gain of the last answer; null: the answer had none.
  const m3::NewGain* new_gain() const { return gain_.k < 0 ? nullptr : &gain_; }

 private:
  void start_emulator(CortexLink link);
  void open_fifos();
  void open_socket();
  const m3::Answer& exchange(const twp_frame& frame);
  void send(const void* bytes, std::size_t size);
  void receive();
  [[noreturn]] void fail(const std::string& why) const;

  Scratch scratch_;
  pid_t pid_ = -1;
  int to_ = -1, from_ = -1;
  std::string pending_;  // bytes after the last zero
  m3::Answer answer_{};
  m3::NewGain gain_{.k = -1};
};

FixedEstimate estimate_of(const m3::Answer& answer);
// The gain as in GAIN: in SI, from the 32-bit format.
Gain gain_of(const m3::NewGain& gain, const DriveConfig& drive);

}  // namespace twinrate
