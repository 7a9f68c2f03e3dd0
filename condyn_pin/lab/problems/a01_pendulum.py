"""A01: a point mass that a massless rod holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import ellipj

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.laboratory import add_point
from condyn_pin.lab.problems.base import Problem
from condyn_pin.lab.problems.setting import Limit, Published, Setting
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince

_MASS: Final = 1.0  # [kg]
_LENGTH: Final = 1.0  # [m]
_GRAVITY: Final = 9.81  # [m/s^2]
_K: Final = math.sin(math.pi / 4)  # sin(psi / 2) at the turning points


@dataclass(frozen=True)
class SimplePendulum(Problem):
    """A point mass in the x-z plane on a rod of 1 m, let go where the rod is level.

    The mass has two coordinates, x and z, and the rod is a constraint between them. With psi the
    angle from the downward vertical and w = sqrt(g / L),

        psi'' = -w^2 sin(psi),    sin(psi / 2) = -k cd(w t | k^2),    k = sin(pi / 4).
    """

    name = "A01"
    title = "simple pendulum"
    source = "IFToMM library of computational benchmark problems, A01"
    measure = "largest distance of the mass from where it should be [m]"
    judged = "energy"
    limits = (
        Limit("5e-5 J", 5e-5, "what EXUDYN's example aims at"),
        Limit("1e-10 J", 1e-10, "this project"),
    )
    published = (
        Published(
            "OpenSim 3.2", "10 s", 0.637, "", "Core i5-4570",
            "RehabEngGroup/MBSbenchmarksInOpenSim, A01",
        ),
        Published(
            "EXUDYN", "10 s", 0.037, "energy within 5e-5 J", "Core i7",
            "jgerstmayr/EXUDYN, pendulumIftommBenchmark.py",
        ),
    )  # fmt: skip
    duration = 10.0  # [s]

    @property
    def setting(self) -> Setting:
        """Order 8, one step from sample to sample, and a gain that is not fast beside the swing."""
        integrator = DormandPrince(relative_tolerance=1e-10, absolute_tolerance=1e-10)
        return Setting(0.025, integrator, Baumgarte.critical(0.5))

    @cached_property
    def scene(self) -> Scene:
        """A mass on two sliders, 1 row."""
        model = pin.Model()
        model.name = "point_on_a_rod"
        add_point(model, "mass", {"x": pin.JointModelPX(), "z": pin.JointModelPZ()}, _MASS)
        robot = Robot("point_on_a_rod", model, postures={"level": np.array([-_LENGTH, 0.0])})
        return Scene(robot, [Loop("mass", "world", "rod", length=_LENGTH, name="rod")])

    @property
    def q0(self) -> Array:
        """The rod level, the mass on the left."""
        return np.array([-_LENGTH, 0.0])

    def observe(self, q: Array, v: Array) -> Array:
        """Return x and z of the mass [m]."""
        return q.copy()

    def answer(self, t: float) -> Array:
        """Return x and z of the mass [m]."""
        _, cn, dn, _ = ellipj(math.sqrt(_GRAVITY / _LENGTH) * t, _K**2)
        s = -_K * cn / dn  # sin(psi / 2)
        return _LENGTH * np.array([2 * s * math.sqrt(1 - s * s), 2 * s * s - 1])
