// The contributions of effects to each row of a record: those of the operating point, of effects
// with memory, and of effects on the commanded voltage.
#pragma once
#include <span>
#include <vector>

#include "model/effects/effect.hpp"
#include "trace/record.hpp"

namespace twinrate {

// True for a drop in proportion to the commanded voltage or to its change: a wrong gain, a lag. The
// two act in sequence: the gain acts on the late voltage.
bool acts_on_command(const Effect& effect);

// True for a drop that bends with the current so sharply that its mean over an interval is not the
// mean of its ends: the dead time where a phase current changes its sign.
bool follows_current(const Effect& effect);

// The terminal current's path from one row to the next, in parts that are straight in stator axes:
// between the rows the current in rotor axes and the angle change evenly. If the row's voltage is
// made from the ticks at its ends (`ticks` in the row, not zero), the path is these two ticks.
// `i_from` and `i_to`: the winding's currents there, A, in rotor axes.
class CurrentPath {
 public:
  CurrentPath(const OperatingPoint& from, const OperatingPoint& to, const Vec2& i_from,
              const Vec2& i_to, double ticks);
  int parts() const { return parts_; }
  OperatingPoint part(int j) const;  // its beginning, with i_moves
  // What a drop in the rotor axes of a part adds to the mean in the rotor axes of `from`.
  Vec2 share(const OperatingPoint& part, const Vec2& drop) const {
    return ticks_ ? of_tick(drop) : Vec2(from_.rotor_axes(part.stator_axes(drop)) / parts_);
  }
  template <class Drop>
  Vec2 mean(const Drop& drop_of) const {
    if (parts_ == 1) return drop_of(part(0));
    Vec2 sum = Vec2::Zero();
    for (int j = 0; j < parts_; ++j) {
      const OperatingPoint p = part(j);
      sum += share(p, drop_of(p));
    }
    return sum;
  }

 private:
  OperatingPoint edge(int j) const;  // where part j begins
  OperatingPoint tick(const OperatingPoint& end, const Vec2& i_dq) const;
  Vec2 of_tick(const Vec2& drop) const;

  const OperatingPoint& from_;
  const OperatingPoint& to_;
  Vec2 i_from_, i_to_;
  int parts_ = 1;
  double ticks_;
  double turn_e_;  // rad
};

class RecordContributions {
 public:
  // `i_path`: the winding's current at each row for the drops that follow it, A, in rotor axes; empty:
  // that of the points. All are kept by reference.
  RecordContributions(const Effects& effects, const std::vector<OperatingPoint>& points,
                      const Record& record, std::span<const Vec2> i_path = {});
  // All contributions except those of an interval.
  Contribution operator[](std::size_t k) const;
  bool any_of_interval() const {
    return late_ || !of_the_command_.empty() || !of_the_path_.empty();
  }
  // The part of its u_dq_drop that depends on the angle and not on a current.
  Vec2 drop_by_angle(std::size_t k) const;
  // Commanded voltage of interval k less the one that acts, with the drops that follow the current,
  // in rotor axes at its beginning.
  Vec2 of_interval(std::size_t k) const;

 private:
  OperatingPoint point(std::size_t k) const;  // with the terminal current
  Contribution at(const OperatingPoint& point, std::size_t k) const;

  const std::vector<OperatingPoint>& points_;
  std::span<const Vec2> i_path_;
  std::vector<const Effect*> of_the_point_, of_the_angle_, of_the_command_, of_the_path_;
  Effects around_winding_;  // effects that can change the current at the terminals
  bool late_ = false;
  std::vector<std::vector<Contribution>> with_memory_;
  std::vector<std::vector<double>> T_load_;  // of shafts
  double ticks_each_;
  double J_ = 0;  // inertia behind the shafts, negative
};

}  // namespace twinrate
