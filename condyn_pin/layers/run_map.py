"""RunMap: the states of a motion with contacts as functions of its start, torques and parameters.

    x_i+1 = step(x_i, tau_i, p)

Backward, a gradient goes against the steps (`Chain`): from the states that are asked for to the
start, with some sqrt(steps) states in memory and the matrices of one step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.layers.configurations import Configurations
from condyn_pin.layers.layer_map import LayerMap, Pair, Shape
from condyn_pin.layers.parameters import Made, Parameters
from condyn_pin.layers.step_map import check_steps
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.routes.base import Chain, Route
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives


class RunMap(LayerMap):
    """q and v at the end of so many steps as tau is long, or after each `every` of them."""

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
        self._parameters = Parameters(Made(scene, integrator, route), wrt)
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
            A = np.vstack(of.matrices)
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

        def asked(i: int, of: StepDerivatives) -> Array | None:
            k, within = divmod(i + 1, every)
            if within:
                return None
            return np.concatenate((dx[k - 1] @ self._space.rates(of.q), dy[k - 1]))

        y, by_tau, others = chain.adjoint(chain.kept(start), asked)
        n = len(start[1])
        by_p = self._parameters.of(others, chain.steps.columns)
        shapes = self._parameters.shapes.values()
        reshaped = (each.reshape(shape) for each, shape in zip(by_p, shapes, strict=True))
        return (y[:n] @ T, y[n:], by_tau, *reshaped)

    def _begun(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, Chain, Array]:
        """Return the start of one motion, its steps, and what its start is in the tangent."""
        steps, route = self._parameters.steps(p, self._dt)
        unit, lengths = self._space.unit(q)
        chain = Chain(route, steps, len(tau), tau)
        return (unit, v), chain, self._space.steps(unit, lengths)

    def __reduce__(self) -> tuple[Any, ...]:
        scene, scheme, route = self._parameters.made
        wrt = tuple(self._parameters.shapes)
        return RunMap, (scene, self._dt, scheme, route, wrt, self._every)

    def _shaped(self, states: Sequence[Pair]) -> Pair:
        """Return the states that are asked for, of all from the start on."""
        every = self._every
        chosen = states[every::every] if every else states[-1:]
        x, y = (np.array(each) for each in zip(*chosen, strict=True))
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise SolveFailed(f"a motion by steps of {self._dt:g} s is not finite", None)
        return (x[0], y[0]) if self._every is None else (x, y)
