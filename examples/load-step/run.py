#!/usr/bin/env python3
"""The load estimate of the disturbance filter, and what its feed-forward does to the dip of the speed."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
runs = {name: twinrate.simulate(here / "drive.toml", {"controller.compensation": choice})
        for name, choice in {"with feed-forward": "paper", "without": "off"}.items()}
window = slice(5500, 12000)
t = 1e-9 * next(iter(runs.values()))["TRUTH"]["t_ns"][window]
speed = {name: (t, run["TRUTH"]["omega_m_rad_s"][window]) for name, run in runs.items()}
fed = runs["with feed-forward"]
twinrate.figure("load-step: 3 Nm at 0.6 s",
                ("speed, rad/s mechanical", "t, s", speed),
                ("load torque, Nm", "t, s", {"true": (t, fed["TRUTH"]["T_load_Nm"][window]),
                                             "estimated": (t, fed["ESTIMATE"]["T_load_Nm"][window])})
                ).save(out / "picture.svg")
asked = 200 / 60 * 2 * numpy.pi
dip = {name: asked - values.min() for name, (_, values) in speed.items()}
print("dip of the speed, rad/s:", {name: round(float(value), 2) for name, value in dip.items()})
assert dip["with feed-forward"] < dip["without"]
