"""LinearizedStep: a step with contacts, and the derivatives of its end by its start.

    M dv+ - J_b^T dl_b - J_c^T dlam = df,    J_b dv+ = ds
    dsigma = G dlam + J_c dv_0 + (J_c v+)_q dq + ...,    the law of the route for dlam

with df and ds what the balance of momentum and the constraints leave by q, v and tau at fixed v+
and impulses (`partials`), and dv_0 the velocities that solve the first line with dlam = 0.
What a scheme adds to g comes from the scheme (`bias_partials`). All of that is by where the
equations are taken and by their v and tau, in the columns of q, v and tau; `StartChainRule` leads
from there to the start of the step.

Off loops with redundant rows nothing satisfies all of them: derivatives by q hold along motions
that keep the constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.partials.contacts import ContactTurning
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.constraints.rows.functions import BoundFunctions
from condyn_pin.contact.indeterminacy import Indeterminacy
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.derivatives.kkt import Linearisation
from condyn_pin.dynamics.scene import Scene, time_of
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import UnsupportedConstraint
from condyn_pin.gradients.routes.partials import (
    FloatingPartials,
    InertiaPartials,
    add_bias_partials,
    agrees_by_chance,
    end_state_partials,
    free_step_partials,
    impact_partials,
    is_open,
    left_of_constraints,
    left_of_momentum,
    linearised,
    row_partials,
    torque_partials,
)
from condyn_pin.gradients.routes.step_derivatives import Columns, ContactLaw, minimum_norm_solution
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.records import Note
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import ContactSteps
from condyn_pin.stepping.step_problem import AcceptedStep, StepProblem, kept_paths, next_path


def falls(model: Any, dt: float) -> float:
    """Return g dt, with 9.81 m/s^2 where there is no gravity [m/s]."""
    return (float(np.linalg.norm(model.gravity.linear)) or 9.81) * dt


def rows_with_a_place(bounds: Sequence[BoundConstraint]) -> list[int]:
    """Return the rows that have a position error."""
    return [row for bound in bounds for row in bound.positioned]


# Of a problem, impulses and their natural residual.
_Law = Callable[[ContactProblem, Array, float], ContactLaw]


class LinearizedEnd(NamedTuple):
    """The end of a step, and its derivatives by all `Columns`."""

    q: Array
    v: Array
    dq: Array  # (nv, columns), tangent
    dv: Array  # (nv, columns)
    posed: StepProblem
    law: ContactLaw
    notes: tuple[Note, ...]  # why the derivatives are those of a rule, or of one side


def _check_time(bounds: Sequence[BoundConstraint]) -> None:
    """Refuse rows of functions with time in them: partials are taken at one time."""
    if moving := [b.name for b in bounds if isinstance(b, BoundFunctions) and b.rheonomic]:
        raise UnsupportedConstraint(
            f"{', '.join(moving)}: time is in its functions, and derivatives of steps and motions "
            "take paths of time alone: Driven(OwnRows(...), along)"
        )


class LinearizedStep:
    """The steps of one scene by one scheme and dt, with their derivatives.

    `wrt` names parameters to differentiate by, as `StepSolution.derivatives` does.

    Not to be shared between threads.
    """

    begin: float  # the time of the scene [s]
    falls: float  # [m/s]
    size: float  # (m g dt) (g dt) [J]

    def __init__(
        self, scene: Scene, scheme: ContactScheme, dt: float, system: System | None = None,
        *, wrt: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.scene, self.scheme, self.wrt = scene, scheme, tuple(wrt)
        self.system = system or System(Workspace(scene.bilateral), contacts=scene.contact_bounds)
        model, self.begin = self.system.model, time_of(scene)
        self.partials = FloatingPartials(model)
        self.turning = ContactTurning(model, scene.contact_bounds)
        self.inertias = InertiaPartials(scene.robot.unedited) if "inertias" in wrt else None
        weighed = self.inertias.size if self.inertias else 0
        self.columns = Columns(scene.robot.nv, self.system.contacts.cones, weighed)
        bounds = self.system.equations.bounds
        _check_time(bounds)
        self.placed = np.array(rows_with_a_place(bounds), dtype=np.int_)
        self.itself = self.columns.empty()  # where the equations are taken, by that
        self.itself[:, self.columns.q] = np.eye(scene.robot.nv)
        self._take(dt, ContactSteps(scheme, self.system, dt))

    def _take(self, dt: float, steps: ContactSteps) -> None:
        """Take other steps of the same scheme, dt long [s]."""
        scheme = self.scheme
        self.dt, self.steps = dt, steps
        self.unit_impulses = dt * self.itself[:, self.columns.q]  # of unit torques
        self.floating, self.paths = steps.floating, steps.paths
        self.falls = falls(self.system.model, dt)
        self.size = self.scene.robot.mass * self.falls**2
        self.share = 0.5 * dt if scheme.at_midpoint else dt  # from `at` to the end [s]
        self._starts = StartChainRule(self.system, scheme, dt, self.partials)

    def lasting(self, dt: float, steps: ContactSteps) -> LinearizedStep:
        """Return other steps of the same scheme, dt long [s]; they share what they work in."""
        others = copy(self)
        others._take(dt, steps)
        return others

    @property
    def linearisation(self) -> Linearisation:
        """The equations of the constraints, linearised."""
        return self.system.workspace.linearisation

    @cached_property
    def without_gravity(self) -> Linearisation:
        """The equations of the constraints, linearised, without gravity."""
        return Linearisation(without_gravity(self.system.model), self.scene.bilateral.bounds)

    def end(
        self, t: float, q: Array, v: Array, law: _Law, taken: AcceptedStep | None = None,
        path: _Law | None = None,
    ) -> LinearizedEnd:  # fmt: skip
        """Return the end of a step from a state, with its derivatives by a `law` of contacts.

        `taken` is the step, if it is at hand, and `path` the law of its attempts before the last,
        along which it was taken again: that of the end if none is given.
        """
        if taken is None:
            self.steps.attempt(t, q, v)
            taken = self.steps.last
        if agrees_by_chance(self, taken.posed):
            taken = self._with_impact_apart(t, q, v)
        after, alongs, notes = np.zeros(0), list[Array](), dict[str, Note]()
        self.steps.check_turn(v, taken.v)
        self.system.at(self.steps.evaluation_time(t))
        for posed, _, attempt, natural in taken.tried:
            if posed.kept is not None:
                after = kept_paths(posed.kept.of, alongs, after)
            if posed.path is not None:
                alongs.append(after)
            of = law if path is None or posed is taken.posed else path
            found = of(posed.problem, attempt.lam, natural)
            if attempt.several:
                found = found.giving_way(posed.problem)
            notes |= {note.text: note for note in _notes(posed, attempt.several)}
            v1 = posed.velocity(found.lam)
            dv1 = self._velocity(posed, found, v1, alongs[-1] if alongs else None)
            if not alongs:
                alongs.append(np.zeros_like(dv1))
            after = next_path(posed, alongs[-1], dv1)
        if notes:
            found = found._replace(margin=0.0)
        self.system.at(t + self.dt)  # where loops are closed behind the step
        q1, v1, dq, dv = end_state_partials(self, posed, v1, dv1)
        chain = self._starts.chain(t, q, v, taken.posed)
        if chain is not None:
            for by in (dq, dv):
                by[:, : len(chain)] = by[:, : len(chain)].dot(chain)
        return LinearizedEnd(q1, v1, dq, dv, posed, found, tuple(notes.values()))

    def _with_impact_apart(self, t: float, q: Array, v: Array) -> AcceptedStep:
        """Return the step with its impact by itself, also where Newton's law is the same."""
        self.steps.always_strikes = True
        try:
            self.steps.attempt(t, q, v)
        finally:
            self.steps.always_strikes = False
        return self.steps.last

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of a step of the scheme."""
        q1, v1, _ = self.steps.step(t, q, v)
        self.steps.check_turn(v, v1)
        return q1, v1

    def ended(self, t: float, q: Array, v: Array, law: _Law) -> tuple[Array, Array]:
        """q+ and v+ of a step by a `law` of contacts, without derivatives."""
        self.steps.attempt(t, q, v)
        posed, _, attempt, natural = self.steps.last.tried[-1]
        self.steps.check_turn(v, self.steps.last.v)
        v1 = posed.velocity(law(posed.problem, attempt.lam, natural).lam)
        moved = self.floating.integrate(posed.at, self.share * v1)
        q1 = self.steps.closings.closed(posed.condensed.factors, moved)
        return q1, self.floating.turned(v1, self.share)

    def _velocity(
        self, posed: StepProblem, law: ContactLaw, v1: Array, along: Array | None
    ) -> Array:
        """Return v+ by all columns (nv, columns), in the axes of the step.

        `along` (nv, columns) is how the velocity changes along which contacts are taken, if any.
        """
        if not len(law.lam):
            return free_step_partials(self, posed, v1)
        condensed, lam = posed.condensed, posed.total(law.lam)
        l_b = condensed.constraint_impulses(lam)
        of = linearised(self, posed, v1, l_b)
        rows = row_partials(self, posed, lam, v1, along)
        f = left_of_momentum(self, of, posed, v1)
        f[:, : rows.pulls.shape[1]] += rows.pulls
        free, dsigma = condensed.changed(f, left_of_constraints(self, of, posed, v1))
        dsigma[:, : rows.slips.shape[1]] += rows.slips
        add_bias_partials(dsigma, self, posed, law, rows)
        if posed.strike is not None and posed.strike.apart.any():
            struck, off = impact_partials(self, posed)
            dsigma += condensed.G.dot(struck)
            dsigma[posed.near.normals] -= off
            free += condensed.X.dot(struck)
        R = posed.problem.R
        G = posed.problem.G if R is None else posed.problem.G + np.diag(R)
        A = law.by_sigma.dot(G)
        A += law.by_lam
        b = law.by_sigma.dot(dsigma)
        b[:, self._friction(posed)] += law.by_friction
        if self.inertias and law.by_size is not None:
            size = self.falls**2 * self.inertias.mass()
            b[:, self.columns.inertias] += np.outer(law.by_size, size)
        free -= condensed.X.dot(minimum_norm_solution(A, b))
        return np.asarray(condensed.factors.mass.L_inv.T.dot(free))

    def _friction(self, posed: StepProblem) -> slice | Indices:
        return self.columns.of_cones("friction", posed.chosen.cones)

    def restitution(self, posed: StepProblem) -> slice | Indices:
        """Return the columns of the restitution of the active cones."""
        return self.columns.of_cones("restitution", posed.chosen.cones)


def _notes(posed: StepProblem, several: Sequence[Indeterminacy]) -> Iterator[Note]:
    """Reasons for derivatives of a step by a rule, or of one side."""
    for each in several:
        text = f"slopes are those of the rule: {each.text}"
        yield Note(each.kind, each.whole_names, text)
    if posed.strike is not None and is_open(posed):
        yield _note(
            "strike", posed, posed.strike.apart,
            "strike at once, and no law says how they share that: slopes are those of one way",
        )  # fmt: skip
    if (pressed := posed.near.pressed).any():
        yield _note(
            "pushes", posed, pressed,
            "opposing pushes limit each other here: by q, slopes are those of each push alone",
        )  # fmt: skip


def _note(kind: str, posed: StepProblem, which: NDArray[np.bool_], text: str) -> Note:
    names = tuple(posed.problem.names[i] for i in np.flatnonzero(which))
    return Note(kind, names, f"{', '.join(names)}: {text}")


# Starts: how the start of the equations of a step changes with that of the step.
#
# Those that are posed in the middle begin at q (+) dt v / 2, with v in the axes of there, and
# torques are those of there; all others have torques of the beginning. Springs and damping act in
# the middle of the step or at its end (`torque_partials`). All else is differentiated by where the
# equations are taken, by their v and tau; the chain rule comes last.


class StartChainRule:
    """The starts of the steps of one system by one scheme and dt."""

    def __init__(
        self, system: System, scheme: ContactScheme, dt: float, partials: FloatingPartials
    ) -> None:
        self._system, self._scheme, self._dt = system, scheme, dt
        self._partials = partials
        self._held = dict[float, Array | None]()  # by how far ahead springs and damping act

    def chain(self, t: float, q: Array, v: Array, posed: StepProblem) -> Array | None:
        """Derivatives of q, v and tau of the equations by those of the step (3 nv, 3 nv).

        None where they are the same: the identity.
        """
        n, ahead, start = len(v), posed.span, (q, v)
        if self._scheme.at_midpoint:
            ahead, t, q, v = ahead - 0.5 * self._dt, posed.t, posed.at, posed.v
        pulled = self._pulls(t, q, v, ahead)
        if pulled is None and not self._scheme.at_midpoint:
            return None
        chain = np.eye(3 * n)
        if self._scheme.at_midpoint:
            half = 0.5 * self._dt
            chain[:n, :n], by_move = self._partials.integrate(start[0], half * start[1])
            chain[:n, n : 2 * n] = half * by_move
            chain[n : 2 * n, n : 2 * n] = self._partials.turned(start[1], half, by_move)
        if pulled is not None:
            chain[2 * n :, : 2 * n] = pulled.dot(chain[: 2 * n, : 2 * n])
        return chain

    def _pulls(self, t: float, q: Array, v: Array, ahead: float) -> Array | None:
        """Return the torques by q and v (nv, 2 nv), None of those that are held alone.

        Those that are held, and springs of joints, change alike everywhere.
        """
        system, model = self._system, self._system.model
        is_held = system.applied.constant is not None and system.passive.between is None
        if not is_held:
            return self._pulled(t, q, v, ahead)
        if ahead not in self._held:
            still = pin.neutral(model), np.zeros(model.nv)
            self._held[ahead] = self._pulled(0.0, *still, ahead)
        return self._held[ahead]

    def _pulled(self, t: float, q: Array, v: Array, ahead: float) -> Array | None:
        pulled = np.hstack(torque_partials(self._system, t, q, v, ahead))
        return pulled if pulled.any() else None
