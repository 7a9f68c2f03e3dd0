"""The verbs step and contact_problem: one step of a scene whose contacts open, stick and slide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from time import perf_counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type, count_text, joint_torques, step_size
from condyn_pin._core.arrays import Array, finite, read_only, rounded
from condyn_pin._core.models import algorithms
from condyn_pin._core.threads import ThreadCache, one_blas_thread
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.forces import AppliedForce, Load, applied_forces
from condyn_pin.constraints.rows.cables import Lines
from condyn_pin.contact.problem import MODES, ContactProblem
from condyn_pin.contact.solution import ContactSolution, ContactStatus, verified
from condyn_pin.dynamics.scene import Scene, check_scene, time_of
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.records import forces_of
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import ContactSteps
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle
from condyn_pin.stepping.step_problem import AcceptedStep, StepProblem

if TYPE_CHECKING:
    from condyn_pin.gradients.routes.route import Route
    from condyn_pin.gradients.routes.step_derivatives import StepDerivatives


# StepSolution: a step with contacts that carries its own proof.


@dataclass(frozen=True, eq=False, repr=False)
class StepSolution:
    """The state after one step, its impulses, and their residual in each law.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,
    J_b v+ = -dt gamma / 2,    sigma = G lam + g

    Attributes
    ----------
    q, v : (nq,), (nv,) array
        Configuration [rad, m] and velocity [rad/s, m/s] at the end of the step.
    lam : (m,) array
        Impulses of the step, of constraints and then of all contacts, zero of those that take no
        part [N s, N m s].
    gaps : dict of str to float
        Distance of each contact and stop at the end [m, rad].
    modes : dict of str to str
        Of each contact: open, stick or slide.
    contact : ContactSolution
        The contact problem of the step, its answer, and seven residuals.
    dynamics_error : float
        The largest entry of M (v+ - v) - dt (tau - h) - J_b^T l_b - J_c^T lam, by Newton-Euler and
        wrenches on the bodies, with neither M nor J [N s, N m s].
    dynamics_limit : float
        The largest `dynamics_error` of a step that is ok: 1e-7 of |M| |v+ - v| + dt (|h| + |tau|)
        of the joint where that is largest, and the rounding of M v [N s, N m s].
    constraint_error : float
        max abs(J_b v+ + dt gamma / 2), of driven rows less s' + dt s'' / 2, by forward kinematics
        [m/s, rad/s].
    violation : float
        max abs(c(q+)) of the constraints [m, rad].
    penetration : float
        The deepest of the contacts at the end [m, rad].
    energy_error : float
        The change of kinetic and potential energy and that of springs, from one state to the other,
        that no work explains [J].
    energy_limit : float
        The largest `energy_error` of a step that is ok: a tenth of the energies in it, and what a
        step of order 1 leaves of forces that begin to act [J].
    energy_lost : float
        What the contacts took, friction and impacts; not negative, springs of a `SoftStep` apart
        [J].
    correction_work : float
        Work of pushing penetrations out, and of moving q back onto the loops [J].
    algorithmic_work : float
        Energy that contacts added although friction and impacts only take it, because a step has J
        at one place only [J].
    driven_work : float
        Work of constraints that follow a path of time [J].
    dt : float
        Time step [s].
    scene : Scene
    integrator : ContactScheme
        The scheme that took the step.
    start : StepStart
        Where the step began, and what acts on it.
    """

    q: Array
    v: Array
    lam: Array  # [N s, N m s]
    gaps: dict[str, float]  # [m, rad]
    modes: dict[str, str]
    contact: ContactSolution
    dynamics_error: float  # [N s, N m s]
    dynamics_limit: float  # [N s, N m s]
    constraint_error: float  # [m/s, rad/s]
    violation: float  # [m, rad]
    penetration: float  # [m, rad]
    energy_error: float  # [J]
    energy_limit: float  # [J]
    energy_lost: float  # [J]
    correction_work: float  # [J]
    algorithmic_work: float  # [J]
    driven_work: float  # [J]
    dt: float  # [s]
    scene: Scene
    integrator: ContactScheme
    start: StepStart
    _taken: AcceptedStep  # the step as it was posed and answered, for its derivatives
    _turns: str  # which body turns further than a step follows, if one does

    @one_blas_thread
    def derivatives(
        self, *, route: Route | None = None, wrt: Sequence[str] = ()
    ) -> StepDerivatives:
        """Return the derivatives of q+ and v+ by q, v, tau, and parameters of contacts and bodies.

        Parameters
        ----------
        route : Route, optional
            Treatment of kinks and jumps: `ActiveSet()` by default, the derivatives within the
            modes of the step.
        wrt : sequence of {"friction", "restitution", "solref", "inertias"}
            Parameters that are required beside q, v and tau. Inertias, ten columns a joint, are
            left out unless they are named; the others are there wherever the step depends on them.

        Returns
        -------
        StepDerivatives

        Raises
        ------
        InvalidArgument
            If the route cannot differentiate a step of this scheme, or by a parameter.
        SolveFailed
            If the contact problem has no answer that modes can be read off.
        StepFailed
            If a body turns further than a step follows it.

        Notes
        -----
        A route that takes other steps, such as `Softened`, takes this one again. Cost:
        `Route.cost`.
        """
        from condyn_pin.gradients.routes import ActiveSet
        from condyn_pin.gradients.routes.route import Route  # they are made of steps

        chosen = ActiveSet() if route is None else route
        check_type("route", chosen, Route, "a Route is needed, such as ActiveSet()")
        return chosen.differentiate(
            self.scene, self.integrator, self.dt, self.start, wrt, taken=self._taken
        )

    @property
    def status(self) -> ContactStatus:
        """OK if contacts are answered, energy kept, loops closed, and turns followed."""
        status, kept = self.contact.status, self._is_balanced and self._keeps_energy
        if status.ok and not (kept and self._is_closed and not self._turns):
            return ContactStatus.INACCURATE
        return status

    @property
    def notices(self) -> tuple[str, ...]:
        """Warnings about the step, one sentence each."""
        said = []
        if not self._is_balanced:
            said.append(
                f"M (v+ - v) is off by {self.dynamics_error:.1e} N s or N m s, and at most "
                f"{self.dynamics_limit:.1e} is right: rounding is as large as what impulses do; "
                "look at contacts that the constraints hold but for a short lever, and at masses "
                "that are far apart"
            )
        if not self._is_closed:
            said.append(
                f"loops are open by {self.violation:.2g} m or rad where the step ends, and cannot "
                f"be closed from there: take a shorter step than {1e3 * self.dt:.4g} ms, from a "
                "state with closed loops"
            )
        said += [note.text for note in self._taken.notes]
        if not self._keeps_energy:
            said.append(
                f"the energy of the two states differs by {self.energy_error:.3g} J that no work "
                f"explains, and at most {self.energy_limit:.2g} J is right: bodies turn or move "
                f"too far in it, take a shorter one than {1e3 * self.dt:.4g} ms"
            )
        if self._turns:
            said.append(self._turns)
        return (*said, *self.contact.notices)

    @property
    def _keeps_energy(self) -> bool:
        """True if the energy changes by the work of the step, to the order of the scheme."""
        return not np.isfinite(self.energy_limit) or self.energy_error <= self.energy_limit

    @property
    def _is_balanced(self) -> bool:
        """True if the balance of momentum holds, to the accuracy of the forces."""
        return self.dynamics_error <= self.dynamics_limit

    @property
    def _is_closed(self) -> bool:
        """True if the loops end closed, except for drift."""
        return self.violation <= tolerances.OUT_OF_REACH

    @property
    def impulses(self) -> dict[str, Array]:
        """Impulses by constraint and by contact [N s, N m s], as `forces`."""
        return forces_of(self.scene, self._taken.posed.at, self.lam)

    @property
    def forces(self) -> dict[str, Array]:
        """Mean forces of the step by constraint, and by contact (t1, t2, n) [N, N m].

        In the axes of each constraint where the step has its rows, or its `axes` if it has such.
        """
        return forces_of(self.scene, self._taken.posed.at, self.lam / self.dt)

    def __repr__(self) -> str:
        counted = [f"{n} {mode}" for mode, n in self._counts.items() if n]
        return (
            f"StepSolution({self.scene.robot.name}: {', '.join(counted) or 'no contacts'}; "
            f"{self.status.word})"
        )

    @property
    def _counts(self) -> dict[str, int]:
        modes = list(self.modes.values())
        return {mode: modes.count(mode) for mode in ("open", "stick", "slide")}

    def __str__(self) -> str:
        lines = [
            f"{self.scene.robot.name}, a step of {1e3 * self.dt:.4g} ms: {self.status}",
            f"natural residual {self.contact.natural:.1e}; "
            f"{count_text(self.contact.iterations, 'iteration')} of {', '.join(self.contact.path)}"
            if self.contact.path
            else "no contact is active",
            f"dynamics    {self.dynamics_error:.1e} N s",
            f"constraints {self.constraint_error:.1e} m/s, {self.violation:.1e} m",
            f"penetration {self.penetration:.1e} m",
            f"energy      lost in contacts {self.energy_lost:.4g} J; added by corrections "
            f"{self.correction_work:.2g} J, by the step itself {self.algorithmic_work:.2g} J"
            + (f", drives {self.driven_work:.4g} J" if self.scene.is_driven else ""),
        ]
        for name, mode in self.modes.items():
            force = rounded(self.forces[name])
            gap = f", gap {1e3 * self.gaps[name]:.4g} mm" if name in self.gaps else ""
            lines.append(f"{name:<28} {mode:<6} {force} N{gap}")
        if not self.status.ok:
            lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# ProvedSteps: steps of a scene with contacts, one at a time, and what each leaves of its laws.
#
#     M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = -dt gamma / 2
#
# are evaluated anew where the step has taken them, by recursive Newton-Euler and by the velocities
# of the frames, whatever solved them; and the account of energy from the two states,
#
#     E(q+, v+) - E(q, v) = (tau - d u) . dt u + work of impulses,    u = (q+ - q) / dt.


class ProvedSteps:
    """Steps of one scene by one scheme and dt; not to be shared between threads."""

    def __init__(self, scene: Scene, dt: float, scheme: ContactScheme) -> None:
        check_scene(scene)
        self._t = time_of(scene)  # where the step begins [s]
        if not isinstance(scheme, ContactScheme):
            raise InvalidArgument(
                f"integrator = {scheme!r}: a scheme with contacts is needed, such as "
                "StewartTrinkle() or Moreau(); simulate takes the others"
            )
        check_scheme(scene, scheme)
        self._scene, self._dt, self._scheme = scene, step_size(dt), scheme
        self._system = System(Workspace(scene.bilateral), contacts=scene.contact_bounds)
        self._steps = ContactSteps(scheme, self._system, self._dt)
        self._run = algorithms(self._system.equations.data)
        self._rows, bounds = scene.rows, scene.contact_bounds
        # the candidates of the proof, not of the step: joints of their sides, of stops and dry
        # friction where v has them, with their signs, and cables
        self._candidates, self._sides = Candidates(self._system.model, bounds), _sides(bounds)
        self._stops = [(stop.iv, stop.sign) for bound in bounds for stop in bound.stops]
        self._dry = [(each.iv, 1.0) for bound in bounds for each in bound.dry]
        lines = [each.line for bound in bounds for each in bound.lines]
        self._lines = Lines(self._system.model, lines) if lines else None
        self._ends = len(self._stops), len(self._stops) + len(lines)
        gravity = float(np.linalg.norm(scene.robot.model.gravity.linear))
        self._weight = scene.robot.mass * gravity  # [N]

    @one_blas_thread
    def pose(
        self, q: Array, v: Array, tau: float | ArrayLike, forces: Sequence[AppliedForce]
    ) -> StepProblem:
        """Return the step from a state as it was posed."""
        self._hold(tau, forces)
        with np.errstate(all="ignore"):
            self._steps.attempt(self._t, q, v)  # an answer shows which contacts are active
        return self._steps.last.posed

    @one_blas_thread
    def step(
        self, q: Array, v: Array, tau: float | ArrayLike, forces: Sequence[AppliedForce]
    ) -> StepSolution:
        """Return the step from a state, with its residual in each law."""
        start = StepStart(*read_only((q, v, self._hold(tau, forces))), tuple(forces))
        with np.errstate(all="ignore"):  # the status says it
            return self._proved(start)

    def _proved(self, start: StepStart) -> StepSolution:
        q, v = start.q, start.v
        begun = perf_counter()
        q1, v1, a = self._steps.attempt(self._t, q, v)
        took = perf_counter() - begun
        posed, ended, found, natural, work, *_ = self._steps.last
        lam = self._steps.impulses()
        contact = verified(posed.problem, found, natural, tolerances.CONTACT_SOLVED, took)
        dynamics, constraint = self._errors(posed, ended, a, lam / self._dt)
        energy, energy_limit = self._energy_error(start, q1, v1)
        equations, candidates = self._system.equations, self._system.contacts
        self._system.at(self._t + self._dt)
        if self._scene.is_driven:
            self._steps.check_path(self._t, q1)
            self._system.check_reach(self._t + self._dt, q1, v1)
        violation = equations.open_by(q1, v1)[0]
        gaps = candidates.exact.gaps(equations.data, q1)
        modes = (MODES[code] for code in self._steps.modes())
        q1, v1, lam = read_only((q1, v1, lam))
        return StepSolution(
            q=q1, v=v1, lam=lam, gaps=dict(zip(candidates.names, gaps.tolist(), strict=False)),
            modes=dict(zip(candidates.names, modes, strict=True)), contact=contact,
            dynamics_error=dynamics, dynamics_limit=self._dynamics_limit(posed, ended, a),
            constraint_error=constraint, violation=violation,
            penetration=float(np.maximum(-gaps, 0.0).max(initial=0.0)),
            energy_error=energy, energy_limit=energy_limit, energy_lost=0.0 - work.contact,
            correction_work=work.correction, algorithmic_work=work.algorithmic,
            driven_work=work.driven,
            dt=self._dt, scene=self._scene, integrator=self._scheme, start=start,
            _taken=self._steps.last, _turns=self._steps.turn_fault(v, v1),
        )  # fmt: skip

    def _hold(self, tau: float | ArrayLike, forces: Sequence[AppliedForce]) -> Array:
        torques = joint_torques("tau", tau, self._scene.robot.nv)
        self._system.applied.hold(torques, applied_forces(forces))
        return np.array(torques)

    def _errors(
        self, posed: StepProblem, ended: Array, a: Array, lam: Array
    ) -> tuple[float, float]:
        """Residuals of the balance of momentum [N s, N m s], and of J_b v+ [m/s, rad/s]."""
        equations, passive = self._system.equations, self._system.passive
        self._system.at(self._steps.evaluation_time(self._t))
        at, v, rows = posed.at, posed.v, self._rows
        gained = (ended - v) / self._dt
        tau = posed.tau - passive.inertia(posed.span) * gained
        if passive.between is not None:
            U, weights = passive.between.inertia_rows(at, posed.span)
            tau -= U.T @ (weights * (U @ gained))
        push = self._push(posed, lam[rows:])
        left, _ = equations.residuals(at, posed.mean, tau + push.torque, a, lam[:rows], push)
        wanted = 0.5 * self._dt * equations.target(at, v)
        # a - gained is -w x u of floating bodies
        missed = equations.gaps(at, ended + 0.5 * self._dt * (a - gained))[1] - wanted
        without = equations.left_out_at(at)
        missed = without.kept(missed) if without else missed
        return self._dt * float(np.abs(left).max()), float(np.abs(missed).max(initial=0.0))

    def _dynamics_limit(self, posed: StepProblem, ended: Array, a: Array) -> float:
        """Return the largest error of the balance of momentum that is right [N s, N m s]."""
        model, data, L = self._system.model, self._system.equations.data, posed.condensed.factors.L
        M, h = L.dot(L.T), self._run.nonLinearEffects(model, data, posed.at, posed.mean)
        a, v1 = np.abs((a, ended))
        sizes = self._dt * (np.abs(M).dot(a) + np.abs(h) + np.abs(posed.tau))
        momenta = np.abs(M).dot(np.abs(posed.v) + v1)
        return float((tolerances.FORCES * sizes + tolerances.FINEST * momenta).max())

    def _energy_error(self, start: StepStart, q1: Array, v1: Array) -> tuple[float, float]:
        """Return the energy that no work explains, and the largest of a step that is right [J]."""
        # A step of order 1 is off by what a force does along the way that it brings about in it, dt
        # F . M^-1 F dt, and an implicit one takes of stiff springs what they have.
        if not (np.isfinite(q1).all() and np.isfinite(v1).all()):
            return nan, nan
        posed, work = self._steps.last.posed, self._steps.last.work
        passive, condensed = self._system.passive, posed.condensed
        q, v = np.array((start.q, q1)), np.array((start.v, v1))
        times = self._t + np.array((0.0, self._dt))
        _, _, kinetic, potential = gauge_of(self._scene).measure(times, q, v)
        springs = passive.energy(q)
        mean = pin.difference(self._system.model, start.q, q1) / self._dt
        tau = self._system.applied.at_sample(self._t, start.q, start.v)
        done = self._dt * float(tau.dot(mean))
        damped = self._dt * float(passive.dissipation(start.q[None], mean[None])[0])
        gained = float(np.diff(kinetic + potential + springs)[0])
        error = gained - (done - damped + work.total)
        kick = condensed.factors.L.T.dot(condensed.free_velocity - posed.v)
        sizes = kinetic.sum() + abs(done) + sum(map(abs, work))
        limit = tolerances.UNBALANCED * float(sizes) + float(kick.dot(kick))
        limit += float(np.abs(np.diff(springs))[0]) + damped
        lifted = tolerances.ENERGY_KEPT * float(np.abs(potential).max())
        return abs(error), limit + lifted + self._weight * tolerances.ENERGY_KEPT

    def _push(self, posed: StepProblem, lam: Array) -> Load:
        """Generalised force of the contacts, at the placements of the step."""
        model, data = self._system.model, self._system.equations.data
        floating, path = self._steps.floating, posed.path
        if path is None:
            return self._load(posed.at, lam)
        there = floating.integrate(posed.at, self._dt * path)
        push = self._load(there, lam)
        still = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        held = self._run.computeStaticTorque(model, data, there, push.added_to(still)).copy()
        pulled = self._run.computeGeneralizedGravity(model, data, there) - held
        torque = push.torque + floating.rows_before(pulled[None], path, self._dt)[0]
        return Load(torque, np.abs(torque), (), ())

    def _load(self, q: Array, lam: Array) -> Load:
        """Forces lam of all candidates at q (rows,) [N, N m], as wrenches: without Jacobians."""
        # Wrenches are those of cones, on the robot and on what carries its ground, and of cables on
        # what carries them; the torque is that of stops, of reels and of dry friction.
        model, data, candidates = self._system.model, self._system.equations.data, self._candidates
        self._run.forwardKinematics(model, data, q)
        points, axes = candidates.points(data, q), candidates.axes(data, q)
        cones, wrenches = 3 * candidates.cones, []
        forces = lam[:cones].reshape(-1, 3)
        for (joint, ground), p, E, force in zip(self._sides, points, axes, forces, strict=True):
            if force.any():  # a point of a pair that has none may be nowhere
                f = E @ force
                on_robot = pin.Force(f, np.cross(p, f))  # at the world's origin
                wrenches.append((joint, data.oMi[joint].actInv(on_robot)))
                wrenches.append((ground, data.oMi[ground].actInv(-on_robot)))
        torque = np.zeros(model.nv)
        stops, lines, dry = np.split(lam[cones:], self._ends)
        along = zip((*self._stops, *self._dry), (*stops, *dry), strict=True)
        for (iv, sign), force in along:
            torque[iv] += sign * force
        if self._lines is not None:
            pulls, on_reels = self._lines.forces(data, lines)
            torque += on_reels
            for joint, x, f in pulls:
                pull = pin.Force(f, np.cross(x, f))
                wrenches.append((joint, data.oMi[joint].actInv(pull)))
        return Load(torque, np.abs(torque), tuple(wrenches), ())


def _sides(bounds: Sequence[BoundContact]) -> list[tuple[int, int]]:
    """Joints that carry the two sides of each cone, in the order of `Candidates`."""
    bodies = [(touch.joint, touch.ground) for bound in bounds for touch in bound.touches]
    pairs = [pair for bound in bounds for pair in bound.pairs]
    return bodies + [(pair.joint, pair.ground) for pair in pairs for _ in range(pair.points)]


# StepStart: where a step with contacts begins, and what acts on it.


class StepStart(NamedTuple):
    """A state, and the torques and forces that are held over the step."""

    q: Array  # (nq,)
    v: Array  # (nv,)
    tau: Array  # (nv,) [N, N m]
    forces: tuple[AppliedForce, ...] = ()


# The verbs step and contact_problem: one step of a scene whose contacts open, stick and slide.


_DEFAULT: Final = StewartTrinkle()


def step(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    forces: Sequence[AppliedForce] = (),
    throw: bool = True,
) -> StepSolution:
    """Return the state after one step in which contacts open, stick and slide, with its errors.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,
    J_b v+ = -dt gamma / 2,    sigma = G lam + g

    Parameters
    ----------
    scene : Scene
        Its constraints never open; its `contacts` may. With driven constraints ``scene.at(t)``
        says when the step begins, and J_b v+ = s' - dt (gamma - s'') / 2.
    q, v : (nq,), (nv,) array_like
        A state; loops are taken as closed.
    tau : 0 or (nv,) array_like, optional
        Torques applied [N, N m]. Springs and damping of the robot act at the end of the step.
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant; none by default.
    throw : bool
        Raise if the status is not ok. With False the same StepSolution comes back, whatever its
        status.

    Returns
    -------
    StepSolution

    Raises
    ------
    InvalidArgument
        If an argument cannot be used, or the scheme cannot let a contact of the scene rebound.
    UnsupportedConstraint
        If constraints are driven and the scene does not say at which time it is.
    NotAssembled
        If the path of a driven constraint leads to where the loops cannot follow.
    StepFailed
        If it presses bodies into each other.
    SolveFailed
        If the contact problem has no answer that is good enough, or rounding is as large as what
        its impulses do; its `solution` is the step.

    Notes
    -----
    In the equation, v+ of a floating body is in its axes at the beginning of the step; the velocity
    returned is in its axes at the end, as in Pinocchio.

    Driven rows end a step of `StewartTrinkle` at s' in its middle, t + dt/2, and one of `Moreau` at
    s'(t + dt): a step that begins with s'(t) shows the force of the motor by `Moreau` alone.

    Cost: that of a step in `simulate`, three quarters of which is the contact solver, and as much
    again for the verification.
    """
    steps = _steps(scene, dt, integrator)
    solution = steps.step(*_state(scene, q, v), tau, forces)
    if throw and not solution.status.ok:
        text = solution.status.text(type(integrator.contact).__name__)
        said = "; ".join((text, *solution.notices))
        raise SolveFailed(
            f"a step of {dt:g} s by {integrator!r}: {said} "
            f"(natural residual {solution.contact.natural:.1e})",
            solution,
        )
    return solution


def contact_problem(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    forces: Sequence[AppliedForce] = (),
) -> ContactProblem:
    """Return the contact problem that a step poses: for `solve_contact`, with any solver.

    sigma = G lam + g,    G = J_c M^-1 J_c^T along the constraints

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array_like
        Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear first.
    tau : 0 or (nv,) array_like, optional
        Torques applied [N, N m].
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant; none by default.

    Returns
    -------
    ContactProblem
        In the rows of the active contacts: those that are near, and those that the step
        would close.

    Raises
    ------
    InvalidArgument
        As `step` does.
    """
    steps = _steps(scene, dt, integrator)
    return steps.pose(*_state(scene, q, v), tau, forces).problem


# A loop over `step` with one scene, or with some in turn, makes ProvedSteps for each.
_kept = ThreadCache[ProvedSteps]()


def _steps(scene: Scene, dt: float, integrator: ContactScheme) -> ProvedSteps:
    steps = _kept.of(scene, (dt, integrator), lambda: ProvedSteps(scene, dt, integrator))
    scene.robot.check_unedited()
    return steps


def _state(scene: Scene, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    robot = scene.robot
    return robot.arguments.configuration("q", q), np.array(finite("v", v, robot.nv))
