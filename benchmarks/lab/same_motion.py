"""The same motion in another scene of the same machine.

The joints that are named are where they are in the source and move as they do there. The others
follow from the loops,

    c(q) = 0,    J v = 0.

Springs of the target that are locked in the source are bent as far as they have to be to carry
the load: by d = -lam_s / k, where lam_s is the torque that holds them still, so that they do not
accelerate either. Where the two scenes differ in geometry, v is the nearest one with J v = 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise
from condyn_pin._core.models import Indices, indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin._core.timing import State
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import free_flyers
from condyn_pin.model.soundness import singular_mass
from condyn_pin.model.springs import Spring

_ROUNDS = 30  # of the load on the springs; it settles by a factor of ten and more in each
_SETTLED = 1e-12  # [rad]
_LEVER = 0.1  # [m]; a force of 10 N is as dear as a torque of 1 N m


@one_blas_thread
def same_motion(source: Scene, target: Scene, state: State, joints: Sequence[str]) -> State:
    """Return (q, v, tau) in `target` for a closed state of `source`.

    `joints` of both scenes decide where the machine is: the floating base and the motors. The
    torques of the source are those of its motors; the torques returned have springs and damping
    among them, and motors that the source does not have hold their joints against gravity. Raises
    NotAssembled if the target cannot be closed there.
    """
    q, v, tau = state
    robot = target.robot
    common = [name for name in source.robot.joints if name in robot.joints]
    guess, wanted, motors = described_posture(target), np.zeros(robot.nv), np.zeros(robot.nv)
    guess[indices(robot.model, common)[0]] = q[indices(source.robot.model, common)[0]]
    _, from_v = indices(source.robot.model, joints)
    _, to_v = indices(robot.model, joints)
    wanted[to_v], motors[to_v] = v[from_v], tau[from_v]
    springs = [s for s in robot.springs if s.joint not in source.robot.joints]
    bent = [spring.joint for spring in springs]
    fixed = [*joints, *bent]
    equations = equations_of(target)
    bent_q, of_springs = indices(robot.model, bent)
    known = np.concatenate([to_v, of_springs])
    for _ in range(_ROUNDS):
        q_ = target.assemble(guess, fixed=fixed, within_limits=False).q
        v_ = _follow(equations, q_, wanted, known, of_springs)
        tau_ = motors + _hold(robot, equations, q_, joints) + robot.passive_torque(q_, v_)
        if not springs:
            break
        step = _bend(equations, (q_, v_, tau_), springs, of_springs)
        guess = q_
        guess[bent_q] += step
        if np.abs(step).max() < _SETTLED:
            break
    return q_, v_, tau_


def loaded(scene: Scene) -> Array:
    """Return the nominal configuration with the springs bent by the forces of standing there."""
    rigid = scene.lock([spring.joint for spring in scene.robot.springs])
    q, v = rigid.state()
    joints = (*free_flyers(rigid.robot), *rigid.robot.motor_joints)
    return same_motion(rigid, scene, (q, v, standing_torque(rigid, q)), joints)[0]


def standing_torque(scene: Scene, q: Array) -> Array:
    """Return the torque of the motors that keeps the robot at q, at rest.

    The smallest one with  S tau + J^T lam = h(q, 0), a force counting by `_LEVER`.
    """
    robot = scene.robot
    _, motors = indices(robot.model, robot.motor_joints)
    terms = equations_of(scene).terms(q, np.zeros(robot.nv))
    A = np.hstack([np.eye(robot.nv)[:, motors], terms.J.T / _LEVER])
    tau = np.zeros(robot.nv)
    tau[motors] = np.linalg.lstsq(A, terms.h, rcond=tolerances.RANK)[0][: len(motors)]
    return tau


def _follow(equations: Equations, q: Array, wanted: Array, known: Indices, still: Indices) -> Array:
    """Return the velocity with J v = 0 that keeps the known entries, or is nearest to them."""
    terms = equations.terms(q, 0 * wanted)
    free = np.setdiff1d(np.arange(len(wanted)), known)
    v = wanted.copy()
    v[free] = -np.linalg.lstsq(terms.J[:, free], terms.J @ wanted, rcond=tolerances.RANK)[0]
    J = np.vstack([terms.J, np.eye(len(wanted))[still]])
    return factorise(terms.M, J, tolerances.RANK, why=singular_mass(equations.model, q)).tangent(v)


def _hold(robot: Robot, equations: Equations, q: Array, joints: Sequence[str]) -> Array:
    """Return the torque against gravity in the motors that are not among `joints`."""
    _, index = indices(robot.model, [name for name in robot.motor_joints if name not in joints])
    torque = np.zeros(robot.nv)
    torque[index] = equations.terms(q, torque).h[index]
    return torque


def _bend(equations: Equations, state: State, springs: Sequence[Spring], index: Indices) -> Array:
    """Return the further deflection of the springs that carries the torques holding them."""
    q, v, tau = state
    terms = equations.terms(q, v)
    n, k = len(v), len(index)
    held = Terms(
        terms.M,
        terms.h,
        np.vstack([terms.J, np.eye(n)[index]]),
        np.concatenate([terms.gamma, np.zeros(k)]),
        np.concatenate([terms.a_ref, np.zeros(k)]),
    )
    _, lam = Reference(refinements=0).solve(held, tau)
    step: Array = -lam[-k:] / np.array([spring.stiffness for spring in springs])
    return step
