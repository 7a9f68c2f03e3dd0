"""EventLocated: impacts at their own times within a step, and the derivatives of that step.

x+ = flow(dt - s) o impact o flow(s),    gap(s) = 0,    ds = -(J_n dq) / (J_n v)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import inf
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms, difference
from condyn_pin.contact.problem import OPEN, SLIDE, STICK, ContactProblem, ContactsInModes, Modes
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.linear_steps import LinearizedEnd, LinearizedStep
from condyn_pin.gradients.routes.route import Route
from condyn_pin.gradients.routes.step_derivatives import (
    ContactLaw,
    StepDerivatives,
    minimum_norm_solution,
    modes_of,
    step_derivatives_of,
)
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.records import Note
from condyn_pin.stepping.contact_steps import ContactSteps
from condyn_pin.stepping.schemes.moreau import Moreau
from condyn_pin.stepping.step_problem import AcceptedStep, ActiveCandidates, StepProblem

# An impact is a step so short that no force has time to do anything [s].
_INSTANT: Final = 1e-15

# How flows are differenced by their length, as a share of the step.
_SHARE: Final = 1e-4


class LocatedStep:
    """One step of some linear steps, cut where gaps close."""

    def __init__(self, steps: LinearizedStep) -> None:
        self._steps, self._dt, self._system = steps, steps.dt, steps.system
        self._law = partial(ActiveSet().law, size=steps.size)
        self._landings = Flows(steps)

    def taken(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the step."""
        done, landings, v0 = 0.0, self._landings, v
        while done < self._dt:
            struck = landings.struck(q, v)
            if struck is not None:
                q, v = self._impact(struck).ended(t + done, q, v, self._law)
            cut = landings.next(t, done, q, v)
            q, v = self._flow(cut, t, q, v)
            done = cut.start + cut.length if cut.closing >= 0 else self._dt
        self._steps.steps.check_turn(v0, v)
        return q, v

    def differentiated(self, route: Route, t: float, q: Array, v: Array) -> StepDerivatives:
        """Return the end of the step, and its derivatives by its start."""
        columns, n, landings = self._steps.columns, len(v), self._landings
        dq, dv, done, ds = columns.empty(), columns.empty(), 0.0, np.zeros(columns.size)
        dq[:, columns.q], dv[:, columns.v] = np.eye(n), np.eye(n)
        modes, none, v0, notes = dict[str, str](), np.zeros(n), v, dict[Note, None]()
        margin = self._from_landing(q, v)
        while done < self._dt:
            struck = landings.struck(q, v)
            if struck is not None:
                impact = self._impact(struck).end(t + done, q, v, self._law)
                modes, margin = self._joined(modes, margin, impact)
                notes |= dict.fromkeys(impact.notes)
                late = np.zeros(n), self._struck_late(impact, t + done)
                q, v, (dq, dv) = impact.q, impact.v, _composed(impact, dq, dv, late, ds)
            cut = landings.next(t, done, q, v)
            flow = self._made(cut.length, cut.held)
            ended = flow.end(t + done, q, v, self._law)
            modes, margin = self._joined(modes, margin, ended)
            notes |= dict.fromkeys(ended.notes)
            if cut.held.any():
                dv = self._settled(ended, t + done, q, v, (dq, dv, ds))
            rate_q, rate_v = none, none
            if ds.any() or cut.closing >= 0:
                rate_q, rate_v = self._rates(cut, t, q, v, ended.q)
            late_q, late_v = self._late(flow, t + done, q, v, ds)
            # at the same time, though this part has begun later by ds
            dq, dv = _composed(ended, dq, dv, (late_q - rate_q, late_v - rate_v), ds)
            q, v, done = ended.q, ended.v, self._dt
            if cut.closing >= 0:
                J_n = landings.normal(q, cut.closing)
                opening, done = float(J_n @ rate_q), cut.start + cut.length
                ds = -(J_n @ dq) / opening
                dq, dv = dq + np.outer(rate_q, ds), dv + np.outer(rate_v, ds)
                margin = min(margin, self._missed(opening * (self._dt - done), opening))
        self._steps.steps.check_turn(v0, v)
        margin = min(margin, self._from_landing(q, v))
        return step_derivatives_of(
            route, self._steps, (q, v), (dq, dv), modes, margin, tuple(notes)
        )

    def _joined(
        self, modes: dict[str, str], margin: float, ended: LinearizedEnd
    ) -> tuple[dict[str, str], float]:
        """Return modes and margin with those of one more part.

        A contact is what it was when it last touched.
        """
        then = modes_of(self._steps, ended).items()
        joined = {name: modes.get(name, "open") if m == "open" else m for name, m in then}
        return joined, min(margin, ended.law.margin)

    def _from_landing(self, q: Array, v: Array) -> float:
        """Distance of closing gaps from zero at the start or end of a step, as a share of it.

        At zero a landing would enter the step, or leave it.
        """
        each = np.column_stack(self._landings.approach(q, v)).tolist()
        return min((self._missed(*one) for one in each if one[1] < -RESTS), default=inf)

    def _missed(self, gap: float, opening: float) -> float:
        """Distance of a closing gap (m, rad) from zero, as a share of a step."""
        return abs(gap) / self._dt / max(-opening, self._steps.falls)

    def _settled(
        self, flow: LinearizedEnd, t: float, q: Array, v: Array, by: tuple[Array, Array, Array]
    ) -> Array:
        """Derivative of v by all columns, with contacts at rest again after a disturbance.

        Velocities that open or close a contact last for no time: closing ones end at once. A
        contact that opens by e v is back after 2 e v / a, and its slip of that time ends too. Any
        other slip ends later, in the flow.
        """
        assert flow.law.modes is not None  # as `ActiveSet` has read them
        modes, held = flow.law.modes.copy(), flow.posed.chosen.near
        gaps, opening = (each[held] for each in self._landings.approach(q, v))
        # not what is on its way out, or comes out of the ground by its flow alone
        modes[: len(gaps)][(opening > RESTS) | (gaps < -TOUCHES)] = OPEN
        (dq, dv, ds), n, e = by, len(v), self._steps.columns.restitution
        steps = self._made(_INSTANT, held)

        def ended(along: bool) -> Array:
            at_once = steps.end(t, q, v, partial(_stopping, modes=modes, along=along))
            late = np.outer(self._struck_late(at_once, t), ds)
            return at_once.dv[:, :n] @ dq + at_once.dv[:, n : 2 * n] @ dv + late

        settled = ended(along=False)
        if dv[:, e].any():
            settled[:, e] = ended(along=True)[:, e]
        return settled

    def _impact(self, struck: NDArray[np.bool_]) -> LinearizedStep:
        return self._made(_INSTANT, struck, rebounds=self._landings.rebounds)

    def _made(
        self, dt: float, held: NDArray[np.bool_], *, rebounds: bool = False
    ) -> LinearizedStep:
        """Return the linear steps of a part."""
        return self._steps.lasting(dt, HeldSteps(self._steps, dt, held, rebounds))

    def _flow(self, cut: Flow, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of a flow, to rounding."""
        return self._made(cut.length, cut.held).ended(t + cut.start, q, v, self._law)

    def _rates(self, cut: Flow, t: float, q: Array, v: Array, middle: Array) -> tuple[Array, Array]:
        """Derivatives of q and v at the end of a flow by its length (nv,); `middle` is that q."""
        by, model = _SHARE * self._dt, self._system.model
        (q1, v1), (q0, v0) = (
            self._flow(cut._replace(length=cut.length + x), t, q, v) for x in (by, -by)
        )
        moved = difference(model, middle, q1) - difference(model, middle, q0)
        return moved / (2 * by), (v1 - v0) / (2 * by)

    def _struck_late(self, ended: LinearizedEnd, t: float) -> Array:
        """Derivative of v behind an instant by its time (nv,), from s'' of driven rows."""
        (condensed, law), equations = (ended.posed.condensed, ended.law), self._system.equations
        if not equations.is_driven:
            return np.zeros(len(ended.v))
        equations.at(t)
        free, dsigma = condensed.changed(np.zeros((len(ended.v), 1)), equations.wanted[2][:, None])
        A = law.by_sigma.dot(condensed.G) + law.by_lam
        free -= condensed.X.dot(minimum_norm_solution(A, law.by_sigma.dot(dsigma)))
        return np.asarray(condensed.factors.mass.L_inv.T.dot(free[:, 0]))

    def _late(
        self, part: LinearizedStep, t: float, q: Array, v: Array, ds: Array
    ) -> tuple[Array, Array]:
        """Derivatives of the end of a flow by its start time, at the same length (nv,) each."""
        system, none = self._system, np.zeros(len(v))
        by = min(_SHARE * self._dt, 0.1 * part.dt)
        is_of_time = system.scene.is_driven or system.applied.constant is None
        if not (is_of_time and ds.any()):
            return none, none
        (q1, v1), (q0, v0) = (part.ended(t + x, q, v, self._law) for x in (by, -by))
        return difference(system.model, q0, q1) / (2 * by), (v1 - v0) / (2 * by)


def _composed(
    ended: LinearizedEnd, dq: Array, dv: Array, late: tuple[Array, Array], ds: Array
) -> tuple[Array, Array]:
    """Return the end of a part by the start of the step, and by what acts in both.

    `late` is how it changes where the part begins later, as it does by ds (columns,).
    """
    n = len(dq)
    both = []
    for of, slope in zip((ended.dq, ended.dv), late, strict=True):
        x = of[:, :n] @ dq + of[:, n : 2 * n] @ dv + np.outer(slope, ds)
        x[:, 2 * n :] += of[:, 2 * n :]
        both.append(x)
    return both[0], both[1]


def _stopping(
    problem: ContactProblem, lam: Array, _: float, modes: Modes, along: bool
) -> ContactLaw:
    """Return the law of impulses that stop what rests: its normal velocity, and `along` its slip.

    What slips has friction of them, whatever comes of it later.
    """
    still, sets = np.zeros_like(lam), problem.sets
    t1, t2, n = sets.axes
    sigma, modes = problem.velocities(still), modes.copy()
    slips = np.hypot(sigma[t1], sigma[t2]) > RESTS
    cones = modes[: len(slips)]
    cones[slips & (cones == STICK)] = SLIDE
    of = ContactsInModes(problem, modes).at(still)
    if not along:
        sticks = (modes == STICK)[sets.blocks]
        sticks[n] = sticks[sets.parts[1]] = False
        of.by_sigma[sticks], of.by_lam[sticks] = 0.0, np.eye(len(lam))[sticks]
    return ContactLaw(still, of.by_sigma, of.by_lam, of.by_friction, inf, modes=modes)


# Landings: when gaps close within a step, and the motion up to there.
#
#     gap(flow(s)) = 0
#
# Between two such times contacts keep what they are, open or at rest, by steps of `Moreau`; what is
# at rest does not rebound.


# A gap that is closed [m, rad], and a velocity along the normal that counts as zero [m/s, rad/s].
TOUCHES: Final = 1e-9
RESTS: Final = 1e-7

# Cuts of one step, at most: what bounces more often rests.
_CUTS: Final = 8

# Halvings of the step in which an impact is looked for: to rounding.
_HALVINGS: Final = 100

# Halvings of the step in which a gap is looked for that opens: a millionth of a millionth of it.
_OPENINGS: Final = 40


class HeldSteps(ContactSteps):
    """Steps with some contacts active, wherever they are: in a flow, or in an impact.

    What is at rest in a flow does not rebound.
    """

    def __init__(
        self, steps: LinearizedStep, dt: float, held: NDArray[np.bool_], rebounds: bool
    ) -> None:
        super().__init__(steps.scheme, steps.system, dt)
        self.held, self._rebounds = held, rebounds

    def pose(
        self, t: float, q: Array, v: Array, active: NDArray[np.bool_] | None = None
    ) -> StepProblem:
        """Return the step from a state with the contacts that are held."""
        return super().pose(t, q, v, self.held)

    def _choose(self, near: NDArray[np.bool_]) -> ActiveCandidates:
        chosen = super()._choose(near)
        if not self._rebounds:
            chosen.restitution[:] = 0.0
        return chosen


class Flow(NamedTuple):
    """A flow, a part of a step."""

    start: float  # [s], since the start of the step
    length: float  # [s]
    held: NDArray[np.bool_]
    closing: int  # the gap that ends it, -1 if the end of the step does


class Flows:
    """The flows of one step, each up to the first gap that closes."""

    def __init__(self, steps: LinearizedStep) -> None:
        self._steps, self._dt, self._system = steps, steps.dt, steps.system
        self._cuts = 0

    def flow(self, cut: Flow, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of a flow."""
        steps = HeldSteps(self._steps, cut.length, cut.held, rebounds=False)
        q, v, _ = steps.step(t + cut.start, q, v)
        return q, v

    def struck(self, q: Array, v: Array) -> NDArray[np.bool_] | None:
        """Flags of touching contacts, if one of them closes; None if none does."""
        gaps, closing = self.approach(q, v)
        touches = gaps <= TOUCHES
        return touches if (touches & (closing < -RESTS)).any() else None

    @property
    def rebounds(self) -> bool:
        """True if struck contacts rebound; after many landings in a step they come to rest."""
        return self._cuts < _CUTS

    def approach(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Gaps, and their opening velocities."""
        system = self._system
        data = system.equations.data
        algorithms(data).computeJointJacobians(system.model, data, q)
        gaps, J = system.contacts.evaluate(data, q)
        return gaps, J[system.contacts.normals].dot(v)

    def normal(self, q: Array, i: int) -> Array:
        """Return the row J_n (nv,) of a gap."""
        system = self._system
        data = system.equations.data
        algorithms(data).computeJointJacobians(system.model, data, q)
        J = system.contacts.evaluate(data, q)[1]
        return np.asarray(J[system.contacts.normals[i]])

    def next(self, t: float, done: float, q: Array, v: Array) -> Flow:
        """Return the flow from a state to the first gap that closes, or to the end of the step."""
        gaps, opening = self.approach(q, v)
        touches = gaps <= TOUCHES
        held = touches & (opening <= RESTS)
        whole = Flow(done, self._dt - done, held, -1)
        if self._cuts >= _CUTS:
            return whole._replace(held=touches)
        # what goes out and does not get there stays active: it may not go in again
        leaves = np.flatnonzero(touches & ~held).tolist()
        inside = [i for i in leaves if self._opened(whole, t, q, v, i) is None]
        if inside:
            held = held.copy()
            held[inside] = True
            whole = whole._replace(held=held)
        ends = self._gaps_after(whole, t, q, v)
        first, closing = whole.length, -1
        for i in np.flatnonzero((ends < 0) & ~held):
            s = self._located(whole, t, q, v, int(i))
            if s < first:
                first, closing = s, int(i)
        self._cuts += closing >= 0
        return whole._replace(length=first, closing=closing)

    def _gaps_after(self, cut: Flow, t: float, q: Array, v: Array) -> Array:
        there = self.flow(cut, t, q, v)[0]
        return self.approach(there, v)[0]

    def _located(self, whole: Flow, t: float, q: Array, v: Array, i: int) -> float:
        """Time at which a gap closes, by secants within an interval around the root.

        The end of the flow, if it never opens.
        """
        low, high = 0.0, whole.length
        f_low, f_high = (
            float(self.approach(q, v)[0][i]),
            float(self._gaps_after(whole, t, q, v)[i]),
        )
        if f_low <= TOUCHES:  # it has just left: the gap opens first
            opened = self._opened(whole, t, q, v, i)
            if opened is None:
                return high
            low, f_low = opened
        for k in range(_HALVINGS):
            s = high - f_high * (high - low) / (f_high - f_low) if k % 3 < 2 else (low + high) / 2
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if abs(f) < TOUCHES / 1e3 or high - low < 1e-15 * self._dt:
                return s
            if f > 0:
                low, f_low = s, f
            else:
                high, f_high = s, f
        return high

    def _opened(
        self, whole: Flow, t: float, q: Array, v: Array, i: int
    ) -> tuple[float, float] | None:
        """Return a time at which a gap is open, and how far; None if there is none."""
        s = whole.length
        for _ in range(_OPENINGS):
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if f > 0:
                return s, f
            s /= 2
        return None


@dataclass(frozen=True)
class EventLocated(Route):
    """The derivatives of a step with impacts located in time: saltation matrices.

    x+ = flow(dt - s) o impact o flow(s),    gap(s) = 0,    ds = -(J_n dq) / (J_n v)

    If the impact comes ds later, the flow after it is ds shorter, and what depends on time, as
    paths and torques may, is taken ds later.

    The step is cut where a gap closes. On both sides contacts keep what they are, open or at rest,
    by steps of `Moreau`; at the cut they rebound by Newton's law, with friction. The time of the
    cut depends on the start, which a step of fixed length ignores: otherwise the height of a ball
    after one bounce has a wrong derivative with respect to its initial height, at every dt.

    Notes
    -----
    The end differs from that of the scheme, which rebounds before or after the true impact. A
    contact that bounces more than eight times within a step rests from then on. One that is on its
    way out of the ground and does not get there within the step closes nothing: it goes on. What
    rests stays at rest: velocities that open or close it, and a small restitution, move it by their
    square. A landing at the very start or end of a step is `one_sided`; derivatives by q of what
    rests at a gap of zero are those of what is in the ground, which stays as deep as it is.

    References
    ----------
    Leine, Nijmeijer. Dynamics and Bifurcations of Non-Smooth Mechanical Systems. Springer, 2004.
    Kong, Payne, Zhu, Johnson. Saltation matrices: the essential tool for linearizing hybrid
    dynamical systems. Proceedings of the IEEE 112, 2024.
    """

    title: ClassVar[str] = "event located"
    cost: ClassVar[str] = "as ActiveSet; a step with an impact as much as ten"
    use: ClassVar[str] = "where the time of an impact matters: throws, bounces, touch-down"

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme of the parts of a step: Moreau's, with the same contact solver."""
        if scheme.law != "ncp":
            raise InvalidArgument(
                f"route = EventLocated(): impacts obey Coulomb's law, and {scheme.title} poses its "
                "convex relaxation; take StewartTrinkle() or Moreau()"
            )
        if isinstance(scheme, Moreau):
            return Moreau(scheme.contact, scheme.restitution_law)
        return Moreau(contact=scheme.contact)

    def at(
        self, steps: LinearizedStep, t: float, q: Array, v: Array, taken: AcceptedStep | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, with its derivatives."""
        with np.errstate(all="ignore"):  # what is not finite is refused
            return LocatedStep(steps).differentiated(self, t, q, v)

    def step(self, steps: LinearizedStep, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the same step of `steps`, without derivatives."""
        with np.errstate(all="ignore"):
            return LocatedStep(steps).taken(t, q, v)
