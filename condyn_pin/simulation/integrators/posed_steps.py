"""PosedSteps: the contact problem of a step, from a state; `contact_steps` has the equations.

M, h, J and gamma are taken where the scheme looks at them, springs and damping put into M and tau,
the constraints eliminated, and of the contacts those chosen that may touch within the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, diagonal_of
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin.contact.condense import condense
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.floating import Floating
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme, Near, yielding_gaps
from condyn_pin.simulation.integrators.curved_paths import CurvedPaths
from condyn_pin.simulation.integrators.path_ends import PathEnds
from condyn_pin.simulation.integrators.posed import Kept, Posed
from condyn_pin.simulation.system import System, total_torque


class PosedSteps:
    """The steps of one system with one scheme and one dt, posed and not yet answered.

    Attributes
    ----------
    floating : Floating
        The axes of floating bodies.
    paths : CurvedPaths
    ends : PathEnds
    """

    def __init__(self, scheme: ContactScheme, system: System, dt: float) -> None:
        self._scheme, self._system, self._dt = scheme, system, dt
        self._equations, self._candidates = system.equations, system.contacts
        self.floating = Floating(system.model)
        self.paths = CurvedPaths(system, self.floating, dt)
        self.ends = PathEnds(system, self.floating, dt)
        passive = system.passive
        self._torque = total_torque(system.applied, passive, dt)
        self._inertia = passive.inertia(dt) if passive.inertia(dt).any() else None
        self._between = passive.between
        self._is_implicit = self._inertia is not None or self._between is not None
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
        at, tau = q, self._torque(t, q, v)
        if scheme.at_midpoint:
            at, v = floating.integrate(q, 0.5 * dt * v), floating.turned(v, 0.5 * dt)
        if self._is_driven:
            system.at(self.looks_at(t))  # with what is driven where it is there
        M, h, J_b, gamma = self._equations.consistent_parts(at, v)
        rates = None
        if self._is_driven:
            rates = self._equations.wanted[1].copy()
            system.at(t + dt)  # where loops are closed behind the step
        data = self._equations.data  # it has the placements and Jacobians of `at` now
        gaps, J = self._candidates.evaluate(data, at)
        chosen = self._choose(scheme.near(gaps, v, dt) if active is None else active)
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
            h = pin.nonLinearEffects(system.model, data, at, mean)
            turning = floating.turning(mean)
            now = condense(factors, J_c, v, dt * (tau - h + inertia.dot(turning)), slip, rates)
        here = gaps[chosen.gaps]
        bends, end = 0.0 * here, None
        if scheme.closes_gaps:
            bends, end = self.paths.bends(at, v, here, before, chosen)
        near = Near(
            dt, here, bends, chosen.restitution, chosen.normals, now.G, before,
            now.contact_velocities, chosen.sets.blocks,
        )  # fmt: skip
        if scheme.closes_gaps:
            near = near._replace(allowed=yielding_gaps(near))
        problem = chosen.problem(scheme, near)
        J_n = J_c[chosen.normals]
        return Posed(
            at, v, mean, turning, tau, gaps, J, end, None, J_c, J_n, chosen, now, near, problem
        )

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
        if self._inertia is not None:
            diagonal = diagonal_of(M)
            diagonal += self._inertia
        if self._between is not None:
            rows, weights = self._between.inertia_rows(q, self._dt)
            M += rows.T @ (weights[:, None] * rows)
        why = singular_mass(self._system.model, q)
        return factorise(M, J_b, tolerances.RANK, why=why)
