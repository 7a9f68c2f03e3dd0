"""Rattle and Shake: the constraints hold at the end of each step, and energy does not drift.

They solve the equations of motion as Hamilton has them, in the momentum p = M v.

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

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import inverse
from condyn_pin._core.models import joints_with_turning_axes, whole_data
from condyn_pin.dynamics.derivatives.solution_derivatives import FreeBodyModel, in_series
from condyn_pin.simulation.integrators.integrator import (
    Integrator,
    Order,
    Stepper,
    fixed_point_iteration,
)
from condyn_pin.simulation.system import System

# Damping of J M^-1 J^T relative to its diagonal. Redundant rows are singular without; an iteration
# to the end makes up for what it leaves, a billionth of each gap over the smallest eigenvalue.
_DAMPING = 1e-9

# The iteration that knows J at the end of the step.
_SECOND = 2


@dataclass(frozen=True)
class Rattle(Integrator):
    """Störmer-Verlet's method with a multiplier for c(q1) = 0 and one for J v1 = 0.

    With f = C^T v - g + tau,

        p_h = p0 + dt/2 (f(q0, M0^-1 p_h) + J0^T lam)
        q1  = q0 exp(dt/2 (M0^-1 p_h + M1^-1 p_h)),    c(q1) = 0
        p1  = p_h + dt/2 (f(q1, M1^-1 p_h) + J1^T mu), J1 M1^-1 p1 = 0

    Symplectic in vector-space coordinates, and symmetric also on free-flyers and balls: the energy
    of a conservative system oscillates about a constant for arbitrarily long times. Implicit if M
    depends on q: the iteration requires that dt |v| is small. Joint damping may be stiff, because
    half of it is implicit; springs require dt sqrt(k / I) < 2, as in Verlet's method.

    References
    ----------
    Andersen. RATTLE: a "velocity" version of the SHAKE algorithm. Journal of Computational Physics
    52, 1983.
    Jay. Symplectic partitioned Runge-Kutta methods for constrained Hamiltonian systems. SIAM
    Journal on Numerical Analysis 33, 1996.
    """

    title: ClassVar[str] = "RATTLE"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = True
    solves_per_step: ClassVar[float] = 8
    use: ClassVar[str] = "over very long times, where energy may not drift"
    keeps_constraints: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return Stepper(_Hamiltonian(system, dt, self.title, hidden=True).step)


@dataclass(frozen=True)
class Shake(Integrator):
    """RATTLE's configurations with velocities that are not projected: J v1 is left as it is.

    References
    ----------
    Ryckaert, Ciccotti, Berendsen. Numerical integration of the Cartesian equations of motion of a
    system with constraints. Journal of Computational Physics 23, 1977.
    """

    title: ClassVar[str] = "SHAKE"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = True
    solves_per_step: ClassVar[float] = 8
    use: ClassVar[str] = "to compare: RATTLE costs no more"
    keeps_constraints: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return Stepper(_Hamiltonian(system, dt, self.title, hidden=False).step)


class _FactorisedState(NamedTuple):
    """Mass matrix, constraint rows, inverses and damping at one configuration."""

    kept: Callable[[Array], Array]  # rows without what the digits of the file make up
    M: Array  # (nv, nv)
    J: Array  # (m, nv), kept
    M_inv: Array  # (nv, nv)
    G_inv: Array  # (m, m), of J M^-1 J^T, damped
    Md_inv: Array  # (nv, nv), of M + dt/2 D
    Gd_inv: Array  # (m, m), of J (M + dt/2 D)^-1 J^T, damped
    D: Array  # (nv, nv), damping of the robot's joints and between its frames


class _Hamiltonian:
    """The steps of one system: RATTLE's, or without what projects the velocity SHAKE's."""

    def __init__(self, system: System, dt: float, title: str, *, hidden: bool) -> None:
        self._system, self._dt, self._half = system, dt, dt / 2
        self._title, self._hidden = title, hidden
        self._end: tuple[Array, _FactorisedState | None] = np.zeros(0), None  # of the last step
        model, _ = in_series(system.model, ())
        nominal = system.scene.nominal
        self._redundancy = nominal.redundancy if nominal.looks_independent else None
        self._carried = None
        if model is not system.model and joints_with_turning_axes(model):
            self._carried = FreeBodyModel(model)
            model = self._carried.model
        # Pinocchio forms C in the world's axes and about its origin: far from there it is made of
        # differences. Where a tree stands does not matter for C and g.
        self._model, self._shifts = _at_origin(model)
        self._data = whole_data(self._model)
        self._passive = system.passive
        self._of_joints = np.diag(self._passive.d)

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and a at its start."""
        a = self._system.acceleration(t, q, v)
        lam = self._system.lam()
        known = self._end[1] if self._end[0] is q else None
        place = known or self._place(q)
        q1, p, v_end, lam = self._first_half(t, q, v, a, lam, place)
        end = self._place(q1)
        v1 = end.M_inv.dot(p + self._half * self._force(t + self._dt, q1, v_end))
        if self._hidden:
            wanted = end.kept(self._system.equations.wanted[1])
            for _ in range(2):
                v1 -= end.M_inv.dot(end.J.T.dot(end.G_inv.dot(end.J.dot(v1) - wanted)))
        else:  # the multiplier of the next step takes the place of this one's
            if self._redundancy:  # what does nothing at the start would do something at the end
                lam = self._redundancy.left_out(place.J, np.zeros(len(lam))).kept(lam)
            v1 += self._half * end.M_inv.dot(end.J.T.dot(lam))
        self._end = q1, end
        return q1, v1, a

    def _first_half(
        self, t: float, q: Array, v: Array, a: Array, lam: Array, place: _FactorisedState
    ) -> tuple[Array, Array, Array, Array]:
        """Return q1, p_h, M1^-1 p_h and lam with c(q1) = 0."""
        system, dt, half = self._system, self._dt, self._half
        D, p0 = place.D, place.M.dot(v)
        towards = place.Gd_inv / (half * dt)  # from a gap to lam
        left_to_do = iter(range(_SECOND, -1, -1))
        system.at(t + dt)  # c and J v of the end, from here on
        v_start = v_end = v + half * a
        p, q1 = p0, q

        def iteration() -> float:
            nonlocal p, v_start, v_end, q1, lam, towards
            if next(left_to_do, None) == 0:  # q1 is nearly known, and with it how lam moves it
                J1 = place.kept(system.equations.jacobian(q1))
                towards = _inverse_between(J1, place.Md_inv, place.J) / (half * dt)
            p = p0 + half * (self._force(t, q, v_start) + D.dot(v_start) + place.J.T.dot(lam))
            v_start = place.Md_inv.dot(p)
            p = p - half * D.dot(v_start)
            M = system.mass(system.integrate(q, half * (v_start + v_end)))
            v_end = dposv(M, p)[1]
            before, q1 = q1, system.integrate(q, half * (v_start + v_end))
            c = place.kept(system.equations.violation(q1))
            lam = lam - towards.dot(c)
            gap, moved = np.abs(c).max(initial=0.0), np.abs(q1 - before).max(initial=0.0)
            return float(max(gap, moved))

        fixed_point_iteration(iteration, self._title, t, dt, system.size(q))
        return q1, p, v_end, lam

    def _force(self, t: float, q: Array, v: Array) -> Array:
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
        if self._shifts:
            q = q.copy()
            q[self._shifts] = 0.0
        C = pin.computeCoriolisMatrix(self._model, self._data, q, v)
        g = pin.computeGeneralizedGravity(self._model, self._data, q)
        return np.asarray(v.dot(C) - g)

    def _place(self, q: Array) -> _FactorisedState:
        """Mass matrix, constraint rows, inverses and damping at q."""
        kept = self._system.kept_rows(q)
        M, J = self._system.mass(q), kept(self._system.equations.jacobian(q))
        M_inv = inverse(M)
        both = M_inv, _inverse_between(J, M_inv, J)
        D = self._passive.damping_matrix(q) if self._passive.between else self._of_joints
        if not D.any():
            return _FactorisedState(kept, M, J, *both, *both, D)
        Md_inv = inverse(M + self._half * D)
        return _FactorisedState(kept, M, J, *both, Md_inv, _inverse_between(J, Md_inv, J), D)


def _inverse_between(J1: Array, M_inv: Array, J: Array) -> Array:
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
