// The processor in the loop: the fast step in the control interrupt (SysTick), the background step
// below it, where every control interrupt preempts it.
//
//   SysTick   stop the timer; SAMPLE(k) -> fast(k) -> Answer(k); start the timer
//   main      background(), when a snapshot is due; else sleep
//
// The timer is stopped while frames are transferred, so the background gets the same instructions
// in every run, however slow the host is.
#include "firmware/cortex_m3/image/link_port.hpp"
#include "firmware/cortex_m3/link.hpp"
#include "firmware/cortex_m3/reading.hpp"

namespace twinrate::m3 {
namespace {

Start start;
TwoRate<Plain32, Format32> filter;
LinkPort port;
Answer answer;
uint32_t bad_frames;
NewGain gain;
bool has_gain;
int32_t last_sent = -1;  // snapshot

// SysTick gets a lower priority than the UART's interrupts, which keep priority 0.
void set_priorities() {
  reg(kSystemPriority15) = 0x80000000u;
}

[[noreturn]] void end(int code) {
  exit_emulator(code);
}

// Waits for the next whole frame; damaged frames are counted and skipped.
void receive(twp_frame& frame) {
  static uint8_t wire[TWP_MAX_WIRE];
  static uint32_t size;
  for (;;) {
    uint8_t bytes[64];
    const uint32_t n = port.read(bytes, sizeof bytes);
    if (n == 0) end(1);
    for (uint32_t i = 0; i < n; ++i) {
      if (bytes[i] != 0) {
        if (size < TWP_MAX_WIRE) wire[size++] = bytes[i];
        continue;
      }
      const uint32_t length = size;
      size = 0;
      if (length == 0) continue;
      if (twp_read(wire, length, &frame) == TWP_FRAME) return;  // one frame in flight: no rest
      ++bad_frames;
    }
  }
}

// Called on entry, before the fast step can use the gain.
void note_gain() {
  has_gain = false;
  if (!start.sends_gains || !filter.has_finished() || filter.finished().k == last_sent) return;
  const auto f = filter.finished();
  last_sent = f.k;
  has_gain = true;
  gain = {
      f.k,
      f.theta,
      {f.K.k00, f.K.k01, f.K.k10, f.K.k11, f.K.k20, f.K.k21, f.K.k30, f.K.k31},
      {f.P.m00, f.P.m01, f.P.m02, f.P.m03, f.P.m11, f.P.m12, f.P.m13, f.P.m22, f.P.m23, f.P.m33}};
}

void answer_tick(uint32_t k) {
  const State<Plain32>& x = filter.state();
  const Clamps clamps = filter.clamps();
  answer.k = k;
  answer.i_alpha = x.i_alpha;
  answer.i_beta = x.i_beta;
  answer.omega = x.omega;
  answer.theta = x.theta;
  answer.gain_snapshot = filter.gain_snapshot();
  answer.late = filter.late();
  answer.bad_frames = bad_frames;
  answer.clamped_P33 = clamps.P33;
  answer.clamped_P34 = clamps.P34;
  answer.clamped_P44 = clamps.P44;
  answer.clamped_omega = clamps.omega;
  uint8_t wire[kAnswerWire];
  port.write(wire, write_answer(answer, has_gain ? &gain : nullptr, wire));
}

void start_timer() {
  reg(kSysTickValue) = 0;
  reg(kSysTickControl) = 7;  // processor clock, interrupt
}

}  // namespace

// `frame`: registers that the processor pushed on entry; word 6 is the address at which the
// background was interrupted.
extern "C" void control(const uint32_t* frame) {
  reg(kSysTickControl) = 0;
  if (filter.background_due()) {
    ++answer.preempted;
    answer.progress = (answer.progress ^ frame[6]) * 16777619u;
  }
  note_gain();
  static twp_frame received;
  port.begin();
  receive(received);
  if (received.header.type == TWP_HELLO) end(0);
  if (received.header.type == TWP_SAMPLE)
    filter.fast(static_cast<int32_t>(received.header.seq), reading<Plain32>(received.body.sample));
  answer_tick(received.header.seq);
  port.end();
  start_timer();
}

extern "C" [[gnu::naked]] void control_interrupt() {
  asm volatile("mov r0, sp\n b control");
}

}  // namespace twinrate::m3

int main() {
  using namespace twinrate::m3;
  set_priorities();
  port.open();
  port.begin();
  uint32_t crc = 0;
  if (!port.read_exactly(reinterpret_cast<uint8_t*>(&start), sizeof start) ||
      !port.read_exactly(reinterpret_cast<uint8_t*>(&crc), 4) ||
      crc != twp_crc32(reinterpret_cast<uint8_t*>(&start), sizeof start))
    return 1;
  port.end();
  filter.start(start.settings);
  reg(kSysTickReload) = start.systick_reload;
  start_timer();
  for (;;) {
    if (filter.background_due()) {
      filter.background();
    } else {
      // An interrupt between the test and WFI is not missed: WFI returns at once if an interrupt is
      // pending under PRIMASK. A missed one would delay the background by a period.
      asm volatile("cpsid i" ::: "memory");
      if (!filter.background_due()) asm volatile("wfi" ::: "memory");
      asm volatile("cpsie i" ::: "memory");
    }
  }
}
