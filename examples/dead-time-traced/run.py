#!/usr/bin/env python3
"""A dead time that the drive file lacks, traced, and the voltage that it takes."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
run = twinrate.simulate(here / "drive.toml", out=out / "run", force=True)
result = twinrate.trace("niewiara2020", out / "run", out=out / "trace", force=True)
found = result["effects"][0]
dead_time, linear = (found["parameters"][key]["value"] for key in ("dead_time", "linear_current"))
before, after = (result["error"][key]["holdout"] for key in ("before", "after"))
print(result["verdict"], found["kind"], f"{1e6 * dead_time:.2f} us, aliases: {', '.join(found['aliases'])}")
print(f"held-out voltage error {before:.2f} -> {after:.2f} V rms")

# Mean voltage that phase a loses, over its current: linear up to linear_current, then constant.
v_dc, f_pwm = run.drive["inverter"]["v_dc_V"], run.drive["rates"]["f_s_Hz"]
i_a = numpy.linspace(-3, 3, 121)
loss = lambda time, width: v_dc * f_pwm * time * numpy.clip(i_a / width, -1, 1)
twinrate.figure("dead-time-traced: voltage lost by a phase",
                ("voltage, V", "phase current, A", {"simulated": (i_a, loss(3e-6, 0.3)),
                                                    "traced": (i_a, loss(dead_time, linear))})
                ).save(out / "picture.svg")
assert found["kind"] == "dead_time" and abs(dead_time - 3e-6) < 3e-8
