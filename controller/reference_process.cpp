#include "controller/reference_process.hpp"

#include <fmt/format.h>

#include "core/process.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

// Every MEASUREMENT has its REFERENCE; a tick that arrives again is answered again.
class ReferenceProcess {
 public:
  ReferenceProcess(Process& p, const SpeedReference& omega_m_ref) : p_(p), drive_(p.drive()) {
    if (!drive_.reference.from_bus)
      throw BadInput(fmt::format("{}: reference.from_bus: true is required for a generator",
                                 p.config().where("reference.from_bus")));
    p.bus().subscribe<measurement_t>([this, omega_m_ref](const measurement_t& m) {
      if (p_.in_turn() && m.seq > last_k_ + 1) return p_.bus().refuse();
      Reference r = drive_.reference_at(m.seq);
      r.omega_m_ref = omega_m_ref(drive_, 1e-9 * static_cast<double>(r.t_ns));
      p_.bus().publish(to_wire(r, p_.bus().session()));
      if (m.seq > last_k_) p_.progress(last_k_ = m.seq);
    });
    p.waiting_for([this] {
      return Waiting{fmt::format("MEASUREMENT({})", last_k_ + 1), Patience::kForMeasurement,
                     Role::kPlant};
    });
  }
  void run() {
    p_.ready();
    p_.run();
  }

 private:
  Process& p_;
  const DriveConfig& drive_;
  std::int64_t last_k_ = -1;
};

}  // namespace

int run_reference(const char* program, int argc, char** argv, const SpeedReference& omega_m_ref) {
  return run_process({Role::kReference, program, "MEASUREMENT -> [reference] -> REFERENCE"}, argc,
                     argv, [&](Process& p) { ReferenceProcess(p, omega_m_ref).run(); });
}

}  // namespace twinrate
