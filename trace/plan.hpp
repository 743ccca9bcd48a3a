// Design of an experiment that separates effects, from information matrices alone.
//
// Every candidate of the tracer is a group of whitened columns X (trace/dictionary.hpp). The
// information of a piece of a run is M = X'X, and the information of several pieces adds up. The
// tracer asks:
//
//   is kind a seen?   D(a) = 1 / size(sigma),  sigma^2 = diag (M_aa)^-1        (trace/conclude.cpp)
//                     standard deviations of its smallest size worth reporting; 4 are enough
//   or is it b?       the part of a that b cannot imitate, in standard deviations, if the n
//                     coefficients of a make the smallest size at c_i each:
//                     D(a|b)^2 = sum_i c_i^2/n (M_aa - M_ab M_bb^-1 M_ba)_ii
//                     sin phi  = D(a|b) / D_0,   D_0^2 = sum_i c_i^2/n (M_aa)_ii
//                     With N rows the score falls by g(D_0) = N log(1 + D_0^2/N) with a, and by
//                     g(D(a|b)) less with b. b is an alias if that is less than 16 (4 sigmas),
//                     or less than 2 % of g(D_0):
//   clearness(a|b)  = 4 (g(D(a|b)) / max(16, 0.02 g(D_0)))^1/2,   enough: 4
//
// D(a|b)^2, a mean over the parameters (of sines: over the phase), is the noncentrality of a test
// of model b if a is true. A T-optimal design maximises it (Atkinson, Fedorov 1975, Biometrika 62,
// 57-70 and 289-303); the Schur complement in it is that of D_s-optimality. Columns that do nothing
// (the sum of three current offsets) are left out of M_aa. Of the grid points of a kind, a is taken
// at its best point and b at the point that imitates a best.
//
// choose(): selects pieces one after another, each time the piece that adds most to
//   worth = sum_a u(D(a)) + mean_b u(clearness(a|b)) + u(D(a|all)),   u(x) = log(1 + min(x, 20)^2)
// for each second of its duration (a greedy exact design; Fedorov 1972, Theory of Optimal
// Experiments). The n-th repetition of a piece counts 1/n, because an error in the model of this
// design repeats with it. D(a|all): a beside all other kinds at once, which matters if several
// effects are present.
#pragma once
#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

namespace twinrate {

struct Information {
  Eigen::MatrixXd M;      // X'X less the share of noise, P x P
  Eigen::VectorXd noise;  // share of noise taken off the diagonal, P
  double rows = 0;
  static Information none(Eigen::Index P);
  Information& operator+=(const Information& other);
};
Information operator*(double factor, Information information);

// Columns [first, first + count) of the information: one candidate of a kind.
struct PlanGroup {
  std::size_t kind = 0;
  Eigen::Index first = 0, count = 0;
  // Size of the effect with these coefficients over the smallest worth reporting.
  std::function<double(const Eigen::VectorXd&)> size;
  Eigen::VectorXd smallest;  // each coefficient that makes this size alone
};

// PlanGroup::smallest of a size.
Eigen::VectorXd smallest_of(const std::function<double(const Eigen::VectorXd&)>& size,
                            Eigen::Index count);

struct PlanCandidates {
  std::vector<std::string> kinds;
  std::vector<PlanGroup> groups;
  Eigen::Index columns = 0;
};

inline constexpr double kEnoughSigmas = 4;  // of the tracer: identifiable, separated
inline constexpr double kEnoughShare = 0.02;

// Prospects of one kind, beside each other kind of the candidates.
struct KindOutlook {
  double alone = 0;            // D(a)
  double beside_all = 0;       // D(a|all)
  std::vector<double> beside;  // D(a|b) by kind; D_0 at its own index
  std::vector<double> sine;    // sin phi
  std::vector<double> clear;   // clearness(a|b)
  std::size_t nearest = 0;     // kind with the least clearness; its own if there is no other
  bool identifiable() const { return alone >= kEnoughSigmas; }
  bool separated() const { return clear[nearest] >= kEnoughSigmas; }
};
std::vector<KindOutlook> outlook(const Information& information, const PlanCandidates& candidates);
double worth(const std::vector<KindOutlook>& outlook);

struct PlanPiece {
  Information information;
  double duration_s = 0;
};
struct PlanSettings {
  double longest_s = 10;
  double enough = 3e-4;        // of the worth so far, a second; a piece that adds less is left out
  std::function<bool()> stop;  // true: the pieces chosen so far are the plan
  std::function<void(std::size_t piece, double worth)> say;
};
// Indices of pieces, in the order chosen; a piece may occur several times. `start`: the information
// that exists already. If nothing fits into longest_s, the plan is empty.
std::vector<std::size_t> choose(const std::vector<PlanPiece>& pieces, const Information& start,
                                const PlanCandidates& candidates, const PlanSettings& settings);

}  // namespace twinrate
