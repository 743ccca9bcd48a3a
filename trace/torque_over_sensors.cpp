#include "trace/torque_over_sensors.hpp"

#include <fmt/format.h>

#include <cmath>

namespace twinrate {
namespace {

// Uncertainty of the motor's torque, or of the load, between rows: a step within an interval moves
// the interval's mean by up to half of the step. For a torque that the rows resolve it is almost
// zero.
Eigen::VectorXd between_rows(const Chain& chain,
                             double (*of)(const OperatingPoint&, const MachineParameters&)) {
  const MachineParameters& machine = chain.equations().facts().machine;
  std::vector<double> torque;
  for (const OperatingPoint& p : chain.equations().points()) torque.push_back(of(p, machine));
  std::vector<double> open(torque.size(), 0.0);
  for (std::size_t k = 1; k + 1 < torque.size(); ++k)
    open[k] = (torque[k - 1] - 2 * torque[k] + torque[k + 1]) / 2;
  return chain.sampler()(open, chain.sampler().torque());
}

}  // namespace

double torque_over_sensors(const Chain& chain, const Sampled& left, const Eigen::VectorXd& noise,
                           const Eigen::VectorXd& of_impacts) {
  if (!left.torque.size() || !(noise.squaredNorm() > 0)) return 0;
  const Runs& runs = chain.sampler().torque();
  const double T_out = chain.sampler().decimation() * chain.equations().record().T_s;
  const AngleNoise flat = AngleNoise::of(noise, runs, T_out);
  const auto of_motor = [](const OperatingPoint& p, const MachineParameters& m) {
    return m.torque(p.i_dq[0], p.i_dq[1]);
  };
  const auto of_load = [](const OperatingPoint& p, const MachineParameters&) { return p.T_load; };
  const double floor =
      std::hypot(flat(noise, runs).norm(), flat(between_rows(chain, of_motor), runs).norm(),
                 flat(between_rows(chain, of_load), runs).norm());
  // Impacts at other moments make a large error, which does not excuse any residual.
  constexpr double kMostOfImpacts = 3;
  const double impacts =
      of_impacts.size() ? std::min(kMostOfImpacts * floor, flat(of_impacts, runs).norm()) : 0;
  return flat(left.torque, runs).norm() / std::hypot(floor, impacts);
}

std::string torque_in_words(double rms, double over) {
  return fmt::format(
      "after whitening, the residual of the torque ({:.3g} Nm rms) is {:.3g} times that of white "
      "noise on the readings",
      rms, over);
}

}  // namespace twinrate
