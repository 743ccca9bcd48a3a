// Bytes to and from the host: two FIFOs by semihosting where they are, else UART0.
//
// The UART is waited for in WFI: polling its register starves the emulator's main loop. Its interrupts
// are enabled inside an exchange only, so that they take no instructions from the background.
#pragma once
#include "firmware/cortex_m3/image/board.hpp"

namespace twinrate::m3 {

class LinkPort {
 public:
  void open();
  // At least one byte; 0: the host is gone.
  uint32_t read(uint8_t* to, uint32_t size);
  void write(const uint8_t* from, uint32_t size);
  bool read_exactly(uint8_t* to, uint32_t size);
  // Around an exchange.
  void begin();
  void end();

 private:
  int in_ = -1, out_ = -1;
  bool is_uart_ = false;
};

}  // namespace twinrate::m3
