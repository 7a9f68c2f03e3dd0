"""Problem: a scene, where it starts, and the motion that is right. The registry is here too.

To write one:

1. Make a frozen dataclass in a file of this folder, which its `__init__.py` imports. `name` is what
   users type; fields are the sizes that the problem is known for.
2. `scene`, `q0`, `v0` and `torque` are the problem in the product's own terms; q0 and v0 satisfy
   the constraints to rounding.
3. `observe` picks the numbers that are compared, and `answer` says what they should be, in closed
   form, or as `digits` whose source is named. It shares no code with Pinocchio.
4. `error` is the measure of the collection that the problem comes from, and `limits` are the errors
   that somebody asks for, each with who does.
5. The equations of the literature, written down once more, are a test of it: in
   `tests/classical.py`, or in a test of its own. Where there is no closed form,
   `benchmarks/problems.py answers` computes the digits from them in extended precision.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from math import ceil, inf, isfinite
from time import process_time
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register, renamed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.solvers.solver import Solver
    from condyn_pin.simulation.drift import Drift
    from condyn_pin.simulation.integrators.integrator import Integrator


@dataclass(frozen=True)
class Limit:
    """An error that somebody asks for."""

    level: str  # how it is called
    value: float  # in the unit of what is judged
    source: str  # who asks for it


@dataclass(frozen=True)
class Setting:
    """How to run a problem; what is None is left to `simulate`."""

    dt: float  # [s]
    integrator: Integrator | None = None
    drift: Drift | None = None
    solver: Solver | None = None


@dataclass(frozen=True)
class Published:
    """What another code needed, as it was published."""

    code: str
    case: str  # what was run
    seconds: float  # CPU time [s]
    error: str  # as stated there; empty if it was not
    processor: str
    source: str


# Problems

Torque = Callable[[float, Array, Array], Array]

PROBLEMS: dict[str, type[Problem]] = {}


class Problem(ABC):
    """A problem with a known answer; a frozen value.

    Attributes
    ----------
    name, title, source : str
    duration : float
        Length of the motion [s].
    scene : Scene
    q0, v0 : (nq,), (nv,) array
        Where it starts.
    torque : callable or None
        tau = f(t, q, v) [N, N m]; None for none at all.
    measure : str
        What `error` is, in words.
    judged : {"error", "energy"}
        What the limits are about: `error`, or the largest change of the energy [J].
    limits : tuple of Limit
        From the coarsest to the finest.
    published : tuple of Published
        CPU times of other codes.
    digits : dict of float to tuple of float
        The answer by time [s], where it is known at these times alone; else empty.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    measure: ClassVar[str]
    judged: ClassVar[Literal["error", "energy"]] = "error"
    limits: ClassVar[tuple[Limit, ...]]
    published: ClassVar[tuple[Published, ...]] = ()
    digits: ClassVar[Mapping[float, tuple[float, ...]]] = MappingProxyType({})
    conservative: ClassVar[bool] = True  # whether `energy` stays what it is

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register(PROBLEMS, cls.name, cls, f"a problem named {cls.name}")

    @property
    @abstractmethod
    def duration(self) -> float:
        """How long it runs [s]."""

    @property
    @abstractmethod
    def setting(self) -> Setting:
        """How it is run by default: the cheapest found by measurement that meets every limit."""

    @property
    @abstractmethod
    def scene(self) -> Scene:
        """The problem as a scene."""

    @property
    @abstractmethod
    def q0(self) -> Array:
        """Where it starts (nq,)."""

    @property
    def v0(self) -> Array:
        """How fast it starts (nv,); at rest if nothing else is said."""
        return np.zeros(self.scene.robot.nv)

    @property
    def torque(self) -> Torque | None:
        """The torques that act."""
        return None

    @abstractmethod
    def observe(self, q: Array, v: Array) -> Array:
        """Return the numbers that are compared (k,) at a state."""

    def answer(self, t: float) -> Array:
        """Return what they should be (k,); InvalidArgument where that is not known."""
        if t not in self.digits:
            known = " and ".join(f"{t:g}" for t in self.digits)
            raise InvalidArgument(f"t = {t!r}: the answer is known at {known} s")
        return np.array(self.digits[t])

    @property
    def only_at(self) -> tuple[float, ...]:
        """Times at which the answer is known [s]; empty where it is known at all times."""
        return tuple(self.digits)

    def error(self, found: Array, wanted: Array) -> float:
        """Return the largest distance [m] of `found` from `wanted`, places (samples, k) both.

        Of problems with `digits` the largest relative error, which is 10^-scd of the test set.
        """
        if self.digits:
            return float(np.abs(found / wanted - 1).max())
        return float(np.linalg.norm(found - wanted, axis=1).max())

    def energy(self, q: Array, v: Array) -> float:
        """Return what is conserved [J]: kinetic energy and every potential."""
        model, data = self._model_and_data
        kinetic = pin.computeKineticEnergy(model, data, q, v)
        return float(kinetic + pin.computePotentialEnergy(model, data, q) + self.potential(q))

    def potential(self, q: Array) -> float:
        """Return the potential of `torque` at q [J]."""
        return 0.0

    @cached_property
    def _model_and_data(self) -> tuple[Any, Any]:
        model = self.scene.robot.model
        return model, model.createData()

    @classmethod
    def sizes(cls) -> tuple[str, ...]:
        """Return the names of the sizes that can be chosen."""
        return tuple(field.name for field in fields(cls))  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """Name and sizes."""
        return ", ".join([self.name, *(f"{key} = {getattr(self, key)}" for key in self.sizes())])

    def __getstate__(self) -> dict[str, Any]:
        # all else is made again when it is needed; Pinocchio's Data cannot be copied
        return {key: getattr(self, key) for key in self.sizes()}

    def run(
        self,
        *,
        dt: float | None = None,
        integrator: Integrator | None = None,
        drift: Drift | None = None,
        solver: Solver | None = None,
        duration: float | None = None,
    ) -> ProblemResult:
        """Simulate the problem and check the motion.

        Parameters
        ----------
        dt : float, optional
            Step [s]. Without any of dt, integrator, drift and solver the problem is run as
            `setting` says; with one of them, what is left out is what `simulate` takes, and
            dt that of `setting`.
        integrator, drift, solver : optional
            As in `simulate`.
        duration : float, optional
            A part of the problem's [s]; all of it by default. It is a whole number of steps.

        Returns
        -------
        ProblemResult
            Errors, CPU time and verdict, also of a motion that ended early.

        Raises
        ------
        InvalidArgument
            If dt or the duration is not positive, or the answer is not known at the end.
        """
        chosen = (integrator, drift, solver)
        if dt is None and all(each is None for each in chosen):
            setting = self.setting
        else:
            setting = Setting(self.setting.dt if dt is None else dt, *chosen)
        return run_problem(self, setting, duration)


