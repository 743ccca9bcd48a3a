// All candidates, as groups of whitened columns.
//
// A candidate is one effect with its non-linear keys at one point of their grid. Its columns are
// the contributions of one unit of each coefficient in all channels.
#pragma once
#include <Eigen/Core>
#include <functional>
#include <memory>

#include "trace/chain.hpp"

namespace twinrate {

struct Candidate {
  std::shared_ptr<Effect> effect;
  std::vector<Sampled> columns;
};

struct Dictionary {
  std::vector<Candidate> sampled, whitened;
  // Computes the columns of sensor effects again, as they are beside the effects in the model: the
  // voltage of a current error depends on the inductance there. False if no kind with such an
  // influence was added since the last call.
  bool renew(const Chain& chain, const Effects& beside);
  // All columns, or those that renew() computed.
  void whiten(const Chain& chain, bool renewed_only = false);

  // Kinds at the last renew() that change the columns of sensor effects, of effects that depend on
  // a current's zero, and of effects that depend on the angle.
  struct Beside {
    std::vector<std::string_view> sensors, at_zero, with_angle;
    bool operator==(const Beside&) const = default;
  } beside;
};

// Candidates of every considered kind with traced_keys() that the record's signals allow, or the
// `wanted` ones of them. The columns are sampled, not yet whitened.
std::vector<Candidate> make_candidates(const Chain& chain,
                                       const std::function<bool(const Effect&)>& wanted = {});

// An inner product, or the part of it that noise adds, by equation.
struct EquationEnergy {
  double electrical = 0, torque = 0;
  double sum() const { return electrical + torque; }
  EquationEnergy operator+(const EquationEnergy& b) const {
    return {electrical + b.electrical, torque + b.torque};
  }
  EquationEnergy operator-(const EquationEnergy& b) const {
    return {electrical - b.electrical, torque - b.torque};
  }
};

// Inner products over a subset of the outputs, less the share of noise (see Chain).
class Rows {
 public:
  Rows() = default;                             // none
  Rows(const Sampler& sampler, bool held_out);  // the training or the held-out outputs
  // Outputs whose row of the record satisfies `in`.
  static Rows where(const Sampler& sampler, const std::function<bool(std::size_t row)>& in);
  double dot(const Sampled& a, const Sampled& b) const;  // of two columns
  double against(const Sampled& column, const Sampled& residual) const;
  EquationEnergy energy(const Sampled& a, const Sampled& b) const;  // share of noise included
  // The share of noise that dot() and against() subtract.
  EquationEnergy noise(const Sampled& a, const Sampled& b) const;
  EquationEnergy noise_against(const Sampled& column, const Sampled& residual) const;
  // The part of it that comes from the answer in the first argument.
  EquationEnergy answer(const Sampled& answered, const Sampled& read) const;
  std::size_t count(const Sampled& like) const;
  // First output and number of outputs of each stretch.
  using Stretches = std::vector<std::pair<Eigen::Index, Eigen::Index>>;
  const Stretches& electrical_pieces() const { return electrical_pieces_; }
  const Stretches& torque_pieces() const { return torque_pieces_; }
  std::size_t electrical() const { return electrical_; }
  std::size_t torque() const { return torque_; }

 private:
  struct Part {
    Eigen::VectorXd Sampled::*d;
    Eigen::VectorXd Sampled::*q;
    Eigen::VectorXd Sampled::*torque;
  };
  static constexpr Part kValue{&Sampled::d, &Sampled::q, &Sampled::torque},
      kNoise{&Sampled::noise_d, &Sampled::noise_q, &Sampled::noise_torque},
      kAnswer{&Sampled::answer_d, &Sampled::answer_q, &Sampled::answer_torque};
  EquationEnergy product(const Part& of_a, const Sampled& a, const Part& of_b,
                         const Sampled& b) const;
  double dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b, const Stretches& pieces) const;
  Stretches electrical_pieces_, torque_pieces_;
  std::size_t electrical_ = 0, torque_ = 0;
};

// Normal equations A x = b. Columns without excitation, or with noise alone, are left out (x = 0).
struct NormalEquations {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  Eigen::VectorXd noise;  // share of noise taken off the diagonal of A

  std::vector<char> usable(double rows) const;
  // A column in use that the others explain, or -1; the last of several that explain one another. A
  // change of all three phases equals the slope of an inverter's drop: beside one another their
  // coefficients are arbitrary.
  Eigen::Index spurious(const std::vector<char>& use) const;
  Eigen::VectorXd solve(const std::vector<char>& use) const;
  Eigen::MatrixXd inverse(const std::vector<char>& use) const;  // zero where left out
};

}  // namespace twinrate
