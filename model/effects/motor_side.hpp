// What the motor does to a load mass behind its shaft along a record, taken once for any number of
// shafts.
#pragma once
#include <span>
#include <vector>

#include "model/effects/shaft.hpp"

namespace twinrate {

class MotorSide {
 public:
  // `behind`: the load behind the shaft at each point. Points `T_s` apart.
  MotorSide(std::span<const OperatingPoint> record, std::vector<double> behind, double T_s);
  std::size_t rows() const { return behind_.size(); }

  // T_load of along_shaft().
  void along(const ShaftFacts& shaft, std::span<double> T_load) const;
  // The same of several at once, a vector of rows() numbers each: bit for bit what along() gives.
  void along(std::span<const ShaftFacts> shafts, std::span<std::vector<double>> T_load) const;

 private:
  void four(const ShaftFacts* shafts, double* const* T_load) const;
  void eight(const ShaftFacts* shafts, double* const* T_load) const;
  void portable(const ShaftFacts* shafts, std::size_t count, double* const* T_load) const;
  void avx2(const ShaftFacts* shafts, std::size_t count, double* const* T_load) const;

  double T_s_;
  std::vector<double> behind_;
  // Speed of the motor: at each row, and from there to the next.
  std::vector<double> omega_m_, omega_m_next_;
  // Where another stretch of time begins. What the load did before is not known: it is at rest
  // against the motor there.
  struct Start {
    std::size_t row = 0;
    double omega_m = 0;
  };
  Start start_at(std::span<const OperatingPoint> record, std::size_t row) const;
  ShaftState at_rest(const ShaftFacts& shaft, const Start& start) const;
  std::vector<Start> starts_;
};

}  // namespace twinrate
