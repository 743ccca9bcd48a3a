"""Twinrate in Python: runs as numpy arrays, and the program's verbs as functions.

    import twinrate
    run = twinrate.simulate("dilys2021", set={"rates.n": 5})
    run["ESTIMATE"]["omega_m_rad_s"]          # numpy array
    run["ESTIMATE"].frame()                   # pandas

Every function runs the code of the program `twinrate`, so results have the same bits. A mistake in
the input raises ValueError with the program's line. docs/python.md describes the package,
docs/own-code.md own parts of the loop.
"""
import csv
import json
import os
import pathlib
import shutil
import sys
import tempfile
import weakref
from collections.abc import Mapping

import numpy

from . import _twinrate
from ._twinrate import Estimate, Measurement, Reference, cos, sin

try:
    import tomllib
except ImportError:  # Python 3.9, 3.10
    tomllib = None

__all__ = [
    "Run", "Table", "Sweep", "Figure", "Drive", "simulate", "sweep", "trace", "design", "figure",
    "drive", "call",
    "run_estimator", "run_controller", "run_reference", "Measurement", "Estimate", "Reference",
    "sin", "cos",  # with the bits of the loop; those of math depend on the processor
]


class Table(Mapping):
    """Columns by name: numpy arrays of equal length, lists of texts."""

    def __init__(self, columns):
        self._columns = columns

    def __getitem__(self, name):
        return self._columns[name]

    def __iter__(self):
        return iter(self._columns)

    def __len__(self):
        return len(self._columns)

    def __repr__(self):
        rows = len(next(iter(self._columns.values()))) if self._columns else 0
        return f"<{rows} rows of {', '.join(self._columns)}>"

    def frame(self):
        """A pandas frame; the columns of an array field NAME are NAME[0], NAME[1] .. . A channel
        has the drive time t_s as index."""
        import pandas

        flat = {}
        for name, column in self.items():
            if isinstance(column, numpy.ndarray) and column.ndim == 2:
                flat.update({f"{name}[{i}]": column[:, i] for i in range(column.shape[1])})
            else:
                flat[name] = column
        index = pandas.Index(1e-9 * flat["t_ns"], name="t_s") if "t_ns" in flat else None
        return pandas.DataFrame(flat, index=index)


class Run(Mapping):
    """A recorded run, channels by name: Run("runs/n5")["ESTIMATE"]["theta_e_rad"].

    `path`: a run directory or an LCM log. `skip_damage`: use the undamaged part of a log, and
    say in `damage` what was skipped; else damage raises ValueError.
    """

    def __init__(self, path, skip_damage=False, _keep=None):
        self.directory = pathlib.Path(path)
        self._keep = _keep  # a temporary directory lives as long as the run
        channels = _twinrate.read_log(os.fspath(path), skip_damage)
        self.damage = channels.pop("damage")
        self._channels = {name: Table(columns) for name, columns in channels.items()}

    def __getitem__(self, channel):
        return self._channels[channel.removeprefix("DRIVE_")]

    def __iter__(self):
        return iter(self._channels)

    def __len__(self):
        return len(self._channels)

    def __repr__(self):
        name = f"run of {self.drive['name']}" if self._is_run() else "log"
        return f"<{name}: {', '.join(self)}>"

    def _is_run(self):
        return (self.directory / "config.toml").exists()

    @property
    def summary(self):
        """The figures of summary.json."""
        return json.loads((self.directory / "summary.json").read_text())

    @property
    def drive(self):
        """The resolved drive file, as nested dictionaries."""
        return _toml((self.directory / "config.toml").read_text())


def call(*arguments):
    """Runs a command line of the program, call("effects", "list"): its exit code and its output."""
    sys.stdout.flush()
    with tempfile.TemporaryFile() as output:
        stdout = os.dup(1)
        os.dup2(output.fileno(), 1)
        try:
            code = _twinrate.call([os.fspath(a) if isinstance(a, os.PathLike) else str(a)
                                   for a in arguments])
        finally:
            os.dup2(stdout, 1)
            os.close(stdout)
        if code == 1 and _twinrate.stop_signalled():
            raise KeyboardInterrupt
        output.seek(0)
        return code, output.read().decode()


