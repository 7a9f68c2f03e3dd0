"""The contract of a route to the derivatives of a step with contacts, and how to write one.

A step is piecewise smooth: within a mode of its contacts - open, stick, slide - its end is a smooth
function of its start, and between two modes it has a kink, or a jump. Routes differ in what they
make of kinks and jumps.

1. Add one file to this folder with one frozen dataclass that inherits from `Route`. Its fields are
   its parameters, each with a default and a unit. It registers itself in `ROUTES`;
   `tests/test_routes.py` compares its derivatives with finite differences.
   Name it in `__init__.py`.
2. Set `title`, `cost` and `use`: when to take it.
3. Write `at(steps, t, q, v, taken)`, which returns `StepDerivatives`. If the end of its step is not
   that of the scheme, write `step` too, and `scheme` if it takes steps of another one; `parameters`
   if it has derivatives by others than the scheme takes.
4. A route that only has another law of the contacts inherits from `LawRoute`, and writes only
   `law(problem, lam, natural, size)`: impulses, and the law linearised at them (`ContactLaw`); and
   `path` if that is not the law of the scheme. All else, how the problem changes with q, v and tau
   and how the end of the step follows, is that of `LinearizedStep`.
5. It reads nothing that an earlier call left behind.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, sqrt
from typing import ClassVar, Final

import numpy as np

from condyn_pin._core.arguments import Grid, register
from condyn_pin._core.arrays import Array
from condyn_pin._core.threads import ThreadCache
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.gradients.routes.step_derivatives import (
    PARAMETERS,
    ContactLaw,
    StepDerivatives,
    differentiated,
)
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.single_step import StepStart
from condyn_pin.stepping.step_problem import AcceptedStep

ROUTES: dict[str, type[Route]] = {}

# Why a step may have no derivatives by a parameter.
_WHY_NOT: Final = {
    "restitution": "for its impacts have none: those of Moreau() do",
    "solref": "for its contacts are rigid: those of SoftStep() and of Softened() are compliant",
}


@dataclass(frozen=True)
class Route(ABC):
    """A method to differentiate a step whose contacts open, stick and slide; a frozen value."""

    title: ClassVar[str]  # what tables show
    cost: ClassVar[str]
    use: ClassVar[str]  # when to take it
    on_request: ClassVar[tuple[str, ...]] = ("inertias",)  # parameters left out unless named
    sweeps: ClassVar[tuple[Grid, ...]] = ()  # values of parameters that are worth a look
    is_smooth: ClassVar[bool] = False  # whether its law has no kinks: those of a scheme are said

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            register(ROUTES, cls.__name__.lower(), cls, f"a route named {cls.__name__}")

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme whose steps are taken; InvalidArgument if there is none."""
        return scheme

    def parameters(self, scheme: ContactScheme) -> tuple[str, ...]:
        """Parameters of the derivatives of steps by a `scheme`, beside q, v and tau."""
        taken = self.scheme(scheme)
        found = ["friction"]
        if taken.takes_restitution:
            found.append("restitution")
        if hasattr(taken, "solref"):
            found.append("solref")
        return (*found, "inertias")

    @abstractmethod
    def at(
        self, steps: LinearizedStep, t: float, q: Array, v: Array, taken: AcceptedStep | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, with its derivatives.

        `taken` is the same step, if it is at hand: nothing has to be solved again.
        """

    def step(self, steps: LinearizedStep, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the same step of `steps`, without derivatives."""
        return steps.step(t, q, v)

    def differentiate(
        self, scene: Scene, scheme: ContactScheme, dt: float, start: StepStart,
        wrt: Sequence[str] = (), taken: AcceptedStep | None = None,
    ) -> StepDerivatives:  # fmt: skip
        """Derivatives of the end of a step of a `scheme`, by its `start` and by `wrt`.

        `taken` is the step, if it is at hand.
        """
        names, own = check_parameters(self, scheme, wrt), self.scheme(scheme)
        steps = linear_steps(scene, own, dt, names)
        steps.system.applied.hold(start.tau, start.forces)
        return self.at(steps, steps.begin, start.q, start.v, taken if own is scheme else None)


class LawRoute(Route, ABC):
    """A route that puts another law of the contacts into the same step."""

    @abstractmethod
    def law(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Return impulses of a problem, and their law linearised.

        Parameters
        ----------
        problem : ContactProblem
            The contact problem.
        lam : (m,) array
            The impulses of the step, where they can be a guess [N s].
        natural : float
            Their residual [1].
        size : float
            (m g dt) (g dt) of the robot and the step [J].
        """

    def path(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Law by which the scheme finds the paths of a step that is tried again."""
        return self.law(problem, lam, natural, size)

    def at(
        self, steps: LinearizedStep, t: float, q: Array, v: Array, taken: AcceptedStep | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, with its derivatives."""
        with np.errstate(all="ignore"):  # what is not finite is refused
            law, path = (partial(of, size=steps.size) for of in (self.law, self.path))
            ended = steps.end(t, q, v, law, taken, path)
            return differentiated(self, steps, ended)

    def step(self, steps: LinearizedStep, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the same step of `steps`, without derivatives."""
        return steps.ended(t, q, v, partial(self.law, size=steps.size))


def check_parameters(
    route: Route, scheme: ContactScheme, wrt: Sequence[str], more: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Return the parameters that are asked for; InvalidArgument if a step does not have one.

    `more` are names that are allowed beside those of the route.
    """
    if isinstance(wrt, str):
        raise InvalidArgument(f"wrt = {wrt!r}: a list of names is needed, such as [{wrt!r}]")
    known = (*more, *route.parameters(scheme))
    for name in wrt:
        if name not in known:
            why = "unknown"
            if name in PARAMETERS:
                why = f"a step by {route!r} has none by it, {_WHY_NOT[name]}"
            raise InvalidArgument(f"wrt: {name!r}: {why}; there are {', '.join(known) or 'none'}")
    return tuple(wrt)


# A loop over derivatives, also by several routes, whose schemes differ, makes what it needs once.
_steps = ThreadCache[LinearizedStep]()


def linear_steps(
    scene: Scene, scheme: ContactScheme, dt: float, wrt: Sequence[str] = ()
) -> LinearizedStep:
    """Return this thread's linear steps of a scene and a scheme: earlier ones, or new ones."""
    scene.robot.check_unedited()
    asked = scheme, dt, tuple(wrt)
    return _steps.of(scene, asked, lambda: LinearizedStep(scene, scheme, dt, wrt=wrt))


# Chain: steps of a motion with contacts, one after the other, with their derivatives.
#
#     x_i+1 = step(x_i, u_i, p),    dx_i+1 = A_i dx_i + B_i du_i + P_i dp
#
# Backward, the gradient y of what is asked of the states x_i, with g_i of x_i itself,
#
#     y_i = g_i + A_i^T y_i+1,    by u_i: B_i^T y_i+1,    by p: sum_i P_i^T y_i+1
#
# and each step is linearised when its turn comes, at a state that is kept, or taken again from one
# that is: no matrix of another step is in memory.


State = tuple[Array, Array]


class StepChain:
    """So many steps of a route.

    Parameters
    ----------
    torques : (count, nv) array, optional
        What is held in each step; without them what the system of `steps` applies.
    """

    def __init__(
        self, route: Route, steps: LinearizedStep, count: int, torques: Array | None = None
    ) -> None:
        self.route, self.steps, self.count = route, steps, count
        self._torques, self._every = torques, max(ceil(sqrt(count)), 1)

    def after(self, start: State) -> Iterator[State]:
        """Return the state after each step."""
        state = start
        for i in range(self.count):
            state = self._next(i, state)
            yield state

    def kept(self, start: State) -> list[State]:
        """Return some sqrt(count) states, from the start on, and the end."""
        ends = list(range(self._every, self.count, self._every))
        found = [start]
        for i, state in enumerate(self.after(start), start=1):
            if i in ends or i == self.count:
                found.append(state)
        return found

    def forward(self, start: State) -> Iterator[StepDerivatives]:
        """Return the derivatives of each step."""
        state = start
        for i in range(self.count):
            of = self._at(i, state)
            yield of
            state = of.q, of.v

    def backward(self, kept: list[State]) -> Iterator[tuple[int, StepDerivatives]]:
        """Return the derivatives of each step, from the last one on, with its number."""
        for first in reversed(range(0, self.count, self._every)):
            last = min(first + self._every, self.count)
            states = [kept[first // self._every]]
            for i in range(first, last - 1):
                states.append(self._next(i, states[-1]))
            for i in reversed(range(first, last)):
                yield i, self._at(i, states[i - first])

    def adjoint(
        self, kept: list[State], asked: Callable[[int, StepDerivatives], Array | None]
    ) -> tuple[Array, Array, Array]:
        """Return the gradient of a function of all states.

        By the start (2 nv,), tangent, by tau (steps, nv), and by all columns (columns,), which all
        steps share. ``asked(i, of)`` is its own gradient (2 nv,) by the end of step i, None if it
        has none.
        """
        columns = self.steps.columns
        y, by_tau = np.zeros(2 * columns.nv), np.zeros((self.count, columns.nv))
        by_others = np.zeros(columns.size)
        for i, of in self.backward(kept):
            own = asked(i, of)
            x = (y if own is None else y + own) @ of.matrix
            by_tau[i] = x[columns.tau]
            by_others += x
            y = x[: 2 * columns.nv]
        return y, by_tau, by_others

    def _next(self, i: int, state: State) -> State:
        self._hold(i)
        return self.route.step(self.steps, self._time(i), *state)

    def _at(self, i: int, state: State) -> StepDerivatives:
        self._hold(i)
        return self.route.at(self.steps, self._time(i), *state)

    def _time(self, i: int) -> float:
        return self.steps.begin + i * self.steps.dt

    def _hold(self, i: int) -> None:
        if self._torques is not None:
            self.steps.system.applied.hold(self._torques[i], ())
