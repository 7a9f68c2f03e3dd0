"""Leg: one scene on its way, as long as its constraints are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi
from typing import NamedTuple

from condyn_pin._core.arrays import Array
from condyn_pin._core.errors import InvalidArgument, StepFailed, UnsupportedConstraint
from condyn_pin.constraints.drift import Correction, Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.simulation.defaults import default_solver
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.integrators.base import Integrator, Stepper
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.recorder import Recorder
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import Applied

# (t, q, v) -> (q, v, a), as the step of an integrator
Move = Callable[[float, Array, Array], tuple[Array, Array, Array]]


class Mover(NamedTuple):
    """A stepper of one size, and the correction behind it."""

    stepper: Stepper
    correct: Correction | None
    dt: float  # [s]


@dataclass(frozen=True)
class Method:
    """How a scene is moved: the choices of a run."""

    tau: Applied
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver | None
    effects: Effects


class Leg:
    """One scene with its solver, its stepper and its samples.

    Parameters
    ----------
    scene : Scene
        With every contact anchored.
    method : Method
    """

    def __init__(self, scene: Scene, method: Method) -> None:
        self.scene, self.method = scene, method
        _check_rows(scene, method.integrator)
        self.solver = default_solver(scene) if method.solver is None else method.solver
        workspace = Workspace(scene, self.solver, drift=method.drift.rows)
        _check_solver(self.solver, method)
        effects = method.effects
        self._tau = method.tau
        self.system = System(workspace, self._tau, springs=effects.springs, damping=effects.damping)
        self._at_start = method.integrator.a_at == "start"

    def use(self, scene: Scene) -> None:
        """Begin anew with a scene whose contacts may be anchored elsewhere, in the same memory."""
        if scene is not self.scene:
            self.scene = scene
            self.system.use(scene)

    def turn(self, every: int) -> int:
        """Return which of `every` steps is a sample, if every so many is to be one."""
        return 0 if self._at_start else every - 1

    def step(self, t: float, q: Array, v: Array, k: int, every: int) -> tuple[Array, Array]:
        """Take step k, which ends at (k + 1) dt, and keep its sample if it is its turn."""
        # the first sample of a phase always is
        keep = k % every == self.turn(every) or not self.recorder.count
        return self._take(self._mover, (k + 1) * self.method.dt, t, q, v, keep)

    def part(
        self, t: float, q: Array, v: Array, t1: float, *, keep: bool = False
    ) -> tuple[Array, Array]:
        """Take a step to t1; `keep` says whether its end is to be a sample."""
        keep = not self.recorder.count if self._at_start else keep
        return self._take(self._mover_of(t1 - t), t1, t, q, v, keep)

    def take_back(self, t: float) -> None:
        """Forget the sample of a step from t that does not count."""
        if not self._at_start:
            self.recorder.drop_after(t)

    def sample(self, t: float, q: Array, v: Array, system: System | None = None) -> None:
        """Keep a state, by the solve there; a step that begins with the same one finds it made."""
        solved = system or self.system
        self._tau.forget()
        a = solved.acceleration(t, q, v)
        self.recorder.add((t, q, v, a, solved.lam(), self._tau.first(t, q, v)))

    def begin(self, t: float, q: Array, v: Array) -> Recorder:
        """Begin to keep samples, with another stepper; return what they go to."""
        self.recorder = Recorder(self.scene)
        self.system.slopes.begin(t, q, v)
        self._mover = self._mover_of(self.method.dt)
        self.move = _composed(*self._mover)
        if not self._at_start:  # else the first step keeps it
            self.sample(t, q, v)
        return self.recorder

    def end(self, t: float, q: Array, v: Array) -> None:
        """Keep the last state, unless the last step did."""
        if self.recorder.last != t:
            self.sample(t, q, v)

    def _take(
        self, mover: Mover, t1: float, t: float, q: Array, v: Array, keep: bool
    ) -> tuple[Array, Array]:
        stepper, correct, dt = mover
        if keep and self._at_start:
            self.sample(t, q, v, stepper.system)
        q1, v1, a = stepper.step(t, q, v)
        # before the correction solves again
        lam = stepper.lam() if keep and stepper.lam else None
        if correct:
            q1, v1 = correct(t + dt, q1, v1)
        if lam is not None:
            self._tau.forget()
            self.recorder.add((t1, q1, v1, a, lam, self._tau.first(t1, q1, v1)))
        return q1, v1

    def _mover_of(self, dt: float) -> Mover:
        """Return a stepper of a size, and the correction behind it."""
        stepper = self.method.integrator.start(self.system, dt)
        if not (self.method.integrator.is_adaptive or self.system.manifold.is_flat):
            stepper = replace(stepper, step=_within_chart(stepper.step, self.system.manifold, dt))
        # a correction reads what the solve of the next step leaves behind
        correct = self.method.drift.start(stepper.system or self.system, dt)
        return Mover(stepper, correct, dt)


def _within_chart(step: Move, manifold: Manifold, dt: float) -> Move:
    """Return a step of one size that fails where a body turns by more than its chart has."""
    slow = (pi / dt) ** 2

    def check(v: Array) -> None:
        if not v.dot(v) > slow:  # all velocities together: most often that is enough
            return
        joint, speed = manifold.largest_turn(v)
        if speed * dt > pi:
            raise StepFailed(
                f"joint {joint!r} turns by {speed * dt:.3g} rad in a step of {dt:.3g} s, and the "
                f"coordinates of a step end at pi: take dt below {pi / speed:.2g} s, better a "
                "tenth of that, or DormandPrince(), which takes smaller steps where it must"
            )

    def checked(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        check(v)
        q1, v1, a = step(t, q, v)
        check(v1)
        return q1, v1, a

    return checked


def _composed(stepper: Stepper, correct: Correction | None, dt: float) -> Move:
    """Return the step with the correction behind it, for steps that are no samples."""
    step = stepper.step
    if correct is None:
        return step

    def corrected(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        q, v, a = step(t, q, v)
        return *correct(t + dt, q, v), a

    return corrected


def _check_solver(solver: Solver, method: Method) -> None:
    """Refuse constraints that are to give way and not to."""
    if solver.exact:
        return
    if method.integrator.keeps_constraints:
        raise InvalidArgument(
            f"solver = {solver!r}: {method.integrator.title} keeps hard constraints itself, and "
            "nothing of it would be soft; use RungeKutta4() or another solver"
        )
    if method.drift.corrects:
        raise InvalidArgument(
            f"drift = {method.drift!r}: it closes what {solver.title} lets open, and nothing of it "
            "would be soft; use NoDrift() or another solver"
        )


def _check_rows(scene: Scene, integrator: Integrator) -> None:
    """Refuse rows that an integrator cannot hold."""
    if not integrator.needs_positions:
        return
    for bound in scene.bounds:
        if len(bound.positioned) < bound.size:
            raise UnsupportedConstraint(
                f"{bound.name}: {integrator.title} holds positions, and it has rows that restrict "
                "velocities only; use RungeKutta4() or GearGuptaLeimkuhler()"
            )