def drive(name, set={}):
    """The resolved drive file of a preset or file, as nested dictionaries."""
    return _toml(_twinrate.resolved_drive(os.fspath(name), _overrides(set)))


def simulate(drive, set={}, estimator=None, out=None, force=False):
    """Runs the whole loop in this process: a Run with the bits of `twinrate simulate`.

    `set`: keys of the drive file, {"rates.n": 5}. `out`: the run directory; without it the run is
    temporary. `estimator`: an own filter in place of the drive file's, an object or a class that is
    called with the drive file as a dictionary. It has

        fast_step(x, m, K) -> x, innov    the state at t_k from that at t_{k-1}, the Measurement m
                                          and the gain K (numpy, n_x by n_y); innov may be left out
        start(m) -> x                     optional: the state of the first sample
        output(x, m) -> dict              optional: theta_e, omega_m, i_d, i_q, T_load, of those
                                          that the drive file's filter should not compute from x

    x has the states of the drive file's filter, in their order: its gains are computed there. A
    state that is not finite is left out.
    """
    keep = _Temporary(out)
    out = keep.path(out, "run")
    _twinrate.simulate(os.fspath(drive), _overrides(set), os.fspath(out), force, _maker(estimator))
    return Run(out, _keep=keep)


class Sweep:
    """The result of a sweep: `limits` (fbmin.csv) and `points` (points.csv) as tables."""

    def __init__(self, directory, _keep=None):
        self.directory = pathlib.Path(directory)
        self._keep = _keep
        self.limits = _table(self.directory / "fbmin.csv")
        self.points = _table(self.directory / "points.csv")

    def _repr_svg_(self):
        return (self.directory / "figure.svg").read_text()


def sweep(drive, speeds, policies=("paper",), seeds=5, set={}, out=None, **options):
    """The slowest gain update rate f_bmin over speed, as `twinrate sweep fb`. `speeds`: electrical,
    Hz. `options`: those of the program, n_max=30."""
    keep = _Temporary(out)
    out = keep.path(out, "sweep")
    code, _ = call("sweep", "fb", drive, "--speeds", _comma(speeds), "--policies", _comma(policies),
                   "--seeds", seeds, "--out", out, "--json", *_set(set), *_options(options))
    if code != 0:
        raise RuntimeError(f"twinrate sweep fb: exit code {code}")
    return Sweep(out, _keep=keep)


def trace(drive, data, holdout=(), set={}, out=None, **options):
    """The effects that the model lacks, as `twinrate trace`: trace.json as a dictionary, and
    extended.toml as `extended`. `data`, `holdout`: a log, or a list of logs; `holdout` may be a
    share of the rows. `options`: those of the program, repair=True, exclude=["torsion"]."""
    keep = _Temporary(out)
    out = keep.path(out, "trace")
    held_out = ["--holdout", *_list(holdout)] if _list(holdout) else []
    call("trace", drive, "--data", *_list(data), *held_out, "--out", out, "--json", *_set(set),
         *_options(options))
    result = json.loads(pathlib.Path(out, "trace.json").read_text())
    result["extended"] = pathlib.Path(out, "extended.toml").read_text()
    return result


def design(drive, set={}):
    """Gains, poles and margins of the state feedback, as `twinrate design lqr --json`."""
    return json.loads(call("design", "lqr", drive, "--json", *_set(set))[1])


class Figure:
    """An SVG picture; a notebook shows it, save(path) writes it."""

    def __init__(self, text):
        self._text = text

    def _repr_svg_(self):
        return self._text

    def save(self, path):
        pathlib.Path(path).write_text(self._text)


