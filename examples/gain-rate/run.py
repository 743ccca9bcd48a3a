#!/usr/bin/env python3
"""The angle error of three gain update rates: every tick, every 12th, every 13th."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
curves, locked = {}, {}
for n in (1, 12, 13):
    run = twinrate.simulate(here / "drive.toml", {"rates.n": n})
    error = run["ESTIMATE"]["theta_e_rad"] - 4 * run["TRUTH"]["theta_m_rad"]
    error = numpy.degrees((error + numpy.pi) % (2 * numpy.pi) - numpy.pi)
    curves[f"n = {n}, f_b = {5000 / n:.0f} Hz"] = (1e-9 * run["TRUTH"]["t_ns"], error)
    locked[n] = run.summary["locked"]
twinrate.figure("gain-rate: angle error at three gain update rates",
                *((f"{name}: angle error, deg", "t, s", {"": curve}) for name, curve in curves.items())
                ).save(out / "picture.svg")
print("locked:", locked)
assert locked == {1: True, 12: True, 13: False}
