#!/usr/bin/env python3
"""A log with names, units and commas of its own: a map is guessed, and the log is imported."""
import pathlib
import sys

import numpy
import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
code, said = twinrate.call("import", here / "bench.csv", "--guess", "--out", out / "map.toml", "--force",
                           "--drive", "dilys2021")
print("\n".join(said.splitlines()[1:]))
twinrate.call("import", here / "bench.csv", "--map", out / "map.toml", "--out", out / "bench.lcm", "--force")
measured = twinrate.Run(out / "bench.lcm")["MEASUREMENT"]
t = 1e-9 * measured["t_ns"]
currents = {f"i_{phase}": (t, measured[f"i_{phase}_A"]) for phase in "abc"}
twinrate.figure("own-log: bench.csv as a log", ("phase currents, A", "t, s", currents),
                ("speed, rad/s mechanical", "t, s", {"measured": (t, measured["omega_m_rad_s"])})
                ).save(out / "picture.svg")
assert code == 0 and numpy.allclose(sum(values for _, values in currents.values()), 0)
