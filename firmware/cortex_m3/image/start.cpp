// Vectors and reset of the bare-metal images, and the two functions that the compiler calls.
#include <stddef.h>
#include <stdint.h>

#include "firmware/cortex_m3/image/board.hpp"

extern "C" {
extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];
int main();

void* memcpy(void* to, const void* from, size_t size) {
  auto* out = static_cast<uint8_t*>(to);
  const auto* in = static_cast<const uint8_t*>(from);
  while (size--) *out++ = *in++;
  return to;
}
void* memset(void* to, int value, size_t size) {
  auto* out = static_cast<uint8_t*>(to);
  while (size--) *out++ = static_cast<uint8_t>(value);
  return to;
}

[[noreturn]] void reset() {
  for (uint32_t *to = data_start, *from = data_load; to < data_end;) *to++ = *from++;
  for (uint32_t* to = bss_start; to < bss_end;) *to++ = 0;
  twinrate::m3::exit_emulator(main());
}
[[noreturn]] void fault() {
  twinrate::m3::exit_emulator(3);
}
void unused() {}
[[gnu::weak]] void control_interrupt() {}
[[gnu::weak]] void uart_received() {}
[[gnu::weak]] void uart_sent() {}

using Handler = void (*)();
[[gnu::section(".vectors"), gnu::used]] const Handler vectors[18] = {
    reinterpret_cast<Handler>(stack_top),
    reset,
    fault,
    fault,
    fault,
    fault,
    fault,
    unused,
    unused,
    unused,
    unused,
    fault,
    unused,
    unused,
    unused,
    control_interrupt,  // SysTick
    uart_received,      // IRQ 0
    uart_sent};         // IRQ 1
}
