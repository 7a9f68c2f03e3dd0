"""Cassie's loops closed twice, the second time by balls nearby."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import z_along
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import (
    Case,
    Rng,
    by_reference,
    closed,
    extreme,
    near,
    powers,
    torques,
    unit,
)
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.robot import Robot


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_loops(severity: float, rng: Rng) -> Case:
    """Angle about its joint from each ball that closes a loop of Cassie to a second one [rad].

    Two balls are a hinge about the line through them, however near they are: each loop loses the
    two other turns.
    """
    cassie = load_robot("cassie", precision=tolerances.ROUNDED_GEOMETRY)
    once = closed(cassie)
    q, _ = once.sample(rng)
    tau = torques(once, rng)
    seconds, hinges, model = [], [], pin.Model(cassie.model)
    for ball in cassie.loops:
        _add_frames(model, cassie, ball, severity * unit(rng), q)
        name = ball.name
        seconds.append(Loop(f"{name}/second_a", f"{name}/second_b"))
        hinges.append(Loop(f"{name}/hinge_a", f"{name}/hinge_b", "hinge", axis="z"))
    cassie = replace(cassie, model=model, postures={"closed": q})
    hinged = Scene(cassie, hinges)
    v = project_velocity(hinged, q, rng.normal(size=cassie.nv))
    held, free = by_reference(hinged, q, v, tau), by_reference(once, q, v, tau)
    right = near(severity, held, free)
    return Case(Scene(cassie, [*once.constraints, *seconds]), q, v, tau, right)


def _add_frames(model: Any, robot: Robot, ball: Constraint, turn: Array, q: Array) -> None:
    """Add both frames of a second ball to a model, and of the hinge that two balls are.

    The second ball is the first, turned about the joint that carries it: it moves by 2 sin(angle/2)
    along the chord, which is the axis of the hinge. On the other body it is where it meets at q.
    `turn` is axis times angle [rad]; the model is written to.
    """
    (a, one), (b, two) = (robot.frame(frame) for frame in ball.frames)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    chord = pin.exp3(turn / 2) @ np.cross(axis, one.translation)
    moved = 2 * math.sin(angle / 2) * chord
    turned = pin.exp3(turn) @ one.rotation
    along = z_along(chord)
    there = data.oMi[b].rotation.T @ data.oMi[a].rotation
    for name, joint, place, axes in (
        ("second_a", a, one.translation + moved, turned),
        ("second_b", b, two.translation + there @ moved, there @ turned),
        ("hinge_a", a, one.translation, along),
        ("hinge_b", b, two.translation, there @ along),
    ):
        name, placement = f"{ball.name}/{name}", pin.SE3(axes, place)
        model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.OP_FRAME))
