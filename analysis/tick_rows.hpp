// The channels of a run as one table: one row a tick, with the fields of its messages that the
// figures need: 272 bytes instead of 640.
//
// Empty: no message at that tick. Of repeated messages of a tick the first is used.
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "core/run_log.hpp"

namespace twinrate {

struct TickRow {
  template <int N>
  using Packed = Eigen::Matrix<double, N, 1, Eigen::DontAlign>;
  struct OfMeasurement {
    int signals;
    Mode mode;
    Packed<3> i_abc;
    double theta_m, omega_m;
  };
  struct OfTruth {
    bool finite;  // currents, speed and angle of the plant
    double omega_m, theta_m, T_em, T_load;
    Packed<2> i_dq;
  };
  struct OfEstimate {
    std::int64_t gain_seq;
    int status;
    bool finite;  // all of it, including the state
    double theta_e, omega_m, T_load;
    Packed<2> i_dq;
  };
  struct OfCommand {
    double omega_m_ref;
    Packed<2> i_dq_ref;
  };
  // Of the fourth state, the angle in ekf_sensorless; 0 if a filter has no fourth state.
  struct OfGain {
    std::int64_t k;
    double K41, K42, P44;
    OfGain(const GainRecord& g) : k(g.k), K41(g.K(3, 0)), K42(g.K(3, 1)), P44(g.P_diagonal(3)) {}
    OfGain(const Gain& g);
  };

  std::int64_t k = -1;
  double t_s = 0;
  std::optional<OfMeasurement> measurement = {};
  std::optional<OfTruth> truth = {};
  std::optional<OfEstimate> estimate = {};
  std::optional<OfCommand> command = {};
  std::optional<OfGain> gain = {};  // used by the fast loop at this tick (Estimate::gain_seq)

  // Takes the first message of each kind. The time is that of the first of these messages:
  // MEASUREMENT, TRUTH, ESTIMATE, COMMAND.
  void take(const Measurement& m);
  void take(const Truth& t);
  void take(const Estimate& e);
  void take(const Command& c);
};

using TickRows = std::span<const TickRow>;

// Every tick of MEASUREMENT, TRUTH, ESTIMATE or COMMAND, in order.
std::vector<TickRow> tick_rows(const RunLog& log);

}  // namespace twinrate
