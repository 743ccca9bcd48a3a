#include "tools/gallery/entries.hpp"

namespace twinrate::gallery {
namespace {

// Where a second mass shows: the speed turns round at once, with nothing to hold.
constexpr const char* kReversal =
    "[reference]\nspeed_rpm = [[0, 60], [3.5, -60]]\n[load]\nT_load_Nm = 0.0\n"
    "[run]\nduration_s = 8.2\n";

constexpr Entry kEntries[] = {
    {"adc_clipping", "limit_A = 1.5\n", Signal::kIq, Over::kTurns,
     "i_meas = max(-limit, min(limit, i)), after noise",
     "Flat tops of the measured phase currents; in rotor axes orders 6 n_p (18) and multiples, if "
     "the peak of the current exceeds the limit. The controller uses the clipped currents, so true "
     "currents and torque are distorted, too.",
     "`current_gain` (a smaller mean); `saturation`, which is smooth."},
    {"adc_quantisation", "lsb_A = 0.2\n", Signal::kIq, Over::kTurns,
     "i_meas = round(i/lsb) lsb, after noise and the steps of [sensors]",
     "Steps in the measured currents, with an error of at most half a step. Their orders depend on "
     "the current; a histogram of the raw samples shows them.",
     "`backlash` and `coulomb_friction` at small current: steps of current excite the same "
     "events."},
    {"backlash",
     "J_load_kgm2 = 2.8e-3\ngap_rad = 0.02\nstiffness_Nm_rad = 300.0\ndamping_Nms_rad = 0.1\n",
     Signal::kTo, Over::kTime,
     "T_shaft = K (delta -+ gap/2) + D delta' beyond the flanks, 0 between them; J_load "
     "omega_load' "
     "= T_shaft - T_load",
     "At a change of sign of the shaft torque the load crosses the gap. Until then the motor runs "
     "alone, with its own smaller inertia; an impact follows. Light loads bounce. Under a load "
     "that holds one flank only the stiffness is visible.",
     "`torsion`, which rings at one frequency at any amplitude; a coarse current ADC.", 60, false,
     3.49, 3.62, nullptr, kReversal},
    {"cogging",
     "origin = \"poles\"\norder = 1\namplitude_Nm = 0.03\nphase_rad = 0.4\n"
     "[[effect]]\nkind = \"cogging\"\norigin = \"slots\"\norder = 1\namplitude_Nm = 0.04\n"
     "[[effect]]\nkind = \"cogging\"\norigin = \"native\"\norder = 1\namplitude_Nm = 0.06\n",
     Signal::kTo, Over::kTurns,
     "T_load += A sin(N theta_m + phase), with N = order x {1, lcm(n_slots, 2 n_p), n_slots, 2 "
     "n_p} "
     "for origin = order, native, slots, poles",
     "Speed, i_q and the estimated load torque at order N, at every load and in either direction "
     "with the same angle. The example has one term of each origin: 6 poles, 27 slots, 54 native; "
     "the observer, too slow for them at one turn per second, shows 23 of 40 and 19 of 60 mNm.",
     "`flux_harmonics` at constant current (it grows with i_q, cogging does not); "
     "`friction_ripple` "
     "in one direction."},
    {"constant_load", "torque_Nm = 0.5\n", Signal::kTo, Over::kSpeed,
     "T_load += T, behind a shaft where there is one",
     "A shift of the estimated load torque and of i_q, the same in both directions.",
     "`coulomb_friction` in one direction; the offset of a torque or q-current sensor."},
    {"coulomb_friction", "torque_Nm = 0.25\n", Signal::kTo, Over::kSpeed,
     "T_load += T_C tanh(omega_m/omega_smooth)",
     "A step of the estimated load torque at a change of sign of the speed, with a bump in the "
     "speed; no order at constant speed.",
     "`constant_load` in one direction; `viscous_friction` at one speed."},
    {"cross_saturation", "coefficient_H_A = 1e-3\n", Signal::kTo, Over::kTime,
     "psi_d -= c/2 i_q^2, psi_q -= c i_d i_q",
     "Less torque per ampere under load: the estimated load torque, computed with the declared "
     "flux, is 0.6 % too large here, and the EMF along q is too small. Both grow with the square "
     "of i_q, so a light load does not show the effect. L_q changes with i_d.",
     "`flux_linkage` at one load; `saturation` of the d axis."},
    {"current_gain", "gain_a = 0.05\ngain_b = 0.0\n", Signal::kIq, Over::kTurns,
     "i_meas = (1 + gain) i, a gain a phase",
     "Order 2 n_p (here 6) in the measured currents, and a constant part, both proportional to the "
     "current. The loop determines the share that becomes true current, torque and speed: here the "
     "d integrator makes the measured i_d smooth and the true one rough, while most of the error "
     "of i_q stays in the reading.",
     "`cogging` of the same order at one load; a wrong torque constant (the constant part)."},
    {"current_offset", "offset_a_A = 0.05\noffset_b_A = -0.02\n", Signal::kIq, Over::kTurns,
     "i_meas = i + offset, an offset a phase",
     "Order n_p (here 3) in the measured currents, the same at every load. The loop follows them, "
     "so the order appears in true currents, torque and speed, and in the estimated load torque, "
     "which uses the measured currents.",
     "`cogging` of order n_p; an offset of the voltages, if no voltage is measured."},
    {"dc_bus_ripple", "amplitude_V = 12.0\nfrequency_Hz = 300.0\n", Signal::kIqTrue, Over::kTime,
     "v_dc += A sin(2 pi f t + phase); the applied voltage is duty v_dc(t), the duty was chosen "
     "for "
     "v_dc(t_k)",
     "The measured bus voltage, and a little in u and i: the modulator corrects with the sample at "
     "the start of the interval. The effect has a frequency, not an order: here 300 Hz at one turn "
     "per second. A trace finds it in v_dc.",
     "A mechanical effect of the same frequency at one speed; it moves in the order spectrum when "
     "the speed changes.",
     360},
    {"dead_time", "dead_time_s = 3e-6\n", Signal::kUd, Over::kTurns,
     "drop of a phase = t_d f_pwm v_dc sat(i/i_linear); edge by edge with plant.inverter = "
     "switched",
     "Orders 6 n_p and its multiples (18, 36) in the voltages and, as far as the current loop lets "
     "them through, in currents and torque; strongest across the current, here in u_d. A shift of "
     "u_q that is similar to a resistance at small current. The switched inverter has sharper "
     "corners: its current ripple at this speed is far below the 0.3 A of the linear zone of the "
     "averaged effect.",
     "`inverter_drop` (same shape; only another bus voltage or switching frequency separates "
     "them); `resistance` at small current.",
     60, true},
    {"eccentric_load", "amplitude_Nm = 0.2\nphase_rad = 0.5\n", Signal::kTo, Over::kTurns,
     "T_load += A sin(theta_m + phase)",
     "Order 1 in load torque and speed, at every speed with the same angle.",
     "`cogging` of order 1; `friction_ripple` of order 1 in one direction; "
     "`encoder_eccentricity`, which grows with the speed."},
    {"periodic_torque", "frequency_Hz = 3\namplitude_Nm = 0.1\n", Signal::kTo, Over::kTime,
     "T_load += A sin(2 pi f t + nu theta_m + phase)",
     "A line in the load torque that keeps its frequency when the speed changes, or one of an "
     "order "
     "that is not whole. It describes the data without a cause.",
     "`cogging`, if the order is whole."},
    {"encoder_eccentricity", "amplitude_rad = 2e-3\n", Signal::kSpeed, Over::kTurns,
     "theta_meas = theta_m + A sin(theta_m + phase)",
     "Order 1 in the true speed; the loop makes the measured speed smooth. The estimated load "
     "torque contains the inertia torque of this ripple, so it grows with the square of the speed.",
     "`eccentric_load` at one speed."},
    {"encoder_offset", "offset_rad = 0.05\n", Signal::kUd, Over::kTurns,
     "theta_meas = theta_m + offset",
     "No order: the current vector is rotated, a true i_d appears, the torque per ampere falls by "
     "cos(n_p offset), u_d shifts.",
     "`flux_linkage` (less torque); an inductance error (u_d)."},
    {"encoder_quantisation", "", Signal::kTo, Over::kTime,
     "theta_meas = floor(theta_m/step) step, step = 2 pi/encoder_counts; omega_m = difference/T_s",
     "Steps of step/T_s in the measured speed (15 rad/s here, at a true 6.3). The estimated load "
     "torque follows them by +-0.7 Nm from tick to tick, and hardly any of it is in orders 1 to "
     "60: at one turn per second the counts pass at 4096 Hz. A simple ratio of counts and ticks "
     "gives a slow beat.",
     "noise of the speed; `encoder_eccentricity` if the beat is slow.", 60, false, 3.48, 3.53,
     "sensors.encoder_counts=4096"},
    {"fan_load", "coefficient_Nms2 = 0.01\n", Signal::kTo, Over::kSpeed,
     "T_load += c omega_m |omega_m|",
     "The estimated load torque is a parabola over the speed, odd in the direction.",
     "`viscous_friction` over a narrow range of speed."},
    {"flux_harmonics", "order = 18\namplitude_Wb = 2.5e-3\n", Signal::kTo, Over::kTurns,
     "delta_psi_d = A cos(N theta_m + phase); u_dq_drop = [d delta_psi/dt, omega_e delta_psi]; "
     "T_load -= 3/2 n_p (delta_psi i_q + d delta_psi/d theta_e i_d)",
     "Order N in the torque, proportional to i_q, and in u_d, u_q, proportional to the speed.",
     "`cogging` of the same order at one load; `dead_time`, which also has 6 n_p, but in the "
     "voltage at any speed."},
    {"flux_linkage", "change_Wb = -0.02\n", Signal::kUq, Over::kSpeed, "psi_d += change",
     "Voltage along q proportional to the speed, and torque proportional to i_q: more current for "
     "the same load, and an error of the estimated load torque of the same ratio. No order.",
     "An error of the torque constant or of a current gain (torque alone), `voltage_gain` (voltage "
     "alone): the two equations together separate them."},
    {"friction_ripple", "order = 1\namplitude_Nm = 0.05\nphase_rad = 0.5\n", Signal::kTo,
     Over::kTurns, "T_load += tanh(omega_m/omega_smooth) A sin(N theta_m + phase)",
     "Like cogging of order N, but its sign changes with the direction.",
     "`cogging` and `eccentric_load` if the drive turns in one direction only."},
    {"inductance", "change_d_H = 4e-3\nchange_q_H = 4e-3\n", Signal::kUd, Over::kTime,
     "psi_d += change_d i_d, psi_q += change_q i_q",
     "Voltage across the current at speed, here along d, omega_e change_q i_q, and the response of "
     "the currents to a voltage step. If the changes differ, a small reluctance torque.",
     "`encoder_offset` (u_d at one load and speed); `saturation` at one load."},
    {"inertia", "change_kgm2 = 0.0088\n", Signal::kTo, Over::kSpeed,
     "(J + change) omega_m' = T_em - B omega_m - T_load",
     "An estimated load torque of change times acceleration: opposite signs at rising and falling "
     "speed, zero at constant speed. The response to a load step is slower.",
     "`constant_load` in a record that only accelerates; a wrong torque constant."},
    {"inverter_drop", "threshold_V = 3.0\nresistance_Ohm = 0.2\n", Signal::kUd, Over::kTurns,
     "drop of a phase = V_0 sat(i/i_linear) + R_on i",
     "As dead time: orders 6 n_p and multiples in the voltages from V_0, and a resistance from "
     "R_on.",
     "`dead_time` (V_0) and `resistance` (R_on)."},
    {"inverter_offset", "offset_a_V = 1.0\noffset_b_V = -0.4\n", Signal::kIq, Over::kTurns,
     "u_phase = asked + offset, an offset a phase against c",
     "Order n_p (here 3) in currents, torque and speed, as far as the loop passes it, and in the "
     "commanded voltages that oppose it; the same at every load and speed.",
     "`current_offset` with a stiff current loop: it has the same order. The voltage equation "
     "separates them at different speeds."},
    {"iron_loss", "resistance_Ohm = 100.0\n", Signal::kIq, Over::kSpeed,
     "i_fe = omega_e [-psi_q, psi_d]/R_c adds to the current at the terminals; u_dq_drop = R_s "
     "i_fe",
     "A measured q current proportional to the speed that makes no torque, so the estimated load "
     "torque rises like friction. The voltage hardly shows it. The currents of TRUTH are those "
     "behind R_c.",
     "`viscous_friction`: the same torque at every load; only the copper loss of i_fe and its d "
     "part, "
     "in proportion to load and speed, differ."},
    {"load_step", "torque_Nm = 1.0\ntime_s = 3.5\n", Signal::kTo, Over::kTime,
     "T_load += T for t >= t_step, behind a shaft where there is one",
     "One dip of the speed, and a step of the estimated load torque with the rise time of the "
     "observer.",
     "`constant_load`, if the step is not in the record.", 60, false, 3.45, 3.7},
    {"missing_samples", "share = 0.02\n", Signal::kAngle, Over::kTime,
     "MEASUREMENT(k) without currents, angle, speed and bus voltage, with probability share",
     "Rows without signals: their fields repeat the previous row, here an angle 0.63 mrad too "
     "small. Filters predict over such a row (status bit 4); controllers hold their output.",
     "`stale_samples`, which have no flag.", 60, false, 3.48, 3.53},
    {"phase_asymmetry", "change_a_Ohm = 0.5\n", Signal::kUd, Over::kTurns,
     "drop of a phase = change i, a change a phase",
     "Order 2 n_p (here 6) in both voltages, proportional to the current, a third of the change "
     "each, and the mean of the three changes as a resistance.",
     "`resistance` (the mean); `current_gain`, which has order 2 n_p in the currents."},
    {"resistance", "change_Ohm = 0.5\ntime_constant_s = 2.0\n", Signal::kUq, Over::kTime,
     "u_dq_drop = change (1 - exp(-(t - start)/tau)) i_dq",
     "Voltage along the current, proportional to it, with a drift if the winding warms up. At low "
     "speed it is most of the voltage.",
     "`inverter_drop` (resistance), `dead_time` at small current; `phase_asymmetry` but for its "
     "order 2 n_p.",
     60, false, 0.5, 8.0},
    {"saturation", "form = \"rational\"\ncurrent_q_A = 8.0\n", Signal::kUd, Over::kTime,
     "psi_q = L_q i_q f(|i_q|/I_s); f(x) = 1/(1 + x) rational, 1/(1 + x^2) square (along its "
     "tangent "
     "beyond x = 0.8), tanh(x)/x tanh; likewise along d where current_d_A is given",
     "Voltage across the current at speed, here along d, that grows less than the current; "
     "currents that respond faster under load.",
     "`inductance` at one load; `cross_saturation`."},
    {"signal_lag", "signal = \"angle\"\nform = \"delay\"\nlag_s = 3e-4\n", Signal::kAngle,
     Over::kSpeed,
     "reading(t) = true(t - lag), or lag reading' = true - reading; a late voltage acts later than "
     "the log has it",
     "No order. Late angle: an error of speed times lag. Late current: a vector turned back by "
     "omega_e lag. Late voltage: the difference of two samples, visible when the voltage changes. "
     "Late speed: its slope times lag.",
     "`encoder_offset` at one speed (angle); `resistance` and `inductance` (a filter in the "
     "current "
     "path)."},
    {"stale_samples", "share = 0.02\n", Signal::kAngle, Over::kTime,
     "currents, angle, speed and v_dc of MEASUREMENT(k) are those of k-1, with probability share; "
     "of signal current the currents alone",
     "Rows equal to the previous row to the last bit, in every measured signal at once: here an "
     "angle 0.63 mrad too small, in 2 % of the rows. If the currents alone repeat, more rows than "
     "chance explains lie behind the line through the neighbouring rows.",
     "noise of the speed; `adc_quantisation`, if only the currents repeat and change little.", 60,
     false, 3.48, 3.53},
    {"stribeck_friction", "torque_Nm = 0.1\nspeed_rad_s = 3.0\n", Signal::kTo, Over::kSpeed,
     "T_load += T_S exp(-(|omega_m|/omega_S)^exponent) tanh(omega_m/omega_smooth)",
     "Load torque that falls with rising speed: two humps beside standstill. The negative damping "
     "there causes stick-slip of slow drives.",
     "`coulomb_friction` at low speed only."},
    {"torsion", "J_load_kgm2 = 2.8e-3\nstiffness_Nm_rad = 61.8\ndamping_Nms_rad = 0.0317\n",
     Signal::kTo, Over::kTime,
     "T_shaft = K delta + D delta', delta = theta_m - theta_load; J_load omega_load' = T_shaft - "
     "T_load",
     "Ringing after every step of torque, at sqrt(K (1/J_load + 1/(J - J_load)))/2 pi (29 Hz here) "
     "at constant current, and lower under a speed controller, which holds the motor while the "
     "load oscillates at sqrt(K/J_load)/2 pi (24 Hz). No effect at constant speed.",
     "`inertia` in slow manoeuvres; a speed controller with too high a gain.", 60, false, 3.49,
     3.75, nullptr, kReversal},
    {"viscous_friction", "coefficient_Nms = 0.05\n", Signal::kTo, Over::kSpeed,
     "T_load += b omega_m", "A straight line of the estimated load torque over the speed.",
     "`machine.B_Nms`: only the sum can be identified; `coulomb_friction` at one speed."},
    {"voltage_gain", "gain = 0.05\n", Signal::kUq, Over::kSpeed, "u = (1 + gain) asked",
     "Every commanded voltage is smaller by the gain; currents, torque and speed stay.",
     "`flux_linkage` and `resistance` together, in the voltage alone."},
};

}  // namespace

std::span<const Entry> entries() {
  return kEntries;
}

}  // namespace twinrate::gallery
