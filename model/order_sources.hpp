// Causes of a torque or speed ripple of a mechanical order N (periods per turn) in a
// permanent-magnet drive with n_p pole pairs and n_slots slots:
//
//   shaft            N = 1            friction over a turn, misalignment, eccentric load
//   current offset   N = n_p          once an electrical turn
//   current scaling  N = 2 n_p        unlike gains of the current sensors
//   dead time, flux  N = m 6 n_p      square waves of the inverter; harmonics of the magnets
//   cogging, poles   N = m 2 n_p      a stator tooth unlike the others
//   cogging, slots   N = m n_slots    a magnet unlike the others
//   cogging, native  N = m lcm(n_slots, 2 n_p)    of the perfect machine, too
//   offset product   N = m n_p, none of these     current offset times another: 15 = 18 - 3
//
// Sources of one order add up and cannot be separated at one speed and load. (Some can at several:
// current scaling grows with the current, cogging does not.)
// n_slots = 0 (not known) leaves slots and native cogging out. Requires N >= 1, n_p >= 1.
// Niewiara, Tarczewski, Grzesiak 2020: (1) to (9) and the discussion of Fig. 6; Chung and Sul 1998
// for the current sensors.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

enum class Source : int {
  kShaft,
  kCurrentOffset,
  kCurrentScaling,
  kDeadTimeAndFlux,
  kPoleCogging,
  kSlotCogging,
  kNativeCogging,
  kOffsetProduct,
};

struct OrderSource {
  Source source;
  int multiple;  // m of the table above
  friend bool operator==(const OrderSource&, const OrderSource&) = default;
};

// In the order of the enumeration; empty: nothing in motor and inverter makes this order.
std::vector<OrderSource> order_sources(int N, int n_p, int n_slots);

// "cogging from the slots".
const char* long_name(Source source);
// "slots", for a label in a figure.
const char* short_name(Source source);

// "current scaling; cogging from the poles: cannot be told apart at one speed and load". Empty if
// there is no source.
std::string describe(const std::vector<OrderSource>& sources);
// "scaling+poles".
std::string label(const std::vector<OrderSource>& sources);

}  // namespace twinrate
