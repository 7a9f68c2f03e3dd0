"""The same machine in other units of length and mass: every answer scales exactly.

With lengths times l and masses times m, and time as it is,

    angles, q', q''      1          positions, v, a of shifts   l        gravity   l
    torques              m l^2      forces                      m l      inertia   m l^2
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import Constraint, Loop
from condyn_pin.contacts import PointContact
from condyn_pin.errors import InvalidArgument
from condyn_pin.extremes.base import Case, extreme, moving
from condyn_pin.robot import Robot
from condyn_pin.scene import Scene
from condyn_pin.solvers.reference import Reference
from condyn_pin.workspace import Workspace

_SIZES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e1, 1e2, 1e3, 1e4, 1e6)


@extreme(severities=_SIZES, any_scene=True)
def other_length(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How large the machine is, times its own size; gravity grows with it."""
    return _case(scene, rng, severity, 1.0)


@extreme(severities=_SIZES, any_scene=True)
def other_mass(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How heavy the machine is, times its own mass."""
    return _case(scene, rng, 1.0, severity)


def _case(scene: Scene, rng: np.random.Generator, length: float, mass: float) -> Case:
    q, v, tau = moving(scene, rng)
    right = Workspace(scene, Reference()).solve(q, v, tau, throw=False).a
    of_q, of_v = shifts(scene.robot.model)
    along_q, along_v = np.where(of_q, length, 1.0), np.where(of_v, length, 1.0)
    torque = mass * length * np.where(of_v, 1.0, length)
    state = (along_q * q, along_v * v, torque * tau)
    return Case(scaled(scene, length, mass), *state, (along_v * right,))


def scaled(scene: Scene, length: float, mass: float) -> Scene:
    """Return the scene with every length and every mass times a number."""
    robot = scene.robot
    of_q, of_v = shifts(robot.model)
    model = pin.Model(robot.model)
    model.gravity.linear = length * model.gravity.linear
    for i in range(model.njoints):
        model.jointPlacements[i].translation *= length
        body = model.inertias[i]
        model.inertias[i] = pin.Inertia(
            mass * body.mass, length * body.lever, mass * length**2 * body.inertia
        )
    for frame in model.frames:
        frame.placement.translation *= length
    model.armature = mass * np.where(of_v, 1.0, length**2) * model.armature
    along = np.where(of_q, length, 1.0)
    postures = {name: along * q for name, q in robot.postures.items()}
    for limit in ("lowerPositionLimit", "upperPositionLimit"):
        with np.errstate(over="ignore"):  # no limit at all stays none
            setattr(model, limit, along * getattr(model, limit))
    return Scene(
        Robot(f"{robot.name} in other units", model, postures, actuated=robot.actuated),
        [_constraint(constraint, length) for constraint in scene.constraints],
    )


def shifts(model: Any) -> tuple[Array, Array]:
    """Return where q and v hold lengths: (nq,) and (nv,), one or zero."""
    of_q, of_v = np.zeros(model.nq), np.zeros(model.nv)
    for joint in model.joints:
        kind = joint.shortname().removeprefix("JointModel")
        if joint.idx_q < 0 or kind.startswith(("R", "Spherical")):
            continue
        if kind not in ("FreeFlyer", "Translation", "PX", "PY", "PZ", "PrismaticUnaligned"):
            raise InvalidArgument(f"a joint of the kind {kind} mixes angles and lengths")
        size = min(joint.nv, 3)
        of_q[joint.idx_q : joint.idx_q + size] = of_v[joint.idx_v : joint.idx_v + size] = 1.0
    return of_q, of_v


def _constraint(constraint: Constraint, length: float) -> Constraint:
    """Return a constraint with its own lengths scaled."""
    if isinstance(constraint, Loop) and constraint.length is not None:
        return replace(constraint, length=length * constraint.length)
    if isinstance(constraint, PointContact):
        if constraint.anchor is not None:
            raise InvalidArgument(f"{constraint.name}: an anchor stays where it is")
        x, y, z = constraint.offset
        return replace(constraint, offset=(length * x, length * y, length * z))
    return constraint
