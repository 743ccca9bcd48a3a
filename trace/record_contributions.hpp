// The contributions of effects to each row of a record: of the operating point, of their memory, and
// of the commanded voltage.
#pragma once
#include <vector>

#include "model/effects/effect.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A drop in proportion to the voltage asked for, or to how it changes: a wrong gain, a lag. These
// follow one another: the gain is that of the late voltage.
bool acts_on_command(const Effect& effect);

class RecordContributions {
 public:
  RecordContributions(const Effects& effects, const std::vector<OperatingPoint>& points,
                      const Record& record);
  // All but what acts on the command.
  Contribution operator[](std::size_t k) const;
  bool any_of_command() const { return late_ || !of_the_command_.empty(); }
  // Of its u_dq_drop, what goes by the angle and not by a current.
  Vec2 drop_by_angle(std::size_t k) const;
  // Voltage asked for in interval k less the one that acts, in rotor axes at its beginning.
  Vec2 of_command(std::size_t k) const;

 private:
  Contribution at(const OperatingPoint& point, std::size_t k) const;

  const std::vector<OperatingPoint>& points_;
  std::vector<const Effect*> of_the_point_, of_the_angle_, of_the_command_;
  Effects around_winding_;  // what may make another current at the terminals
  bool late_ = false;
  std::vector<std::vector<Contribution>> with_memory_;
  std::vector<std::vector<double>> T_load_;  // of shafts
  double J_ = 0;                             // theirs
};

}  // namespace twinrate
