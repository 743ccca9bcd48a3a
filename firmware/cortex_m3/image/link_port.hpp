// Bytes to and from the host: through two FIFOs by semihosting if they exist, else through UART0.
//
// The port waits for the UART in WFI, because polling its register starves the emulator's main
// loop. The UART's interrupts are enabled only inside an exchange, so that they take no
// instructions from the background.
#pragma once
#include "firmware/cortex_m3/image/board.hpp"

namespace twinrate::m3 {

class LinkPort {
 public:
  void open();
  // Reads at least one byte; 0: the host has ended.
  uint32_t read(uint8_t* to, uint32_t size);
  void write(const uint8_t* from, uint32_t size);
  bool read_exactly(uint8_t* to, uint32_t size);
  // Called before and after an exchange.
  void begin();
  void end();

 private:
  int in_ = -1, out_ = -1;
  bool is_uart_ = false;
};

}  // namespace twinrate::m3
