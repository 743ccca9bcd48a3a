// Many drives at once: the whole closed loop of a sensorless drive, several drives side by side in
// a vector register, for sweeps.
//
//   points -> [run_points] -> locked, angle error   for each point
//
// Covered: surface-magnet machine without effects, averaged inverter, computation delay of one
// sample, filter ekf_sensorless (euler, rk4), controller foc on the estimate, start aligned or
// flying, all gain policies but `scheduled` and `propagated` (lane_settings names the rest). The
// noise is that of model/random.hpp, the filter kernel that of estimator/kernels/, the equations
// those of plant_sim/drive_model.hpp and controller/foc.hpp; the plant is integrated by
// lanes/plant.hpp. So a point runs like ClosedLoop's (loop/closed_loop.hpp) up to rounding: a
// count of the ADC may fall the other way now and then.
//
// A point's result depends on nothing but the point: not on the instruction set, nor on the points
// beside it, nor on the threads. Bit for bit.
#pragma once
#include <atomic>
#include <span>
#include <string>

#include "core/config.hpp"
#include "lanes/points.hpp"

namespace twinrate::lanes {

// Fills `settings`. Empty text where the drive is covered, else the key that is not.
std::string lane_settings(Config& config, LaneSettings& settings);
// The point that the config itself describes.
Point point_of(const DriveConfig& config);

// portable: one drive at a time on any machine; scalar: the same with FMA instructions.
enum class Isa : int { kPortable = 0, kScalar = 1, kAvx2 = 2, kAvx512 = 3 };
inline constexpr const char* kIsaNames[] = {"portable", "scalar", "avx2", "avx512"};
bool available(Isa isa);
Isa widest();  // of this machine
int width(Isa isa);

// `results` has the size of `points`. `threads` = 0: one a CPU. `stop`, where given, is looked at
// between points: true ends early, and the points not run keep their results. `done`, where given,
// counts finished points.
void run_points(const LaneSettings& settings, std::span<const Point> points,
                std::span<PointResult> results, int threads = 0, Isa isa = widest(),
                const std::atomic<bool>* stop = nullptr, std::atomic<std::size_t>* done = nullptr);

// One interval of the engine's plant, for whoever wants to compare it with another integrator.
struct PlantSample {
  double i_alpha, i_beta, omega_e, theta_e;
};
PlantSample advance_plant(const LaneSettings& settings, const PlantSample& x, double u_alpha,
                          double u_beta, double T_load);

}  // namespace twinrate::lanes
