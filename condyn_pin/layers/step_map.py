"""StepMap: the end of a step with contacts as a function of (q, v, tau) and of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import step_size
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene, check_scene, time_of
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.layers.layer_map import Pair
from condyn_pin.layers.parameters import Made, Parameters
from condyn_pin.layers.state_map import StateMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives


class StepChange:
    """How the end of a step changes, with the parameters of a layer behind q, v and tau."""

    def __init__(self, of: StepDerivatives, parameters: Parameters) -> None:
        n = len(of.v)
        self._cuts = np.cumsum([n, n, n, *map(np.prod, parameters.shapes.values())])[:-1]
        self._shapes = [(n,)] * 3 + [*parameters.shapes.values()]
        both = np.vstack(of.matrices)
        self.matrix = np.hstack([both[:, : 3 * n], *parameters.of(both, of.columns)])
        self._n = n

    def jvp(self, *steps: Array) -> Pair:
        """Return (dq+, dv+) along steps of q, v, tau and the parameters."""
        moved = self.matrix @ np.concatenate([step.ravel() for step in steps])
        return moved[: self._n], moved[self._n :]

    def vjp(self, dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by q, v, tau and the parameters."""
        by = np.split(np.concatenate((dx, dy)) @ self.matrix, self._cuts)
        return tuple(each.reshape(s) for each, s in zip(by, self._shapes, strict=True))


class StepMap(StateMap):
    """(q+, v+) of one step, and its derivatives by a route."""

    ends_in_q: ClassVar[bool] = True

    def __init__(
        self, scene: Scene, dt: float, integrator: ContactScheme, route: Route,
        wrt: Sequence[str] = (),
    ) -> None:  # fmt: skip
        check_steps(scene, dt, integrator, route)
        self.parameters = Parameters(Made(scene, integrator, route), wrt)
        super().__init__(scene.robot, self.parameters.shapes)
        self._dt = float(dt)
        self.x_size, self.y_size = self.nq, self.nv

    def answer(self, q: Array, v: Array, tau: Array, *p: Array) -> Pair:
        """Return q+ and v+."""
        steps, route = self.parameters.steps(p, self._dt)
        steps.system.applied.hold(tau, ())
        q, v = route.step(steps, steps.begin, q, v)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            how = f"a step of {self._dt:g} s by {steps.scheme!r}"
            raise SolveFailed(f"{how} is not finite", None)
        return np.asarray(q), np.asarray(v)

    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, StepChange]:
        """Return q+ and v+, and their derivatives."""
        steps, route = self.parameters.steps(p, self._dt)
        steps.system.applied.hold(tau, ())
        found = route.at(steps, steps.begin, q, v)
        return (found.q, found.v), StepChange(found, self.parameters)

    def matrices(self, change: StepChange) -> Pair:
        """Return the derivatives of q+ and of v+, (nv, 3 nv + parameters) each."""
        return change.matrix[: self.nv], change.matrix[self.nv :]

    def __reduce__(self) -> tuple[Any, ...]:
        scene, scheme, route = self.parameters.made
        return StepMap, (scene, self._dt, scheme, route, tuple(self.parameters.shapes))


def check_steps(scene: Scene, dt: float, integrator: ContactScheme, route: Route) -> None:
    """Refuse what no steps of a layer can be made of."""
    check_scene(scene)
    if not isinstance(integrator, ContactScheme):
        raise InvalidArgument(
            f"integrator = {integrator!r}: one that lets contacts open is needed, such as "
            "StewartTrinkle()"
        )
    if not isinstance(route, Route):
        raise InvalidArgument(f"route = {route!r}: a Route is needed, such as ActiveSet()")
    step_size(dt)
    time_of(scene)  # refuses driven rows without a time
    check_scheme(scene, integrator)
    route.scheme(integrator)  # refuses what it cannot take
