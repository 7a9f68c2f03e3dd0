"""ContactSteps: steps of one size of a robot whose contacts open, stick and slide.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,
    J_b v+ = s' - dt gamma / 2,    sigma = G lam + g

with gamma less s'' for rows that are driven along s(t), and s' = 0 for all others. Constraints are
eliminated (`condyn_pin.contact.condense`), and the answer of the contact solver is proved in every
step. Springs and joint damping act at the end of it: M has dt D + dt^2 K more, and tau has dt K v
less.

The velocity is tangent to the constraints in the middle of the step, where J_b is dt/2 Jdot_b more,
and Jdot_b v = gamma: loops stay closed to dt^3. One with J_b v+ = 0 would lose dt gamma in each
step, and a four-bar with it 0.15 J in a second at 1 ms, in place of 0.004 J. Where nothing touches,
h is taken at the mean of v and v+. `LoopProjection` closes loops that are open after the step.

Velocities of floating bodies are in axes that stand still within the step (`Manifold`): h is
M w x u less, and gamma J_b w x u.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np
import scipy.optimize  # noqa: F401  # now, not within the first hard step of a motion: 0.2 s
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, diagonal_of
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.models import algorithms
from condyn_pin.contact.condense import condense
from condyn_pin.contact.problem import OPEN, ContactProblem, Modes, contact_modes
from condyn_pin.contact.restitution import ImpactAnswer
from condyn_pin.contact.solution import verified
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.errors import SolveFailed, StepFailed
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.integrators.contact_scheme import (
    AT_REST,
    ActiveContacts,
    ContactScheme,
    fastest,
    yielding_gaps,
)
from condyn_pin.simulation.integrators.integrator import StepEffects, Stepper
from condyn_pin.simulation.records import NO_WORK, ContactWork, Note, Row, notes_of, touch_of
from condyn_pin.simulation.system import System, blocked_path_error, total_torque
from condyn_pin.stepping.step_problem import (
    MISSED,
    AcceptedStep,
    ActiveCandidates,
    CurvatureCorrection,
    EndsOfPaths,
    ReusedParts,
    StepAttempt,
    StepProblem,
    answered,
    drive_work,
    kept_paths,
    next_path,
    step_work,
)

# ContactSteps: the contact problem of a step posed from a state, and answered.
#
# M, h, J and gamma are taken where the scheme looks at them, springs and damping put into M and
# tau, the constraints eliminated, and of the contacts those chosen that may touch within the step.


# Approach of what rests [m/s, rad/s], relative to the fastest contact if that is faster.
_SLOW = 1e-9

# How far from that of a bent path the rate of a gap may be where it rests, relative to it.
_LIKE = 2.0

# How often a step is posed anew because its paths end elsewhere, at most: each time their error
# falls by a factor of two at least, and most often by one of about dt |v|.
_AGAIN = 6

# Places on the way to the next step at which shapes are looked at that may pass each other.
_LOOKS = 64


class ContactSteps:
    """The steps of one system with one scheme and one dt."""

    # whether impacts are apart from the step behind them also where Newton's law is the same
    always_strikes: bool = False
    last: AcceptedStep  # the step that was taken last

    def __init__(self, scheme: ContactScheme, system: System, dt: float) -> None:
        self._scheme, self._system, self._dt = scheme, system, dt
        self._equations, self._candidates = system.equations, system.contacts
        self._run = algorithms(self._equations.data)
        self.floating = system.manifold  # the axes of floating bodies
        self.paths = CurvatureCorrection(system, self.floating, dt)
        self.ends = EndsOfPaths(system, self.floating, dt)
        self._applied, passive = system.applied, system.passive
        # springs and damping by how far ahead of where they are evaluated they act [s]
        self._torques = {x: total_torque(self._applied, passive, x) for x in (0.0, 0.5 * dt, dt)}
        self._inertias = {x: passive.inertia(x) for x in (0.5 * dt, dt)}
        self._between = passive.between
        self._is_implicit = not passive.is_nothing
        self._span = dt
        self._chosen: tuple[bytes, ActiveCandidates] | None = None
        self._is_driven = system.scene.is_driven
        self._share = 0.5 if scheme.at_midpoint else 1.0  # of dt, from `at` to the end
        self.closings = LoopProjection(system, self._factors)
        self._normals = self._candidates.normals
        self._driven = system.equations.driven
        self._furthest: tuple[str, float] | None = None
        self._own = StepEffects(NO_WORK)  # of the last step alone
        self._slow = system.manifold.slow(dt)

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and the mean acceleration."""
        # StepFailed if the contact solver has no answer.
        self._own = StepEffects(NO_WORK)
        taken = self.attempt(t, q, v)
        if self._is_driven:
            self.check_path(t, taken[0])
        if not self.last.natural <= tolerances.CONTACT_SOLVED:
            self._check_answer(t)
        last, notes = self.last, list[tuple[float, Note]]()
        if (
            last.attempt.several
            or last.missed
            or last.through
            or last.posed.strike is not None
            or last.posed.near.gaps.min(initial=0.0) < -AT_REST
        ):
            said = (*notes_of(last.attempt.several), *last.notes)
            notes = [(t, note) for note in said]
        self._own = StepEffects(last.work, notes=tuple(notes))
        return taken

    def effects(self, work: ContactWork) -> StepEffects:
        """Effects of the last step, behind this work of contacts."""
        return self._own._replace(work=work.plus(self._own.work))

    def turn_fault(self, v: Array, v1: Array) -> str:
        """Message on a joint that turns too far in a step from v to v1; empty if none does."""
        slow = self._slow
        if slow is None or (v.dot(v) <= slow and v1.dot(v1) <= slow):
            return ""
        fault = self._system.turn_fault
        return fault(v, self._dt) or fault(v1, self._dt)

    def check_turn(self, v: Array, v1: Array) -> None:
        """Refuse a step in which a body turns further than it is followed."""
        fault = self.turn_fault(v, v1)
        if fault and not isfinite(v1.dot(v1)):
            raise SolveFailed(fault, None)
        if fault:
            raise StepFailed(fault)

    def check_path(self, t: float, q1: Array) -> None:
        """Refuse paths that press bodies into each other in the last step: all bodies are rigid."""
        posed = self.last.posed
        stuck = posed.near.G.diagonal()[posed.chosen.normals] == 0.0
        if not stuck.any():
            return
        data = self._equations.data
        self._run.forwardKinematics(self._system.model, data, q1)
        gaps = self._candidates.gaps(data, q1)
        for place in np.flatnonzero(posed.chosen.near)[stuck]:
            if gaps[place] < min(-MISSED, posed.gaps[place]):
                raise blocked_path_error(self._candidates.names[place], t + self._dt, -gaps[place])

    def _check_answer(self, t: float) -> None:
        """Refuse the last step, unless it has all that its contact solver promises."""
        solver, (posed, _, found, natural, *_) = self._scheme.contact, self.last
        if not isfinite(natural) and np.isfinite(found.lam).all():
            raise StepFailed(
                f"t = {t:g} s: the step is not finite, its numbers overflow; look at v, tau and "
                "masses, or take a smaller dt"
            )
        if not solver.exact and found.answered and isfinite(natural):
            return
        answer = verified(posed.problem, found, natural, tolerances.CONTACT_SOLVED, nan)
        names = ", ".join(posed.problem.names)
        if answer.unmet:
            why = f"{answer.status}"
        else:
            why = (
                f"{solver!r} leaves a natural residual of {natural:.1e}, and "
                f"{tolerances.CONTACT_SOLVED:g} is asked for; take a smaller dt"
            )
            if not isinstance(solver, SemismoothNewton):
                why += ", or contact=SemismoothNewton()"
        said = "; ".join((why, *answer.notices))
        raise StepFailed(f"contacts {names} at t = {t:g} s: {said}")

    def attempt(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Take the step even if the contact solver failed; return q, v and a as `step`."""
        tried = self._answered(t, q, v)
        posed, v1, found, natural = tried[-1]
        lam, dt, floating = posed.total(found.lam), self._dt, self.floating
        a = v1 - posed.v
        a /= dt
        a -= posed.turning
        rest = self._share * dt
        moved, turned = floating.integrate(posed.at, rest * v1), floating.turned(v1, rest)
        q1 = self.closings.closed(posed.condensed.factors, moved)
        work = step_work(self._scheme, posed, lam, v1)
        if self._is_driven:
            work = work.more(driven=drive_work(posed, lam, self._driven))
        if q1 is not moved:
            work = work.more(correction=self.closings.work(moved, q1, turned))
        if not isfinite(q1.dot(q1).item() + v1.dot(v1).item() + work.total):
            natural = nan  # also where no contact is active
        self.last = AcceptedStep(
            posed=posed,
            v=v1,
            attempt=found,
            natural=natural,
            work=work,
            tried=tuple(tried),
            missed=self._furthest,
            through=self._through(posed, v1),
        )
        return q1, turned, a

    def _through(self, posed: StepProblem, v1: Array) -> tuple[str, ...]:
        """Return the pairs of shapes that meet on the way to the next step, and not at its end."""
        candidates, dt = self._candidates, self._dt
        k, cones = candidates.contact_points, candidates.cones
        if self._scheme.closes_gaps or k == cones:
            return ()
        rows = slice(3 * k + 2, 3 * cones, 3)
        comes = (posed.gaps[k:cones] > 0.0) & (
            posed.gaps[k:cones] + dt * posed.J[rows].dot(v1) < 0.0
        )
        if not comes.any():
            return ()
        data, floating = self._equations.data, self.floating

        def met(share: float) -> NDArray[np.bool_]:
            q = floating.integrate(posed.at, share * dt * v1)
            self._run.forwardKinematics(self._system.model, data, q)
            return np.asarray(candidates.gaps(data, q)[k:cones] <= 0.0)

        def each(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
            flags = flags.copy()
            for places in candidates.several:  # one pair, wherever it meets
                its = slice(places.start - k, places.stop - k)
                flags[its] = flags[its].any()
            return flags

        comes = each(comes) & ~each(met(1.0))
        if not comes.any():
            return ()
        through = np.zeros_like(comes)
        for i in range(1, _LOOKS):
            through |= comes & each(met(i / _LOOKS))
        names = candidates.names[k:cones]
        return tuple(dict.fromkeys(names[i].split("/point ")[0] for i in np.flatnonzero(through)))

    def lam(self) -> Array:
        """Return the forces of the last step: of constraints, then of all candidates [N, N m]."""
        return self.impulses() / self._dt

    def impulses(self) -> Array:
        """Return the impulses of the last step, in the same order [N s, N m s]."""
        posed, rows = self.last.posed, self._equations.m
        found = posed.total(self.last.attempt.lam)
        impulses = np.zeros(rows + self._candidates.rows)
        impulses[:rows] = posed.condensed.constraint_impulses(found)
        impulses[rows:][posed.chosen.rows] = found
        return impulses

    def touch(self, work: ContactWork) -> Array:
        """Contact record of the last step: natural residual, work so far and modes."""
        return touch_of(self.last.natural, work, self.modes(), is_driven=self._is_driven)

    def modes(self) -> Modes:
        """Return the modes of all candidates in the last step."""
        posed = self.last.posed
        modes = np.full(len(posed.chosen.active), OPEN)
        if posed.problem.rows:
            modes[posed.chosen.active] = contact_modes(posed.problem, self.last.attempt.lam)
        return modes

    def sample(self, t: float, q: Array, v: Array, work: ContactWork) -> Row:
        """Return a sample of a state: with the forces of the step that begins there."""
        _, _, a = self.step(t, q, v)
        tau = self._system.applied.at_sample(t, q, v)
        return t, q, v, a, self.lam(), tau, self.touch(work)

    def _answered(self, t: float, q: Array, v: Array) -> list[StepAttempt]:
        """Return a step as it was tried, each time along the path before; the last one is taken."""
        tried, self._furthest = [self._first(t, q, v)], None
        off = self._end_gap_errors(tried[0])
        return tried if off is None else self._along_paths(tried, off)

    def _along_paths(self, tried: list[StepAttempt], off: Array) -> list[StepAttempt]:
        """Return a step as it was tried again along its paths, until each ends where it should."""
        # Contacts that do not feel each other end by themselves: each group keeps the best of its
        # attempts, whatever those of others bring.
        solver, first = self._scheme.contact, tried[0].posed
        of_gaps, of_velocities = self.ends.alone(first)
        groups = np.arange(int(of_gaps.max(initial=-1)) + 1)

        def by_group(off: Array | None) -> Array:
            return np.array([0.0 if off is None else off[of_gaps == i].max() for i in groups])

        def again(of_groups: NDArray[np.int_]) -> StepAttempt:
            """Return the next attempt, of each group along its path in an attempt, or the next."""
            last, of, kept = tried[-1], np.append(of_groups, -1)[of_velocities], None
            path = last.posed.v if last.posed.path is None else last.posed.path
            along = next_path(last.posed, path, last.v)
            if (of_groups >= 0).any():
                kept = ReusedParts(of, np.append(of_groups == 0, False)[of_gaps], first)
                along = kept_paths(of, paths, along)
            paths.append(along)
            return answered(self.pose_along(last.posed, along, kept), solver)

        paths, best, least = [first.v], 0 * groups, by_group(off)
        while (least > MISSED).any() and len(tried) <= _AGAIN:
            ended = np.where(least > MISSED, -1, best)
            tried.append(again(ended))
            if not tried[-1].is_answer_of(solver):
                del tried[-1], paths[-1]
                break
            now = by_group(self._end_gap_errors(tried[-1]))
            better = now < least
            best[better], least[better] = len(tried) - 1, now[better]
            at_last = np.where(ended < 0, len(tried) - 1, ended)
        if len(groups) and not least.max() <= MISSED:
            its = of_gaps == int(least.argmax())
            name = self._candidates.names[int(np.where(its, off, -1.0).argmax())]
            self._furthest = name, float(least.max())
        if (best == best[:1]).all():
            return tried[: 1 + int(best.max(initial=0))]
        if (best != at_last).any():
            tried.append(again(best))
        return tried

    def _first(self, t: float, q: Array, v: Array) -> StepAttempt:
        """Return a step with all contacts that it closes, as they are where it begins."""
        solver = self._scheme.contact
        tried = answered(self.pose(t, q, v), solver)
        while self._scheme.closes_gaps:
            missed = self._missed(tried.posed, tried.v)
            if missed is None:
                break
            posed = self.pose(t, q, v, tried.posed.chosen.near | missed)
            tried = answered(posed, solver)
        return tried

    def _end_gap_errors(self, tried: StepAttempt) -> Array | None:
        """Error of gaps at the end of a step (k,) [m, rad]; None if within tolerance."""
        if not self._scheme.closes_gaps or not tried.is_answer_of(self._scheme.contact):
            return None
        return self.ends.gap_errors(tried.posed, tried.attempt.lam, tried.v)

    def _missed(self, posed: StepProblem, v1: Array) -> NDArray[np.bool_] | None:
        """Return a flag for each gap that the step closes and that takes no part, None for none."""
        # Where a step is long, or an impulse turns a body, what was far away goes through.
        near = posed.chosen.near
        if posed.chosen.is_everything:
            return None
        missed = (posed.gaps + self._dt * posed.J[self._normals].dot(v1) < 0) & ~near
        return missed if missed.any() else None

    # The step as it is posed.

    def evaluation_time(self, t: float) -> float:
        """Return the time at which the equations of a step from t are evaluated [s]."""
        return t + (1.0 - self._share) * self._dt

    def pose(
        self, t: float, q: Array, v: Array, active: NDArray[np.bool_] | None = None
    ) -> StepProblem:
        """Return the step from a state with its contact problem, not yet solved."""
        # The gaps in the problem are those that are near, or those that are `active`.
        scheme, system, floating, dt = self._scheme, self._system, self.floating, self._dt
        at, evaluated_at = q, self.evaluation_time(t)
        if scheme.at_midpoint:
            at, v = floating.integrate(q, 0.5 * dt * v), floating.turned(v, 0.5 * dt)
        else:
            tau = self._torques[dt](t, q, v)
        if self._is_driven:
            system.at(evaluated_at)  # with what is driven where it is there
        M, h, J_b, gamma = self._equations.consistent_parts(at, v)
        if scheme.at_midpoint:
            self._span = 0.5 * dt if self._is_resolved(M, at) else dt
            tau = self._torques[self._span - 0.5 * dt](evaluated_at, at, v)
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
                tau = tau + (
                    self._applied(evaluated_at, at, mean) - self._applied(evaluated_at, at, v)
                )
            h = self._run.nonLinearEffects(system.model, data, at, mean)
            turning = floating.turning(mean)
            now = condense(factors, J_c, v, dt * (tau - h + inertia.dot(turning)), slip, rates)
        here = gaps[chosen.gaps]
        bends, end, e = 0.0 * here, None, chosen.restitution
        if scheme.closes_gaps:
            bends, end = self.paths.bends(at, v, here, before, chosen)
        elif bent is not None:
            bends, end = bent[chosen.gaps], straight
            e = np.where(bends == 0.0, e, 0.0)  # what rests does not rebound
        near = ActiveContacts(
            dt=dt, gaps=here, bends=bends, restitution=e, normals=chosen.normals, G=now.G,
            before=before, free=now.contact_velocities, blocks=chosen.sets.blocks,
        )  # fmt: skip
        if scheme.closes_gaps:
            near = near._replace(allowed=yielding_gaps(near))
        strike = self._struck(chosen, near)
        if strike is not None:
            near = near.behind(strike)
        problem = chosen.problem(scheme, near)
        J_n = J_c[chosen.normals]
        return StepProblem(
            at=at, v=v, mean=mean, turning=turning, tau=tau, gaps=gaps, J=J, straight=end,
            path=None, J_c=J_c, J_n=J_n, chosen=chosen, condensed=now, near=near, problem=problem,
            strike=strike, span=self._span, t=evaluated_at,
        )  # fmt: skip

    def _bent(
        self, at: Array, v: Array, gaps: Array, J: Array
    ) -> tuple[Array | None, Array | None]:
        """Path bend s of what rests on planes and hangs on cables (k,) [m], and q (+) dt v."""
        #     s = gap(q (+) dt v) - gap - dt J_n v
        # A contact is at rest if its gap and rate are of the size of s, and s / dt. None without
        # one.
        candidates, dt = self._candidates, self._dt
        curved, small = candidates.curved, self._scheme.touching
        speeds, here = J[candidates.curved_rows].dot(v), gaps[curved]
        moved = dt * np.abs(speeds)
        if not ((here <= small + moved) & (moved > small)).any():
            return None, None
        end, data = self.floating.integrate(at, dt * v), self._equations.data
        self._run.forwardKinematics(self._system.model, data, end)
        s = candidates.curved_gaps(data, end) - here - dt * speeds
        rests = (np.abs(s) > small) & (np.abs(dt * speeds - s) <= _LIKE * np.abs(s))
        rests &= here <= small + np.abs(s)
        if not rests.any():
            return None, None
        bent = np.zeros(len(gaps))
        bent[curved] = np.where(rests, s, 0.0)
        return bent, end

    def _is_resolved(self, M: Array, q: Array) -> bool:
        """True if springs and dampers are soft enough to act in the middle of a step."""
        # trace M^-1 (dt D + dt^2 K) <= 1: at the middle of the step stiffer ones would swing on,
        # which they do not at its end.
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

    def _struck(self, chosen: ActiveCandidates, near: ActiveContacts) -> ImpactAnswer | None:
        """Return the impact with which a step begins, None if nothing strikes."""
        law, e = self._scheme.impacts, near.restitution
        if law is None or not e.any():
            return None
        closing = near.before[near.normals]
        if not ((closing < -_SLOW * max(1.0, fastest(near.before))) & (e > 0.0)).any():
            return None
        strike = law.strike(chosen.impact(near), e, always=self.always_strikes)
        return strike if strike.notes or strike.apart.any() else None

    def impact_at(
        self, chosen: ActiveCandidates, near: ActiveContacts, at: Array, v: Array
    ) -> ContactProblem:
        """Contact problem of the same contacts before an impact at another state."""
        # Placements are those of that state; `near` has the contacts of the step.
        M, _, J_b, _ = self._equations.consistent_parts(at, v)
        _, J = self._candidates.evaluate(self._equations.data, at)
        factors = self._factors(M.copy() if self._is_implicit else M, J_b, at)
        J_c = J[chosen.rows]
        there = condense(factors, J_c, v, 0.0 * v, J_b.dot(v))
        return chosen.impact(near._replace(G=there.G, before=J_c.dot(v)))

    def pose_along(
        self, posed: StepProblem, u: Array, kept: ReusedParts | None = None
    ) -> StepProblem:
        """Return a step again, with its contacts as they are where a path along u ends."""
        # Those that are `kept` at the beginning bend as they did there.
        there, dt = self.ends.there(posed.at, u), self._dt
        near_there = self._scheme.near(there.gaps, u, dt)
        active = self.ends.active_flags(posed, there, near_there)
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
        near = ActiveContacts(
            dt=dt, gaps=gaps, bends=bends, restitution=chosen.restitution, normals=chosen.normals,
            G=now.G, before=J_c.dot(posed.v), free=now.contact_velocities,
            blocks=chosen.sets.blocks,
        )  # fmt: skip
        near = near._replace(allowed=yielding_gaps(near))
        return posed._replace(
            path=u, J_c=J_c, J_n=rates[chosen.gaps], chosen=chosen, condensed=now, near=near,
            problem=chosen.problem(self._scheme, near), kept=kept,
        )  # fmt: skip

    def _choose(self, near: NDArray[np.bool_]) -> ActiveCandidates:
        """Return the active candidates; most often they are those of the step before."""
        key = near.tobytes()
        if self._chosen is None or self._chosen[0] != key:
            dry = np.ones(self._candidates.intervals, dtype=bool)
            active = np.concatenate((near, dry))
            self._chosen = key, ActiveCandidates(self._candidates, active, self._dt)
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


def contact_stepper(scheme: ContactScheme, system: System, dt: float) -> Stepper:
    """Return a scheme at work on a system."""
    steps = ContactSteps(scheme, system, dt)
    return Stepper(
        steps.step, steps.lam, effects=steps.effects, touch=steps.touch, sample=steps.sample
    )


# Closings: what a step leaves open of loops is closed behind it.
#
#     q (+) -M^-1 J_b^T (J_b M^-1 J_b^T)^-1 c(q),    again and again, to rounding
#
# With the factors of the step, where that will do.


# Newton's steps that close loops behind a step, at most: a few, and more beside a dead point.
_CLOSINGS = 10

# A gap that counts as rounding [m, rad].
CLOSED = 1e-13

# Gaps that the factors of the step still close, each time up to a share dt |v| [m, rad].
SMALL = 1e-6


class ClosingInterval(NamedTuple):
    """A part of the way on which loops are closed, by the same factors."""

    factors: MinimumNorm  # of the step, or of `begin`
    begin: Array
    end: Array


class LoopProjection:
    """The closing of the loops of one system.

    factors: those that a step at q would have
    """

    def __init__(
        self, system: System, factors: Callable[[Array, Array, Array], MinimumNorm]
    ) -> None:
        self._system, self._equations, self._factors = system, system.equations, factors

    def closed(self, of_step: MinimumNorm, q: Array) -> Array:
        """Return q with loops closed."""
        return self.closing_path(of_step, q)[-1].end if of_step.rank else q

    def work(self, q: Array, q1: Array, v: Array) -> float:
        """Energy gained by the move from q to q1, which closes the loops [J]."""
        model, data, passive = self._system.model, self._equations.data, self._system.passive
        won = pin.computeMechanicalEnergy(model, data, q1, v)
        won -= pin.computeMechanicalEnergy(model, data, q, v)
        if len(passive.k) or passive.between:
            won += float(passive.energy(q1) - passive.energy(q))
        return float(won)

    def closing_path(self, of_step: MinimumNorm, q: Array) -> list[ClosingInterval]:
        """Path from q to closed loops by Newton steps, one part for each set of factors."""
        way, least = [ClosingInterval(of_step, q, q)], inf
        for _ in range(_CLOSINGS if of_step.rank else 0):
            c = self._equations.violation(q)
            gap = max(map(abs, c.tolist()))
            if not gap < least:  # rounding, or out of reach
                break
            way[-1], least = way[-1]._replace(end=q), gap
            if gap <= CLOSED:
                break
            if gap > SMALL:
                J = self._equations.consistent_jacobian(q)
                factors = self._factors(self._system.mass(q), J, q)
                way.append(ClosingInterval(factors, q, q))
            q = self._system.integrate(q, way[-1].factors.closing(c))
        return way
