#!/usr/bin/env python3
"""An own filter in Python: as the built-in one, but its speed is corrected with half the gain."""
import math
import pathlib
import sys

import numpy
import twinrate


class Cautious:
    share = 0.5

    def __init__(self, drive):
        p, self.T_s = drive["machine"], 1 / drive["rates"]["f_s_Hz"]
        self.r = 1 - self.T_s * p["R_s_Ohm"] / p["L_d_H"]
        self.g, self.b = self.T_s / p["L_d_H"], self.T_s * p["psi_f_Wb"] / p["L_d_H"]

    def fast_step(self, x, m, K):
        i_alpha, i_beta, omega_e, theta_e = x.tolist()
        u_alpha, u_beta = m.u_alphabeta
        emf = omega_e * self.b
        prior = numpy.array([i_alpha * self.r + u_alpha * self.g + emf * twinrate.sin(theta_e),
                             i_beta * self.r + u_beta * self.g - emf * twinrate.cos(theta_e),
                             omega_e, theta_e + omega_e * self.T_s])
        innov = numpy.array(m.i_alphabeta) - prior[:2]
        correction = K[:, 0] * innov[0] + K[:, 1] * innov[1]
        correction[2] *= self.share
        x = prior + correction
        x[3] -= 2 * math.pi * math.floor(x[3] / (2 * math.pi))
        return x, innov


class Equal(Cautious):
    share = 1.0


here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
runs = {name: twinrate.simulate(here / "drive.toml", estimator=own)
        for name, own in {"built-in": None, "own": Cautious, "equal": Equal}.items()}
speed = {name: run["ESTIMATE"]["omega_m_rad_s"] for name, run in runs.items()}
t = 1e-9 * runs["own"]["ESTIMATE"]["t_ns"]
twinrate.figure("own-filter: half the gain of the speed",
                ("estimated speed, rad/s mechanical", "t, s", {"built-in": (t, speed["built-in"]),
                                                               "own": (t, speed["own"])})
                ).save(out / "picture.svg")
print("with the whole gain equal to the built-in filter:", (speed["equal"] == speed["built-in"]).all())
assert (speed["equal"] == speed["built-in"]).all() and not (speed["own"] == speed["built-in"]).all()
