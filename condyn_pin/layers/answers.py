"""Layers of answers: solve, step, simulate.

SolveMap: accelerations and constraint forces as a function of (q, v, tau) and of inertias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import check_type, step_size
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.dynamics.scene import Scene, check_scene, time_of
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.gradients.routes.route import Route, StepChain
from condyn_pin.gradients.routes.step_derivatives import StepDerivatives
from condyn_pin.layers.maps import (
    Configurations,
    LayerMap,
    MapDerivatives,
    Pair,
    Parameters,
    ParametrisedScene,
    Shape,
    StateMap,
)
from condyn_pin.model.smaller import weighing
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.plan import check_scheme


class SolveChange:
    """Derivatives of a solution by q, v, tau and, last, inertias."""

    def __init__(self, of: Any, bodies: int) -> None:
        self.of, self._shape = of, (bodies, 10)
        self.by_inertias = np.vstack(of.by_inertias())

    @property
    def matrix(self) -> Array:
        """Derivatives of a and then lam by q, v, tau and inertias."""
        return np.hstack([self.of.matrix, self.by_inertias])

    def jvp(self, dq: Array, dv: Array, dtau: Array, by: Array) -> Pair:
        """Return (da, dlam) along steps of q, v, tau and inertias."""
        da, dlam = self.of.jvp(dq, dv, dtau)
        more = self.by_inertias @ by.ravel()
        return da + more[: len(da)], dlam + more[len(da) :]

    def vjp(self, da: Array, dlam: Array) -> tuple[Array, ...]:
        """Return the gradients by q, v, tau and inertias."""
        by = (np.concatenate((da, dlam)) @ self.by_inertias).reshape(self._shape)
        return (*self.of.vjp(da, dlam), by)


class SolveMap(StateMap):
    """(a, lam) of a scene, in memory of its own."""

    def __init__(
        self, scene: Scene, solver: Solver | None, drift: Baumgarte | None,
        wrt: Sequence[str] = (),
    ) -> None:  # fmt: skip
        if tuple(wrt) not in ((), ("inertias",)):
            raise InvalidArgument(f'wrt = {wrt!r}: ["inertias"], or nothing, is what a solve has')
        self._scene, self._drift = scene, drift
        self._workspace = Workspace(scene, solver, drift=drift)
        self._bodies, self._last = scene.robot.model.njoints - 1, b""
        super().__init__(scene.robot, dict.fromkeys(wrt, (self._bodies, 10)))
        self.x_size, self.y_size = scene.robot.nv, scene.rows

    def answer(self, q: Array, v: Array, tau: Array, *p: Array) -> Pair:
        """Return a and lam."""
        found = self._weighing(*p).solve(q, v, tau)
        return found.a, found.lam

    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, Any]:
        """Return a and lam, and their derivatives."""
        found = self._weighing(*p).derivatives(q, v, tau)
        pair = found.solution.a, found.solution.lam
        return pair, SolveChange(found, self._bodies) if p else found

    def __reduce__(self) -> tuple[Any, ...]:
        wrt = tuple(self.inputs)[3:]
        return SolveMap, (self._scene, self._workspace.solver, self._drift, wrt)

    def _weighing(self, *inertias: Array) -> Workspace:
        """Return the workspace of the robot with these inertias; its own without any."""
        if inertias and inertias[0].tobytes() != self._last:
            heavy = replace(self._scene, robot=weighing(self._scene.robot, inertias[0]))
            self._workspace = Workspace(heavy, self._workspace.solver, drift=self._drift)
            self._last = inertias[0].tobytes()
        return self._workspace


# StepMap: the end of a step with contacts as a function of (q, v, tau) and of parameters.


class StepMap(StateMap):
    """(q+, v+) of one step, and its derivatives by a route."""

    ends_in_q: ClassVar[bool] = True

    def __init__(
        self, scene: Scene, dt: float, integrator: ContactScheme, route: Route,
        wrt: Sequence[str] = (),
    ) -> None:  # fmt: skip
        check_steps(scene, dt, integrator, route)
        self.parameters = Parameters(ParametrisedScene(scene, integrator, route), wrt)
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

    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, MapDerivatives]:
        """Return q+ and v+, and their derivatives."""
        steps, route = self.parameters.steps(p, self._dt)
        steps.system.applied.hold(tau, ())
        found = route.at(steps, steps.begin, q, v)
        all_columns, shapes = found.matrix, [(self.nv,)] * 3 + [*self.parameters.shapes.values()]
        by_p = self.parameters.of(all_columns, found.columns)
        matrix = np.hstack([all_columns[:, : 3 * self.nv], *by_p])
        return (found.q, found.v), MapDerivatives(matrix, self.nv, shapes)

    def __reduce__(self) -> tuple[Any, ...]:
        scene, scheme, route = self.parameters.made
        return StepMap, (scene, self._dt, scheme, route, tuple(self.parameters.shapes))


def check_steps(scene: Scene, dt: float, integrator: ContactScheme, route: Route) -> None:
    """Refuse arguments of which no steps of a layer can be made."""
    check_scene(scene)
    if not isinstance(integrator, ContactScheme):
        raise InvalidArgument(
            f"integrator = {integrator!r}: one that lets contacts open is needed, such as "
            "StewartTrinkle()"
        )
    check_type("route", route, Route, "a Route is needed, such as ActiveSet()")
    step_size(dt)
    time_of(scene)  # refuses driven rows without a time
    check_scheme(scene, integrator)
    route.scheme(integrator)  # refuses what it cannot take


# RunMap: the states of a motion with contacts as functions of its start, torques and parameters.
#
#     x_i+1 = step(x_i, tau_i, p)
#
# Backward, a gradient goes against the steps (`StepChain`): from the states that are returned to
# the start, with some sqrt(steps) states in memory and the matrices of one step.


class RunMap(LayerMap):
    """q and v after all steps of tau, or after each `every` of them."""

    def __init__(
        self, scene: Scene, dt: float, integrator: ContactScheme, route: Route,
        wrt: Sequence[str], every: int | None,
    ) -> None:  # fmt: skip
        check_steps(scene, dt, integrator, route)
        whole = isinstance(every, int) and not isinstance(every, bool) and every > 0
        if every is not None and not whole:
            raise InvalidArgument(f"every = {every!r}: a whole number of steps > 0, or None")
        self._dt, self._every = float(dt), every
        self._space = Configurations(scene.robot)
        self._parameters = Parameters(ParametrisedScene(scene, integrator, route), wrt)
        nq, nv = self._space.nq, self._space.nv
        start = {"q": (nq,), "v": (nv,), "tau": (None, nv)}
        super().__init__({**start, **self._parameters.shapes})

    def outputs(self, shapes: Sequence[Shape]) -> tuple[Shape, Shape]:
        """Return the shapes of q and v; InvalidArgument if tau has a wrong number of steps."""
        (nq,), (nv,), (steps, _) = shapes[:3]
        if not steps:
            raise InvalidArgument("tau has no steps: one row for each step is needed")
        if self._every is None:
            return (nq,), (nv,)
        if steps % self._every:
            raise InvalidArgument(
                f"tau has {steps} steps: a multiple of every = {self._every} is needed"
            )
        return (steps // self._every, nq), (steps // self._every, nv)

    def value_of(self, *inputs: Array) -> Pair:
        """Return q and v of one motion."""
        start, chain, _ = self._begun(*inputs)
        return self._shaped([start, *chain.after(start)])

    def jvp_of(self, inputs: Sequence[Array], steps: Sequence[Array]) -> Pair:
        """Return the changes of q and v of one motion along steps of all inputs."""
        start, chain, T = self._begun(*inputs)
        dq, dv, dtau, *dp = steps
        x, columns = np.concatenate((T @ dq, dv)), chain.steps.columns
        moves = [(self._space.rates(start[0]) @ x[: len(dv)], x[len(dv) :])]
        for i, of in enumerate(chain.forward(start)):
            A = of.matrix
            blocks = self._parameters.of(A, columns)
            x = A[:, : len(x)] @ x + A[:, columns.tau] @ dtau[i]
            x += sum(block @ step.ravel() for block, step in zip(blocks, dp, strict=True))
            moves.append((self._space.rates(of.q) @ x[: len(dv)], x[len(dv) :]))
        return self._shaped(moves)

    def vjp_of(self, inputs: Sequence[Array], dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by all inputs of one motion, in one sweep back."""
        start, chain, T = self._begun(*inputs)
        dx, dy = np.atleast_2d(dx), np.atleast_2d(dy)
        every = self._every or chain.count

        def arriving(i: int, of: StepDerivatives) -> Array | None:
            k, within = divmod(i + 1, every)
            if within:
                return None
            return np.concatenate((dx[k - 1] @ self._space.rates(of.q), dy[k - 1]))

        y, by_tau, others = chain.adjoint(chain.kept(start), arriving)
        n = len(start[1])
        by_p = self._parameters.of(others, chain.steps.columns)
        shapes = self._parameters.shapes.values()
        reshaped = (each.reshape(shape) for each, shape in zip(by_p, shapes, strict=True))
        return (y[:n] @ T, y[n:], by_tau, *reshaped)

    def _begun(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, StepChain, Array]:
        """Return the start of one motion, its steps, and what its start is in the tangent."""
        steps, route = self._parameters.steps(p, self._dt)
        unit, lengths = self._space.unit(q)
        chain = StepChain(route, steps, len(tau), tau)
        return (unit, v), chain, self._space.steps(unit, lengths)

    def __reduce__(self) -> tuple[Any, ...]:
        scene, scheme, route = self._parameters.made
        wrt = tuple(self._parameters.shapes)
        return RunMap, (scene, self._dt, scheme, route, wrt, self._every)

    def _shaped(self, states: Sequence[Pair]) -> Pair:
        """Return the requested states, out of all from the start on."""
        every = self._every
        chosen = states[every::every] if every else states[-1:]
        x, y = (np.array(each) for each in zip(*chosen, strict=True))
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise SolveFailed(f"a motion by steps of {self._dt:g} s is not finite", None)
        return (x[0], y[0]) if self._every is None else (x, y)
