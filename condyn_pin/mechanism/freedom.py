"""Freedom of a floating robot: how it can still move as one body, its joints held.

With the columns of J that belong to the base, J_b (m, 6), these are the twists of its null space,

    J_b (v, omega) = 0.

A robot on two points turns about the line through them; on one, any way about it; what glides on a
plane shifts in it. Each is told in words: pure shifts first, then turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import null_space, rank_of
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene

_SMALL = 1e-6  # a component of a unit vector, or a distance [m], that counts as zero

Points = Sequence[tuple[str, Array]]


def base_freedom(scene: Scene, q: Array) -> Iterator[str]:
    """Say for every floating base that the constraints hold how it can still move."""
    model, equations = scene.robot.model, equations_of(scene)
    J = equations.jacobian(q)
    ends = equations.placements(q)
    for i in range(1, model.njoints):
        name, joint = model.names[i], model.joints[i]
        alone = len(model.subtrees[i]) == 1  # a body without joints: mobility says it
        if model.parents[i] or alone or joint.shortname() != "JointModelFreeFlyer":
            continue
        J_b = J[:, joint.idx_v : joint.idx_v + 6].copy()
        of_robot = set(model.subtrees[i])
        for bound in scene.bounds:
            if bound.within(of_robot):
                J_b[bound.rows] = 0.0  # a loop of the robot itself holds nothing as one body
        free = null_space(J_b) if len(J_b) else np.eye(6)
        if len(free) in (0, 6):  # held, or flying
            continue
        oMb = equations.data.oMi[i]
        twists = np.array([oMb.toActionMatrix() @ twist for twist in free])
        points = _points(scene, ends, np.abs(J_b).max(axis=1))
        yield (
            f"{listed([each for each, _ in points])}: held by this, what hangs on {name} can still "
            f"{_told(twists, points)}, as one body with its joints held"
        )


def _points(scene: Scene, ends: Sequence[Any], sizes: Array) -> Points:
    """Return names of the constraints that hold the base, and where in the world."""
    found = []
    for bound, pair in zip(scene.bounds, ends, strict=True):
        if pair is not None and sizes[bound.rows].any():
            found.append((bound.name, np.array(pair[bound.on_robot].translation)))
    return found


def _told(twists: Array, points: Points) -> str:
    """Return in words how a body can move, from twists (k, 6) at the origin of the world."""
    _, S, Vt = np.linalg.svd(twists[:, 3:].T)
    turning = rank_of(S)
    mixed = Vt @ twists  # the last ones do not turn
    turns, shifts = mixed[:turning], mixed[turning:, :3]
    # what can be shifted besides is no part of a turn
    turns = np.hstack([turns[:, :3] - turns[:, :3] @ _projector(shifts), turns[:, 3:]])
    told = [_shifts(shifts)] if len(shifts) else []
    if len(turns) == 1:
        told.append(_turn(turns[0], shifts, points))
    elif len(turns):
        told.append(_turns(turns, points))
    return " and ".join(told)


def _shifts(shifts: Array) -> str:
    if len(shifts) == 1:
        return f"shift along {_direction(shifts[0])}"
    if len(shifts) == 2:
        return f"shift in the plane across {_direction(np.cross(*shifts))}"
    return "shift any way"


def _turn(twist: Array, shifts: Array, points: Points) -> str:
    v, omega = twist[:3], twist[3:]
    size = float(np.linalg.norm(omega))
    along = omega / size
    pitch = float(v @ along) / size  # [m/rad]
    if len(shifts) > 1 and np.linalg.norm(shifts @ along) < _SMALL:
        return f"turn about {_direction(along)}"  # anywhere in the plane
    middle = np.cross(along, v) / size
    on = [name for name, x in points if np.linalg.norm(np.cross(along, x - middle)) < _SMALL]
    if len(on) > 1:
        where = f"turn about the line through {listed(on)}"
    else:
        through = on[0] if on else _point(middle)
        where = f"turn about an axis along {_direction(along)} through {through}"
    return where if abs(pitch) < _SMALL else f"{where}, moving along it by {pitch:.3g} m/rad"


def _turns(turns: Array, points: Points) -> str:
    how = "any way" if len(turns) == 3 else "about two axes"
    for name, x in points:
        # the point stands still in all of them
        if np.abs(turns[:, :3] + np.cross(turns[:, 3:], x)).max() < _SMALL:
            return f"turn {how} about {name}"
    return f"turn {how}"


def _projector(shifts: Array) -> Array:
    if not len(shifts):
        return np.zeros((3, 3))
    Q = np.linalg.qr(shifts.T)[0]
    return np.asarray(Q @ Q.T)


def _direction(x: Array) -> str:
    """Return an axis of the world, or three numbers."""
    unit = x / np.linalg.norm(x)
    largest = int(np.abs(unit).argmax())
    if np.abs(np.delete(unit, largest)).max() < _SMALL:
        return f"the world's {'xyz'[largest]}"
    return _point(np.copysign(1.0, unit[largest]) * unit)


def _point(x: Array) -> str:
    return f"({', '.join(f'{each + 0.0:.3g}' for each in np.round(x, 6))})"
