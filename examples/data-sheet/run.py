#!/usr/bin/env python3
"""From the values of a data sheet to a drive that turns."""
import pathlib
import sys

import twinrate

out = pathlib.Path(sys.argv[1])
sheet = {"poles": 14, "kv_rpm_V": 150, "r_phase_Ohm": 0.039, "l_phase_H": 24e-6, "inertia_gcm2": 2500,
         "rated_current_A_peak": 30, "rated_torque_Nm": 1.65, "v_dc_V": 24, "encoder_counts": 8192}
code, said = twinrate.call("machine", "new", "gimbal", "--out", out / "gimbal.toml", "--force",
                           "--from", *(f"{key}={value}" for key, value in sheet.items()))
print("\n".join(line for line in said.splitlines() if line.startswith("  psi_f_Wb") or "J_kgm2" in line))
run = twinrate.simulate(out / "gimbal.toml", {"run.duration_s": 0.8, "run.settle_s": 0.6})
truth, estimate = run["TRUTH"], run["ESTIMATE"]
t = 1e-9 * truth["t_ns"]
twinrate.figure("data-sheet: a drive from nine values",
                ("speed, rad/s mechanical", "t, s", {"true": (t, truth["omega_m_rad_s"]),
                                                     "estimated": (t, estimate["omega_m_rad_s"])}),
                ("current i_q, A", "t, s", {"true": (t, truth["i_q_A"])})).save(out / "picture.svg")
print("locked:", run.summary["locked"])
assert code == 0 and run.summary["locked"]
