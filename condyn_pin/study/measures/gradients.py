"""Derivatives of the end of a motion through contact by each route, against differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import seconds, step_size
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin._core.trees import whole_data
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes import ROUTES, Route
from condyn_pin.gradients.routes.route import Chain, linear_steps
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.outcome import uninterrupted
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.run import simulate
from condyn_pin.stepping.schemes.event_driven import EventDriven
from condyn_pin.stepping.schemes.moreau import Moreau
from condyn_pin.study.measures.contact import feet_on_the_floor
from condyn_pin.study.measures.measure import Answer, Measure, relative
from condyn_pin.study.measures.trajectory import schemes_made
from condyn_pin.study.tables import Methods, Parameter

# Random directions of a start and its torques, and differences along them [m/s, rad/s]. Events are
# located to 1e-10, and what is left of them is a millionth.
_DIRECTIONS: Final = 4
_H: Final = 1e-4

# The longest step between two events of the truth [s]: by a method of order 4.
_FINE: Final = 5e-3

# How often what is drawn at random is drawn, for its mean and its spread.
_SEEDS: Final = 4

_PARTS: Final = ("q", "v", "tau")


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
        if not self.wrt or set(self.wrt) - set(_PARTS):
            raise InvalidArgument(f"wrt = {self.wrt!r}: some of {', '.join(_PARTS)} are needed")

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

    def answer(self, workspace: RouteBench, state: State, truth: Array, accuracy: float) -> Answer:
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
        return Answer(
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
        chain, n = Chain(route, steps, self._steps, np.tile(tau, (self._steps, 1))), len(v)
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
    for part in _PARTS:
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
    steps = max(int(np.ceil(duration / _FINE)), 10)

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
