"""Following: closed configurations along a motion of the motors, never across a dead point.

The motors go from where they are to their target, in strides. In each, the dependent joints are
predicted and then corrected,

    q (+) G dq_A,     and from there J_D dq_D = -c(q) until the loops are closed.

A stride from q0 is kept if at the predicted and at the corrected configuration

    |J_D(q0)^+ J_D(q) - 1| <= 1/2     (largest singular value).

Then J_D stays regular in it, and the motors lead to one configuration only. Towards a dead point
J_D(q0)^+ grows and the strides shrink to nothing: it is reached from one side, and not crossed,
whatever the sign of det(Q^T J_D) is beyond.

References
----------
Deuflhard. Newton Methods for Nonlinear Problems. Springer, 2011, section 5.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.joints import indices
from condyn_pin.dynamics.at_state import kept_rows
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import BranchChanged, InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembling import assemble_from
from condyn_pin.mechanism.assembly import Assembly, AssemblyStatus
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import Closer

_LONGEST = 0.1  # stride of a motor [rad, m]
_SHORTEST = 1e-5  # the same: a gap of CLOSED hides a dead point that is nearer [rad, m]
_CHANGE = 0.5  # of J_D in a stride, relative
_CORRECTIONS = 10
_FARTHEST = 100.0  # that a motor is followed [rad, m]


class Follower:
    """What moves the motors of one scene, the dependent joints following.

    `actuated` and `dependent` are velocity indices; `motors` is where q holds the motors.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, model, chains = scene, scene.robot.model, chains_of(scene)
        self.actuated, self.dependent = chains.actuated, chains.dependent
        self.motors, _ = indices(model, scene.robot.actuated)
        moving = np.zeros(model.nv, dtype=bool)
        moving[self.dependent] = True
        self.closer = Closer.of(scene, moving)

    @property
    def rates(self) -> Array:
        """The rates s' of the rows of J: zero but where they are driven."""
        rates: Array = self.closer.equations.wanted[1][self.closer.rows]
        return rates

    def jacobian(self, q: Array) -> Array:
        """Return the rows of J that have a position, without what digits of a file make up."""
        (J,) = kept_rows(self._scene, self.closer.equations.jacobian(q))
        return J[self.closer.rows]

    def inverse(self, J: Array) -> Array:
        """Return J_D^+."""
        J_D = J[:, self.dependent]
        if not J_D.size:
            return np.zeros(J_D.shape[::-1])
        return np.asarray(np.linalg.pinv(J_D, rcond=tolerances.DEAD_POINT), dtype=np.float64)

    def G(self, J: Array) -> Array:
        """Return dq/dq_A (nv, n_actuated) in tangent columns."""
        A = self.actuated
        G = np.zeros((J.shape[1], A.size))
        G[A, np.arange(A.size)] = 1.0
        G[self.dependent] = -self.inverse(J) @ J[:, A]
        return G

    def follow(self, start: Array, target: Array) -> tuple[Array, float]:
        """Move the motors of a closed configuration towards a target, which has them elsewhere.

        Return the last configuration reached, closed, and the share of the way: less than 1 if the
        strides shrank to nothing.
        """
        model = self.closer.equations.model
        whole = np.array(pin.difference(model, start, target))[self.actuated]
        length = max(float(np.abs(whole).max()), _SHORTEST)
        q, share, stride = start, 0.0, _LONGEST / length
        while share < 1.0 and stride * length >= _SHORTEST:
            aim = 1.0 if share + stride >= 1.0 else share + stride
            there = np.array(pin.interpolate(model, start, target, aim)) if aim < 1.0 else target
            end = self._stride(q, (aim - share) * whole, there)
            if end is None:
                stride = (aim - share) / 2
            else:
                q, share, stride = end, aim, min(1.5 * stride, _LONGEST / length)
        return q, share

    def _stride(self, q: Array, dq_A: Array, there: Array) -> Array | None:
        """Return the end of a stride, or None if it is too long."""
        J = self.jacobian(q)
        inverse = self.inverse(J)
        dq = np.zeros(J.shape[1])
        dq[self.actuated] = dq_A
        dq[self.dependent] = -inverse @ (J[:, self.actuated] @ dq_A)
        predicted = np.array(pin.integrate(self.closer.equations.model, q, dq))
        predicted[self.motors] = there[self.motors]
        if self._change(inverse, predicted) > _CHANGE:
            return None
        end = self.closer.close(predicted, most=_CORRECTIONS)
        if end.size > tolerances.CLOSED or self._change(inverse, end.q) > _CHANGE:
            return None
        return end.q

    def _change(self, inverse: Array, q: Array) -> float:
        """Return |J_D(q0)^+ J_D(q) - 1|; 1 or more if J_D(q0) is singular."""
        change = inverse @ self.jacobian(q)[:, self.dependent] - np.eye(len(inverse))
        return float(np.linalg.norm(change, 2)) if change.size else 0.0


def with_motors(follower: Follower, start: Array, q_actuated: ArrayLike) -> Array:
    """Return the start with the motors where they are to be."""
    model, motors = follower.closer.equations.model, follower.motors
    target = start.copy()
    target[motors] = finite("q_actuated", q_actuated, motors.size)
    target = normalised(model, "q_actuated", target)
    farthest = float(np.abs(pin.difference(model, start, target)).max())
    if not farthest <= _FARTHEST:
        raise InvalidArgument(
            f"q_actuated: a motor is {farthest:.3g} rad or m from where it is in `near`; "
            f"at most {_FARTHEST:g} are followed"
        )
    return target


def drive(scene: Scene, follower: Follower, start: Array, target: Array) -> Assembly:
    """Close the start, and move the motors from there."""
    moving, motors = follower.closer.moving, follower.motors
    first = assemble_from(scene, start, moving, within_limits=False)
    if not first.status.ok:
        error = first.error()
        raise type(error)(f"where the motors start, {error}", first)
    q, share = follower.follow(first.q, target)
    there = q.copy()
    there[motors] = target[motors]
    last = assemble_from(scene, there, moving, within_limits=False)
    if share == 1.0:
        return last
    way = f"the motors were followed for {share:.1%} of the way from `near`"
    if not last.closed:
        raise NotAssembled(f"{way}; {last.error()}", last)
    J = follower.closer.equations.jacobian(q)
    loops = chains_of(scene).weakest(J)
    last = replace(last, status=AssemblyStatus.BRANCH_CHANGED, flipped=(loops,))
    raise BranchChanged(
        f"{loops}: {way}, up to a dead point; beyond, they lead to more than one configuration: "
        "pass a `near` on the side that is meant",
        last,
    )
