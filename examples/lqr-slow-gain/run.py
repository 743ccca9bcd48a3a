#!/usr/bin/env python3
"""State feedback with a gain every 20th tick: as computed it is lost, turned with the rotor it holds."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
panels, locked = [], {}
for policy in ("paper", "rotate"):
    run = twinrate.simulate(here / "drive.toml", {"gain.policy": policy})
    error = run["ESTIMATE"]["theta_e_rad"] - 4 * run["TRUTH"]["theta_m_rad"]
    error = numpy.degrees((error + numpy.pi) % (2 * numpy.pi) - numpy.pi)
    panels.append((f"policy {policy}: angle error, deg", "t, s", {"": (1e-9 * run["TRUTH"]["t_ns"], error)}))
    locked[policy] = run.summary["locked"]
twinrate.figure("lqr-slow-gain: f_b = 250 Hz at 400 rad/s electrical", *panels).save(out / "picture.svg")
print("locked:", locked)
assert locked == {"paper": False, "rotate": True}
