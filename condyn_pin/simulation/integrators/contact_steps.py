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
h is taken at the mean of v and v+. What a step leaves open is closed behind it.

Velocities of floating bodies are in axes that stand still within the step (`Manifold`): h is
M w x u less, and gamma J_b w x u.
"""

from __future__ import annotations

from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.attempts import judged
from condyn_pin.contact.problem import OPEN, Modes, contact_modes
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.errors import SolveFailed, StepFailed
from condyn_pin.simulation.contact_record import touch_of
from condyn_pin.simulation.dead_ends import pressed_in
from condyn_pin.simulation.integrators.base import Stepper
from condyn_pin.simulation.integrators.closings import Closings
from condyn_pin.simulation.integrators.contact_scheme import AT_REST, ContactScheme
from condyn_pin.simulation.integrators.path_ends import MISSED, kept_paths, next_path
from condyn_pin.simulation.integrators.posed import Kept, Posed
from condyn_pin.simulation.integrators.posed_steps import PosedSteps
from condyn_pin.simulation.integrators.step_work import drive_work, step_work
from condyn_pin.simulation.integrators.tried import Taken, Tried, answered
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.remarks import notes_of
from condyn_pin.simulation.system import System

# How often a step is posed anew because its paths end elsewhere, at most: each time their error
# falls by a factor of two at least, and most often by one of about dt |v|.
_AGAIN = 6

# Places on the way to the next step at which shapes are looked at that may pass each other.
_LOOKS = 64


class ContactSteps(PosedSteps):
    """The steps of one system with one scheme and one dt.

    Attributes
    ----------
    closings : Closings
    last : Taken
        The step that was taken last.
    """

    last: Taken

    def __init__(self, scheme: ContactScheme, system: System, dt: float) -> None:
        super().__init__(scheme, system, dt)
        self.closings = Closings(system, self._factors)
        self._normals = self._candidates.normals
        self._driven = system.equations.driven
        self._furthest: tuple[str, float] | None = None
        self._slow = system.manifold.slow(dt)

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and the mean acceleration.

        StepFailed if the contact solver has no answer.
        """
        taken = self.attempt(t, q, v)
        if self._is_driven:
            self.check_path(t, taken[0])
        if not self.last.natural <= tolerances.CONTACT_SOLVED:
            self._check_answer(t)
        last = self.last
        if (
            last.attempt.several
            or last.missed
            or last.through
            or last.posed.strike is not None
            or last.posed.near.gaps.min(initial=0.0) < -AT_REST
        ):
            self._system.remarks.note(t, (*notes_of(last.attempt.several), *last.notes))
        return taken

    def turn_fault(self, v: Array, v1: Array) -> str:
        """Return which body turns too far in a step from v to v1; nothing if none does."""
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
        """Refuse paths that press bodies into each other in the last step: nothing gives way."""
        posed = self.last.posed
        stuck = posed.near.G.diagonal()[posed.chosen.normals] == 0.0
        if not stuck.any():
            return
        data = self._equations.data
        algorithms(data).forwardKinematics(self._system.model, data, q1)
        gaps = self._candidates.gaps(data, q1)
        for place in np.flatnonzero(posed.chosen.near)[stuck]:
            if gaps[place] < min(-MISSED, posed.gaps[place]):
                raise pressed_in(self._candidates.names[place], t + self._dt, -gaps[place])

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
        answer = judged(posed.problem, found, natural, tolerances.CONTACT_SOLVED, nan)
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
        """Return the same of whatever the contact solver has answered."""
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
        self._system.contact_work = self._system.contact_work.plus(work)
        if not isfinite(q1.dot(q1).item() + v1.dot(v1).item() + work.total):
            natural = nan  # also where no contact takes part
        self.last = Taken(
            posed, v1, found, natural, work, tuple(tried), self._furthest, self._through(posed, v1)
        )
        return q1, turned, a

    def _through(self, posed: Posed, v1: Array) -> tuple[str, ...]:
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
            algorithms(data).forwardKinematics(self._system.model, data, q)
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

    def touch(self) -> Array:
        """Return what else there is to keep of the contacts of the last step."""
        work = self._system.contact_work
        return touch_of(self.last.natural, work, self.modes(), is_driven=self._is_driven)

    def modes(self) -> Modes:
        """Return the modes of all candidates in the last step."""
        posed = self.last.posed
        modes = np.full(len(posed.chosen.active), OPEN)
        if posed.problem.rows:
            modes[posed.chosen.active] = contact_modes(posed.problem, self.last.attempt.lam)
        return modes

    def sample(self, t: float, q: Array, v: Array) -> Row:
        """Return a sample of a state: with the forces of the step that begins there."""
        system, work = self._system, self._system.contact_work
        _, _, a = self.step(t, q, v)
        system.contact_work = work
        return t, q, v, a, self.lam(), system.applied.at_sample(t, q, v), self.touch()

    def _answered(self, t: float, q: Array, v: Array) -> list[Tried]:
        """Return a step as it was tried, each time along the path before; the last one is taken."""
        tried, self._furthest = [self._first(t, q, v)], None
        off = self._off(tried[0])
        return tried if off is None else self._along_paths(tried, off)

    def _along_paths(self, tried: list[Tried], off: Array) -> list[Tried]:
        """Return a step as it was tried again along its paths, until each ends where it should.

        Contacts that do not feel each other end by themselves: each group keeps the best of its
        attempts, whatever those of others bring.
        """
        solver, first = self._scheme.contact, tried[0].posed
        of_gaps, of_velocities = self.ends.alone(first)
        groups = np.arange(int(of_gaps.max(initial=-1)) + 1)

        def by_group(off: Array | None) -> Array:
            return np.array([0.0 if off is None else off[of_gaps == i].max() for i in groups])

        def again(of_groups: NDArray[np.int_]) -> Tried:
            """Return the next attempt, of each group along its path in an attempt, or the next."""
            last, of, kept = tried[-1], np.append(of_groups, -1)[of_velocities], None
            path = last.posed.v if last.posed.path is None else last.posed.path
            along = next_path(last.posed, path, last.v)
            if (of_groups >= 0).any():
                kept = Kept(of, np.append(of_groups == 0, False)[of_gaps], first)
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
            now = by_group(self._off(tried[-1]))
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

    def _first(self, t: float, q: Array, v: Array) -> Tried:
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

    def _off(self, tried: Tried) -> Array | None:
        """Return how far from where they should contacts end (k,) [m, rad]; None if near enough."""
        if not self._scheme.closes_gaps or not tried.is_answer_of(self._scheme.contact):
            return None
        return self.ends.off(tried.posed, tried.attempt.lam, tried.v)

    def _missed(self, posed: Posed, v1: Array) -> NDArray[np.bool_] | None:
        """Return a flag for each gap that the step closes and that takes no part, None for none.

        Where a step is long, or an impulse turns a body, what was far away goes through.
        """
        near = posed.chosen.near
        if posed.chosen.is_everything:
            return None
        missed = (posed.gaps + self._dt * posed.J[self._normals].dot(v1) < 0) & ~near
        return missed if missed.any() else None


def contact_stepper(scheme: ContactScheme, system: System, dt: float) -> Stepper:
    """Return a scheme at work on a system."""
    steps = ContactSteps(scheme, system, dt)
    return Stepper(steps.step, steps.lam, touch=steps.touch, sample=steps.sample)
