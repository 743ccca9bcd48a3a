#!/usr/bin/env python3
"""A recorded drive and a drive file that lacks its cogging: the tracer names it."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
run = twinrate.simulate(here / "drive.toml", out=out / "run", force=True)
result = twinrate.trace("dilys2021", out / "run", out=out / "trace", force=True)
print(result["verdict"], [effect["kind"] for effect in result["effects"]])
effect = result["effects"][0]["parameters"]
order, amplitude, phase = (effect[key]["value"] for key in ("order", "amplitude", "phase"))

# Torque balance of the declared model at the true speed, T_em - B omega - J domega/dt, mean over 1 ms.
truth, machine = run["TRUTH"], run.drive["machine"]
omega, theta, T_s = truth["omega_m_rad_s"], truth["theta_m_rad"], 1 / run.drive["rates"]["f_s_Hz"]
mean_of = lambda x: numpy.convolve(x, numpy.array([0.5, 1, 1, 1, 1, 0.5]) / 5, "valid")
load = mean_of(truth["T_em_Nm"] - machine["B_Nms"] * omega) - machine["J_kgm2"] * (omega[5:] - omega[:-5]) / (5 * T_s)
known = mean_of(amplitude * numpy.sin(order * theta + phase))
late = slice(4000, 4300)
t = mean_of(1e-9 * truth["t_ns"])[late]
twinrate.figure(f"cogging-traced: order {order:.0f}, {1000 * amplitude:.2f} mNm, phase {phase:.2f} rad",
                ("residual torque, Nm", "t, s", {"of the declared model": (t, load[late]),
                                                 "with the traced cogging": (t, (load - known)[late])})
                ).save(out / "picture.svg")
print(f"residual torque {1000 * load[late].std():.2f} -> {1000 * (load - known)[late].std():.2f} mNm rms")
assert result["verdict"] == "traced" and (load - known)[late].std() < 0.5 * load[late].std()
