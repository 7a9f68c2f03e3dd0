"""Scenes that move as is known, each with a state to begin at."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from shared import robot

import condyn_pin as cp
from lab import drift

G = 9.81

Start = tuple[cp.Scene, np.ndarray, np.ndarray]


def body(joint, *, inertia=0.01, mass=1.0, centre=(0.0, 0.0, 0.0), damping=0.0) -> cp.Robot:
    """One body on one joint."""
    model = pin.Model()
    j = model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    moments = inertia * np.diag([1.0, 2.0, 2.5])
    model.appendBodyToJoint(j, pin.Inertia(mass, np.array(centre), moments), pin.SE3.Identity())
    model.addFrame(pin.Frame("origin", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.damping[:] = damping
    return cp.Robot("body", model)


def top() -> Start:
    """A free body whose origin is held: it spins about a point."""
    free = body(pin.JointModelFreeFlyer(), centre=(0.0, 0.0, 0.3), inertia=0.02)
    scene = cp.Scene(free, [cp.PointContact("origin")])
    return scene, pin.neutral(free.model), np.array([0.0, 0.0, 0.0, 0.5, 0.8, 9.0])


def bar(gap: float = 0.0) -> Start:
    """A four-bar, whose loop may be open."""
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    q, v = scene.state()
    return scene, q + np.array([gap, 0.0, 0.0]), v


def hanging_cassie() -> Start:
    """Cassie held by its pelvis, whose rods are damped at 2700 / s."""
    cassie = robot("cassie")
    scene = cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")])
    return scene, *scene.state()


def falling() -> tuple[cp.Scene, cp.Scene]:
    """A ball in the air, and on the floor."""
    ball = body(pin.JointModelPZ())
    return cp.Scene(ball), cp.Scene(ball, [cp.constraints.PlanarContact("origin", height=0.0)])


def rod_pendulum() -> Start:
    """A point mass in a plane at the end of a rod of 1 m, from the horizontal."""
    return drift.rod_pendulum(), np.array([1.0, 0.0]), np.zeros(2)
