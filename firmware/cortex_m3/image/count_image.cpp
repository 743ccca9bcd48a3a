// Counts the instructions of each step of the filter with SysTick, which counts exactly with the
// instructions under qemu -icount. Reads settings.bin (Settings, a count, samples), runs the filter
// over the samples, and measures every step at the last ticks. Writes counts.txt:
//
//   mark measure_begin ADDRESS measure_end ADDRESS
//   step NAME ADDRESS CALLS SUM LEAST MOST      instructions of a call and its harness
//
// An empty step is measured, too: it gives the instructions of the harness.
#include "firmware/cortex_m3/image/board.hpp"
#include "firmware/cortex_m3/image/count_steps.hpp"

extern "C" const char measure_begin[], measure_end[];

namespace twinrate::m3 {
namespace {

constexpr int kMeasuredTicks = 64;
constexpr int kMaxSamples = 2000;

struct Tally {
  uint32_t calls = 0, sum = 0, least = ~0u, most = 0;
};

Settings settings;
Sample samples[kMaxSamples];
StepContext context;
Tally tally[64];

[[gnu::noinline, gnu::noclone]] uint32_t measure(Step step, StepContext* c) {
  asm volatile(".global measure_begin\n.type measure_begin, %function\nmeasure_begin: nop");
  const uint32_t before = reg(kSysTickValue);
  step(c);
  const uint32_t after = reg(kSysTickValue);
  asm volatile(".global measure_end\n.type measure_end, %function\nmeasure_end: nop");
  return (before - after) & 0xffffff;
}

// SysTick runs at 40 ns, an instruction takes 2^7 ns of virtual time under -icount shift=7.
uint32_t instructions(uint32_t ticks) {
  return (ticks * 40 + 64) / 128;
}

class Text {
 public:
  explicit Text(int file) : file_(file) {}
  Text& word(const char* text) {
    write_file(file_, text, length_of(text));
    write_file(file_, " ", 1);
    return *this;
  }
  Text& number(uint32_t n) {
    char digits[11], *at = digits + 10;
    *at = 0;
    do {
      *--at = static_cast<char>('0' + n % 10);
      n /= 10;
    } while (n);
    return word(at);
  }
  void end() { write_file(file_, "\n", 1); }

 private:
  int file_;
};

void measure_all() {
  for (int i = 0; i < kSteps; ++i) {
    const uint32_t count = instructions(measure(steps()[i].run, &context));
    Tally& t = tally[i];
    ++t.calls;
    t.sum += count;
    if (count < t.least) t.least = count;
    if (count > t.most) t.most = count;
  }
}

void write_counts() {
  Text out(open_file("counts.txt", kWriteBinary));
  out.word("mark").word("measure_begin").number(reinterpret_cast<uint32_t>(measure_begin) & ~1u);
  out.word("measure_end").number(reinterpret_cast<uint32_t>(measure_end) & ~1u).end();
  for (int i = 0; i < kSteps; ++i) {
    const Tally& t = tally[i];
    out.word("step").word(steps()[i].name).number(reinterpret_cast<uint32_t>(steps()[i].run) & ~1u);
    out.number(t.calls).number(t.sum).number(t.least).number(t.most).end();
  }
}

}  // namespace
}  // namespace twinrate::m3

int main() {
  using namespace twinrate::m3;
  const int file = open_file("settings.bin", kReadBinary);
  uint32_t count = 0;
  if (file < 0 || !read_all(file, &settings, sizeof settings) || !read_all(file, &count, 4) ||
      count > kMaxSamples || !read_all(file, samples, count * sizeof(Sample)))
    return 1;
  reg(kSysTickReload) = 0xffffff;
  reg(kSysTickValue) = 0;
  reg(kSysTickControl) = 5;  // processor clock, no interrupt
  start(context, settings);
  for (uint32_t k = 0; k < count; ++k) {
    run_tick(context, samples[k]);
    if (k + kMeasuredTicks >= count) measure_all();
  }
  write_counts();
  return 0;
}
