// The traits of an effect: facts by which tracer, planner and reports treat it, so that none of
// them asks for its kind. Plain data, one list a kind, in the effect's own file.
//
// Every trait begins as not stated, and tests/model/traits_test.cpp refuses a kind that leaves one
// so. "none" is a statement.
#pragma once
#include <cstddef>

namespace twinrate {

struct None {};

// A stated list: an array with static storage, or none.
template <class T>
class Stated {
 public:
  constexpr Stated() = default;
  constexpr Stated(None) : stated_(true) {}
  template <std::size_t n>
  constexpr Stated(const T (&list)[n]) : first_(list), count_(n), stated_(true) {}
  constexpr const T* begin() const { return first_; }
  constexpr const T* end() const { return first_ + count_; }
  constexpr bool empty() const { return count_ == 0; }
  constexpr bool is_stated() const { return stated_; }

 private:
  const T* first_ = nullptr;
  std::size_t count_ = 0;
  bool stated_ = false;
};

struct Traits {
  enum class Answer { kUnstated, kNo, kYes };

  // The equation whose error it explains.
  enum class Equation { kUnstated, kElectrical, kMechanical, kSensing };

  // Effects of one family share a cause or a part of the drive.
  enum class Family {
    kUnstated,
    kFriction,       // torque by speed, against the motion
    kLoad,           // torque by time alone
    kTorqueRipple,   // torque by the angle
    kInertia,        // torque by the acceleration
    kShaft,          // a second mass
    kResistance,     // voltage in proportion to the current
    kInverter,       // voltage lost in the inverter
    kFlux,           // flux linkage other than L i + psi_f
    kIron,           // current into the iron
    kBus,            // voltage of the DC bus
    kCurrentSensor,  // reading of the currents
    kAngleSensor,    // reading of the angle
    kLag,            // signals that come late
    kSamples,        // ADC steps and range, rows lost or repeated
  };
  // The rank is the order in which a search adds the members of a family, the most common first.
  struct InFamily {
    Family name = Family::kUnstated;
    int rank = -1;
  };

  // Its contribution is periodic in the angle or in time, at constant currents and speed. An order
  // counts periods a mechanical turn: `order` if it is fixed, else the value of the key.
  struct Period {
    enum In { kUnstated, kNothing, kAngle, kTime, kAngleOrTime };
    In in = kUnstated;
    double order = 0;
    const char* order_key = "";
    const char* frequency_key = "";

    bool of_angle() const { return in == kAngle || in == kAngleOrTime; }
  };

  // Whether a drive may have it more than once. By key: two of one kind are different effects if
  // the key differs by `distance` or more, or, at a distance of 0, differs at all.
  struct Repeats {
    enum How { kUnstated, kOnce, kByKey, kFreely };
    How how = kUnstated;
    const char* key = "";
    double distance = 0;
  };

  // How its parameters beyond the linear ones are found.
  enum class Place {
    kUnstated,
    kLinear,   // there are none: a regression is enough
    kGrid,     // a grid of values
    kMoment,   // a moment of the record
    kLine,     // a line in the spectrum of the residual: it describes, and names no cause
    kZone,     // a zone around zero current, in which it bends
    kShaft,    // a simplex over mass, stiffness and damping
    kGap,      // the same and the gap, beside the best shaft without one
    kBusLine,  // a line in the spectrum of the bus voltage
    kSamples,  // the raw samples show it before any fit
  };

  // Noise of the sensors in the columns of its regression.
  enum class Noise {
    kUnstated,
    kNone,
    kSome,    // in a column that stays mostly signal
    kMimics,  // columns that together can take the shape of the residual's own noise
    kInSum,   // each column is mostly signal, the sum of all is noise if i_d is zero
  };

