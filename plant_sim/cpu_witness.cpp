#include "plant_sim/cpu_witness.hpp"

#include <sched.h>

#include <algorithm>
#include <chrono>

#include "core/process.hpp"
#include "core/realtime_setup.hpp"
#include "core/signals_io.hpp"

namespace twinrate {

CpuWitness::CpuWitness(int cpu, int priority) : noted_ns_(host_now_ns()) {
  thread_ = std::thread([this, cpu, priority] { note(cpu, priority); });
  ready_.wait();
}

CpuWitness::~CpuWitness() {
  ends_ = true;
  thread_.join();
}

void CpuWitness::note(int cpu, int priority) {
  sched_param param{};
  if (has_realtime_policy()) sched_getparam(0, &param);  // started with one (chrt), as the watched
  param.sched_priority = std::max(priority, param.sched_priority) + 1;
  // With normal priority it would not run on that CPU beside a watched process that spins.
  if (param.sched_priority > 1) sched_setscheduler(0, SCHED_FIFO, &param);
  pin_to_cpu(cpu);
  noted_ns_ = host_now_ns();
  ready_.count_down();
  while (!ends_) {
    noted_ns_ = host_now_ns();
    std::this_thread::sleep_for(std::chrono::nanoseconds(StoodTime::kPeriod_ns));
  }
}

}  // namespace twinrate
