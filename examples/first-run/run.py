#!/usr/bin/env python3
"""A first run: speed and angle error of a sensorless start."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
run = twinrate.simulate(here / "drive.toml")
truth, estimate, reference = run["TRUTH"], run["ESTIMATE"], run["REFERENCE"]
t = 1e-9 * truth["t_ns"]
error = estimate["theta_e_rad"] - run.drive["machine"]["n_p"] * truth["theta_m_rad"]
error = numpy.degrees((error + numpy.pi) % (2 * numpy.pi) - numpy.pi)
twinrate.figure("first-run: a sensorless start, f_b = f_s/5",
                ("speed, rad/s mechanical", "t, s", {"true": (t, truth["omega_m_rad_s"]),
                                                     "estimated": (t, estimate["omega_m_rad_s"])}),
                ("angle error, deg electrical", "t, s", {"error": (t, error)})).save(out / "picture.svg")
summary = run.summary
print(f"locked: {summary['locked']}, angle error {numpy.degrees(summary['angle_error_rms_rad']):.2f} deg rms")
assert summary["locked"]
