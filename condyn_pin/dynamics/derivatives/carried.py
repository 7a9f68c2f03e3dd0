"""Joints whose axes turn with their own q.

    v_J = S(q) v

Pinocchio's derivatives of velocities, accelerations and torques, and its Coriolis matrix, take S
for constant in the axes of the body. Where it is not, and the joint is made of others
(SphericalZYX, Universal, Composite), the same joint as its parts in series, with nothing between
them, has the same q, v, M and h, and every S is constant.

What turns still is not made of other joints: it is carried by a free body,

    nu = Phi(q) v,    nu' = Phi a + c,    c = Phi' v

whose velocity nu has axes that do not turn, so that all derivatives are known there. The joint
hands on what its axes S, the blocks of Phi, feel of them,

    r = Phi^T r~(nu', nu),        s = s~(nu', nu)

and the derivatives are those of the chain

    dr = Phi^T (r~_q Phi dq + r~_v dnu + M~ dnu') + (Phi_q dq)^T r~,    ds the same with J~ for M~.

S is a few sines of q, so that S_q is differenced to rounding:

    f'(0) d ~ sum_j w_j (f(j h d) - f(-j h d)) / h,    wrong by h^8 f^(9) / 630
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import Indices, turning
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.rows.bound import AnyBound

_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-7  # [rad, m]: below the rounding of f over h


class Chain(NamedTuple):
    """How the carried state changes with that of the model, at one state."""

    Phi: Array  # (n~, n)
    v_q: Array  # (n~, n), of nu = Phi v
    a_q: Array  # (n~, n), of nu' = Phi a + c
    a_v: Array  # (n~, n), of c
    S_q: tuple[Array, ...]  # (k, 6, k) of each joint: by each of its coordinates


class _Places(NamedTuple):
    """Where coordinates are, in the model and in that with free bodies."""

    q: Indices
    v: Indices
    q_free: Indices
    v_free: Indices


class _Joint(NamedTuple):
    """A joint by itself, and where its coordinates and those of its free body are."""

    model: Any
    data: Any
    places: _Places


class Carried:
    """A model with free bodies in the place of the joints whose axes turn.

    `model` has the same joints by number, without their armature, which needs no derivatives.
    """

    def __init__(self, model: Any) -> None:
        chosen, free = turning(model), pin.Model()
        self._n = model.nv
        self._joints: list[_Joint] = []
        nothing = np.zeros(0, dtype=int)
        stay = [_Places(nothing, nothing, nothing, nothing)]
        for i in range(1, model.njoints):
            joint = model.joints[i]
            kind = pin.JointModelFreeFlyer() if i in chosen else joint
            free.addJoint(model.parents[i], kind, model.jointPlacements[i], model.names[i])
            free.inertias[i] = model.inertias[i]
            places = _places(joint, free.joints[i])
            if i in chosen:
                self._joints.append(_alone(joint, places))
            else:
                stay.append(places)
        self._stay = _Places(*map(np.concatenate, zip(*stay, strict=True)))
        free.armature[self._stay.v_free] = model.armature[self._stay.v]
        free.gravity = model.gravity
        self.model = free

    def state(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Chain]:
        """Return q, v and a of the model with free bodies, and how they change."""
        free, stay = self.model, self._stay
        Phi, v_q, a_q, a_v = np.zeros((4, free.nv, self._n))
        q_free, nu, rate = np.zeros(free.nq), np.zeros(free.nv), np.zeros(free.nv)
        Phi[stay.v_free, stay.v] = 1.0
        q_free[stay.q_free], nu[stay.v_free], rate[stay.v_free] = q[stay.q], v[stay.v], a[stay.v]
        all_S_q = []
        for joint in self._joints:
            at, its = joint.places, (q[joint.places.q], v[joint.places.v], a[joint.places.v])
            block = np.ix_(at.v_free, at.v)
            Phi[block], nu[at.v_free], rate[at.v_free] = _axes(joint, *its)
            q_free[at.q_free] = pin.SE3ToXYZQUAT(joint.data.oMi[1])
            S_q, its_v_q, its_a_q = _by_q(joint, *its)
            v_q[block], a_q[block] = its_v_q.T, its_a_q.T
            a_v[block] = its_v_q.T + np.tensordot(v[at.v], S_q, 1)
            all_S_q.append(S_q)
        return q_free, nu, rate, Chain(Phi, v_q, a_q, a_v, tuple(all_S_q))

    def back(self, chain: Chain, by_state: Array, by_a: Array, r: Array) -> Array:
        """Return what the model has for [[r_q, r_v], [s_q, s_v]] of that with free bodies.

        `by_a` (n~ + m, n~) is M~ above J~, and r (n~,) are torques and forces that move the bodies
        so.
        """
        of_q, of_v = np.hsplit(by_state, 2)
        by_q = of_q @ chain.Phi + of_v @ chain.v_q + by_a @ chain.a_q
        moved = np.hstack([by_q, of_v @ chain.Phi + by_a @ chain.a_v])
        top = chain.Phi.T @ moved[: len(r)]
        for joint, S_q in zip(self._joints, chain.S_q, strict=True):
            at = joint.places
            top[np.ix_(at.v, at.v)] += (S_q.swapaxes(1, 2) @ r[at.v_free]).T
        return np.vstack([top, moved[len(r) :]])


def _places(joint: Any, free: Any) -> _Places:
    """Return where the coordinates of a joint are, here and there."""
    return _Places(
        np.arange(joint.idx_q, joint.idx_q + joint.nq),
        np.arange(joint.idx_v, joint.idx_v + joint.nv),
        np.arange(free.idx_q, free.idx_q + free.nq),
        np.arange(free.idx_v, free.idx_v + free.nv),
    )


def _alone(joint: Any, places: _Places) -> _Joint:
    """Return a joint by itself."""
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    return _Joint(model, whole_data(model), places)


def _axes(joint: _Joint, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return S (6, k), S v and S a + c of a joint by itself."""
    data = joint.data
    pin.forwardKinematics(joint.model, data, q, v, a)
    S = np.array(data.joints[1].S).reshape(6, joint.model.nv)
    return S, np.array(data.v[1].vector), np.array(data.a[1].vector)


