"""ProvedSteps: steps of a scene with contacts, one at a time, and what each leaves of its laws.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = -dt gamma / 2

are evaluated anew where the step has taken them, by recursive Newton-Euler and by the velocities of
the frames, whatever solved them; and the account of energy from the two states,

    E(q+, v+) - E(q, v) = (tau - d u) . dt u + work of impulses,    u = (q+ - q) / dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import joint_torques, step_size
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.forces import AppliedForce, Load, applied_forces
from condyn_pin.contact.attempts import judged
from condyn_pin.contact.problem import MODES
from condyn_pin.contact.solution import contact_load
from condyn_pin.dynamics.scene import Scene, time_of
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.contact_steps import ContactSteps
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.step_solution import StepSolution
from condyn_pin.simulation.step_start import StepStart
from condyn_pin.simulation.system import System


class ProvedSteps:
    """Steps of one scene by one scheme and dt; not to be shared between threads."""

    def __init__(self, scene: Scene, dt: float, scheme: ContactScheme) -> None:
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
        gravity = float(np.linalg.norm(scene.robot.model.gravity.linear))
        self._weight = scene.robot.mass * gravity  # [N]

    @one_blas_thread
    def pose(
        self, q: Array, v: Array, tau: float | ArrayLike, forces: Sequence[AppliedForce]
    ) -> Posed:
        """Return the step from a state as it was posed."""
        self._hold(tau, forces)
        with np.errstate(all="ignore"):
            self._steps.attempt(self._t, q, v)  # an answer shows which contacts take part
        return self._steps.last.posed

    @one_blas_thread
    def step(
        self, q: Array, v: Array, tau: float | ArrayLike, forces: Sequence[AppliedForce]
    ) -> StepSolution:
        """Return the step from a state, and what it leaves of each law."""
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
        contact = judged(posed.problem, found, natural, tolerances.CONTACT_SOLVED, took)
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

    def _errors(self, posed: Posed, ended: Array, a: Array, lam: Array) -> tuple[float, float]:
        """Return what is left of the balance of momentum [N s], and of J_b v+ [m/s]."""
        equations, passive = self._system.equations, self._system.passive
        self._system.at(self._steps.looks_at(self._t))
        at, v, rows = posed.at, posed.v, self._scene.rows
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

    def _dynamics_limit(self, posed: Posed, ended: Array, a: Array) -> float:
        """Return the largest error of the balance of momentum that is right [N s, N m s]."""
        model, data, L = self._system.model, self._system.equations.data, posed.condensed.factors.L
        M, h = L.dot(L.T), algorithms(data).nonLinearEffects(model, data, posed.at, posed.mean)
        a, v1 = np.abs((a, ended))
        sizes = self._dt * (np.abs(M).dot(a) + np.abs(h) + np.abs(posed.tau))
        momenta = np.abs(M).dot(np.abs(posed.v) + v1)
        return float((tolerances.FORCES * sizes + tolerances.FINEST * momenta).max())

    def _energy_error(self, start: StepStart, q1: Array, v1: Array) -> tuple[float, float]:
        """Return the energy that no work explains, and the largest of a step that is right [J].

        A step of order 1 is off by what a force does along the way that it brings about in it,
        dt F . M^-1 F dt, and an implicit one takes of stiff springs what they have.
        """
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

    def _push(self, posed: Posed, lam: Array) -> Load:
        """Return what contacts do to the robot, where the step has taken them."""
        model, data = self._system.model, self._system.equations.data
        bounds, floating, path = self._scene.contact_bounds, self._steps.floating, posed.path
        if path is None:
            return contact_load(model, data, posed.at, bounds, lam)
        there = floating.integrate(posed.at, self._dt * path)
        push = contact_load(model, data, there, bounds, lam)
        still = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        held = (
            algorithms(data).computeStaticTorque(model, data, there, push.on_top_of(still)).copy()
        )
        pulled = algorithms(data).computeGeneralizedGravity(model, data, there) - held
        torque = push.torque + floating.rows_before(pulled[None], path, self._dt)[0]
        return Load(torque, np.abs(torque), (), ())
