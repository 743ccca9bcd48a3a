// The closed loop of many sensorless drives at once, several drives in one vector register, for
// sweeps.
//
//   points -> [run_points] -> locked, angle error   for each point
//
// Covered: surface-magnet machine without effects, averaged inverter, computation delay of one
// sample, filter ekf_sensorless (euler, rk4), controller foc on the estimate, start aligned or
// flying, all gain policies except `scheduled` and `propagated` (lane_settings names what is not
// covered). The noise is that of model/random.hpp, the filter kernel that of estimator/kernels/,
// the equations are those of plant_sim/drive_model.hpp and controller/foc.hpp; lanes/plant.hpp
// integrates the plant. A point equals that of ClosedLoop (loop/closed_loop.hpp) up to rounding: a
// rounding error can change a sample by one count of the ADC.
//
// The result of a point depends on the point alone, bit for bit: not on the instruction set, on
// other points or on the number of threads.
#pragma once
#include <atomic>
#include <span>
#include <string>

#include "core/config.hpp"
#include "lanes/points.hpp"

namespace twinrate::lanes {

// Fills `settings`. Returns "" if the drive is covered, else the reason.
std::string lane_settings(Config& config, LaneSettings& settings);
// The point of the config.
Point point_of(const DriveConfig& config);

// portable: one drive at a time on any machine; scalar: the same with FMA instructions.
enum class Isa : int { kPortable = 0, kScalar = 1, kAvx2 = 2, kAvx512 = 3 };
inline constexpr const char* kIsaNames[] = {"portable", "scalar", "avx2", "avx512"};
bool available(Isa isa);
Isa widest();  // of this machine
int width(Isa isa);

// `results` has the size of `points`. `threads` = 0: one for each CPU. `stop` (optional) is read
// between points: true ends early, and the results of the other points stay unchanged. `done`
// (optional) counts finished points.
void run_points(const LaneSettings& settings, std::span<const Point> points,
                std::span<PointResult> results, int threads = 0, Isa isa = widest(),
                const std::atomic<bool>* stop = nullptr, std::atomic<std::size_t>* done = nullptr);

// One interval of the engine's plant, for comparison with another integrator.
struct PlantSample {
  double i_alpha, i_beta, omega_e, theta_e;
};
PlantSample advance_plant(const LaneSettings& settings, const PlantSample& x, double u_alpha,
                          double u_beta, double T_load);

}  // namespace twinrate::lanes
