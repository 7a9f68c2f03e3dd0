"""The heavy top: a body that spins fast about a fixed point, for integrators on rotations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from scipy.integrate import solve_ivp

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.problems.base import Problem
from condyn_pin.lab.problems.setting import Limit, Setting
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince

_MASS: Final = 15.0  # [kg]
_INERTIA: Final = (0.234375, 0.46875, 0.234375)  # about its centre of mass [kg m^2]
_ARM: Final = 1.0  # from the fixed point to the centre of mass, along y [m]
_SPIN: Final = (0.0, 150.0, -4.61538)  # in its own axes, which start as the world's [rad/s]
_GRAVITY: Final = 9.81  # [m/s^2]


@dataclass(frozen=True)
class HeavyTop(Problem):
    """A free body whose tip a ball joint holds, axis level at first, spun at 150 rad/s about it.

    With e the unit vector along its axis, A and C its moments of inertia about the fixed point,
    across and along, and L = A e x e' + C s e the angular momentum, the spin s is constant and

        e' = L x e / A,    L' = -m g l (e x z).

    These six equations are as slow as the precession, and are integrated to rounding.
    """

    name = "heavy_top"
    title = "heavy top"
    source = (
        "Bruls, Cardona. On the use of Lie group time integrators in multibody dynamics. Journal "
        "of Computational and Nonlinear Dynamics 5, 2010"
    )
    measure = "largest distance of the centre of mass from where it should be [m]"
    limits = (
        Limit("1e-6 m", 1e-6, "this project"),
        Limit("1e-9 m", 1e-9, "this project"),
    )
    duration = 2.0  # [s]

    @property
    def setting(self) -> Setting:
        """Order 8 with adaptive steps: the motion is smooth."""
        integrator = DormandPrince(relative_tolerance=1e-11, absolute_tolerance=1e-11)
        return Setting(0.005, integrator, Baumgarte.critical(10.0))

    @cached_property
    def scene(self) -> Scene:
        """A free-flyer with its tip on the world's origin: 3 rows."""
        model = pin.Model()
        model.name = "heavy_top"
        here = pin.SE3.Identity()
        body = model.addJoint(0, pin.JointModelFreeFlyer(), here, "body")
        model.appendBodyToJoint(body, pin.Inertia(_MASS, np.zeros(3), np.diag(_INERTIA)), here)
        tip = pin.SE3(np.eye(3), np.array([0.0, -_ARM, 0.0]))
        model.addFrame(pin.Frame("tip", body, 0, tip, pin.FrameType.OP_FRAME))
        robot = Robot("heavy_top", model, postures={"level": _level()})
        return Scene(robot, [Loop("tip", "world", name="ball")])

    @property
    def q0(self) -> Array:
        """Its axis level, along y."""
        return _level()

    @property
    def v0(self) -> Array:
        """Spun about its axis, and turned a little about z."""
        return np.concatenate([np.cross(_SPIN, [0.0, _ARM, 0.0]), _SPIN])

    def observe(self, q: Array, v: Array) -> Array:
        """Return the centre of mass [m]."""
        return q[:3].copy()

    def answer(self, t: float) -> Array:
        """Return the centre of mass [m]."""
        return _ARM * np.asarray(self._axis(t))[:3]

    @cached_property
    def _axis(self) -> Any:
        """(e, L) as a function of time."""
        across = _INERTIA[0] + _MASS * _ARM**2
        e, z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
        L = np.array([across, _INERTIA[1], across]) * _SPIN

        def rates(t: float, y: Array) -> Array:
            turning = np.cross(y[3:], y[:3]) / across
            return np.concatenate([turning, -_MASS * _GRAVITY * _ARM * np.cross(y[:3], z)])

        start = np.concatenate([e, L])
        found = solve_ivp(
            rates, (0.0, self.duration), start, method="DOP853", rtol=3e-14, atol=1e-14,
            dense_output=True, max_step=1e-2,
        )  # fmt: skip
        return found.sol


def _level() -> Array:
    return np.array([0.0, _ARM, 0.0, 0.0, 0.0, 0.0, 1.0])
