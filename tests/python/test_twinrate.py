"""The Python module: the same bits as the programs, ValueError with the program's line."""
import math
import os
import pathlib
import subprocess
import tempfile
import unittest

import numpy
import twinrate

PROGRAM = os.environ["TWINRATE_PROGRAM"]
SOURCE = pathlib.Path(os.environ["TWINRATE_SOURCE_DIR"])
SHORT = {"run.duration_s": 0.2, "run.settle_s": 0.1}
CHANNELS = ["MEASUREMENT", "TRUTH", "ESTIMATE", "GAIN", "REFERENCE", "COMMAND"]


def template(name):
    """The class of an own process as `twinrate new` writes it."""
    text = (SOURCE / "tools/new" / name / "NAME.py.in").read_text().replace("@NAME@", "own")
    space = {"__name__": "own"}
    exec(compile(text, name, "exec"), space)
    return space


def program(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True)


class Case(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.path = pathlib.Path(cls.folder.name)

    def assert_same_bits(self, a, b):
        for channel in CHANNELS:
            self.assertEqual(list(a[channel]), list(b[channel]))
            self.assertGreater(len(a[channel]["seq"]), 100)
            for name, column in a[channel].items():
                numpy.testing.assert_array_equal(column, b[channel][name], f"{channel}.{name}")


class Simulate(Case):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.out = cls.path / "program"
        done = program("simulate", "dilys2021", "--run-dir", cls.out,
                       *(w for k, v in SHORT.items() for w in ("--set", f"{k}={v}")))
        assert (cls.out / "log.lcm").exists(), done.stderr
        cls.run_of_program = twinrate.Run(cls.out)

    def test_the_run_has_the_bits_of_the_program(self):
        self.assert_same_bits(twinrate.simulate("dilys2021", SHORT), self.run_of_program)

    def test_a_key_of_the_drive_file_is_set(self):
        run = twinrate.simulate("dilys2021", {**SHORT, "rates.n": 4})
        self.assertEqual(run.drive["rates"]["n"], 4)
        self.assertEqual(numpy.diff(run["GAIN"]["seq"]).max(), 4)

    def test_an_own_filter_that_computes_the_same_has_the_same_bits(self):
        own = template("estimator-python")["OwnEkf"]
        self.assert_same_bits(twinrate.simulate("dilys2021", SHORT, estimator=own),
                              self.run_of_program)

    def test_an_own_filter_changes_the_run(self):
        class Deaf:
            def fast_step(self, x, m, K):
                return x

        with tempfile.TemporaryDirectory() as out:
            run = twinrate.simulate("dilys2021", SHORT, estimator=Deaf(), out=out + "/run")
            self.assertTrue((run["ESTIMATE"]["theta_e_rad"] == 0).all())
            self.assertFalse(run.summary["locked"])

    def test_an_own_filter_names_what_it_estimates(self):
        class Knows:
            def fast_step(self, x, m, K):
                return x, [0.0, 0.0]

            def output(self, x, m):
                return {"theta_e": (4 * m.theta_m) % (2 * math.pi), "omega_m": 12.5}

        run = twinrate.simulate("dilys2021", SHORT, estimator=Knows())
        self.assertTrue((run["ESTIMATE"]["omega_m_rad_s"] == 12.5).all())

    def test_a_mistake_in_an_own_filter_ends_the_run(self):
        class Short:
            def fast_step(self, x, m, K):
                return [0.0]

        with self.assertRaisesRegex(ValueError, r"fast_step\(\): x: 4 numbers expected, found 1"):
            twinrate.simulate("dilys2021", SHORT, estimator=Short())

        class Fails:
            def fast_step(self, x, m, K):
                raise ZeroDivisionError("mine")

        with self.assertRaises(ZeroDivisionError):
            twinrate.simulate("dilys2021", SHORT, estimator=Fails())

    def test_the_arrays_are_those_of_the_csv_export(self):
        csv = self.path / "estimate.csv"
        program("export", self.out, "--format", "csv", "--channels", "ESTIMATE", "--out", csv)
        import pandas
        exported = pandas.read_csv(csv, comment="#", float_precision="round_trip")
        frame = self.run_of_program["ESTIMATE"].frame()
        rows = len(exported)
        self.assertGreater(rows, 900)
        for name in ["theta_e_rad", "omega_m_rad_s", "i_q_A"]:
            numpy.testing.assert_array_equal(exported[f"ESTIMATE.{name}"], frame[name].iloc[:rows])
        self.assertEqual(list(frame.filter(like="x_hat")), [f"x_hat[{i}]" for i in range(4)])


class Interrupt(Case):
    SCRIPT = """
import os, signal, sys, threading, twinrate
threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    twinrate.simulate("dilys2021", {"run.duration_s": 1000}, out=sys.argv[1])
    sys.exit("not interrupted")
except KeyboardInterrupt:
    pass
run = twinrate.simulate("dilys2021", {"run.duration_s": 0.2, "run.settle_s": 0.1})
assert len(run["ESTIMATE"]["seq"]) == 1000
"""

    def test_ends_a_run_and_the_next_one_is_whole(self):
        import sys
        out = self.path / "interrupted"
        done = subprocess.run([sys.executable, "-c", self.SCRIPT, out], capture_output=True,
                              text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(len(twinrate.Run(out)["ESTIMATE"]["seq"]), 5000 * 1000)


class BadInput(Case):
    def says(self, *arguments):
        return program(*arguments).stderr.removeprefix("twinrate: ").strip()

    def test_has_the_line_of_the_program(self):
        for set in [{"rates.n": 0}, {"rates.nn": 3}, {"estimator.kind": "kalman"}]:
            key, value = next(iter(set.items()))
            with self.assertRaises(ValueError) as raised:
                twinrate.simulate("dilys2021", set)
            self.assertEqual(str(raised.exception),
                             self.says("simulate", "dilys2021", "--set", f"{key}={value}"))
            self.assertIn(key, str(raised.exception))

    def test_no_such_drive_or_log(self):
        with self.assertRaisesRegex(ValueError, "no_such_drive"):
            twinrate.simulate("no_such_drive")
        with self.assertRaisesRegex(ValueError, "no_such_run"):
            twinrate.Run(self.path / "no_such_run")
        with self.assertRaisesRegex(ValueError, "frobnicate"):
            twinrate.call("frobnicate")

    def test_a_finished_run_is_not_overwritten(self):
        out = self.path / "run"
        twinrate.simulate("dilys2021", SHORT, out=out)
        with self.assertRaisesRegex(ValueError, "--force"):
            twinrate.simulate("dilys2021", SHORT, out=out)
        twinrate.simulate("dilys2021", SHORT, out=out, force=True)


@unittest.skipUnless(subprocess.run(["unshare", "-rn", "true"]).returncode == 0,
                     "no network namespaces here")
class Bus(Case):
    # In a namespace of its own: a drive in realtime, and a client that hears it.
    SCRIPT = """
ip link set lo up multicast on && ip route add 239.0.0.0/8 dev lo
"$TWINRATE_PROGRAM" launch dilys2021 --duration 0.6s --set run.settle_s=0.3 --pace realtime --run-dir "$1" >/dev/null 2>&1 &
"$2" -c '
import twinrate
drive = twinrate.Drive()
heard = {}
for _ in range(100):                  # a busy machine starts late
    heard = drive.capture(0.1)
    if "ESTIMATE" in heard: break
seq = heard["ESTIMATE"]["seq"]
assert (seq[1:] > seq[:-1]).all(), seq
assert len(heard["ESTIMATE"]["theta_e_rad"]) == len(seq)
'
heard=$?
wait
exit $heard
"""

    def test_a_client_hears_a_running_drive(self):
        import sys
        done = subprocess.run(["unshare", "-rn", "bash", "-c", self.SCRIPT, "_", self.path / "run",
                               sys.executable], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)


@unittest.skipUnless(subprocess.run(["unshare", "-rn", "true"]).returncode == 0,
                     "no network namespaces here")
class Steering(Case):
    SCRIPT = """
ip link set lo up multicast on && ip route add 239.0.0.0/8 dev lo
"$TWINRATE_PROGRAM" launch dilys2021 --duration 3s --pace wall --run-dir "$1" >/dev/null 2>&1 &
until [ -s "$1/log.lcm" ]; do sleep 0.05; done
"$2" -c '
import sys, twinrate
line = twinrate.Drive(sys.argv[1]).set(speed_rpm=600)
assert line.startswith("tick "), line
' "$1"
steered=$?
wait
exit $steered
"""

    def test_a_client_steers_a_running_drive(self):
        import sys
        out = self.path / "steered"
        done = subprocess.run(["unshare", "-rn", "bash", "-c", self.SCRIPT, "_", out,
                               sys.executable], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        asked = twinrate.Run(out)["REFERENCE"]["omega_m_ref_rad_s"][-1]
        self.assertAlmostEqual(asked, 600 / 60 * 2 * math.pi, places=9)


class Verbs(Case):
    def test_design_is_that_of_the_program(self):
        import json
        shown = json.loads(program("design", "lqr", "dilys2021", "--json").stdout)
        self.assertEqual(twinrate.design("dilys2021"), shown)
        self.assertEqual(len(shown["q"]["K"]), 3)

    def test_sweep_is_that_of_the_program(self):
        sweep = twinrate.sweep("dilys2021", [50, 80], seeds=1, n_max=20)
        out = self.path / "sweep"
        program("sweep", "fb", "dilys2021", "--speeds", "50,80", "--seeds", 1, "--n-max", 20,
                "--out", out, "--json")
        self.assertEqual((sweep.directory / "points.csv").read_text(),
                         (out / "points.csv").read_text())
        self.assertEqual(list(sweep.limits["f_e_Hz"]), [50, 80])
        self.assertTrue((sweep.limits["n_max"] > 1).all())

    def test_trace_is_that_of_the_program(self):
        extra = self.path / "cogging.toml"
        extra.write_text('preset = "dilys2021"\n[[effect]]\nkind = "cogging"\norder = 24\n'
                         'amplitude_Nm = 0.004\n[run]\nduration_s = 1.0\nsettle_s = 0.5\n')
        run = twinrate.simulate(extra, out=self.path / "cogged")
        result = twinrate.trace("dilys2021", run.directory, out=self.path / "traced",
                                exclude=["torsion", "backlash"])
        done = program("trace", "dilys2021", "--data", run.directory, "--out",
                       self.path / "by_program", "--json", "--exclude", "torsion", "backlash")
        self.assertEqual((self.path / "traced/extended.toml").read_text(),
                         (self.path / "by_program/extended.toml").read_text(), done.stderr)
        self.assertEqual(result["verdict"], "traced")
        self.assertEqual([e["kind"] for e in result["effects"]], ["cogging"])
        excluded = [row["kind"] for row in result["not_identifiable"]
                    if row["why"] == "excluded by --exclude"]
        self.assertEqual(excluded, ["backlash", "torsion"])

    def test_call_returns_what_the_program_prints(self):
        code, text = twinrate.call("effects", "list")
        self.assertEqual((code, text), (0, program("effects", "list").stdout))


if __name__ == "__main__":
    unittest.main()
