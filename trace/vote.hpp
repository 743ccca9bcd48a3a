// The vote of the judging rows on one claim: errors with it and without it, by channel.
#pragma once
#include <array>
#include <map>
#include <vector>

#include "trace/angle_error.hpp"
#include "trace/chain.hpp"
#include "trace/split.hpp"
#include "trace/transfer.hpp"

namespace twinrate {

using Channel = Eigen::VectorXd Sampled::*;
inline constexpr std::array<Channel, 3> kSampledChannels = {&Sampled::d, &Sampled::q,
                                                            &Sampled::torque};

// The outputs of a chain whose rows judge.
class JudgingRows {
 public:
  JudgingRows(const Chain& whole, const JudgedFiles& files)
      : sampler_(whole.sampler()), files_(files), rows_(whole.equations().record().size()) {}

  double product(const Sampled& x, const Sampled& y, Channel channel) const;
  double energy(const Sampled& y, Channel channel) const { return product(y, y, channel); }
  // Of the voltage and of the torque.
  std::array<double, 2> energies(const Sampled& y) const {
    return {energy(y, &Sampled::d) + energy(y, &Sampled::q), energy(y, &Sampled::torque)};
  }
  void add_energy(const Sampled& y, Channel channel, std::map<int, double>& of_file) const;
  // Projection of `y` on `change`, over the standard deviation of the same projection of `noise` at
  // other moments.
  double along(const Sampled& y, const Sampled& change, const Sampled& noise,
               const std::vector<Channel>& moved) const;
  // Share of the energy of a claim's change that the means over a few long stretches have, which a
  // scale of the equations could explain as well. A change that is periodic in the angle, or
  // constant in stator axes while the rotor turns, has none.
  double steady_share(const Sampled& with, const Sampled& without,
                      const std::vector<Channel>& moved) const;
  // Energies with a claim and without it, in eight pieces for each block of a file. The size of a
  // piece is half its share of the time and half its share of the claim's change, so that a claim
  // that acts at a few moments has pieces there.
  struct Energies {
    Pieces with, without;
  };
  Energies pieces(const Sampled& with, const Sampled& without,
                  const std::vector<Channel>& moved) const;

 private:
  struct RowEnergy {
    double with = 0, without = 0, change = 0;
  };
  template <class F>
  void each(Channel channel, F&& f) const;
  std::size_t file_of(std::size_t row) const {
    return files_.of_row.empty() ? 0 : static_cast<std::size_t>(files_.of_row[row]);
  }
  void add_pieces(std::size_t file, const std::vector<RowEnergy>& rows,
                  const std::vector<char>& judges, Energies& all) const;

  const Sampler& sampler_;
  const JudgedFiles& files_;
  std::size_t rows_;
};

struct Vote : Votes {
  bool of_voltage = false, of_torque = false;  // equations that it moves
  double steady_share = 0;
  double torque_share = 1;  // part of the fall of energy that is in the torque
};

// `with`, `without`: whitened residuals of the models with the claim and without it.
// `through_zone`: the model has an effect that depends on a current's zero. Its slope of some 30
// Ohm amplifies any noise there, so the comparisons with noise are left out. `in_sensors`: they are
// of Chain::in_sensors. `silent`: share of the
// energy below which a channel does not count as changed.
Vote vote(const JudgingRows& judging, const Sampled& with, const Sampled& without,
          const AngleErrorFall& angle, const Effect& claim, bool through_zone, bool in_sensors,
          double silent);

// Projection of the rows on a claim's change, over the standard deviation of the noise of the
// sensors and of the controller's response to it, less the part that this noise has in common with
// the noise in the claim. 0: the projection vanishes.
double along_beside_noise(const JudgingRows& judging, const Sampled& with, const Sampled& without,
                          const std::vector<Channel>& moved);

}  // namespace twinrate
