// What the rows that judge say of one claim: with it and without, channel by channel.
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
  void add_energy(const Sampled& y, Channel channel, std::map<int, double>& of_file) const;
  // What `y` holds along `change`, in deviations of what `noise` holds along it at other moments.
  double along(const Sampled& y, const Sampled& change, const Sampled& noise,
               const std::vector<Channel>& moved) const;
  // Share of the energy of what a claim changes that the means over a few long stretches have: what a
  // scale of the equations could change as well. What turns with the rotor, or stands while it turns, has none.
  double steady_share(const Sampled& with, const Sampled& without,
                      const std::vector<Channel>& moved) const;
  // Energies with a claim and without, in as many pieces of each file as eight a block: each has as much of its
  // time and of what the claim changes, half and half. One that acts at a few moments speaks there.
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
};

// `with`, `without`: whitened residuals of the models with the claim and without. `through_zone`: the model has
// what turns at a current's zero: some 30 Ohm around it make any noise loud there, and what is told there is no
// noise. `silent`: share of the energy below which nothing is moved.
Vote vote(const JudgingRows& judging, const Sampled& with, const Sampled& without,
          const AngleErrorFall& angle, const Effect& claim, bool through_zone, double silent);

// Energy of the torque that is left over that of the sensors' noise.
double torque_over_noise(const JudgingRows& judging, const Sampled& left);
// What the rows hold along what a claim changes, in deviations of the noise of the sensors and of the controller's
// answer to it, less what that noise has in common with the noise in the claim. 0: along it they hold nothing.
double along_beside_noise(const JudgingRows& judging, const Sampled& with, const Sampled& without,
                          const std::vector<Channel>& moved);

}  // namespace twinrate
