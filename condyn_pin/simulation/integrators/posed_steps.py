"""PosedSteps: the contact problem of a step, from a state; `contact_steps` has the equations.

M, h, J and gamma are taken where the scheme looks at them, springs and damping put into M and tau,
the constraints eliminated, and of the contacts those chosen that may touch within the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, diagonal_of
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.condense import condense
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.restitution import Strike
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import (
    ContactScheme,
    Near,
    fastest,
    yielding_gaps,
)
from condyn_pin.simulation.integrators.curved_paths import CurvedPaths
from condyn_pin.simulation.integrators.path_ends import PathEnds
from condyn_pin.simulation.integrators.posed import Kept, Posed
from condyn_pin.simulation.system import System, total_torque

# Approach of what rests [m/s, rad/s], relative to the fastest contact if that is faster.
_SLOW = 1e-9

# How far from that of a bent path the rate of a gap may be where it rests, relative to it.
_LIKE = 2.0


class PosedSteps:
    """The steps of one system with one scheme and one dt, posed and not yet answered.

    Attributes
    ----------
    floating : Manifold
        The axes of floating bodies.
    paths : CurvedPaths
    ends : PathEnds
    always_strikes : bool
        Whether impacts are apart from the step behind them also where Newton's law is the same.
    """

    always_strikes: bool = False

    def __init__(self, scheme: ContactScheme, system: System, dt: float) -> None:
        self._scheme, self._system, self._dt = scheme, system, dt
        self._equations, self._candidates = system.equations, system.contacts
        self.floating = system.manifold
        self.paths = CurvedPaths(system, self.floating, dt)
        self.ends = PathEnds(system, self.floating, dt)
        self._applied, passive = system.applied, system.passive
        # springs and damping by how far ahead of where they are evaluated they act [s]
        self._torques = {x: total_torque(self._applied, passive, x) for x in (0.0, 0.5 * dt, dt)}
        self._inertias = {x: passive.inertia(x) for x in (0.5 * dt, dt)}
        self._between = passive.between
        self._is_implicit = not passive.is_nothing
        self._span = dt
        self._chosen: tuple[bytes, Chosen] | None = None
        self._is_driven = system.scene.is_driven
        self._share = 0.5 if scheme.at_midpoint else 1.0  # of dt, from `at` to the end

    def looks_at(self, t: float) -> float:
        """Return the time at which the equations of a step from t are evaluated [s]."""
        return t + (1.0 - self._share) * self._dt

    def pose(self, t: float, q: Array, v: Array, active: NDArray[np.bool_] | None = None) -> Posed:
        """Return the step from a state with its contact problem, not yet solved.

        The gaps that take part are those that are near, or those that are `active`.
        """
        scheme, system, floating, dt = self._scheme, self._system, self.floating, self._dt
        at, looks_at = q, self.looks_at(t)
        if scheme.at_midpoint:
            at, v = floating.integrate(q, 0.5 * dt * v), floating.turned(v, 0.5 * dt)
        else:
            tau = self._torques[dt](t, q, v)
        if self._is_driven:
            system.at(looks_at)  # with what is driven where it is there
        M, h, J_b, gamma = self._equations.consistent_parts(at, v)
        if scheme.at_midpoint:
            self._span = 0.5 * dt if self._is_resolved(M, at) else dt
            tau = self._torques[self._span - 0.5 * dt](looks_at, at, v)
        rates = None
        if self._is_driven:
            rates = self._equations.wanted[1].copy()
            system.at(t + dt)  # where loops are closed behind the step
        data = self._equations.data  # it has the placements and Jacobians of `at` now
        gaps, J = self._candidates.evaluate(data, at)
        touch, bent, straight = scheme.near(gaps, v, dt), None, None
        if scheme.follows_planes:
            bent, straight = self._bent(at, v, gaps, J)
            if bent is not None:
                touch |= (bent != 0.0) & (gaps <= scheme.touching + np.abs(bent))
        chosen = self._choose(touch if active is None else active)
        J_c, turning = J[chosen.rows], floating.turning(v)
        before = J_c.dot(v)
        slip = -0.5 * dt * (gamma - J_b.dot(turning)) if len(J_b) else gamma  # none
        if rates is not None:
            slip += rates
        # without springs and damping: they act in v+ - v, as it is in these axes
        inertia = M.copy() if self._is_implicit else M
        factors, mean = self._factors(M, J_b, at), v
        now = condense(factors, J_c, v, dt * (tau - h + inertia.dot(turning)), slip, rates)
        if not len(J_c):
            mean = 0.5 * (v + now.free_velocity)
            if scheme.at_midpoint and self._applied.constant is None:
                tau = tau + (self._applied(looks_at, at, mean) - self._applied(looks_at, at, v))
            h = algorithms(data).nonLinearEffects(system.model, data, at, mean)
            turning = floating.turning(mean)
            now = condense(factors, J_c, v, dt * (tau - h + inertia.dot(turning)), slip, rates)
        here = gaps[chosen.gaps]
        bends, end, e = 0.0 * here, None, chosen.restitution
        if scheme.closes_gaps:
            bends, end = self.paths.bends(at, v, here, before, chosen)
        elif bent is not None:
            bends, end = bent[chosen.gaps], straight
            e = np.where(bends == 0.0, e, 0.0)  # what rests does not rebound
        near = Near(
            dt, here, bends, e, chosen.normals, now.G, before, now.contact_velocities,
            chosen.sets.blocks,
        )  # fmt: skip
        if scheme.closes_gaps:
            near = near._replace(allowed=yielding_gaps(near))
        strike = self._struck(chosen, near)
        if strike is not None:
            near = near.behind(strike)
        problem = chosen.problem(scheme, near)
        J_n = J_c[chosen.normals]
        return Posed(
            at, v, mean, turning, tau, gaps, J, end, None, J_c, J_n, chosen, now, near, problem,
            strike, self._span, looks_at,
        )  # fmt: skip

    def _bent(
        self, at: Array, v: Array, gaps: Array, J: Array
    ) -> tuple[Array | None, Array | None]:
        """Return how far paths bend what rests on a plane (k,), and where straight ones end.

            s = gap(q (+) dt v) - gap - dt J_n v

        A contact rests whose gap and rate are of the size of s, and s / dt. None where none does.
        """
        candidates, dt = self._candidates, self._dt
        k, small = candidates.contact_points, self._scheme.touching
        speeds = J[2 : 3 * k : 3].dot(v)
        moved = dt * np.abs(speeds)
        if not ((gaps[:k] <= small + moved) & (moved > small)).any():
            return None, None
        end, data = self.floating.integrate(at, dt * v), self._equations.data
        algorithms(data).forwardKinematics(self._system.model, data, end)
        s = candidates.gaps_over_planes(data) - gaps[:k] - dt * speeds
        rests = (np.abs(s) > small) & (np.abs(dt * speeds - s) <= _LIKE * np.abs(s))
        rests &= gaps[:k] <= small + np.abs(s)
        if not rests.any():
            return None, None
        bent = np.zeros(len(gaps))
        bent[:k] = np.where(rests, s, 0.0)
        return bent, end

    def _is_resolved(self, M: Array, q: Array) -> bool:
        """Whether springs and dampers move little within a step: they act in its middle then.

        trace M^-1 (dt D + dt^2 K) <= 1: at the middle of the step stiffer ones would swing on,
        which they do not at its end.
        """
        if not self._is_implicit:
            return True
        try:
            M_inv = np.linalg.inv(M)
        except np.linalg.LinAlgError:
            return False
        size = float(self._inertias[self._dt].dot(M_inv.diagonal()))
        if self._between is not None:
            rows, weights = self._between.inertia_rows(q, self._dt)
            size += float(weights.dot(np.einsum("ri,ij,rj->r", rows, M_inv, rows)))
        return size <= 1.0

    def _struck(self, chosen: Chosen, near: Near) -> Strike | None:
        """Return the impact with which a step begins, None if nothing strikes."""
        law, e = self._scheme.impacts, near.restitution
        if law is None or not e.any():
            return None
        closing = near.before[near.normals]
        if not ((closing < -_SLOW * max(1.0, fastest(near.before))) & (e > 0.0)).any():
            return None
        strike = law.strike(chosen.impact(near), e, always=self.always_strikes)
        return strike if strike.notes or strike.apart.any() else None

    def impact_at(self, chosen: Chosen, near: Near, at: Array, v: Array) -> ContactProblem:
        """Return the same contacts before an impact at another state, the placements taken there.

        `near` is what they are in the step.
        """
        M, _, J_b, _ = self._equations.consistent_parts(at, v)
        _, J = self._candidates.evaluate(self._equations.data, at)
        factors = self._factors(M.copy() if self._is_implicit else M, J_b, at)
        J_c = J[chosen.rows]
        there = condense(factors, J_c, v, 0.0 * v, J_b.dot(v))
        return chosen.impact(near._replace(G=there.G, before=J_c.dot(v)))

    def pose_along(self, posed: Posed, u: Array, kept: Kept | None = None) -> Posed:
        """Return a step again, with its contacts as they are where a path along u ends.

        Those that are `kept` at the beginning bend as they did there.
        """
        there, dt = self.ends.there(posed.at, u), self._dt
        near_there = self._scheme.near(there.gaps, u, dt)
        active = self.ends.takes_part(posed, there, near_there)
        begun, rates = self.ends.begun(posed)
        bent = there.gaps - begun
        if kept is not None:
            its, first = kept.gaps, kept.first
            active[its] = first.chosen.near[its]
            begun, rates = np.where(its, first.gaps, begun), rates.copy()
            rates[its], bent[its] = first.J[self._candidates.normals[its]], 0.0
            bent[first.chosen.near & its] = first.near.bends[its[first.chosen.near]]
        chosen = self._choose(active)
        J_c = there.J[chosen.rows]
        now, gaps = posed.condensed.with_contacts(J_c), begun[chosen.gaps]
        bends = bent[chosen.gaps] - dt * J_c.dot(u)[chosen.normals]
        near = Near(
            dt, gaps, bends, chosen.restitution, chosen.normals, now.G, J_c.dot(posed.v),
            now.contact_velocities, chosen.sets.blocks,
        )  # fmt: skip
        near = near._replace(allowed=yielding_gaps(near))
        return posed._replace(
            path=u, J_c=J_c, J_n=rates[chosen.gaps], chosen=chosen, condensed=now, near=near,
            problem=chosen.problem(self._scheme, near), kept=kept,
        )  # fmt: skip

    def _choose(self, near: NDArray[np.bool_]) -> Chosen:
        """Return the candidates that take part; most often they are those of the step before."""
        key = near.tobytes()
        if self._chosen is None or self._chosen[0] != key:
            dry = np.ones(self._candidates.intervals, dtype=bool)
            active = np.concatenate((near, dry))
            self._chosen = key, Chosen(self._candidates, active, self._dt)
        return self._chosen[1]

    def _factors(self, M: Array, J_b: Array, q: Array) -> MinimumNorm:
        """Return the factors of J_b and of M with what springs and damping add to it in a step."""
        if self._is_implicit:
            diagonal = diagonal_of(M)
            diagonal += self._inertias[self._span]
        if self._between is not None:
            rows, weights = self._between.inertia_rows(q, self._span)
            M += rows.T @ (weights[:, None] * rows)
        why = singular_mass(self._system.model, q)
        return factorise(M, J_b, tolerances.RANK, why=why)
