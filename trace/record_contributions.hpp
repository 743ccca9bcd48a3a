// The contributions of effects to each row of a record: those of the operating point, of effects
// with memory, and of effects on the commanded voltage.
#pragma once
#include <vector>

#include "model/effects/effect.hpp"
#include "trace/record.hpp"

namespace twinrate {

// True for a drop in proportion to the commanded voltage or to its change: a wrong gain, a lag. The
// two act in sequence: the gain acts on the late voltage.
bool acts_on_command(const Effect& effect);

class RecordContributions {
 public:
  RecordContributions(const Effects& effects, const std::vector<OperatingPoint>& points,
                      const Record& record);
  // All contributions except those on the command.
  Contribution operator[](std::size_t k) const;
  bool any_of_command() const { return late_ || !of_the_command_.empty(); }
  // The part of its u_dq_drop that depends on the angle and not on a current.
  Vec2 drop_by_angle(std::size_t k) const;
  // Commanded voltage of interval k less the one that acts, in rotor axes at its beginning.
  Vec2 of_command(std::size_t k) const;

 private:
  Contribution at(const OperatingPoint& point, std::size_t k) const;

  const std::vector<OperatingPoint>& points_;
  std::vector<const Effect*> of_the_point_, of_the_angle_, of_the_command_;
  Effects around_winding_;  // effects that can change the current at the terminals
  bool late_ = false;
  std::vector<std::vector<Contribution>> with_memory_;
  std::vector<std::vector<double>> T_load_;  // of shafts
  double J_ = 0;                             // inertia behind the shafts, negative
};

}  // namespace twinrate
