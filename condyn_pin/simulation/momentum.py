"""The equations of motion as Hamilton has them, in the momentum p = M v.

    q' = v,    p' = C(q, v)^T v - g(q) + tau + J^T lam,    c(q) = 0

since p' = M v' + M' v and M' = C + C^T, with C the Coriolis matrix for which M' - 2 C is
skew-symmetric. On free-flyers and balls p is that of the body frame.

Pinocchio's C is that one where the axes of a joint do not turn with its own q: joints whose axes do
are taken apart, or carried by free bodies with velocities nu = Phi v, where

    C^T v = Phi^T C~^T nu + Phi'^T M~ nu.

References
----------
Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, chapter VII.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import turning
from condyn_pin._core.linalg.inverse import inverse
from condyn_pin.dynamics.derivatives.carried import Carried, in_series

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System

# Damping of J M^-1 J^T relative to its diagonal. Redundant rows are singular without; an iteration
# to the end makes up for what it leaves, a billionth of each gap over the smallest eigenvalue.
_DAMPING = 1e-9


class Place(NamedTuple):
    """What belongs to one configuration."""

    M: Array  # (nv, nv)
    J: Array  # (m, nv)
    M_inv: Array  # (nv, nv)
    G_inv: Array  # (m, m), of J M^-1 J^T, damped
    Md_inv: Array  # (nv, nv), of M + dt/2 D
    Gd_inv: Array  # (m, m), of J (M + dt/2 D)^-1 J^T, damped
    D: Array  # (nv, nv), damping of the robot's joints and between its frames


class Momentum:
    """The terms of one system, and what half a step of size dt makes of them."""

    def __init__(self, system: System, dt: float) -> None:
        self._system = system
        model, _ = in_series(system.model, ())
        self._carried = None
        if model is not system.model and turning(model):
            self._carried = Carried(model)
            model = self._carried.model
        # Pinocchio forms C in the world's axes and about its origin: far from there it is made of
        # differences. Where a tree stands does not matter for C and g.
        self._model, self._places = _at_origin(model)
        self._data = self._model.createData()
        self._passive, self._half = system.passive, dt / 2
        self._of_joints = np.diag(self._passive.d)

    def force(self, t: float, q: Array, v: Array) -> Array:
        """Return C^T v - g + tau (nv,)."""
        tau = self._system.torque(t, q, v)
        if self._carried is None:
            return self._pull(q, v) + tau
        q, nu, _, chain = self._carried.state(q, v, np.zeros_like(v))
        pull = chain.Phi.T @ self._pull(q, nu)
        rate = chain.a_v - chain.v_q  # Phi'
        p = np.asarray(pin.crba(self._model, self._data, q)) @ nu
        return np.asarray(pull + rate.T @ p + tau)

    def _pull(self, q: Array, v: Array) -> Array:
        """Return C^T v - g where no axes turn."""
        if self._places:
            q = q.copy()
            q[self._places] = 0.0
        C = pin.computeCoriolisMatrix(self._model, self._data, q, v)
        g = pin.computeGeneralizedGravity(self._model, self._data, q)
        return np.asarray(v.dot(C) - g)

    def velocity(self, q: Array, p: Array) -> Array:
        """Return M^-1 p (nv,)."""
        velocity: Array = dposv(self._system.mass(q), p)[1]
        return velocity

    def place(self, q: Array) -> Place:
        """Return what belongs to q."""
        M, J = self._system.mass(q), self._system.equations.jacobian(q)
        M_inv = inverse(M)
        both = M_inv, between(J, M_inv, J)
        passive = self._passive
        D = passive.damping_matrix(q) if passive.between else self._of_joints
        if not D.any():
            return Place(M, J, *both, *both, D)
        Md_inv = inverse(M + self._half * D)
        return Place(M, J, *both, Md_inv, between(J, Md_inv, J), D)


def between(J1: Array, M_inv: Array, J: Array) -> Array:
    """Return (J1 M^-1 J^T)^-1 (m, m), damped."""
    G: Array = J1.dot(M_inv).dot(J.T)
    if len(G):
        # rows across a plane may all be zero
        G[np.diag_indices(len(G))] += _DAMPING * (G.diagonal().max() or 1.0)
    return inverse(G)


def _at_origin(model: Any) -> tuple[Any, list[int]]:
    """Return a model whose trees begin at the origin, and where q says that they do not."""
    moved = pin.Model(model)
    places: list[int] = []
    for i in range(1, moved.njoints):
        if moved.parents[i] == 0:
            joint = moved.joints[i]
            moved.jointPlacements[i].translation = np.zeros(3)
            if joint.shortname() == "JointModelFreeFlyer":
                places += range(joint.idx_q, joint.idx_q + 3)
    return moved, places
