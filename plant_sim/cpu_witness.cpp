#include "plant_sim/cpu_witness.hpp"

#include <chrono>

#include "core/process.hpp"
#include "core/realtime_setup.hpp"
#include "core/signals_io.hpp"

namespace twinrate {

CpuWitness::CpuWitness(int cpu, int priority) : noted_ns_(host_now_ns()) {
  thread_ = std::thread([this, cpu, priority] { note(cpu, priority); });
}

CpuWitness::~CpuWitness() {
  ends_ = true;
  thread_.join();
}

void CpuWitness::note(int cpu, int priority) {
  pin_to_cpu(cpu);
  take_fifo(priority);
  while (!ends_) {
    noted_ns_ = host_now_ns();
    std::this_thread::sleep_for(std::chrono::nanoseconds(StoodTime::kPeriod_ns));
  }
}

}  // namespace twinrate
