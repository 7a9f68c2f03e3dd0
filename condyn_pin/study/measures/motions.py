"""Measures of motions: a contact step's impulses, the end of a motion, and its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import lru_cache
from math import inf, isfinite
from typing import Any, ClassVar, Final, TypeVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Grid, read_call, seconds, step_size
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import whole_data
from condyn_pin._core.timing import Call, State
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.restitution import RESTITUTION_LAWS
from condyn_pin.contact.solution import ContactSolution, attempt_contact, solve_contact, verified
from condyn_pin.contact.solvers import CONTACT_SOLVERS, ContactSolver
from condyn_pin.contact.solvers.contact_solver import SolverResult
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace, default_solver
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes import ROUTES, Route
from condyn_pin.gradients.routes.route import StepChain, linear_steps
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.drift import DRIFTS, Drift, NoDrift
from condyn_pin.simulation.integrators import INTEGRATORS, Integrator
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.motion_status import uninterrupted
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.stepping.schemes.event_driven import EventDriven
from condyn_pin.stepping.schemes.moreau import Moreau
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle
from condyn_pin.stepping.single_step import contact_problem
from condyn_pin.study.measures.measure import ComparedAnswer, Measure, or_inf, relative
from condyn_pin.study.tables import Methods, Parameter

_FRICTION = 0.7  # of rubber on a dry floor

_NEWTON = SemismoothNewton()

# Natural residual of what may be compared with: a hundred times below the finest that is asked for.
_EXACT = 1e-13


@dataclass(frozen=True, eq=False)
class ContactBench:
    """A contact solver, and the problems of a scene that were posed to it."""

    scene: Scene
    solver: ContactSolver
    problems: dict[bytes, ContactProblem] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactMeasure(Measure):
    """The error of the impulses of one step, by the velocities: |J^T (lam - lam*)| in M^-1.

    e^2 = d^T G d / max(lam*^T G lam*, m g^2 dt^2),    d = lam - lam*

    lam* is the nearer of two answers of `SemismoothNewton`, from no impulses and from lam: where
    several redundant contacts slide, Coulomb's law has many answers, and an exact one is not wrong
    for being another.

    In a row of this measure `constraint_error` is the natural residual, without a unit,
    `dynamics_error` the energy of the wrong velocities d^T G d / 2 [J], and `iterations` those of
    all methods that had a part. The name of a robot stands for it with its loops on its feet.

    Parameters
    ----------
    dt : float
        Of the step [s].
    integrator : ContactScheme
        What poses the problem.

    Raises
    ------
    InvalidArgument
        If dt is not positive, or the integrator is no scheme with contacts.
    """

    name: ClassVar[str] = "contact"
    asks: ClassVar[type] = ContactSolver
    methods: ClassVar[Methods] = CONTACT_SOLVERS

    dt: float = 1e-3  # [s]
    integrator: ContactScheme = StewartTrinkle()  # noqa: RUF009  a value

    def __post_init__(self) -> None:
        step_size(self.dt)
        if not isinstance(self.integrator, ContactScheme):
            raise InvalidArgument(
                f"integrator = {self.integrator!r}: a scheme with contacts is needed, such as "
                "StewartTrinkle()"
            )

    def scenes_of(self, robot: Robot) -> Mapping[str, Scene]:
        """Return the robot with its loops on its feet, with a friction of 0.7."""
        return feet_on_the_floor(robot)

    def open(self, scene: Scene, method: ContactSolver) -> ContactBench:
        """Return a contact solver with the scene, its problems not built yet."""
        if not scene.contacts:
            raise InvalidArgument("the scene has no contacts that may open: Scene(contacts=...)")
        if self.integrator.law not in method.laws:
            raise InvalidArgument(
                f"{self.integrator.title} poses the {self.integrator.law}, and {method.title} "
                f"solves {' and '.join(method.laws)}"
            )
        return ContactBench(scene, method)

    def truth(self, scene: Scene, state: State) -> Array:
        """Return the impulses of Newton's method, to rounding (m,) [N s]."""
        return solve_contact(self._problem(scene, state), _NEWTON, throw=False).lam

    def answer(
        self, workspace: ContactBench, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a contact solver at a state."""
        problem, solver = self._posed(workspace, state), workspace.solver
        found, natural = attempt_contact(problem, solver, None, _goal(solver))
        solution = verified(problem, found, natural, accuracy, solve_time=0.0)
        robot = workspace.scene.robot
        gravity = float(np.linalg.norm(robot.model.gravity.linear))
        least = robot.mass * (gravity * self.dt) ** 2
        lost, error = inf, inf
        if np.isfinite(solution.lam).all():
            polished = _NEWTON.attempt(problem, solution.lam).lam
            exact = natural_residual(problem, polished) <= _EXACT
            others = (truth, polished) if exact else (truth,)
            distances = (_distance(problem, solution.lam, other, least) for other in others)
            lost, error = min(distances, key=lambda pair: pair[1])
        return ComparedAnswer(
            error=error,
            status=solution.status.word,
            dynamics_error=lost,
            constraint_error=or_inf(natural),
            iterations=solution.iterations,
        )

    def calls(self, workspace: ContactBench) -> Mapping[str, Call]:
        """Return the solve as in a time step, and the one with all seven residuals."""
        solver, goal = workspace.solver, _goal(workspace.solver)

        def once(q: Array, v: Array, tau: Array) -> tuple[SolverResult, float]:
            return attempt_contact(self._posed(workspace, (q, v, tau)), solver, None, goal)

        def solve(q: Array, v: Array, tau: Array) -> ContactSolution:
            problem = self._posed(workspace, (q, v, tau))
            return solve_contact(problem, solver, accuracy=goal, throw=False)

        return {"once": once, "solve": solve}

    def _posed(self, bench: ContactBench, state: State) -> ContactProblem:
        """Contact problem of a step from a state, built once."""
        key = b"".join(x.tobytes() for x in state)
        if key not in bench.problems:
            bench.problems[key] = self._problem(bench.scene, state)
        return bench.problems[key]

    def _problem(self, scene: Scene, state: State) -> ContactProblem:
        return contact_problem(scene, *state, dt=self.dt, integrator=self.integrator)


def feet_on_the_floor(robot: Robot) -> Mapping[str, Scene]:
    """Return a robot with its loops on its feet, by label, with a friction of 0.7."""
    feet = robot.frictional_contacts(_FRICTION)
    if not feet:
        raise InvalidArgument(
            f"{robot.name} has no feet: hand in a Scene with contacts in place of its name"
        )
    return {f"{robot.name} on its feet": Scene(robot, robot.loops, feet)}


def _goal(solver: ContactSolver) -> float:
    """Required accuracy of the contact solve: the solver's own tolerance, if it is larger."""
    return max(getattr(solver, "tolerance", 0.0), tolerances.CONTACT_SOLVED)


def _distance(
    problem: ContactProblem, lam: Array, other: Array, least: float
) -> tuple[float, float]:
    """Energy of the velocity difference J^T (lam - other) [J], and its relative size."""
    d = lam - other
    wrong = max(float(d @ problem.G @ d), 0.0)
    size = max(float(other @ problem.G @ other), least)
    return wrong / 2, (wrong / size) ** 0.5 if size else inf if wrong else 0.0


# As far as doubles go: a thousandth of what any integrator with a fixed step reaches.
_CONVERGED = DormandPrince(relative_tolerance=1e-13, absolute_tolerance=1e-14)
_PARTS = 10

# As near as a scheme of first order comes in a second or two.
_FINE_SCHEME, _FINE_PARTS = Moreau(), 5000

# What parameters of a measure may be.
SCHEMES: Final[Mapping[str, type]] = {
    **INTEGRATORS, **DRIFTS, **CONTACT_SOLVERS, **RESTITUTION_LAWS,
}  # fmt: skip


def schemes_made(how: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return parameters with the schemes that their texts name, such as ``"Moreau()"``."""
    return {
        name: read_call(parameter).made(SCHEMES) if isinstance(parameter, str) else parameter
        for name, parameter in how.items()
    }


_T = TypeVar("_T")


def _default_entries(registry: Mapping[str, type[_T]]) -> tuple[_T, ...]:
    """Entries of a registry with default parameters; those with a required one are left out."""
    kinds = registry.values()
    return tuple(kind() for kind in kinds if not any(f.default is MISSING for f in fields(kind)))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class MotionBench:
    """A scene, and the workspace of its bilateral constraints."""

    scene: Scene
    held: Workspace


@dataclass(frozen=True)
class TrajectoryMeasure(Measure):
    """The error of q and v at the end of a motion, under the torques of the state, held constant.

    Of q relative to the larger of the distance moved and that of a free fall, of v relative to the
    larger of |v|_inf and the speed of a free fall; the larger of the two. The truth is the same
    motion by an adaptive method of order 8 with tolerances of rounding, and without drift control.
    With contacts that may open it is that of `Moreau` in 5000 steps: an error below some 1e-3 is
    not known, for every scheme that lets contacts close is of first order.

    In a row of this measure `constraint_error` is the largest gap of a constraint, or penetration,
    on the way [m, rad], `dynamics_error` the largest error of the energy balance [J], and
    `iterations` the steps.

    Parameters
    ----------
    duration : float
        [s]. The only parameter that changes the question.
    dt : float
        Step [s].
    integrator, drift : Integrator, Drift, optional
        As in `simulate`.

    Raises
    ------
    InvalidArgument
        If dt or the duration is not positive.
    """

    name: ClassVar[str] = "trajectory"
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {
            "dt": (1e-2, 3e-3, 1e-3, 3e-4),
            "integrator": _default_entries(INTEGRATORS),
            "drift": (None, *_default_entries(DRIFTS)),
        },
    )

    duration: float = 0.1  # [s]
    dt: float = 1e-3  # [s]
    integrator: Integrator | None = None
    drift: Drift | None = None

    def __post_init__(self) -> None:
        for parameter in ("duration", "dt"):
            value = getattr(self, parameter)
            if not isinstance(value, (int, float)) or not 0 < value < np.inf:
                raise InvalidArgument(f"{parameter} = {value!r}: a number > 0 [s] is needed")

    @property
    def label(self) -> str:
        """The name, with the duration if it differs from its default."""
        usual = self.duration == type(self).duration
        return self.name if usual else f"{self.name}(duration={self.duration!r})"

    @property
    def how(self) -> Mapping[str, Parameter]:
        """Step, integrator and drift scheme; None where `simulate` chooses."""
        chosen = {"integrator": self.integrator, "drift": self.drift}
        return {"dt": self.dt} | {k: v if v is None else repr(v) for k, v in chosen.items()}

    def with_how(self, how: Mapping[str, Parameter]) -> Measure:
        """Return the measure with a step, an integrator and a drift scheme, as `how` has them."""
        return replace(self, **schemes_made(how))

    def open(self, scene: Scene, method: Solver) -> MotionBench:
        """Return a scene, and the workspace of a solver on its bilateral constraints."""
        return MotionBench(scene, Workspace(scene.bilateral, method))

    def truth(self, scene: Scene, state: State) -> Array:
        """Return q and v at the end (nq + nv,)."""
        return _converged_end(scene, self.duration, *(x.tobytes() for x in state))

    def answer(
        self, workspace: MotionBench, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a motion with a workspace's solver."""
        motion, model = self._motion(workspace, state), workspace.held.model
        q, v = truth[: model.nq], truth[model.nq :]
        off = np.array(pin.difference(model, q, motion.q[-1]))
        way = np.array(pin.difference(model, state[0], q))
        gravity = workspace.held.scene.nominal.estimator.gravity
        gaps = motion.gaps.values()
        penetration = max((_largest(np.minimum(gap, 0.0)) for gap in gaps), default=0.0)
        return ComparedAnswer(
            error=max(
                relative(way + off, way, gravity * self.duration**2 / 2),
                relative(motion.v[-1], v, gravity * self.duration),
            ),
            status="ok" if motion.run.status.ok else motion.run.status.word,
            dynamics_error=_largest(motion.energy.error),
            constraint_error=max(_largest(motion.violation), penetration),
            iterations=len(motion.t) - 1,
        )

    def calls(self, workspace: MotionBench) -> Mapping[str, Call]:
        """Return the whole simulation, its workspace included."""

        def once(q: Array, v: Array, tau: Array) -> Trajectory:
            return self._motion(workspace, (q, v, tau))

        return {"once": once}

    def _motion(self, workspace: MotionBench, state: State) -> Trajectory:
        motion = simulate(
            workspace.scene,
            *state,
            duration=self.duration,
            dt=self.dt,
            integrator=self.integrator,
            drift=self.drift,
            solver=workspace.held.solver,
        )
        return uninterrupted(motion)


@lru_cache(maxsize=1000)
def _converged_end(scene: Scene, duration: float, q: bytes, v: bytes, tau: bytes) -> Array:
    """Final q and v of the converged motion (nq + nv,), cached for all steps and schemes."""
    integrator, parts = (_FINE_SCHEME, _FINE_PARTS) if scene.contacts else (_CONVERGED, _PARTS)
    motion = simulate(
        scene,
        *map(np.frombuffer, (q, v, tau)),
        duration=duration,
        dt=duration / parts,
        integrator=integrator,
        drift=None if scene.contacts else NoDrift(),
        solver=default_solver(scene.bilateral),
        record=parts,
    )
    if not uninterrupted(motion).run.status.ok:
        raise InvalidArgument(f"duration = {duration!r}: no converged motion: {motion.run.reason}")
    return np.concatenate([motion.q[-1], motion.v[-1]])


def _largest(x: Array) -> float:
    worst = float(np.abs(x).max(initial=0.0))
    return worst if isfinite(worst) else np.inf


# Random directions of a start and its torques, and differences along them [m/s, rad/s]. Events are
# located to 1e-10, and what is left of them is a millionth.
_DIRECTIONS: Final = 4
_H: Final = 1e-4

# The longest step between two events of the truth [s]: by a method of order 4.
_FINE_DT: Final = 5e-3

# How often what is drawn at random is drawn, for its mean and its spread.
_SEEDS: Final = 4

_WITH_RESPECT_TO: Final = ("q", "v", "tau")


@dataclass(frozen=True)
class RouteBench:
    """A route, and the scene whose motions it differentiates."""

    scene: Scene
    route: Route


@dataclass(frozen=True)
class GradientMeasure(Measure):
    """The error of the derivative of a motion's end by its start and its torques.

    e = |dx_T / dx_0 d - slope| / max(|slope|_inf, 1),    x = (q / T, v)

    over random directions d, each a velocity of order one of what moves freely. The slope is that
    of differences of the motion by `EventDriven`, whose impacts, lift-off and slip are located:
    that of the motion itself, not of its steps, so that the error is the bias of a route and of the
    step together.

    In a row of this measure `dynamics_error` is the spread, the standard deviation over seeds of a
    route that draws at random, relative as the error, `constraint_error` how far the end of the
    route's steps is from that of the motion, in x, and `iterations` the steps. The name of a
    robot stands for it with its loops on its feet.

    Parameters
    ----------
    duration : float
        T, of the motion [s].
    wrt : sequence of {"q", "v", "tau"}
        What directions are made of. What touches at the start has a slope by q on one side alone,
        so that q is not among them unless it is asked for.
    dt : float
        Step [s].
    integrator : ContactScheme
        Whose steps are differentiated.

    Raises
    ------
    InvalidArgument
        If dt or the duration is not positive, dt exceeds the duration, the integrator is no scheme
        with contacts, or `wrt` names no part of the start.
    """

    name: ClassVar[str] = "gradients"
    asks: ClassVar[type] = Route
    methods: ClassVar[Methods] = ROUTES

    duration: float = 0.01  # [s]
    wrt: Sequence[str] = ("v", "tau")
    dt: float = 1e-3  # [s]
    integrator: ContactScheme = Moreau()  # noqa: RUF009  a value

    def __post_init__(self) -> None:
        if round(seconds("duration", self.duration) / step_size(self.dt)) < 1:
            raise InvalidArgument(f"dt = {self.dt!r}: at most the duration, {self.duration:g} s")
        if not isinstance(self.integrator, ContactScheme):
            raise InvalidArgument(
                f"integrator = {self.integrator!r}: a scheme with contacts is needed, such as "
                "Moreau()"
            )
        object.__setattr__(self, "wrt", tuple(self.wrt))
        if not self.wrt or set(self.wrt) - set(_WITH_RESPECT_TO):
            raise InvalidArgument(
                f"wrt = {self.wrt!r}: some of {', '.join(_WITH_RESPECT_TO)} are needed"
            )

    @property
    def label(self) -> str:
        """The name, with the duration and the directions if they differ from their defaults."""
        usual = type(self)()
        mine = [k for k in ("duration", "wrt") if getattr(self, k) != getattr(usual, k)]
        said = ", ".join(f"{k}={getattr(self, k)!r}" for k in mine)
        return f"{self.name}({said})" if said else self.name

    @property
    def how(self) -> Mapping[str, Parameter]:
        """Step and integrator."""
        return {"dt": self.dt, "integrator": repr(self.integrator)}

    def with_how(self, how: Mapping[str, Parameter]) -> Measure:
        """Return the measure with a step and an integrator, as `how` has them."""
        return replace(self, **schemes_made(how))

    def scenes_of(self, robot: Robot) -> Mapping[str, Scene]:
        """Return the robot with its loops on its feet, with a friction of 0.7."""
        return feet_on_the_floor(robot)

    def open(self, scene: Scene, method: Route) -> RouteBench:
        """Return a route and a scene; InvalidArgument if the route does not support the steps."""
        check_scheme(scene, self.integrator)
        method.scheme(self.integrator)  # refuses what it cannot take
        return RouteBench(scene, method)

    def truth(self, scene: Scene, state: State) -> Array:
        """Return slopes (2 nv, directions) and, in the last column, the end (2 nv,), both in x."""
        arrays = (x.tobytes() for x in state)
        return _slopes(scene, self.duration, tuple(self.wrt), *arrays)

    def answer(
        self, workspace: RouteBench, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a route at a state."""
        route = workspace.route
        drawn = [route]
        if hasattr(route, "seed"):
            seeds: Any = [{"seed": k} for k in range(_SEEDS)]
            drawn = [replace(route, **each) for each in seeds]
        found = np.array([self._found(workspace.scene, each, state) for each in drawn])
        slopes, end = found[..., :-1], found[0, :, -1]
        size = max(float(np.abs(truth[:, :-1]).max()), 1.0)
        spread = slopes.std(axis=0, ddof=1) if len(drawn) > 1 else np.zeros(1)
        return ComparedAnswer(
            error=relative(slopes.mean(axis=0), truth[:, :-1], 1.0),
            status="ok",
            dynamics_error=float(spread.max()) / size,
            constraint_error=float(np.abs(end - truth[:, -1]).max()),
            iterations=self._steps,
        )

    def calls(self, workspace: RouteBench) -> Mapping[str, Call]:
        """Return the derivatives of a motion along all directions, its steps included."""

        def once(q: Array, v: Array, tau: Array) -> Array:
            return self._found(workspace.scene, workspace.route, (q, v, tau))

        return {"once": once}

    @property
    def _steps(self) -> int:
        return round(self.duration / self.dt)

    def _found(self, scene: Scene, route: Route, state: State) -> Array:
        """Slopes (2 nv, directions) and, in the last column, the end (2 nv,), by a route, in x."""
        q, v, tau = state
        steps = linear_steps(scene, route.scheme(self.integrator), self.duration / self._steps)
        chain, n = StepChain(route, steps, self._steps, np.tile(tau, (self._steps, 1))), len(v)
        dq, dv, dtau = _directions(scene, self.duration, tuple(self.wrt), q.tobytes())
        x = np.vstack((dq, dv))
        for of in chain.forward((q, v)):
            A = of.matrix
            x = A[:, : 2 * n] @ x + A[:, 2 * n : 3 * n] @ dtau
        moved = np.array(pin.difference(scene.robot.model, q, of.q))
        scaled = np.column_stack((x, np.concatenate((moved, of.v))))
        scaled[:n] /= self.duration
        return scaled


@lru_cache(maxsize=1000)
def _directions(scene: Scene, duration: float, wrt: tuple[str, ...], at: bytes) -> list[Array]:
    """Return random directions of q, v and tau (nv, directions) each; zero if not in `wrt`."""
    rng, n, q = np.random.default_rng(0), scene.robot.nv, np.frombuffer(at)
    workspace = Workspace(scene.bilateral)
    M = pin.crba(workspace.model, whole_data(workspace.model), q)
    sizes = {"q": duration * np.ones(n), "v": np.ones(n), "tau": np.diag(M) / duration}
    J = workspace.jacobian(q)
    found = []
    for part in _WITH_RESPECT_TO:
        drawn = rng.normal(size=(n, _DIRECTIONS)) * (part in wrt)
        if part != "tau" and len(J):  # along the constraints
            drawn -= np.linalg.lstsq(J, J @ drawn, rcond=1e-9)[0]
        found.append(sizes[part][:, None] * drawn)
    return found


@lru_cache(maxsize=1000)
def _slopes(
    scene: Scene, duration: float, wrt: tuple[str, ...], q: bytes, v: bytes, tau: bytes
) -> Array:
    """Slopes and end of the converged motion, cached for all routes and steps."""
    start = [np.frombuffer(x) for x in (q, v, tau)]
    model, n = scene.robot.model, scene.robot.nv
    steps = max(int(np.ceil(duration / _FINE_DT)), 10)

    def end(dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        q0 = np.array(pin.integrate(model, start[0], dq))
        motion = simulate(
            scene, q0, start[1] + dv, start[2] + dtau, duration=duration, dt=duration / steps,
            integrator=EventDriven(), record=steps,
        )  # fmt: skip
        if not uninterrupted(motion).run.status.ok:
            raise InvalidArgument(f"duration = {duration!r}: no such motion: {motion.run.reason}")
        return motion.q[-1], motion.v[-1]

    def between(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
        moved = np.array(pin.difference(model, other[0], one[0]))
        return np.concatenate((moved / duration, one[1] - other[1]))

    still, columns = np.zeros(n), []
    for along in zip(*(x.T for x in _directions(scene, duration, wrt, q)), strict=True):
        up, down = (end(*(s * _H * x for x in along)) for s in (1, -1))
        columns.append(between(up, down) / (2 * _H))
    columns.append(between(end(still, still, still), (start[0], 0 * start[1])))
    return np.column_stack(columns)