  // The picture in which it can be seen by eye.
  enum class View {
    kUnstated,
    kShare,                    // against its own share of the residual
    kPhaseVoltageOverCurrent,  // electrical views
    kResistanceOverTime,
    kFluxOverItsCurrent,
    kFluxOverOtherCurrent,
    kVoltageOverSpeed,
    kTorqueOverPeriod,          // mechanical views
    kTorqueOverPeriodByMotion,  // times the sign of the speed
    kTorqueOverSpeed,
    kTorqueOverTime,
  };

  // A run that separates effects, the most telling first: of several, the first is proposed.
  enum class Run {
    kUnstated,
    kTwoBusVoltages,  // those down to kWindingAlone need more than another profile
    kUncoupled,       // only between two effects
    kWindingAlone,    // likewise
    kStandstillWithoutVoltage,
    kFastWithoutLoad,
    kLoadStepsAndCurrents,
    kReversals,
    kSlowBothWays,
    kConstantSpeeds,
    kVaried,
  };
  // A similar kind, and the run that separates the two. The other kind has the same entry.
  struct Relative {
    const char* kind;
    Run run;
  };

  // Parameters of another effect in terms of its own.
  struct KeyPair {
    enum Scale { kSame, kPerSwitchedVolt };  // divided by v_dc f_pwm
    const char* from;
    const char* to;
    Scale scale = kSame;
  };
  // Another name for the same thing, under a condition.
  struct Reading {
    enum When {
      kAtOneBusVoltage,     // while v_dc hardly changes
      kItsThreshold,        // likewise, the part that does not grow with the current
      kItsSlope,            // the part in proportion to the current
      kItsCommonPart,       // the part that all phases share
      kFromTheBeginning,    // of a moment at the start of the record
      kWithoutGap,          // of a gap that closes
      kWhereBurstsRemain,   // of a shaft that leaves bursts of torque
      kAtOrderOfPolePairs,  // in logs of angle and current alone: at order n_p
      kAtTwiceThatOrder,    // likewise, at order 2 n_p
      kWithoutVoltage,      // likewise, at any order
    };
    When when;
    const char* kind;
    Stated<KeyPair> keys = None{};  // none: the values do not follow
  };

  // A physical bound of a parameter, tighter than the range of its field.
  struct Bound {
    enum Of { kOne, kStatorResistance, kInductanceAtRated };  // L_q / i_rated
    const char* key;
    double most;  // of its magnitude, times `of`
    Of of = kOne;
  };

  // A fault of the samples that shows this effect, with the key of its size, and the index of a
  // choice if needed.
  struct FromFault {
    enum Fault { kCoarseCurrents, kLimitedCurrents, kMissingRows, kStaleRows, kHeldCurrents };
    Fault fault;
    const char* size_key;
    const char* choice_key = "";
    int position = 0;
  };

  // A loss is never negative; for one that continues a declared loss, the sum of both is not.
  enum class Loss { kUnstated, kNo, kYes, kBeyondViscosity };  // machine.B

  Equation equation = Equation::kUnstated;
  InFamily family;
  Period period;
  Repeats repeats;
  Place place = Place::kUnstated;
  Noise noise = Noise::kUnstated;
  Answer on_command = Answer::kUnstated;  // changes the voltage command, whatever the current is
  Loss loss = Loss::kUnstated;
  View view = View::kUnstated;
  Run told_by = Run::kUnstated;  // the run that separates it from most others
  Stated<Relative> relatives;
  Stated<Reading> readings;
  Stated<Bound> bounds;
  Stated<FromFault> faults;
};

// The names of traits inside a class that states them.
struct TraitNames {
  static constexpr None none{};
  using Answer = Traits::Answer;
  using Equation = Traits::Equation;
  using Family = Traits::Family;
  using Period = Traits::Period;
  using Repeats = Traits::Repeats;
  using Place = Traits::Place;
  using Noise = Traits::Noise;
  using View = Traits::View;
  using Run = Traits::Run;
  using Relative = Traits::Relative;
  using KeyPair = Traits::KeyPair;
  using Reading = Traits::Reading;
  using Bound = Traits::Bound;
  using FromFault = Traits::FromFault;
  using Loss = Traits::Loss;
};

}  // namespace twinrate