def _by_q(joint: _Joint, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return S_q (k, 6, k), and S v and S a + c by q, each (k, 6): one row per coordinate."""

    def moved(step: Array) -> Array:
        return np.column_stack(_axes(joint, pin.integrate(joint.model, q, step), v, a))

    rows = np.array([slope(moved, direction) for direction in np.eye(len(v))])
    return rows[:, :, :-2], rows[:, :, -2], rows[:, :, -1]


def in_series(model: Any, bounds: Sequence[AnyBound]) -> tuple[Any, tuple[AnyBound, ...]]:
    """Return model and constraints with such joints in series; the same ones if there are none."""
    if not turning(model):
        return model, tuple(bounds)
    series, last = pin.Model(), [0]
    for i in range(1, model.njoints):
        parent, placement = last[model.parents[i]], model.jointPlacements[i]
        for k, (joint, at) in enumerate(_parts(model.joints[i])):
            parent = series.addJoint(parent, joint, placement * at, f"{model.names[i]}.{k}")
            placement = pin.SE3.Identity()
        series.inertias[parent] = model.inertias[i]
        last.append(parent)
    series.armature, series.gravity = model.armature, model.gravity
    return series, tuple(bound.moved(last) for bound in bounds)


def _parts(joint: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the joints that one is made of, each with its placement on the one before."""
    name, here = joint.shortname(), pin.SE3.Identity()
    if name == "JointModelSphericalZYX":
        yield from (
            (kind(), here) for kind in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        )
    elif name == "JointModelUniversal":
        universal = joint.extract()
        for axis in (universal.axis1, universal.axis2):
            yield pin.JointModelRevoluteUnaligned(*axis.tolist()), here
    elif name == "JointModelComposite":
        composite = joint.extract()
        for part, at in zip(composite.joints, composite.jointPlacements, strict=True):
            for each, within in _parts(part):
                yield each, at * within
                at = here
    else:
        yield joint, here


def slope(function: Callable[[Array], Array], direction: Array) -> Array:
    """Return the derivative of a smooth function of a step, along a direction, at no step."""
    steps = [j * _H * direction for j in range(1, len(_WEIGHTS) + 1)]
    changes = np.array([function(step) - function(-step) for step in steps])
    return np.asarray(np.tensordot(_WEIGHTS, changes, 1) / _H)
