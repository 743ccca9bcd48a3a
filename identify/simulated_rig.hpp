// The simulated plant of a drive file as a rig, which shows only its readings.
//
// The shaft is free and at rest at first: load and start of the drive file are not used. The
// effects of the plant act, including those of the readings. The wiring can be wrong, to test
// whether the identification detects it.
#pragma once
#include "core/config.hpp"
#include "identify/rig.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {

struct Wiring {
  bool swapped_phases = false;    // b and c
  bool reversed_encoder = false;  // counts against the rotation
};

class SimulatedRig final : public Rig {
 public:
  // Throws BadInput.
  SimulatedRig(const Config& drive, const Wiring& wiring);
  const RigFacts& facts() const override { return facts_; }
  RigRow step(const Vec2& u_alphabeta_ref, double theta_e) override;

 private:
  Config config_;
  Plant plant_;
  Wiring wiring_;
  RigFacts facts_;
};

}  // namespace twinrate
