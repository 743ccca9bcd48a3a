// The matrices of the hand-written filter kernels, entry by entry: symmetric entries are held once,
// zero entries not at all.
//
// T is a number (double, float) or a row of numbers, one of each filter (lanes/lanes.hpp);
// it needs + - * / only. Row and column count from 0, as in Eigen.
#pragma once

namespace twinrate::kernel {

// A symmetric 4 by 4 matrix by its upper triangle.
template <class T>
struct Symmetric4 {
  T m00, m01, m02, m03;
  T m11, m12, m13;
  T m22, m23;
  T m33;
};

// A gain of four states on two outputs.
template <class T>
struct Gain42 {
  T k00, k01;
  T k10, k11;
  T k20, k21;
  T k30, k31;
};

// A gain of four states on three outputs.
template <class T>
struct Gain43 {
  T k00, k01, k02;
  T k10, k11, k12;
  T k20, k21, k22;
  T k30, k31, k32;
};

}  // namespace twinrate::kernel