def load_problem(name: str, *, n: int | None = None) -> Problem:
    """Return a benchmark problem: ``load_problem("A02", n=40).run()``.

    Parameters
    ----------
    name : str
        A name of `PROBLEMS`.
    n : int, optional
        Its size, for a problem that has one: cells of A02.

    Returns
    -------
    Problem

    Raises
    ------
    UnknownName
        If there is no such problem.
    InvalidArgument
        If the problem has no size, or not this one.
    """
    if name not in PROBLEMS:
        raise unknown_name("problem", str(name), PROBLEMS)
    kind = PROBLEMS[name]
    if n is None:
        return kind()
    if "n" not in kind.sizes():
        sized = ", ".join(each for each in PROBLEMS if "n" in PROBLEMS[each].sizes())
        raise InvalidArgument(f"n = {n!r}: {name} has no size; {sized} has")
    return kind(**{"n": n})


# Results: how far a simulated motion is from the right one, and what it cost


# Samples along a motion: as many as the library of problems asks for, or more.
_SAMPLES = 400


@dataclass(frozen=True)
class ProblemResult:
    """A problem that was run, and the verdict.

    The errors of a motion that ended early are infinite.

    Attributes
    ----------
    problem : Problem
    setting : Setting
        What was asked for.
    duration : float
        Length of the motion [s].
    cpu_seconds : float
        Processor time of `simulate`, its workspace included [s].
    evaluations : int
        Of the equations of motion: solves, and residuals of implicit integrators.
    trajectory : Trajectory
        The motion; its `run` says what was used, and how it ended.
    error : float
        By the problem's own measure, in its own unit.
    difference : float
        The largest of a number that is compared [m, rad, m/s: its own unit].
    energy_drift : float or None
        Largest change of the energy along the motion [J]; None where it is not conserved.
    violation, constraint_velocity : float
        Largest |c(q)| [m, rad] and |J v| [m/s, rad/s] along it.
    """

    problem: Problem
    setting: Setting
    duration: float  # [s]
    cpu_seconds: float  # [s]
    evaluations: int
    trajectory: Trajectory = field(repr=False, compare=False)
    error: float = inf
    difference: float = inf
    energy_drift: float | None = inf  # [J]
    violation: float = inf  # [m, rad]
    constraint_velocity: float = inf  # [m/s, rad/s]

    slip = renamed("constraint_velocity")

    @property
    def dt(self) -> float:
        """The step [s]."""
        return self.trajectory.run.dt

    @property
    def ended(self) -> str:
        """Why it ended early; empty if it did not."""
        run = self.trajectory.run
        return "" if run.status.ok else run.reason

    @property
    def judged(self) -> float:
        """The number that the limits are about."""
        if self.problem.judged == "error":
            return self.error
        return inf if self.energy_drift is None else self.energy_drift

    @property
    def met(self) -> tuple[Limit, ...]:
        """The limits that are met; none unless the motion is whole."""
        whole = not self.ended and self.duration >= self.problem.duration * (1 - 1e-12)
        return tuple(limit for limit in self.problem.limits if whole and self.judged <= limit.value)

    @property
    def verdict(self) -> str:
        """The finest limit that is met, in words."""
        if self.ended:
            return f"failed: {self.ended}"
        if self.duration < self.problem.duration * (1 - 1e-12):
            return f"no verdict: {self.duration:g} s of {self.problem.duration:g} s"
        if not self.met:
            coarsest = self.problem.limits[0]
            return f"not met: {_said(coarsest)}; found {self.judged:.2g}"
        finest = self.met[-1]
        return f"met: {_said(finest)}; found {self.judged:.2g}"

    @property
    def method(self) -> str:
        """Integrator, drift scheme and solver, every parameter said."""
        run = self.trajectory.run
        return f"{run.integrator!r}, {run.drift!r}, {run.solver!r}"

    def facts(self) -> dict[str, str]:
        """Return what `python benchmarks/lab problem` prints, by its label."""
        drift = "not conserved in this problem"
        if self.energy_drift is not None:
            drift = f"{self.energy_drift:.2g} J"
        took = f"{self.cpu_seconds:.3g} s for {self.duration:g} s"
        return {
            "run with": f"dt {self.dt:g} s, {self.method}",
            "error": f"{self.error:.2g}: {self.problem.measure}",
            "difference": f"{self.difference:.2g}, the largest of a number that is compared",
            "energy drift": drift,
            "violation": f"{self.violation:.2g} in c(q), {self.constraint_velocity:.2g} in J v",
            "CPU": f"{took}, {self.evaluations} evaluations",
            "verdict": self.verdict,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return every number, for a file; what is not finite is None."""
        run = self.trajectory.run
        errors = ("error", "difference", "energy_drift", "violation", "constraint_velocity")
        numbers = {name: getattr(self, name) for name in errors}
        return {
            "problem": self.problem.label,
            "integrator": repr(run.integrator),
            "drift": repr(run.drift),
            "solver": repr(run.solver),
            "dt": self.dt,
            "duration": self.duration,
            **{k: x if x is not None and isfinite(x) else None for k, x in numbers.items()},
            "cpu_seconds": self.cpu_seconds,
            "evaluations": self.evaluations,
            "verdict": self.verdict,
        }

    def __str__(self) -> str:
        facts = self.facts().items()
        head = f"{self.problem.label}: {self.problem.title}"
        return "\n".join([head, *(f"  {label:<13} {text}" for label, text in facts)])


def _said(limit: Limit) -> str:
    return f"{limit.level}, {limit.value:g} ({limit.source})"


def run_problem(problem: Problem, setting: Setting, duration: float | None) -> ProblemResult:
    """Simulate, compare with the right motion, and give a verdict; `Problem.run` says how."""
    duration = _duration(problem, duration)
    steps = _steps(setting.dt, duration)
    scene, q0, v0 = problem.scene, problem.q0, problem.v0
    torque, nothing, evaluations = problem.torque, np.zeros(scene.robot.nv), 0

    def counted(t: float, q: Array, v: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        return nothing if torque is None else torque(t, q, v)

    start = process_time()
    trajectory = simulate(
        scene,
        q0,
        v0,
        counted,
        duration=duration,
        dt=duration / steps,
        integrator=setting.integrator,
        drift=setting.drift,
        solver=setting.solver,
        record=max(1, steps // _SAMPLES),
    )
    seconds = process_time() - start
    count = evaluations  # to measure the motion asks for the torque again
    found = _errors(problem, trajectory) if trajectory.run.status.ok else {}
    return ProblemResult(problem, setting, duration, seconds, count, trajectory, **found)


def _errors(problem: Problem, trajectory: Trajectory) -> dict[str, Any]:
    """Return what is wrong with a motion of a problem, by the fields of its result."""
    states = list(zip(trajectory.t.tolist(), trajectory.q, trajectory.v, strict=True))
    known = states[-1:] if problem.only_at else states
    found = np.array([problem.observe(q, v) for _, q, v in known])
    wanted = np.array([problem.answer(_near(t, problem.only_at)) for t, _, _ in known])
    energy_drift = None
    if problem.conservative:
        energies = np.array([problem.energy(q, v) for _, q, v in states])
        energy_drift = float(np.abs(energies - energies[0]).max())
    return {
        "error": problem.error(found, wanted),
        "difference": float(np.abs(found - wanted).max()),
        "energy_drift": energy_drift,
        "violation": float(trajectory.violation.max()),
        "constraint_velocity": float(trajectory.constraint_velocity.max()),
    }


def _duration(problem: Problem, duration: float | None) -> float:
    if duration is None:
        return problem.duration
    check_positive(duration=duration)
    if problem.only_at and duration not in problem.only_at:
        known = " and ".join(f"{t:g}" for t in problem.only_at)
        raise InvalidArgument(
            f"duration = {duration!r}: the answer of {problem.name} is known at {known} s"
        )
    return float(duration)


def _steps(dt: float, duration: float) -> int:
    """Return the number of steps; the last one has to end where the motion does."""
    check_positive(dt=dt)
    steps = max(1, round(duration / dt))
    if abs(steps * dt - duration) > 1e-9 * duration:
        raise InvalidArgument(
            f"dt = {dt!r}: {duration:g} s is not a whole number of steps; "
            f"{duration / ceil(duration / dt)!r} is"
        )
    return steps


def _near(t: float, known: tuple[float, ...]) -> float:
    """Return t, or the time that it means among those that are known."""
    return min(known, key=lambda each: abs(each - t)) if known else t
