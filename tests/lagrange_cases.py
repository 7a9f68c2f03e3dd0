"""A rod pendulum and a closed arm, each twice: as equations of SymPy, and as a scene."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp
from lagrange import Rows, System

import condyn_pin as cp

GRAVITY = sp.Rational(981, 100)  # [m/s^2]
MASS, LENGTH, PIVOT = sp.Rational(3, 2), sp.Rational(4, 5), sp.Matrix([sp.Rational(1, 5), 1])
LINKS = sp.Rational(1, 2), sp.Rational(2, 5), sp.Rational(3, 10)  # [m]
MASSES = 2, sp.Rational(3, 2), 1  # [kg]
HOOK = sp.Matrix([sp.Rational(3, 5), sp.Rational(-2, 5)])  # x and z [m]

DRIFTS = {
    "no drift control": None,
    "underdamped": cp.Baumgarte(3.0, 5.0),
    "critical": cp.Baumgarte(4.0, 4.0),
    "overdamped": cp.Baumgarte(6.0, 4.0),
}
each_drift = pytest.mark.parametrize("drift", DRIFTS.values(), ids=list(DRIFTS))


@dataclass(frozen=True, eq=False)
class Case:
    """The same mechanism twice: as equations of SymPy, and as a scene."""

    system: System
    scene: cp.Scene

    @functools.cached_property
    def kept(self) -> list[int]:
        """Rows in the plane: all, but for the y of a ball."""
        return [0, 2] if self.scene.rows == 3 else list(range(self.scene.rows))

    def states(self, closed: bool, count: int = 3):
        """Yield (q, v, tau), moving, on the constraints or far off."""
        rng = np.random.default_rng(11)
        for _ in range(count):
            q, v = self.scene.sample(rng) if closed else rng.normal(size=(2, self.system.n))
            yield q, v, 3 * rng.normal(size=self.system.n)


def in_the_plane(x, z) -> np.ndarray:
    return np.array([float(x), 0.0, float(z)])


@functools.cache
def rod_pendulum() -> Case:
    """A point mass at (x, z), a rod to the pivot: L = m (x'^2 + z'^2) / 2 - m g z."""
    q, v = sp.Matrix(sp.symbols("x z", real=True)), sp.Matrix(sp.symbols("vx vz", real=True))
    r = q - PIVOT
    c = sp.Matrix([LENGTH - sp.sqrt(r.dot(r))])
    L = MASS * v.dot(v) / 2 - MASS * GRAVITY * q[1]

    model, here = pin.Model(), pin.SE3.Identity()
    x = model.addJoint(0, pin.JointModelPX(), here, "x")
    z = model.addJoint(x, pin.JointModelPZ(), here, "z")
    point = pin.Inertia(float(MASS), np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(z, point, here)
    model.addFrame(pin.Frame("mass", z, 0, here, pin.FrameType.OP_FRAME))
    robot = cp.Robot("point mass", model, precision=0.0).with_frame(
        "pivot", "world", in_the_plane(*PIVOT)
    )
    rod = cp.Loop("pivot", "mass", "rod", length=float(LENGTH))
    return Case(System(q, v, L, Rows.of(c, q, v)), cp.Scene(robot, [rod]))


def arm_robot() -> cp.Robot:
    """Three slender rods that turn about y, m l^2 / 12 across; a frame at the tip."""
    model, joint, at = pin.Model(), 0, np.zeros(3)
    for length, mass in zip(map(float, LINKS), map(float, MASSES), strict=True):
        place = pin.SE3(np.eye(3), at)
        joint = model.addJoint(joint, pin.JointModelRY(), place, f"joint{joint}")
        at = np.array([length, 0.0, 0.0])
        across = mass * length**2 / 12
        rod = pin.Inertia(mass, at / 2, np.diag([0.0, across, across]))
        model.appendBodyToJoint(joint, rod, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), at)
    model.addFrame(pin.Frame("tip", joint, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("arm", model, precision=0.0).with_frame("hook", "world", in_the_plane(*HOOK))


@functools.cache
def arm(closure: str) -> Case:
    """Three rods in the plane x-z, the tip held: L = sum m v_c^2 / 2 + I w^2 / 2 - m g z_c.

    With C = tip - hook and R the axes of the last rod, the closures mean

        planar, the hook first     c = -C                         in the axes of the world
        planar, the tip first      c = R^T C, its derivatives with the turning of R
        ball, point                c = R^T C, J v = R^T C', J a + gamma = R^T C''
    """
    q, v = sp.Matrix(sp.symbols("q1:4", real=True)), sp.Matrix(sp.symbols("v1:4", real=True))
    end, L = sp.zeros(2, 1), sp.Integer(0)
    for k, (length, mass) in enumerate(zip(LINKS, MASSES, strict=True)):
        angle, rate = sum(q[: k + 1]), sum(v[: k + 1])  # about y: from x to -z
        along = sp.Matrix([sp.cos(angle), -sp.sin(angle)])
        centre, end = end + along * length / 2, end + along * length
        velocity = centre.jacobian(q) * v
        inertia = mass * length**2 / sp.Integer(12)
        L += mass * velocity.dot(velocity) / 2 + inertia * rate**2 / 2 - mass * GRAVITY * centre[1]
    C, to_tip = end - HOOK, sp.Matrix([along.T, [-along[1], along[0]]])
    rows, constraint = {
        "planar of the world": (Rows.of(-C, q, v), cp.Loop("hook", "tip", "planar", axis="y")),
        "planar of the tip": (Rows.of(to_tip * C, q, v), cp.Loop("tip", "hook", "planar", "y")),
        "ball": (Rows.of(C, q, v).seen_in(to_tip), cp.Loop("tip", "hook", "ball")),
        "point": (
            Rows.of(C, q, v).seen_in(to_tip),
            cp.PointContact("tip", anchor=tuple(in_the_plane(*HOOK))),
        ),
    }[closure]
    return Case(System(q, v, L, rows), cp.Scene(arm_robot(), [constraint]))


CASES = {
    "rod pendulum": rod_pendulum,
    **{
        f"arm, {closure}": functools.partial(arm, closure)
        for closure in ("planar of the world", "planar of the tip", "ball", "point")
    },
}
each_case = pytest.mark.parametrize("case", CASES.values(), ids=list(CASES))
each_place = pytest.mark.parametrize("closed", [True, False], ids=["closed", "open"])


def gains(drift: cp.Baumgarte | None) -> tuple[float, float]:
    return (drift.alpha, drift.beta) if drift else (0.0, 0.0)


def assert_near(found: np.ndarray, wanted: np.ndarray, share: float) -> None:
    """|found - wanted| <= share max(1, |wanted|), with the largest entries."""
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() <= share * max(1.0, np.abs(wanted).max())
