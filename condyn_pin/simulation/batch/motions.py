"""The verb simulate_batch: many motions of one scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.rows import Native, RowWork, run
from condyn_pin._core.threads import ThreadCache, one_blas_thread
from condyn_pin._core.work import Arrays, Messages, Progress, silent
from condyn_pin.constraints.contacts.contact import Contact
from condyn_pin.constraints.drift import Baumgarte, Drift
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import why_not
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import LARGEST, Workspace
from condyn_pin.errors import CondynError, NotAssembled, SolveFailed, StepFailed
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import with_anchors
from condyn_pin.simulation.batch.inputs import (
    Recipe,
    check_states,
    driven_path_of,
    forces_in,
    split,
)
from condyn_pin.simulation.batch.trajectory import (
    ENDS,
    RUN_STATUSES,
    BatchTrajectory,
    array_kinds,
    samples_in,
)
from condyn_pin.simulation.drift import NoDrift, PostStabilization, uses_the_solver
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.explicit import RungeKutta4, SemiImplicitEuler
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.integrators.midpoint import ImplicitMidpoint, LinearlyImplicitMidpoint
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.measures import (
    Energy,
    damping_rate,
    gauge_of,
    integral_error,
    is_accurate,
    work,
)
from condyn_pin.simulation.motion_status import (
    JudgedMotion,
    MotionLimits,
    RunStatus,
    check_limits,
    judged_status,
    uninterrupted,
)
from condyn_pin.simulation.plan import Plan, check_penetration, default_solver, plan
from condyn_pin.simulation.records import ContactWork, Phase, touch_of
from condyn_pin.simulation.run import LOST, HybridPhase, first_state, follow, is_lost
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import PassiveForces, Torque, TorqueJacobian
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.stepping.batch import SteppedRows, contacts_of, states_of, step_plan
from condyn_pin.stepping.contact_steps import ContactSteps

# Samples that are checked where none is to be kept, at most, and how many steps are between two
# of them, at least: gaps and energies change slowly, and a look costs half a step.
_LOOKS: Final = 50
_APART: Final = 10

# A chunk that takes about a tenth of a second, for steps of some microseconds a solve.
_SOLVES: Final = 10_000


def simulate_batch(
    scene: Scene,
    Q0: ArrayLike,
    V0: ArrayLike,
    TAU: float | ArrayLike | Torque = 0.0,
    *,
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int | None = None,
    limits: MotionLimits | None = None,
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchTrajectory:
    """Return the motions of a scene from many states.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam + sum J_f(q)^T f,
    J a + gamma = a_ref,    row by row

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start of each motion.
    Q0, V0 : (N, nq), (N, nv) array_like
        States that satisfy the constraints, up to 1e-4 m and rad. As all numbers here they are
        taken in double precision: those of float32 have its 1e-7.
    TAU : 0, (nv,) or (N, nv) array_like, or callable, optional
        The torques applied [N, N m]: the same for all, constant for each, or tau(t, q, v), a
        function that is defined in a module, or an instance of a class there, if there are
        processes.
    forces : sequence of AppliedForce, optional
        Forces from outside, as in `simulate`; with two axes one row per motion. None by default.
    jacobian, duration, dt, integrator, drift, solver
        As in `simulate`.
    record : int, optional
        Keep every `record`-th sample, in 8 (1 + nq + 3 nv + m) bytes each: 1.2 kB of Cassie on its
        loops. By default none is: every tenth is checked, or fifty of each motion.
    limits
        As in `simulate`, at the samples that are checked.
    executor, chunk, progress
        As in `solve_batch`; a chunk takes about a tenth of a second by default.

    Returns
    -------
    BatchTrajectory
        To the bit what `simulate` returns, in any process. Motions that break down, leave
        their `limits`, or cannot begin, raise nothing: ``failed`` has their indices, ``counts``
        their number, ``reasons`` what, where, when and how far.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used; the text names the row.
    WorkersLost
        As in `solve_batch`; its ``done`` is the BatchTrajectory of what was simulated.
    Interrupted
        After Ctrl-C; its ``table`` is the same.
    UnknownName, UnsupportedConstraint, StaleModel, UnsupportedBackend
        As in `solve_batch`.

    Notes
    -----
    Cost: that of the steps, divided by the workers, and half a millisecond per motion, or two if
    contacts have to be anchored. Only `simulate` has events, and can switch effects off.
    """
    begun = perf_counter()
    function = TAU if callable(TAU) else None
    planned = plan(
        scene, function or 0.0, duration=duration, dt=dt, integrator=integrator, drift=drift,
        solver=solver, record=1 if record is None else record, jacobian=jacobian,
        limits=check_limits(limits),
    )  # fmt: skip
    every = max(planned.steps // _LOOKS, _APART) if record is None else record
    given: ArrayLike = 0.0 if function is not None else TAU  # type: ignore[assignment]
    q, v, tau = check_states(scene.robot, Q0, V0, given, suffix="0")
    _, first, more = split(scene.robot, forces, len(q), functions=True)
    most = max(1, int(_SOLVES / planned.steps / max(planned.integrator.solves_per_step, 1)))
    motions = Motions(
        function=function, jacobian=jacobian, duration=duration, dt=planned.dt,
        integrator=planned.integrator, drift=planned.drift, solver=solver, steps=planned.steps,
        every=every, limits=planned.limits, forces=first, contacts=tuple(scene.contacts),
        most=most,
    )  # fmt: skip
    held = _begun(scene.bilateral)
    recipe = Recipe(held, solver)
    if isinstance(executor, Native):  # whose workspace is that of the motions
        recipe = Recipe(held, solver or default_solver(held), planned.drift.rows)
    return run(
        motions, recipe, {"q0": q, "v0": v, "tau0": tau} | more,
        array_kinds(scene, 0 if record is None else motions.kept), partial(_batch, planned, begun),
        executor=executor, chunk=chunk, progress=progress,
    )  # fmt: skip


_started = ThreadCache[Scene]()


def _begun(scene: Scene) -> Scene:
    """Return a scene where motions begin: the same one each time, so that its workspace is."""
    return _started.of(scene, None, lambda: scene.at(0.0)) if scene.is_driven else scene


def _batch(planned: Plan, begun: float, outputs: Arrays) -> BatchTrajectory:
    """Return the outputs as a value."""
    solver = default_solver(planned.scene.bilateral) if planned.solver is None else planned.solver
    return BatchTrajectory(
        scene=planned.scene, integrator=planned.integrator, drift=planned.drift, solver=solver,
        duration=planned.duration, dt=planned.dt, steps=planned.steps, limits=planned.limits,
        **{name: outputs[name] for name in ENDS}, reasons=outputs["words"],
        samples=samples_in(outputs), seconds=perf_counter() - begun,
    )  # fmt: skip


# Motions: what a worker does with its rows of a `simulate_batch`.


# What `simulate` raises of a state that no motion begins at.
_CANNOT_BEGIN: Final = (NotAssembled, SolveFailed, StepFailed)


@dataclass(frozen=True)
class Motions(RowWork):
    """Motions from some states."""

    function: Torque | None = field(compare=False)  # its == may be that of arrays
    jacobian: TorqueJacobian | None = field(compare=False)
    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver | None
    steps: int
    every: int
    limits: MotionLimits
    forces: tuple[AppliedForce, ...] = ()  # at the first state
    contacts: tuple[Contact, ...] = ()  # of the scene: workspaces hold none
    most: int = 1
    most_of_core = 16

    @property
    def kept(self) -> int:
        """Number of samples of a motion that goes to its end."""
        return len(range(0, self.steps, self.every)) + 1

    def plan(self, scene: Scene) -> Plan:
        """Return the plan of the first of them."""
        planned = plan(
            scene, self.function or 0.0, duration=self.duration, dt=self.dt,
            integrator=self.integrator, drift=self.drift, solver=self.solver,
            record=self.every, forces=self.forces, jacobian=self.jacobian,
            limits=self.limits,
        )  # fmt: skip
        return replace(planned, at_events=False)  # as many samples of each motion

    def row(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> str:
        """Simulate one motion; return why it ended early."""
        begun, q, v = perf_counter(), inputs["q0"], inputs["v0"]
        # functions are not compared: their == may be that of arrays
        asked = self, id(self.function), id(self.jacobian)
        runner = _runners.of(workspace, asked, lambda: _Runner(self, workspace))
        try:
            found = runner.run(q, v, inputs["tau0"], forces_in(inputs, self.forces))
        except _CANNOT_BEGIN as error:
            outputs["q"][...], outputs["v"][...], outputs["t"][...] = q, v, 0.0
            outputs["statuses"][...] = RUN_STATUSES.index(RunStatus.FAILED)
            reason = str(error)
        else:
            _write_outputs(outputs, found)
            reason = found.reason
        outputs["run_times"][...] = perf_counter() - begun
        return reason

    def core(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Simulate the motions; return those that are left, and why others are not ok."""
        work = self._with_contacts if self.contacts else self._without_contacts
        return work(workspace, inputs, outputs, threads)

    def _without_contacts(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        model, count = workspace.model, len(inputs["q0"])
        kept, nv = self.kept, workspace.model.nv
        drives = driven_path_of(workspace, self.dt, self.steps)
        # what a drive does is the work of its forces; that of dampers has accelerations in it
        damped = is_accurate(self.integrator) and workspace.model.damping.any()
        answers = kept if "samples_a" in outputs or drives.rows.size or damped else 0
        states = states_of(workspace, inputs)
        found = {
            "t": np.zeros((count, kept)),
            "q": np.zeros((count, kept, model.nq)),
            "v": np.zeros((count, kept, nv)),
            "a": np.zeros((count, answers, nv)),
            "lam": np.zeros((count, answers, workspace.scene.rows)),
            "measures": np.zeros((count, kept, MEASURED)),
        }
        done = np.zeros(count, np.int32)
        corrects = self.drift.every if isinstance(self.drift, PostStabilization) else 0
        rank = chains_of(workspace.scene).rank if corrects and workspace.scene.rows else 0
        plan = {
            "integrator": _INTEGRATORS[self.integrator], "dt": self.dt, "steps": self.steps,
            "every": self.every, "correct_every": corrects, "with_answers": answers > 0,
            "closed": tolerances.NEARLY_CLOSED / 10, "largest": LARGEST, "lost": LOST,
            "reach": Manifold(model).reach, "rank": rank, "out_of_reach": tolerances.OUT_OF_REACH,
        }  # fmt: skip
        workspace.compiled.core.simulate(
            **states, plan=plan, driven=drives.rows, path=drives.wanted, **found, done=done,
            times=outputs["run_times"], threads=threads,
        )  # fmt: skip
        if drives.rows.size:
            found["driven"] = drives.power(found["lam"], self.every)
        words = put_motions(
            outputs,
            np.flatnonzero(done),
            found,
            states["TAU"],
            workspace.scene,
            workspace.solver,
            self,
        )
        return np.flatnonzero(done == 0), words

    def _with_contacts(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Simulate in the core; after a step in Python, a motion continues there."""
        states = states_of(workspace, inputs)
        tau, ways = (
            states["TAU"],
            _MotionsUnderWay(self, workspace, outputs, states["Q"], states["V"].copy()),
        )
        core = contacts_of(workspace, self.contacts)
        outputs["run_times"][:] = 0.0
        ahead = self.steps % self.every > 0  # the last sample is that of a step not taken
        paths = driven_path_of(workspace, self.dt, self.steps + ahead)
        python = None
        while True:
            core.simulate(
                step=ways.step, Q=ways.q, V=ways.v, works=ways.works, TAU=tau,
                plan=step_plan(self.integrator, self.dt), steps=self.steps, every=self.every,
                closed=tolerances.NEARLY_CLOSED / 10, lost=LOST, **ways.found, done=ways.done,
                times=outputs["run_times"], driven=paths.rows, path=paths.wanted, threads=threads,
            )  # fmt: skip
            stopped = np.flatnonzero((ways.done == 0) & (ways.step >= 0))
            if not stopped.size:
                break
            python = python or _Steps(self, workspace)
            for i in stopped:
                python.take(ways, int(i), tau[i])
        scene = replace(workspace.scene, contacts=self.contacts)
        words = put_motions(
            outputs, np.flatnonzero(ways.done), ways.found, tau, scene, workspace.solver, self
        )
        return np.flatnonzero(ways.done == 0), words

    def why_not(self, workspace: Workspace) -> Iterator[str]:
        """Yield the reasons why the core cannot simulate such motions."""
        drift, solver = self.drift, workspace.solver
        if self.function is not None:
            yield "TAU is a function: its motions have constant torques alone"
        if self.forces:
            yield "there are forces from outside: its motions have constant torques alone"
        if self.contacts:
            steps = SteppedRows(self.contacts, self.dt, self.integrator)  # type: ignore[arg-type]
            yield from steps.why_not(workspace)  # names another kind of integrator
            if not isinstance(drift, NoDrift):
                yield f"drift = {drift!r}: with contacts it has NoDrift alone"
            return
        if self.integrator not in _INTEGRATORS:
            known = ", ".join(dict.fromkeys(type(each).__name__ for each in _INTEGRATORS))
            yield f"integrator = {self.integrator!r}: it has {known}"
        if not isinstance(drift, NoDrift | Baumgarte | PostStabilization):
            yield f"drift = {drift!r}: it has NoDrift, Baumgarte and PostStabilization"
        yield from why_not(workspace)
        by_mass = not isinstance(drift, PostStabilization) or drift.metric == "mass"
        if isinstance(solver, Proximal):
            for name in workspace.pinocchio_constraints.approximated:
                yield f"constraint {name!r} stands for two points, which steps leave a little open"
            if isinstance(drift, PostStabilization) and not (
                by_mass and uses_the_solver(workspace, solver)
            ):
                yield f"drift = {drift!r}: it corrects by the factor of a solve, in the metric of M"
        elif not by_mass:
            yield f"drift = {drift!r}: it corrects in the metric of M"


class _Runner:
    """One motion after the other from what they share: a plan, and a phase."""

    def __init__(self, motions: Motions, workspace: Workspace) -> None:
        self.motions, self.workspace = motions, workspace
        self._scene = workspace.scene
        if motions.contacts:
            self._scene = replace(workspace.scene, contacts=motions.contacts)
        self._plan = motions.plan(self._scene)
        self._phase: HybridPhase | None = None

    def run(self, q: Array, v: Array, tau: Array, forces: tuple[AppliedForce, ...]) -> Trajectory:
        """Return the motion from a state; KeyboardInterrupt if it was interrupted, for all."""
        self._plan.tau.hold(None if self.motions.function else tau, forces)
        phase, self._phase = self._phase, None  # one that cannot begin leaves none
        state = _start(self.workspace, q, v, self._plan)
        check_penetration(self._scene, state[0], self._plan.integrator)
        trajectory, phase = follow(self._plan, *state, phase=phase)
        uninterrupted(trajectory)
        self._phase = phase
        return trajectory


_runners = ThreadCache[_Runner]()


def _start(workspace: Workspace, q: Array, v: Array, plan: Plan) -> tuple[Array, Array]:
    """Return a first state; what is clearly closed is not checked twice."""
    q_, v_ = normalised(workspace.model, "q", q), v.copy()
    with np.errstate(all="ignore"):  # what overflows is clearly not closed
        gap = max(workspace.equations.open_by(q_, v_))
    if gap < tolerances.NEARLY_CLOSED / 10:
        return q_, v_
    return first_state(workspace.scene, q, v, plan)


def _write_outputs(outputs: Arrays, found: Trajectory) -> None:
    for name in ("t", "q", "v"):
        outputs[name][...] = getattr(found, name)[-1]
    for name in ("violation", "constraint_velocity"):
        outputs[name][...] = getattr(found, name).max()
    outputs["energy_error"][...] = np.abs(found.energy.error).max()
    outputs["statuses"][...] = RUN_STATUSES.index(found.status)
    if samples := samples_in(outputs):
        for name, kept in samples.arrays.items():
            its = getattr(found, name)
            kept[: len(found)] = its.columns if name == "contact" else its


# Motions by the compiled core: which it takes, and what becomes of its samples.
#
# It steps, and measures samples; energies are balanced here, for all motions at once. A motion that
# it gives up, for whatever reason, is made again by Python, which says why.


# Integrators by their names there.
_INTEGRATORS: Final[dict[Integrator, str]] = {
    SemiImplicitEuler(): "semi_implicit",
    SemiImplicitEuler(implicit=False): "explicit_forces",
    LinearlyImplicitMidpoint(): "linear_midpoint",
    ImplicitMidpoint(): "implicit_midpoint",
    RungeKutta4(): "runge_kutta_4",
}


class Measures(NamedTuple):
    """Columns of what the core measures at a sample, or their values (k, N)."""

    violation: Array  # [m, rad]
    slip: Array  # [m/s, rad/s]
    kinetic: Array  # energies [J]
    potential: Array
    springs: Array
    damping: Array  # what damping takes [W]

    @classmethod
    def of(cls, table: Array) -> Measures:
        """Measures of a table (k, N, columns)."""
        return cls(*np.moveaxis(table, 2, 0))


MEASURED: Final = len(Measures._fields)


def put_motions(
    outputs: Arrays, ok: NDArray[np.intp], found: dict[str, Any], tau: Array, scene: Scene,
    solver: Solver, motions: Motions,
) -> Messages:  # fmt: skip
    """Put the motions that went to their end into their rows; return why some are not ok."""
    # `found` has their samples: t, q, v, a, lam and measures, the power of what is driven, and of
    # contacts and drives their work and columns.
    if not ok.size:
        return {}
    found = {name: its[ok] for name, its in found.items()}
    t, q, v = (found[name] for name in ("t", "q", "v"))
    measures = Measures.of(found["measures"])
    outputs["t"][ok], outputs["q"][ok], outputs["v"][ok] = t[:, -1], q[:, -1], v[:, -1]
    violation, slip = measures.violation, measures.slip
    outputs["violation"][ok] = violation.max(axis=1)
    outputs["constraint_velocity"][ok] = slip.max(axis=1)
    energy = _energies(found, tau[ok], scene, motions.integrator)
    outputs["energy_error"][ok] = np.abs(energy.error).max(axis=0)
    if "samples_t" in outputs:
        for name in ("t", "q", "v", "a", "lam", "contact"):
            if name in found:
                outputs[f"samples_{name}"][ok] = found[name]
        outputs["samples_tau"][ok] = tau[ok, None]
    words = {}
    for k, row in enumerate(ok.tolist()):
        anchored = with_anchors(scene, q[k, 0], {})
        course = JudgedMotion(
            phases=(Phase(anchored, slice(0, len(t[k])), ()),), t=t[k], q=q[k], v=v[k],
            violation=violation[k], constraint_velocity=slip[k], energy=energy.of(k), dt=motions.dt,
            integrator=motions.integrator, solver=solver, limits=motions.limits,
        )  # fmt: skip
        status, said = judged_status(course)
        outputs["statuses"][row] = RUN_STATUSES.index(status)
        if said:
            words[row] = said
    return words


def _energies(found: dict[str, Any], tau: Array, scene: Scene, integrator: Integrator) -> Energy:
    """Return the energies of motions, each (k, N), work integrated over the samples."""
    t, q, v = found["t"][0], found["q"], found["v"]
    measures = Measures.of(found["measures"])
    damping = measures.damping
    passive, mean = PassiveForces.of(scene.robot), 0.5 * (v[:, 1:] + v[:, :-1])
    flat = (-1, *q.shape[2:]), (-1, *v.shape[2:])
    taken = passive.dissipation(q[:, :-1].reshape(flat[0]), mean.reshape(flat[1]))
    between = np.einsum("ni,nki->kn", tau, mean), -taken.reshape(mean.shape[:2]).T
    power = np.einsum("ni,nki->kn", tau, v), -damping.T
    rate = None
    if is_accurate(integrator) and found["a"].shape[1] == v.shape[1]:
        rate = damping_rate(passive, v, found["a"])
    done = work(t, power[0]), work(t, power[1], None if rate is None else rate.T)
    along = v.transpose(1, 0, 2)
    off = sum(integral_error(t, *each, along) for each in zip(power, done, between, strict=True))
    none = np.zeros_like(power[0])
    contact, correction, algorithmic, driven = none, none, none, none
    if "work" in found:
        contact, correction, algorithmic, driven = found["work"].T[:4]
    elif "driven" in found:
        drives = found["driven"].T
        driven = work(t, drives)
        off = off + integral_error(t, drives, driven, 0.5 * (drives[1:] + drives[:-1]))
    return Energy(
        kinetic=measures.kinetic.T, potential=measures.potential.T, springs=measures.springs.T,
        work=done[0], damping=done[1],
        impacts=none, driven=driven, contact=contact, correction=correction,
        algorithmic=algorithmic, doubt=np.asarray(off),
    )  # fmt: skip


# Motions with contacts on their way, and the steps of them that the compiled core leaves to Python.


class _MotionsUnderWay:
    """Motions on their way, as the core has them."""

    def __init__(
        self, of: Motions, workspace: Workspace, outputs: Arrays, q: Array, v: Array
    ) -> None:
        count, model, kept = len(q), workspace.model, of.kept
        self.q, self.v, self.works = q, v, np.zeros((count, 4))
        self.step, self.done = np.zeros((2, count), np.int32)
        widths = {"q": model.nq, "v": model.nv, "measures": MEASURED, "work": 4}
        self.found = {name: np.zeros((count, kept, size)) for name, size in widths.items()}
        self.found["t"] = np.zeros((count, kept))
        for name in ("a", "lam", "contact"):  # where samples are asked for
            shape = outputs.get(f"samples_{name}", np.zeros((0, 0, 0))).shape[1:]
            self.found[name] = np.zeros((count, *shape))


class _Steps:
    """Steps of motions by Python."""

    def __init__(self, of: Motions, workspace: Workspace) -> None:
        assert isinstance(of.integrator, ContactScheme)
        self._of, self._gauge = of, gauge_of(workspace.scene)
        scene = replace(workspace.scene, contacts=of.contacts)
        self._system = System(workspace, contacts=scene.contact_bounds)
        self._steps = ContactSteps(of.integrator, self._system, of.dt)
        self._slow = self._system.manifold.slow(of.dt)
        self._is_driven = scene.is_driven
        self._is_anchored = all(bound.anchored for bound in scene.bounds)

    @one_blas_thread
    def take(self, ways: _MotionsUnderWay, i: int, tau: Array) -> None:
        """Take the next step of motion i; it is not to go on where there is none."""
        of, k = self._of, int(ways.step[i])
        q, v, work = ways.q[i].copy(), ways.v[i].copy(), ContactWork(*ways.works[i].tolist())
        ways.step[i] = -1
        if not self._is_anchored:  # but where its motion has begun, which nobody knows here
            return
        self._system.applied.hold(tau, ())
        try:
            with np.errstate(all="ignore"):
                q1, v1, a = self._steps.step(k * of.dt, q, v)
                if self._is_driven and k < of.steps:
                    self._system.check_reach((k + 1) * of.dt, q1, v1)
        except CondynError:
            return
        if is_lost(v1) or (self._slow and v1.dot(v1) > self._slow):
            return
        if k == 0:
            self._keep(ways, i, 0, (0.0, q, v, a), work)
        if k == of.steps:  # the step of the last sample is not taken
            self._keep(ways, i, k // of.every + 1, (k * of.dt, q, v, a), work)
            ways.done[i] = 1
            return
        work, end = self._steps.effects(work).work, k + 1
        ways.q[i], ways.v[i], ways.works[i], ways.step[i] = q1, v1, work, end
        if end % of.every == 0:
            self._keep(ways, i, end // of.every, (end * of.dt, q1, v1, a), work)
            ways.done[i] = end == of.steps

    def _keep(
        self, ways: _MotionsUnderWay, i: int, row: int, state: tuple[float, Array, Array, Array],
        work: ContactWork,
    ) -> None:  # fmt: skip
        t, q, v, a = state
        found = ways.found
        found["t"][i, row], found["q"][i, row], found["v"][i, row] = t, q, v
        found["work"][i, row] = work
        measured = self._gauge.measure(np.array([t]), q[None], v[None])
        passive = self._system.passive
        acting = passive.energy(q), passive.dissipation(q[None], v[None])[0]
        found["measures"][i, row] = [*(float(each[0]) for each in measured), *acting]
        if found["a"].shape[1]:
            found["a"][i, row], found["lam"][i, row] = a, self._steps.lam()
            found["contact"][i, row] = touch_of(
                self._steps.last.natural, work, self._steps.modes(), is_driven=self._is_driven
            )