def figure(title, *panels, points=1000):
    """A figure of panels, one above the other, each (title, x label, {name: (x, y)}). Longer curves
    are thinned to every n-th of their points."""
    drawn = []
    for panel_title, x_label, curves in panels:
        thinned = []
        for name, (x, y) in curves.items():
            step = max(1, len(x) // points)
            thinned.append((name, list(map(float, x[::step])), list(map(float, y[::step]))))
        drawn.append((panel_title, x_label, thinned))
    return Figure(_twinrate.figure(title, drawn))


class Drive:
    """A drive that runs, over the bus, with the project's own LCM code: LCM's Python package is not
    needed. `run_dir`: the directory of the run to steer, else the newest running one in runs/.
    `url`: LCM's, else LCM_DEFAULT_URL, else the default."""

    def __init__(self, run_dir=None, url="", channel_suffix=""):
        self._run_dir, self._url, self._suffix = run_dir, url, channel_suffix

    def set(self, *words, **values):
        """Steers, as the verb set: set(speed_rpm=500, load_Nm=0.02), set("stop"). Returns the line
        that the verb prints, with the tick from which on it applies; a refusal raises
        RuntimeError."""
        where = [("--run-dir", self._run_dir), ("--lcm-url", self._url),
                 ("--channel-suffix", self._suffix)]
        options = [word for option, value in where if value for word in (option, value)]
        code, text = call("set", *words, *(f"{key}={_text(value)}" for key, value in values.items()),
                          *options)
        if code != 0:
            raise RuntimeError(f"set {' '.join([*words, *values])}: refused, exit code {code}")
        return text.strip()

    def step(self, seconds=0.5, **values):
        """set(), then capture()."""
        self.set(**values)
        return self.capture(seconds)

    def capture(self, seconds):
        """What comes over the bus for this time, wall clock: tables by channel, as in a Run."""
        return {name: Table(columns)
                for name, columns in _twinrate.capture(seconds, self._url, self._suffix).items()}


def run_estimator(estimator, argv=None):
    """Runs an own filter (see simulate) as the estimator process of a launched set, with the
    options of every process. Returns the exit code."""
    return _twinrate.run_estimator(list(argv or sys.argv), _maker(estimator))


def run_controller(controller, argv=None):
    """Runs an own control law as the controller process of a launched set: an object, or a class
    called with the drive file, that has step(m, e, r) -> u_alpha, u_beta, the voltage (V) for
    Measurement, Estimate and Reference of a tick. Returns the exit code."""
    return _twinrate.run_controller(list(argv or sys.argv), _maker(controller))


def run_reference(omega_m_ref, argv=None):
    """Runs omega_m_ref(t_s), the speed reference in rad/s mechanical, as a process of its own; the
    drive file needs reference.from_bus = true. Returns the exit code."""
    return _twinrate.run_reference(list(argv or sys.argv), omega_m_ref)


class _Temporary:
    """A directory that goes with its owner, where the user wants none of his own."""

    def __init__(self, wanted):
        self._name = None if wanted is not None else tempfile.mkdtemp(prefix="twinrate-")
        if self._name:
            weakref.finalize(self, shutil.rmtree, self._name, ignore_errors=True)

    def path(self, wanted, name):
        return os.path.join(self._name, name) if wanted is None else wanted


def _maker(own):
    if own is None:
        return None
    return (lambda toml: own(_toml(toml))) if isinstance(own, type) else (lambda toml: own)


def _toml(text):
    if tomllib is None:
        raise RuntimeError("a drive file as a dictionary needs Python 3.11")
    return tomllib.loads(text)


def _text(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_text(v) for v in value) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)


def _overrides(values):
    return [f"{key}={_text(value)}" for key, value in values.items()]


def _set(values):
    return [word for override in _overrides(values) for word in ("--set", override)]


def _options(options):
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            words.append(option)
        elif value is not False and value is not None:
            words += [option, *(value if isinstance(value, (list, tuple)) else [value])]
    return words


def _list(value):
    if isinstance(value, (str, os.PathLike, float, int)):
        return [value]
    return list(value)


def _comma(values):
    return ",".join(str(v) for v in _list(values))


def _table(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    names = list(rows[0]) if rows else []
    return Table({name: _column([row[name] for row in rows]) for name in names})


def _column(cells):
    try:
        return numpy.array([float(cell) if cell else numpy.nan for cell in cells])
    except ValueError:
        return cells
