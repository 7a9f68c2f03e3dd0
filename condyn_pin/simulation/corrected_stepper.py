"""CorrectedStepper: steps of one size, q and v, with the correction of a drift scheme."""

from __future__ import annotations

from collections.abc import Callable

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Drift
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.system import NO_TOUCH, System


class CorrectedStepper:
    """An integrator's steps of one size, the correction of a drift scheme behind each."""

    def __init__(self, system: System, integrator: Integrator, drift: Drift, dt: float) -> None:
        self._dt, self._manifold = dt, system.manifold
        bare = integrator.start(system, dt)
        self._step, self._lam, self._touch = bare.step, bare.lam, bare.touch
        self.sample = bare.sample or system.sample
        # what a step begins with may be another system's solve
        self._first = bare.sample or (bare.system or system).sample
        self._samples_start = integrator.a_at == "start"
        # a correction reads what the solve of the next step leaves behind
        self._system = bare.system or system
        self._correct = drift.start(self._system, dt)
        self._is_driven = system.scene.is_driven
        self._slow = None if integrator.between_events.is_adaptive else system.manifold.slow(dt)

    def take(
        self, t: float, q: Array, v: Array, t1: float, keep: Callable[[Row], None] | None = None
    ) -> tuple[Array, Array]:
        """Return q and v after a step to t1; `keep` is handed the sample that belongs to it."""
        slow, lam = self._slow, None
        if keep and self._samples_start:
            keep(self._first(t, q, v))
        if slow and v.dot(v) > slow:  # all velocities together: most often that is enough
            self._manifold.check_turn(v, self._dt)
        q, v, a = self._step(t, q, v)
        if slow and v.dot(v) > slow:
            self._manifold.check_turn(v, self._dt)
        if self._is_driven:
            self._system.check_reach(t1, q, v)
        if keep and self._lam:
            lam = self._lam()  # before the correction solves again
        if self._correct:
            q, v = self._correct(t + self._dt, q, v)
        if keep and lam is not None:
            touch = self._touch() if self._touch else NO_TOUCH
            keep((t1, q, v, a, lam, self._system.applied.at_sample(t1, q, v), touch))
        return q, v
