// The parts of the board that the images use: SysTick, NVIC, UART0 of mps2-an385, and semihosting.
#pragma once
#include <stddef.h>
#include <stdint.h>

namespace twinrate::m3 {

inline volatile uint32_t& reg(uint32_t address) {
  return *reinterpret_cast<volatile uint32_t*>(address);  // NOLINT: a register
}

inline constexpr uint32_t kSysTickControl = 0xe000e010, kSysTickReload = 0xe000e014,
                          kSysTickValue = 0xe000e018, kInterruptEnable = 0xe000e100,
                          kInterruptDisable = 0xe000e180, kPriority = 0xe000e400,
                          kSystemPriority15 = 0xe000ed20;
inline constexpr uint32_t kUart = 0x40004000;  // DATA, STATE, CTRL, INTSTATUS, BAUDDIV

// Semihosting: operations of ARM's specification.
enum SemihostingCall : int { kOpen = 1, kClose = 2, kWrite = 5, kRead = 6, kExit = 0x18 };
inline int semihosting(int operation, const void* parameters) {
  register int r0 asm("r0") = operation;
  register const void* r1 asm("r1") = parameters;
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

inline uint32_t length_of(const char* text) {
  uint32_t n = 0;
  while (text[n]) ++n;
  return n;
}
inline constexpr uint32_t kReadBinary = 1, kWriteBinary = 5;
inline int open_file(const char* path, uint32_t mode) {
  const uint32_t block[3] = {reinterpret_cast<uint32_t>(path), mode, length_of(path)};
  return semihosting(kOpen, block);
}
// Returns the number of bytes that were not transferred.
inline int read_file(int file, void* to, uint32_t size) {
  const uint32_t block[3] = {static_cast<uint32_t>(file), reinterpret_cast<uint32_t>(to), size};
  return semihosting(kRead, block);
}
inline int write_file(int file, const void* from, uint32_t size) {
  const uint32_t block[3] = {static_cast<uint32_t>(file), reinterpret_cast<uint32_t>(from), size};
  return semihosting(kWrite, block);
}
// Reads until `size` bytes are complete; false at the end of the file.
inline bool read_all(int file, void* to, uint32_t size) {
  auto* at = static_cast<uint8_t*>(to);
  while (size > 0) {
    const auto left = static_cast<uint32_t>(read_file(file, at, size));
    if (left >= size) return false;
    at += size - left;
    size = left;
  }
  return true;
}
[[noreturn]] inline void exit_emulator(int code) {
  constexpr uint32_t kApplicationExit = 0x20026, kRunTimeError = 0x20023;
  semihosting(kExit, reinterpret_cast<const void*>(code == 0 ? kApplicationExit : kRunTimeError));
  for (;;) {
  }
}

}  // namespace twinrate::m3
