"""Completion: the state of the passive joints from those of the motors.

With the columns of J split into motors A, dependent joints D and the rest,

    J_D dq_D + J_A dq_A = 0,     G = dq/dq_A = ( I on A,  -J_D^+ J_A on D,  0 on the rest ).

Where rows are driven, c(q) = s(t), the motors leave J_D v_D = s'(t) - J_A v_A:

    v = G v_A + ( 0 on A,  J_D^+ s' on D,  0 on the rest ).

The rest is what neither motors nor loops determine, such as a floating base, springs, or the spin
of a rod: it stays where it is. `condyn_pin.mechanism.following` moves the motors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import counted, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg import rank_of
from condyn_pin.constraints.rows.bound import beyond_text
from condyn_pin.dynamics.scene import Scene, check_time
from condyn_pin.errors import InvalidArgument, NotAssembled, UnsupportedConstraint
from condyn_pin.mechanism.assembling import check_held, limited, nominal_configuration
from condyn_pin.mechanism.assembly import Assembly, AssemblyStatus
from condyn_pin.mechanism.closed_chains import ClosedChains, chains_of
from condyn_pin.mechanism.following import Follower, drive, with_motors


@dataclass(frozen=True, eq=False)
class CompleteState:
    """The whole state that belongs to given motor positions and speeds.

    v = G v_actuated + J_D^+ s'

    Attributes
    ----------
    q : (nq,) array
        Configuration [rad, m].
    v : (nv,) array
        G times the velocities of the motors, and what driven rows add: J_D^+ s'.
    G : (nv, n_actuated) array
        dq/dq_actuated, in tangent columns [1, m, 1/m].
    undetermined : int
        Directions in which the robot can still move with the motors held. Of these, q and v are
        those of `near`, at rest.
    conflicting : int
        Conditions among the motors themselves: more than zero if there are more motors than degrees
        of freedom. Then G holds only for motor motions that are compatible with each other.
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

    def __str__(self) -> str:
        lines = [str(self.assembly)]
        free = counted(self.undetermined, "direction")
        lines.append(f"{free} that neither motors nor loops determine")
        if self.conflicting:
            lines.append(f"{counted(self.conflicting, 'condition')} among the motors themselves")
        lines += [
            f"{label} = {np.array2string(x, precision=6, suppress_small=True)}"
            for label, x in (("q", self.q), ("v", self.v))
        ]
        return "\n".join(lines)


@one_blas_thread
def complete_state(
    scene: Scene,
    q_actuated: ArrayLike,
    v_actuated: ArrayLike | None = None,
    *,
    near: ArrayLike | None = None,
    within_limits: bool = True,
) -> CompleteState:
    """Return the whole state from the motor positions and speeds that encoders measure.

    c(q) = 0,    v = G v_actuated,    q and v of the motors as given

    Parameters
    ----------
    scene : Scene
        With driven constraints ``scene.at(t)``: c(q) = s(t) and J v = s'(t).
    q_actuated : (k,) array_like
        Positions of the actuated joints, in the order of ``robot.actuated`` [rad, m].
    v_actuated : (k,) array_like, optional
        Their velocities [rad/s, m/s]; at rest by default, but for motors that are driven.
    near : (nq,) array_like, optional
        Where everything starts that the motors do not determine, and stays if the loops do not
        either: a floating base, springs, the spin of a rod. The nominal state by default. The
        motors are followed from there, in a straight line of their coordinates and in strides
        of 0.1 rad or less, so that its branch is kept [rad, m].
    within_limits : bool
        Refuse motors outside their limits, and those that take another joint out of its.

    Returns
    -------
    CompleteState

    Raises
    ------
    InvalidArgument
        If a motor is outside its limits, or the robot has none; or if driven rows move a motor at
        another velocity.
    NotAssembled
        If the loops cannot be closed with the motors there, or only beyond joint limits; also where
        driven rows have a motor elsewhere.
    UnsupportedConstraint
        If constraints are driven and the scene does not say at which time it is, or have no place.
    BranchChanged
        If a dead point lies on the way, whether or not the loops close beyond it.
    """
    robot, model, chains = scene.robot, scene.robot.model, chains_of(scene)
    check_time(scene)
    if belts := [b.name for b in scene.bounds if b.drive and not b.positioned]:
        raise UnsupportedConstraint(
            f"{', '.join(belts)}: rows on the velocity alone say nothing of where anything is; "
            "project_velocity makes a velocity fit to them"
        )
    robot.check_unedited()
    A = chains.actuated
    if not A.size:
        raise InvalidArgument(
            f"{robot.name} has no actuated joints: dataclasses.replace(robot, actuated=[...])"
        )
    v_A = None if v_actuated is None else finite("v_actuated", v_actuated, A.size)
    start = nominal_configuration(scene) if near is None else normalised(model, "near", near)
    follower = Follower(scene)
    target = with_motors(follower, start, q_actuated)
    if within_limits:
        check_held("q_actuated", chains.limits, target, A)
    assembly = drive(scene, follower, start, target)
    if within_limits:
        _check_dependent(chains, assembly)
    J = follower.jacobian(assembly.q)
    G = follower.G(J)
    passive = np.delete(J, A, axis=1)
    known = _rank(passive)
    return CompleteState(
        q=assembly.q,
        v=_velocity(scene, follower, assembly.q, G, v_A),
        G=G,
        undetermined=passive.shape[1] - known,
        conflicting=_rank(J) - known,
        residual=max((gap.size for gap in assembly.violation.values()), default=0.0),
        assembly=assembly,
    )


def _velocity(scene: Scene, follower: Follower, q: Array, G: Array, v_A: Array | None) -> Array:
    """Return v (nv,) of the motors' v_A, or of the least that driven rows leave to them."""
    if not scene.is_driven:
        return np.zeros(len(G)) if v_A is None else G @ v_A
    J, rates = follower.jacobian(q), follower.rates
    v = np.zeros(len(G))
    v[follower.dependent] = follower.inverse(J) @ rates
    missing, fast = rates - J @ v, float(np.abs(rates).max())
    if v_A is None:
        v_A = np.zeros(G.shape[1])
        if np.abs(missing).max() > tolerances.FORCES * fast:  # motors are moved too
            v_A = np.linalg.pinv(J @ G, rcond=tolerances.DEAD_POINT) @ missing
    v = v + G @ v_A
    off = np.abs(J @ v - rates)
    if off.max() > tolerances.FORCES * max(fast, np.abs(v).max()):
        row = scene.row_names[follower.closer.rows[int(off.argmax())]]
        raise InvalidArgument(
            f"v_actuated: {row} would leave its path by {off.max():.3g} m/s or rad/s: it moves the "
            "motors too; leave v_actuated out, or give velocities that fit"
        )
    return v


def _check_dependent(chains: ClosedChains, assembly: Assembly) -> None:
    """Refuse a state in which the motors take a joint out of its limits."""
    moved = limited(chains.limits, chains.dependent)
    out = {joint: by for joint, by in assembly.beyond_limits.items() if joint in moved}
    if out:
        raise NotAssembled(
            f"with the motors there, {beyond_text(out)}; move them elsewhere, or pass "
            "within_limits=False",
            replace(assembly, status=AssemblyStatus.BEYOND_LIMITS),
        )


def _rank(J: Array) -> int:
    return rank_of(np.linalg.svd(J, compute_uv=False), tolerances.DEAD_POINT)
