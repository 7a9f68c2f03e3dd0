"""A04: Bricard's loop, which counting says cannot move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.problems.base import Problem
from condyn_pin.lab.problems.setting import Limit, Published, Setting
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince

_GRAVITY: Final = 9.81  # [m/s^2]
_AXIAL: Final = 0.1**2 / 6  # inertia of a rod of 1 kg, 1 m and 0.1 m x 0.1 m [kg m^2]
_ACROSS: Final = (1 + 0.1**2) / 12  # [kg m^2]

# The library's axes, y up: where the rods begin and end with every angle zero, and their hinges.
_POINTS: Final = np.array(
    [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], dtype=float
)
_AXES: Final = np.array([(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)

_NODES: Final = 256  # of the trapezoidal rule; 64 already give 15 digits


@dataclass(frozen=True)
class Bricard(Problem):
    """Five rods and the ground, six hinges each at a right angle to the next, from rest.

    The loop closes with the odd hinges at a and the even ones at b, and moves by its energy:

        sin b = -sin a / (1 + sin a),    m(a) a'^2 / 2 + V(a) = V(0),    0 <= a <= pi.

    With a = (pi / 2) (1 - cos s) the turning points disappear, and time is the integral of a smooth
    periodic function of s: its cosine series converges to rounding.
    """

    name = "A04"
    title = "Bricard's mechanism"
    source = "IFToMM library of computational benchmark problems, A04"
    measure = "largest distance of the end of rod 2 from where it should be [m]"
    limits = (
        Limit("1e-6 m", 1e-6, "this project"),
        Limit("1e-10 m", 1e-10, "this project"),
    )
    published = (
        Published(
            "OpenSim 3.2", "10 s", 0.258, "", "Core i5-4570",
            "RehabEngGroup/MBSbenchmarksInOpenSim, A04",
        ),
        Published(
            "EXUDYN", "10000 steps", 3.57, "", "not stated",
            "jgerstmayr/EXUDYN, bricardMechanism.py",
        ),
    )  # fmt: skip
    duration = 10.0  # [s]

    @property
    def setting(self) -> Setting:
        """Order 8 with adaptive steps: the motion is smooth."""
        integrator = DormandPrince(relative_tolerance=1e-7, absolute_tolerance=1e-7)
        return Setting(0.025, integrator, Baumgarte.critical(10.0))

    @cached_property
    def scene(self) -> Scene:
        """The robot `bricard` with its loops: 6 rows of rank 4."""
        robot = load_robot("bricard")
        return Scene(robot, robot.loops)

    @property
    def q0(self) -> Array:
        """Along the edges of a cube."""
        return np.array(self.scene.robot.postures["home"])

    def observe(self, q: Array, v: Array) -> Array:
        """Return the end of rod 2 in the library's axes [m]."""
        model, data = self._model_and_data
        pin.forwardKinematics(model, data, q)
        x, y, z = data.oMi[model.getJointId("theta2")].act(np.array([1.0, 0.0, 0.0]))
        return np.array([x, z, -y])

    def answer(self, t: float) -> Array:
        """Return the end of rod 2 in the library's axes [m]."""
        a, _ = self.motion(t)
        z = -math.sin(a) / (1 + math.sin(a))
        return np.array([math.cos(a) / (1 + math.sin(a)), -math.sqrt(1 - z * z), z])

    def motion(self, t: float) -> tuple[float, float]:
        """Return a [rad] and a' [rad/s] at a time."""
        mean, c = self._series
        k = np.arange(1, len(c) + 1)
        s = t / mean
        for _ in range(50):
            late = mean * s + float(c / k @ np.sin(k * s)) - t
            slowness = mean + float(c @ np.cos(k * s))
            s -= late / slowness
            if abs(late) < 1e-15 * max(1.0, t):
                break
        return math.pi / 2 * (1 - math.cos(s)), math.pi / 2 * math.sin(s) / slowness

    @cached_property
    def _series(self) -> tuple[float, Array]:
        """The mean and the cosines of dt/ds [s]."""
        s = (np.arange(_NODES) + 0.5) * 2 * math.pi / _NODES
        dt_ds = np.array([_slowness(each) for each in s])
        k = np.arange(1, _NODES // 4)
        return float(dt_ds.mean()), 2 * np.cos(np.outer(k, s)) @ dt_ds / _NODES


def _slowness(s: float) -> float:
    """Return dt/ds [s]: (pi / 2) |sin s| sqrt(m / (2 (V(0) - V)))."""
    inertia, height = _inertia_and_height(math.pi / 2 * (1 - math.cos(s)))
    start = float((_POINTS[:-1] + _POINTS[1:])[:, 1].sum()) / 2
    fallen = _GRAVITY * (start - height)
    return math.pi / 2 * abs(math.sin(s)) * math.sqrt(inertia / (2 * fallen))


def _inertia_and_height(a: float) -> tuple[float, float]:
    """Return m(a) [kg m^2] and the sum of the rods' heights [m], the loop closed at a."""
    b = math.asin(-math.sin(a) / (1 + math.sin(a)))
    db_da = -math.cos(a) / ((1 + math.sin(a)) ** 2 * math.cos(b))
    R, p = np.eye(3), np.zeros(3)
    omega, end_velocity = np.zeros(3), np.zeros(3)
    inertia = height = 0.0
    for i, axis in enumerate(_AXES):
        angle, rate = (b, db_da) if i % 2 else (a, 1.0)
        omega = omega + R @ axis * rate
        R = R @ _turn(axis, angle)
        rod = R @ (_POINTS[i + 1] - _POINTS[i])
        velocity = end_velocity + np.cross(omega, rod / 2)
        spin = _ACROSS * (omega @ omega) + (_AXIAL - _ACROSS) * (omega @ rod) ** 2
        inertia += float(velocity @ velocity + spin)
        height += float(p[1] + rod[1] / 2)
        p, end_velocity = p + rod, end_velocity + np.cross(omega, rod)
    return inertia, height


def _turn(axis: Array, angle: float) -> Array:
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R: Array = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K
    return R
