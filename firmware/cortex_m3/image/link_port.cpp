#include "firmware/cortex_m3/image/link_port.hpp"

namespace twinrate::m3 {
namespace {

constexpr uint32_t kData = kUart, kState = kUart + 4, kControl = kUart + 8, kStatus = kUart + 12,
                   kBaud = kUart + 16;
constexpr uint32_t kTransmitFull = 1;
constexpr uint32_t kTransmitBit = 1, kReceiveBit = 2;  // of kStatus
constexpr uint32_t kBothInterrupts = 3;                // IRQ 0 receive, IRQ 1 transmit

constexpr uint32_t kRing = 256;
volatile uint8_t ring[kRing];
volatile uint32_t ring_in, ring_out;

// Sleeps until an interrupt; `ready` is tested with interrupts masked, so that no interrupt is
// missed.
template <class Ready>
void wait_for(Ready ready) {
  for (;;) {
    asm volatile("cpsid i" ::: "memory");
    const bool done = ready();
    if (!done) asm volatile("wfi" ::: "memory");
    asm volatile("cpsie i" ::: "memory");
    if (done) return;
  }
}

}  // namespace

void LinkPort::open() {
  in_ = open_file("to_device", kReadBinary);
  if (in_ >= 0) {
    out_ = open_file("from_device", kWriteBinary);
    return;
  }
  is_uart_ = true;
  reg(kBaud) = 16;
  reg(kControl) = 0xf;  // transmit, receive and their interrupts
}

void LinkPort::begin() {
  if (is_uart_) reg(kInterruptEnable) = kBothInterrupts;
}
void LinkPort::end() {
  if (is_uart_) reg(kInterruptDisable) = kBothInterrupts;
}

uint32_t LinkPort::read(uint8_t* to, uint32_t size) {
  if (!is_uart_) return size - static_cast<uint32_t>(read_file(in_, to, size));
  wait_for([] { return ring_in != ring_out; });
  uint32_t n = 0;
  while (n < size && ring_in != ring_out) {
    to[n++] = ring[ring_out % kRing];
    ring_out = ring_out + 1;
  }
  return n;
}

bool LinkPort::read_exactly(uint8_t* to, uint32_t size) {
  for (uint32_t got = 0; got < size;) {
    const uint32_t n = read(to + got, size - got);
    if (n == 0) return false;
    got += n;
  }
  return true;
}

void LinkPort::write(const uint8_t* from, uint32_t size) {
  if (!is_uart_) {
    write_file(out_, from, size);
    return;
  }
  for (uint32_t i = 0; i < size; ++i) {
    wait_for([] { return (reg(kState) & kTransmitFull) == 0; });
    reg(kData) = from[i];
  }
}

}  // namespace twinrate::m3

extern "C" {
void uart_received() {
  using namespace twinrate::m3;
  reg(kStatus) = kReceiveBit;
  ring[ring_in % kRing] = static_cast<uint8_t>(reg(kData));
  ring_in = ring_in + 1;
}
void uart_sent() {
  using namespace twinrate::m3;
  reg(kStatus) = kTransmitBit;
}
}
