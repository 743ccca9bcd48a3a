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
     "Flat tops of the measured phase currents; in rotor axes orders 6 n_p (18) and multiples, as "
     "soon as the current's peak passes the limit. The controller believes them, so true currents "
     "and torque are bent, too.",
     "`current_gain` (a smaller mean); `saturation`, which is smooth."},
    {"adc_quantisation", "lsb_A = 0.2\n", Signal::kIq, Over::kTurns,
     "i_meas = round(i/lsb) lsb, after noise and the steps of [sensors]",
     "Steps in the measured currents, half of one at most away from the truth. What order they "
     "make "
     "depends on the current; a histogram of the raw samples shows them at once.",
     "`backlash` and `coulomb_friction` at small current: steps of current excite the same "
     "events."},
    {"backlash",
     "J_load_kgm2 = 2.8e-3\ngap_rad = 0.02\nstiffness_Nm_rad = 300.0\ndamping_Nms_rad = 0.1\n",
     Signal::kTo, Over::kTime,
     "T_shaft = K (delta -+ gap/2) + D delta' beyond the flanks, 0 between them; J_load "
     "omega_load' "
     "= T_shaft - T_load",
     "Where the shaft's torque changes its sign the motor runs alone for the moment that the load "
     "needs to cross the gap, with its own smaller inertia, and is hit when it arrives; light "
     "loads "
     "bounce. Under a load that holds one flank there is nothing to see but the stiffness.",
     "`torsion`, which rings at one frequency whatever the amplitude; a coarse current ADC.", 60,
     false, 3.49, 3.62, nullptr, kReversal},
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
     "the observer, too slow for them at one turn a second, shows 23 of 40 and 19 of 60 mNm.",
     "`flux_harmonics` at constant current (it grows with i_q, cogging does not); "
     "`friction_ripple` "
     "in one direction."},
    {"constant_load", "torque_Nm = 0.5\n", Signal::kTo, Over::kSpeed,
     "T_load += T, behind a shaft where there is one",
     "A shift of the estimated load torque and of i_q that does not ask for the direction.",
     "`coulomb_friction` in one direction; the offset of a torque or q-current sensor."},
    {"coulomb_friction", "torque_Nm = 0.25\n", Signal::kTo, Over::kSpeed,
     "T_load += T_C tanh(omega_m/omega_smooth)",
     "A step of the estimated load torque where the speed changes its sign, and the bump in the "
     "speed there; nothing that turns at constant speed.",
     "`constant_load` in one direction; `viscous_friction` at one speed."},
    {"cross_saturation", "coefficient_H_A = 1e-3\n", Signal::kTo, Over::kTime,
     "psi_d -= c/2 i_q^2, psi_q -= c i_d i_q",
     "Less torque an ampere at load: the estimated load torque, which believes the magnets, is too "
     "large by 0.6 % here, and the EMF along q too small; both with the square of i_q, so a light "
     "load shows nothing. Where i_d flows, L_q changes with it.",
     "`flux_linkage` at one load; `saturation` of the d axis."},
    {"current_gain", "gain_a = 0.05\ngain_b = 0.0\n", Signal::kIq, Over::kTurns,
     "i_meas = (1 + gain) i, a gain a phase",
     "Order 2 n_p (here 6) in the measured currents, and a constant part, both in proportion to "
     "the "
     "current. How much of it becomes true current, torque and speed is up to the loop: here the d "
     "integrator makes the measured i_d smooth and the true one rough, while i_q keeps most of it "
     "in the reading.",
     "`cogging` of the same order at one load; a wrong torque constant (the constant part)."},
    {"current_offset", "offset_a_A = 0.05\noffset_b_A = -0.02\n", Signal::kIq, Over::kTurns,
     "i_meas = i + offset, an offset a phase",
     "Order n_p (here 3) in the measured currents, the same at every load; from there, as far as "
     "the loop follows it, in true currents, torque and speed, and in the estimated load torque, "
     "which believes the currents.",
     "`cogging` of order n_p; an offset of the voltages, where no voltage is measured."},
    {"dc_bus_ripple", "amplitude_V = 12.0\nfrequency_Hz = 300.0\n", Signal::kIqTrue, Over::kTime,
     "v_dc += A sin(2 pi f t + phase); the applied voltage is duty v_dc(t), the duty was chosen "
     "for "
     "v_dc(t_k)",
     "The measured bus voltage, and a little in u and i: the modulator corrects with the sample of "
     "the start of the interval. A frequency, not an order: here 300 Hz at one turn a second. A "
     "trace reads it off v_dc.",
     "A mechanical effect of the same frequency at one speed; it moves in the order spectrum when "
     "the speed changes.",
     360},
    {"dead_time", "dead_time_s = 3e-6\n", Signal::kUd, Over::kTurns,
     "drop of a phase = t_d f_pwm v_dc sat(i/i_linear); edge by edge with plant.inverter = "
     "switched",
     "Orders 6 n_p and its multiples (18, 36) in the voltages and, as far as the current loop lets "
     "them through, in currents and torque; strongest across the current, here in u_d. A shift of "
     "u_q that looks like resistance at small current. The switched inverter has the sharper "
     "corners: "
     "its current ripple at this speed is far less than the 0.3 A in which the averaged effect "
     "fades.",
     "`inverter_drop` (same shape; only the bus voltage or the switching frequency tells them "
     "apart); `resistance` at small current.",
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
     "that is not whole. It describes what the data show, not its cause.",
     "`cogging`, where the order is whole."},
    {"encoder_eccentricity", "amplitude_rad = 2e-3\n", Signal::kSpeed, Over::kTurns,
     "theta_meas = theta_m + A sin(theta_m + phase)",
     "Order 1 in the true speed: the loop makes the measured one smooth. The estimated load torque "
     "holds the inertia torque of that, so it grows with the speed squared.",
     "`eccentric_load` at one speed."},
    {"encoder_offset", "offset_rad = 0.05\n", Signal::kUd, Over::kTurns,
     "theta_meas = theta_m + offset",
     "No order at all: the current vector is turned, a true i_d appears, torque a ampere falls by "
     "cos(n_p offset), u_d shifts.",
     "`flux_linkage` (less torque); an inductance error (u_d)."},
    {"encoder_quantisation", "", Signal::kTo, Over::kTime,
     "theta_meas = floor(theta_m/step) step, step = 2 pi/encoder_counts; omega_m = difference/T_s",
     "Steps of step/T_s in the measured speed (15 rad/s here, at a true 6.3). The estimated load "
     "torque follows them by +-0.7 Nm from tick to tick, and hardly any of it lies in orders 1 to "
     "60: at one turn a second the counts pass at 4096 Hz. Where counts and ticks are in a simple "
     "ratio it beats slowly.",
     "noise of the speed; `encoder_eccentricity` where the beat is slow.", 60, false, 3.48, 3.53,
     "sensors.encoder_counts=4096"},
    {"fan_load", "coefficient_Nms2 = 0.01\n", Signal::kTo, Over::kSpeed,
     "T_load += c omega_m |omega_m|",
     "The estimated load torque is a parabola over the speed, odd in the direction.",
     "`viscous_friction` over a narrow range of speed."},
    {"flux_harmonics", "order = 18\namplitude_Wb = 2.5e-3\n", Signal::kTo, Over::kTurns,
     "delta_psi_d = A cos(N theta_m + phase); u_dq_drop = [d delta_psi/dt, omega_e delta_psi]; "
     "T_load -= 3/2 n_p (delta_psi i_q + d delta_psi/d theta_e i_d)",
     "Order N in the torque in proportion to i_q, and in u_d, u_q in proportion to the speed.",
     "`cogging` of the same order at one load; `dead_time`, which has 6 n_p too but in the voltage "
     "whatever the speed."},
    {"flux_linkage", "change_Wb = -0.02\n", Signal::kUq, Over::kSpeed, "psi_d += change",
     "Voltage along q in proportion to the speed, and torque in proportion to i_q: more current "
     "for "
     "the same load, and an estimated load torque that is wrong by as much. Nothing that turns.",
     "An error of the torque constant or of a current gain (torque alone), `voltage_gain` (voltage "
     "alone): the two equations together tell them apart."},
    {"friction_ripple", "order = 1\namplitude_Nm = 0.05\nphase_rad = 0.5\n", Signal::kTo,
     Over::kTurns, "T_load += tanh(omega_m/omega_smooth) A sin(N theta_m + phase)",
     "Like cogging of order N, but its sign changes with the direction.",
     "`cogging` and `eccentric_load` where the drive turns in one direction only."},
    {"inductance", "change_d_H = 4e-3\nchange_q_H = 4e-3\n", Signal::kUd, Over::kTime,
     "psi_d += change_d i_d, psi_q += change_q i_q",
     "Voltage across the current at speed, here along d, omega_e change_q i_q, and the answer of "
     "the "
     "currents to a step of voltage. Where the changes differ, a little reluctance torque.",
     "`encoder_offset` (u_d at one load and speed); `saturation` at one load."},
    {"inertia", "change_kgm2 = 0.0088\n", Signal::kTo, Over::kSpeed,
     "(J + change) omega_m' = T_em - B omega_m - T_load",
     "An estimated load torque of change times the acceleration: one sign on the way up, the other "
     "on the way down, nothing at constant speed. The answer to a load step is slower.",
     "`constant_load` in a record that only accelerates; a wrong torque constant."},
    {"inverter_drop", "threshold_V = 3.0\nresistance_Ohm = 0.2\n", Signal::kUd, Over::kTurns,
     "drop of a phase = V_0 sat(i/i_linear) + R_on i",
     "As dead time: orders 6 n_p and multiples in the voltages from V_0, and a resistance from "
     "R_on.",
     "`dead_time` (V_0) and `resistance` (R_on)."},
    {"inverter_offset", "offset_a_V = 1.0\noffset_b_V = -0.4\n", Signal::kIq, Over::kTurns,
     "u_phase = asked + offset, an offset a phase against c",
     "Order n_p (here 3) in currents, torque and speed, as far as the loop lets it through, and in "
     "the voltages that the loop asks for against it; the same at every load and speed.",
     "`current_offset`, where the current loop is stiff: it turns at the same order. The voltage "
     "equation tells them apart at different speeds."},
    {"iron_loss", "resistance_Ohm = 100.0\n", Signal::kIq, Over::kSpeed,
     "i_fe = omega_e [-psi_q, psi_d]/R_c adds to the current at the terminals; u_dq_drop = R_s "
     "i_fe",
     "Measured q current in proportion to the speed that makes no torque, and so an estimated load "
     "torque that rises like friction. Voltage hardly shows it. The currents of TRUTH are those "
     "behind R_c.",
     "`viscous_friction`: the same torque at every load; only the copper loss of i_fe and its d "
     "part, "
     "in proportion to load and speed, differ."},
    {"load_step", "torque_Nm = 1.0\ntime_s = 3.5\n", Signal::kTo, Over::kTime,
     "T_load += T for t >= t_step, behind a shaft where there is one",
     "One dip of the speed, and a step of the estimated load torque with the observer's own rise.",
     "`constant_load`, where the step is not in the record.", 60, false, 3.45, 3.7},
    {"missing_samples", "share = 0.02\n", Signal::kAngle, Over::kTime,
     "MEASUREMENT(k) without currents, angle, speed and bus voltage, with probability share",
     "Rows without signals: their fields repeat the row before, here an angle of 0.63 mrad too "
     "little. Filters predict over such a row (status bit 4), controllers hold what they had.",
     "`stale_samples`, which do not say so.", 60, false, 3.48, 3.53},
    {"phase_asymmetry", "change_a_Ohm = 0.5\n", Signal::kUd, Over::kTurns,
     "drop of a phase = change i, a change a phase",
     "Order 2 n_p (here 6) in both voltages in proportion to the current, a third of the change "
     "each, and the mean of the three changes as a resistance.",
     "`resistance` (the mean); `current_gain`, which has order 2 n_p in the currents."},
    {"resistance", "change_Ohm = 0.5\ntime_constant_s = 2.0\n", Signal::kUq, Over::kTime,
     "u_dq_drop = change (1 - exp(-(t - start)/tau)) i_dq",
     "Voltage along the current in proportion to it, that creeps where the winding warms up. At "
     "low speed it is most of the voltage.",
     "`inverter_drop` (resistance), `dead_time` at small current; `phase_asymmetry` but for its "
     "order 2 n_p.",
     60, false, 0.5, 8.0},
    {"saturation", "form = \"rational\"\ncurrent_q_A = 8.0\n", Signal::kUd, Over::kTime,
     "psi_q = L_q i_q f(|i_q|/I_s); f(x) = 1/(1 + x) rational, 1/(1 + x^2) square (along its "
     "tangent "
     "beyond x = 0.8), tanh(x)/x tanh; likewise along d where current_d_A is given",
     "Voltage across the current at speed, here along d, that grows less than the current; "
     "currents "
     "that answer faster at load.",
     "`inductance` at one load; `cross_saturation`."},
    {"signal_lag", "signal = \"angle\"\nform = \"delay\"\nlag_s = 3e-4\n", Signal::kAngle,
     Over::kSpeed,
     "reading(t) = true(t - lag), or lag reading' = true - reading; a late voltage acts later than "
     "the log has it",
     "No order: of the angle an error of speed times lag; of the current a vector turned back by "
     "omega_e lag; of the voltage the difference of two samples, which shows where the voltage "
     "changes; of the speed its slope times lag.",
     "`encoder_offset` at one speed (angle); `resistance` and `inductance` (a filter in the "
     "current "
     "path)."},
    {"stale_samples", "share = 0.02\n", Signal::kAngle, Over::kTime,
     "currents, angle, speed and v_dc of MEASUREMENT(k) are those of k-1, with probability share; "
     "of signal current the currents alone",
     "Rows equal to the row before to the last bit, in every measured signal at once: here an "
     "angle "
     "of 0.63 mrad too little, 2 % of the time. Where the currents alone repeat, more rows than "
     "chance explains stay behind the line through the rows around.",
     "noise of the speed; `adc_quantisation`, where only the currents repeat and change little.",
     60, false, 3.48, 3.53},
    {"stribeck_friction", "torque_Nm = 0.1\nspeed_rad_s = 3.0\n", Signal::kTo, Over::kSpeed,
     "T_load += T_S exp(-(|omega_m|/omega_S)^exponent) tanh(omega_m/omega_smooth)",
     "Load torque that falls with rising speed: two humps beside standstill. Negative damping "
     "there, which makes slow drives stick and slip.",
     "`coulomb_friction` at low speed only."},
    {"torsion", "J_load_kgm2 = 2.8e-3\nstiffness_Nm_rad = 61.8\ndamping_Nms_rad = 0.0317\n",
     Signal::kTo, Over::kTime,
     "T_shaft = K delta + D delta', delta = theta_m - theta_load; J_load omega_load' = T_shaft - "
     "T_load",
     "Ringing after every step of torque, at sqrt(K (1/J_load + 1/(J - J_load)))/2 pi (29 Hz here) "
     "where the current is held, and lower under a speed controller, which holds the motor while "
     "the load swings at sqrt(K/J_load)/2 pi (24 Hz). Nothing at constant speed.",
     "`inertia` in slow manoeuvres; a speed controller that is tuned too hard.", 60, false, 3.49,
     3.75, nullptr, kReversal},
    {"viscous_friction", "coefficient_Nms = 0.05\n", Signal::kTo, Over::kSpeed,
     "T_load += b omega_m", "A straight line of the estimated load torque over the speed.",
     "`machine.B_Nms`: only the sum can be identified; `coulomb_friction` at one speed."},
    {"voltage_gain", "gain = 0.05\n", Signal::kUq, Over::kSpeed, "u = (1 + gain) asked",
     "Every voltage that the drive asks for is smaller by the gain; currents, torque and speed "
     "stay.",
     "`flux_linkage` and `resistance` together, in the voltage alone."},
};

}  // namespace

std::span<const Entry> entries() {
  return kEntries;
}

}  // namespace twinrate::gallery
