#!/usr/bin/env python3
"""Full load on a machine with inner magnets: currents at maximum torque per ampere."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
run = twinrate.simulate(here / "drive.toml")
truth, estimate = run["TRUTH"], run["ESTIMATE"]
t = 1e-9 * truth["t_ns"]
twinrate.figure("ipmsm-full-load: 2.3 Nm from 0.3 s to 0.6 s",
                ("speed, rad/s mechanical", "t, s", {"true": (t, truth["omega_m_rad_s"]),
                                                     "estimated": (t, estimate["omega_m_rad_s"])}),
                ("current, A", "t, s", {"i_d": (t, truth["i_d_A"]), "i_q": (t, truth["i_q_A"])})
                ).save(out / "picture.svg")
late = (t > 0.5) & (t < 0.59)
print(f"under load: i_d {truth['i_d_A'][late].mean():.2f} A, i_q {truth['i_q_A'][late].mean():.2f} A, angle error "
      f"{numpy.degrees(run.summary['angle_error_rms_rad']):.2f} deg rms")
assert run.summary["locked"]
