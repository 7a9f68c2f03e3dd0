"""Completion: the state of the passive joints from those of the motors.

With the columns of J split into motors A, dependent joints D and the rest,

    J_D dq_D + J_A dq_A = 0,     G = dq/dq_A = ( I on A,  -J_D^+ J_A on D,  0 on the rest ).

The rest is what neither motors nor loops determine, such as a floating base, springs, or the spin
of a rod: it stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, finite
from condyn_pin.errors import InvalidArgument
from condyn_pin.rows.equations import Equations
from condyn_pin.states.assembly import assemble_from
from condyn_pin.states.assembly_report import Assembly

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

_STRIDE = 0.1  # of a motor, between two closings on the way [rad, m]
_FARTHEST = 100.0  # that a motor is followed [rad, m]


@dataclass(frozen=True, eq=False)
class CompleteState:
    """The whole state that belongs to a state of the motors.

    Attributes
    ----------
    q : (nq,) array
    v : (nv,) array
        G times the velocities of the motors.
    G : (nv, n_actuated) array
        dq/dq_actuated, in tangent columns.
    undetermined : int
        Directions in which the robot can still move with the motors held. Of these, q and v are
        those of `near`, at rest.
    conflicting : int
        Conditions among the motors themselves: more than zero if there are more motors than
        degrees of freedom. Then G holds only for motions of the motors that fit together.
    residual : float
        max abs(c(q)) [m, rad].
    assembly : Assembly
        The last closing, with branch and smallest singular value.
    """

    q: Array
    v: Array
    G: Array
    undetermined: int
    conflicting: int
    residual: float  # [m, rad]
    assembly: Assembly


def complete_state(
    scene: Scene, q_actuated: ArrayLike, v_actuated: ArrayLike | None, near: ArrayLike | None
) -> CompleteState:
    """Return the whole state of a scene from its motors; see `Scene.complete_state`."""
    robot, model, chains = scene.robot, scene.robot.model, scene.chains
    robot.check_unedited()
    A, D = chains.actuated, chains.dependent
    if not A.size:
        raise InvalidArgument(
            f"{robot.name} has no actuated joints: dataclasses.replace(robot, actuated=[...])"
        )
    v_A = np.zeros(A.size) if v_actuated is None else finite("v_actuated", v_actuated, A.size)
    start = scene.audit.q if near is None else normalised(model, "near", near)
    assembly = _drive(scene, start, q_actuated)
    J = Equations(model, scene.bounds).jacobian(assembly.q)[chains.rows]
    G = np.zeros((robot.nv, A.size))
    G[A, np.arange(A.size)] = 1.0
    if D.size:
        G[D] = -np.linalg.lstsq(J[:, D], J[:, A], rcond=tolerances.DEAD_POINT)[0]
    passive = np.delete(J, A, axis=1)
    known = _rank(passive)
    return CompleteState(
        q=assembly.q,
        v=G @ v_A,
        G=G,
        undetermined=passive.shape[1] - known,
        conflicting=_rank(J) - known,
        residual=max((gap.size for gap in assembly.gap.values()), default=0.0),
        assembly=assembly,
    )


def _drive(scene: Scene, start: Array, q_actuated: ArrayLike) -> Assembly:
    """Move the motors in small strides, the dependent joints following."""
    model, chains = scene.robot.model, scene.chains
    joints = [model.joints[model.getJointId(name)] for name in scene.robot.actuated]
    iq = np.array([j.idx_q + k for j in joints for k in range(j.nq)], dtype=np.int_)
    target = start.copy()
    target[iq] = finite("q_actuated", q_actuated, iq.size)
    target = normalised(model, "q_actuated", target)
    moving = np.zeros(model.nv, dtype=bool)
    moving[chains.dependent] = True
    farthest = float(np.abs(pin.difference(model, start, target)).max())
    if not farthest <= _FARTHEST:
        raise InvalidArgument(
            f"q_actuated: a motor is {farthest:.3g} rad or m from where it is in `near`; "
            f"at most {_FARTHEST:g} are followed"
        )
    q = start
    for share in np.linspace(0.0, 1.0, 2 + int(farthest / _STRIDE))[1:]:
        there = np.array(pin.interpolate(model, start, target, float(share)))
        q = q.copy()
        q[iq] = there[iq] if share < 1.0 else target[iq]
        assembly = assemble_from(scene, q, moving, within_limits=False)
        if not assembly.status.ok:
            raise assembly.error()
        q = assembly.q
    return assembly


def _rank(J: Array) -> int:
    S = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(tolerances.DEAD_POINT * S.max(initial=0.0) < S))
