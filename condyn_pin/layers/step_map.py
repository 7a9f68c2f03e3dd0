"""StepMap: the end of a step with contacts as a function of (q, v, tau)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array, finite
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.layers.state_map import Pair, StateMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.plan import check_scheme
from condyn_pin.simulation.routes.base import Route, linear_steps
from condyn_pin.simulation.routes.linear_steps import LinearSteps
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives


class StepMap(StateMap):
    """(q+, v+) of one step, and its derivatives by a route."""

    ends_in_q: ClassVar[bool] = True

    def __init__(self, scene: Scene, dt: float, integrator: ContactScheme, route: Route) -> None:
        check_scene(scene)
        if not isinstance(integrator, ContactScheme):
            raise InvalidArgument(
                f"integrator = {integrator!r}: one that lets contacts open is needed, such as "
                "StewartTrinkle()"
            )
        if not isinstance(route, Route):
            raise InvalidArgument(f"route = {route!r}: a Route is needed, such as ActiveSet()")
        if not float(finite("dt", dt, ())) > 0.0:
            raise InvalidArgument(f"dt = {dt!r}: a positive number is needed [s]")
        check_scheme(scene, integrator)
        super().__init__(scene.robot)
        self._scene, self._dt = scene, float(dt)
        self._scheme, self._route = route.scheme(integrator), route
        self.x_size, self.y_size = self.nq, self.nv

    def answer(self, q: Array, v: Array, tau: Array) -> Pair:
        """Return q+ and v+."""
        q, v = self._route.step(self._steps(tau), 0.0, q, v)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise SolveFailed(f"a step of {self._dt:g} s by {self._scheme!r} is not finite", None)
        return np.asarray(q), np.asarray(v)

    def change(self, q: Array, v: Array, tau: Array) -> tuple[Pair, StepDerivatives]:
        """Return q+ and v+, and their derivatives."""
        found = self._route.at(self._steps(tau), 0.0, q, v)
        return (found.q, found.v), found

    def matrices(self, change: StepDerivatives) -> Pair:
        """Return the derivatives of q+ and of v+, (nv, 3 nv) each."""
        d = change
        of_q = np.hstack([d.dq_dq, d.dq_dv, d.dq_dtau])
        return of_q, np.hstack([d.dv_dq, d.dv_dv, d.dv_dtau])

    def _steps(self, tau: Array) -> LinearSteps:
        steps = linear_steps(self._scene, self._scheme, self._dt)  # those of this thread
        steps.system.applied.hold(tau, ())
        return steps
