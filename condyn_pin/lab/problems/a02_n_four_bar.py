"""A02: the N-four-bar, which passes through a singular posture twice a turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import ellipj, ellipkm1

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.lab.problems.base import Problem
from condyn_pin.lab.problems.setting import Limit, Published, Setting
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar
from condyn_pin.model.soundness import MOST_JOINTS
from condyn_pin.simulation.integrators.explicit import RungeKutta4

_GRAVITY: Final = 9.81  # [m/s^2]
_THRESHOLD: Final = 1e-3  # [m, m/s]: what smaller values are divided by instead
_LIBRARY: Final = "IFToMM library of computational benchmark problems, A02, N = 40"


@dataclass(frozen=True)
class NFourBar(Problem):
    """N square cells in a row, kicked over at -1 rad/s, through the flat posture again and again.

    With theta the angle of every crank from the x axis and psi = theta + pi / 2,

        psi'' = -w^2 sin(psi),    w^2 = g ((N + 1) / 2 + N) / ((N + 1) / 3 + N),

    which turns over: W = sqrt(1 + 4 w^2), m = (2 w / W)^2, psi = 2 am(K(m) - W t / 2 | m).

    Parameters
    ----------
    n : int
        Number of cells. The library's is 40, over 20 s; 2 over 10 s is common.
    """

    name = "A02"
    title = "N-four-bar"
    source = _LIBRARY
    measure = (
        "largest error of position and velocity of the first crank's tip, each divided by its "
        "value or 1e-3, whichever is larger"
    )
    limits = (
        Limit("low precision", 1e-1, _LIBRARY),
        Limit("high precision", 1e-3, _LIBRARY),
    )
    published = (
        Published(
            "OpenSim 3.2", "N = 2, 10 s", 0.455, "", "Core i5-4570",
            "RehabEngGroup/MBSbenchmarksInOpenSim, A02",
        ),
        Published(
            "EXUDYN", "N = 2, 10 s, dt = 0.01", 0.0776, "energy within 0.114 J", "Core i9",
            "jgerstmayr/EXUDYN, fourBarMechanismIftomm.py",
        ),
    )  # fmt: skip

    n: int = 2

    def __post_init__(self) -> None:
        check_count("n", self.n, most=MOST_JOINTS)

    @property
    def duration(self) -> float:
        """20 s, as the library has it; 10 s for two cells, as others have it."""
        return 10.0 if self.n == 2 else 20.0

    @property
    def setting(self) -> Setting:
        """Steps of one size, for adaptive ones crowd about the singular posture.

        There the error of an acceleration is its rounding over sin(theta)^2: the nearer a stage
        comes, the worse. These steps pass at 1e-4 rad or more; with n = 40 and 0.008 s, or n = 2
        and 0.00125 s, a stage comes within 2e-5 rad and the motion is lost. What is left, drift
        control at 25 /s or more has to take out within half a turn; a small weight and several
        iterations keep the solve exact where J M^-1 J^T has eigenvalues of 1e-6.
        """
        solver = Proximal(mu=1e-8, max_iterations=10, relative_accuracy=1e-12)
        if self.n == 2:
            return Setting(5e-4, RungeKutta4(), Baumgarte.critical(70.0), solver)
        return Setting(0.01, RungeKutta4(), Baumgarte.critical(30.0), solver)

    @cached_property
    def scene(self) -> Scene:
        """The mechanism `n_four_bar`: 3 N rows of rank 2 N."""
        robot = n_four_bar(self.n)
        return Scene(robot, robot.loops)

    @property
    def q0(self) -> Array:
        """Square."""
        return np.array(self.scene.robot.postures["square"])

    @property
    def v0(self) -> Array:
        """Every crank at -1 rad/s, the couplers level."""
        v = np.full(2 * self.n + 1, -1.0)
        v[1::2] = 1.0
        return v

    def observe(self, q: Array, v: Array) -> Array:
        """Return position and velocity of the first crank's tip, x z x' z' [m, m/s]."""
        return _tip(float(q[0]), float(v[0]))

    def answer(self, t: float) -> Array:
        """Return position and velocity of the first crank's tip [m, m/s]."""
        w2 = _GRAVITY * ((self.n + 1) / 2 + self.n) / ((self.n + 1) / 3 + self.n)
        W2 = 1 + 4 * w2
        u = ellipkm1(1 / W2) - math.sqrt(W2) * t / 2  # K(m), with 1 - m = 1 / W^2
        _, _, dn, am = ellipj(u, 4 * w2 / W2)
        return _tip(2 * am - math.pi / 2, -math.sqrt(W2) * dn)

    def error(self, found: Array, wanted: Array) -> float:
        """Return the largest error, relative as the library has it.

        The library averages over samples and quantities; the largest is never less.
        """
        scale = np.maximum(np.abs(wanted), _THRESHOLD)
        return float((np.abs(found - wanted) / scale).max())


def _tip(theta: float, rate: float) -> Array:
    x, z = math.cos(theta), math.sin(theta)
    return np.array([x, z, -z * rate, x * rate])
