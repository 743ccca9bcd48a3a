#!/usr/bin/env python3
"""The slowest gain update rate f_bmin over speed, with two gain policies."""
import os
import pathlib
import shutil
import sys

import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
drive = os.path.relpath(here / "drive.toml")  # the caption of the figure has the command
sweep = twinrate.sweep(drive, [40, 64, 100], policies=["paper", "rotate"], seeds=1, n_max=60)
shutil.copy(sweep.directory / "figure.svg", out / "picture.svg")
for policy, f_e, n in zip(sweep.limits["policy"], sweep.limits["f_e_Hz"], sweep.limits["n_max"]):
    print(f"{policy:7} f_e {f_e:3.0f} Hz: a gain every {n:.0f} ticks")
assert len(sweep.limits["n_max"]) == 6
