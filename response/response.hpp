// Frequency response of the closed loop, measured in lock-step, and the response of its design.
//
//   speed     added to the speed reference, rad/s      -> omega_m, rad/s
//   current   added to the reference of i_d, A         -> i_d, A
//   load      added to the load torque, Nm             -> omega_m, rad/s     without load.slew_Nm_s
//
// The test signal x is a multisine: 24 lines at multiples of 1/T_p, spread over the logarithm of the
// frequency, phases by Schroeder. After the settling time of the drive file and one period, four
// periods are measured. Reference and load of the drive file keep the values of the settling time.
// X, Y_p: the lines of x and of the true output in period p = 1 .. P.
//
//   H         = mean_p Y_p/X
//   coherence = |mean_p Y_p|^2/mean_p |Y_p|^2        1: x alone causes the output
//   sigma     = |H| sqrt((1/coherence - 1)/(P - 1))         of |H|
//
// A line is measured if 2 sigma is below the 3 dB that define the bandwidth.
//
// The design assumes exact currents, angle and speed: its difference to the measured curve is
// caused by the filter. Discrete, at z = exp(j omega T_s), PI controllers and delay d of the drive
// file:
//
//   H_i   = C_i P_i/(1 + C_i P_i)      C = K_p + K_i T_s/(z - 1),  P_i = z^-d (1 - a)/(R_s (z - a))
//   L_w   = C_w H_q K_t T_s/(2 J) (z + 1)/(z - 1 + B T_s/J)
//   speed = L_w/(1 + L_w)              load = -T_s/J/(z - 1 + B T_s/J)/(1 + L_w)
#pragma once
#include <complex>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

enum class ResponseOf : int { kSpeed = 0, kCurrent, kLoad };
inline constexpr const char* kResponseNames[] = {"speed", "current", "load"};

struct ResponseLine {
  double f = 0;  // Hz
  std::complex<double> H;
  double coherence = 0, sigma = 0;
  std::optional<std::complex<double>> design;  // of field-oriented control
  bool measured() const;
};

struct Response {
  ResponseOf of = ResponseOf::kSpeed;
  int n = 1;
  bool locked = true;  // else the lines are empty
  std::vector<ResponseLine> lines;
};

// `config` as the drive runs, including n. `stop` ends the measurement early: Response without
// lines. Throws BadInput.
Response measure_response(Config& config, ResponseOf of, const std::function<bool()>& stop = {});

// Frequency in Hz at which |H| of the measured lines first falls 3 dB below its value at the lowest
// line; empty if it does not fall, or if the lowest line is not measured.
std::optional<double> bandwidth(const Response& response, bool of_design);

std::string response_csv(const std::vector<Response>& responses);
std::string response_json(const std::string& drive, const std::vector<Response>& responses);
std::string response_svg(const std::string& drive, const std::vector<Response>& responses);

}  // namespace twinrate
