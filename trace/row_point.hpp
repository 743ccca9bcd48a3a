#pragma once
#include "model/point_of.hpp"
#include "trace/record.hpp"

namespace twinrate {

// Operating point of row k of a log in `frame`: its voltage, and its bus voltage or the nominal
// `v_dc`. The caller sets currents and load.
inline OperatingPoint point_of(const Record& record, std::size_t k, const RotorFrame& frame,
                               double v_dc) {
  OperatingPoint p = point_of(record.t[k], frame);
  if (!record.u_alphabeta.empty()) p.u_dq = p.rotor_axes(record.u_alphabeta[k]);
  p.v_dc = record.v_dc.empty() ? v_dc : record.v_dc[k];
  return p;
}

}  // namespace twinrate
