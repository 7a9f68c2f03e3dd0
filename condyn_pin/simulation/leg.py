"""Leg: one scene on its way, as long as its constraints are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from condyn_pin.arrays import Array
from condyn_pin.drift.base import Drift
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.scene import Scene
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.recorder import Recorder
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import Applied
from condyn_pin.solvers.base import Solver
from condyn_pin.workspace import Workspace

# (t, q, v) -> (q, v, a), as the step of an integrator
Move = Callable[[float, Array, Array], tuple[Array, Array, Array]]


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
        workspace = Workspace(scene, method.solver, drift=method.drift.rows)
        _check_solver(workspace.solver, method)
        self.solver, effects = workspace.solver, method.effects
        self._tau = method.tau
        self.system = System(workspace, self._tau, springs=effects.springs, damping=effects.damping)
        self._at_start = method.integrator.a_at == "start"

    def step(self, t: float, q: Array, v: Array, k: int, every: int) -> tuple[Array, Array]:
        """Take step k, which ends at (k + 1) dt, and keep its sample if it is its turn."""
        # the first sample of a phase always is
        turn = k % every == 0 or not self.recorder.count
        keep = turn if self._at_start else (k + 1) % every == 0
        t1 = (k + 1) * self.method.dt
        return self._take(self._move, self._lam, t1, t, q, v, keep)

    def part(
        self, t: float, q: Array, v: Array, t1: float, *, keep: bool = False
    ) -> tuple[Array, Array]:
        """Take a step to t1; `keep` says whether its end is to be a sample."""
        move, lam = self._mover(t1 - t)
        keep = not self.recorder.count if self._at_start else keep
        return self._take(move, lam, t1, t, q, v, keep)

    def take_back(self, t: float) -> None:
        """Forget the sample of a step from t that does not count."""
        if not self._at_start:
            self.recorder.drop_after(t)

    def sample(self, t: float, q: Array, v: Array) -> None:
        """Keep a state at which no step begins, or none has ended."""
        self._tau.forget()
        a = self.system.acceleration(t, q, v)
        self.recorder.add((t, q, v, a, self.system.lam(), self._tau.first(t, q, v)))

    def begin(self, t: float, q: Array, v: Array) -> Recorder:
        """Begin to keep samples, with another stepper; return what they go to."""
        self.recorder = Recorder(self.scene)
        self._move, self._lam = self._mover(self.method.dt)
        if not self._at_start:  # else the first step keeps it
            self.sample(t, q, v)
        return self.recorder

    def end(self, t: float, q: Array, v: Array) -> None:
        """Keep the last state, unless the last step did."""
        if self.recorder.last != t:
            self.sample(t, q, v)

    def _take(
        self, move: Move, lam: Callable[[], Array], t1: float, t: float, q: Array, v: Array,
        keep: bool,
    ) -> tuple[Array, Array]:  # fmt: skip
        tau = self._tau
        tau.forget()
        q1, v1, a = move(t, q, v)
        if keep:
            if not self._at_start:
                t, q, v = t1, q1, v1
                tau.forget()
            self.recorder.add((t, q, v, a, lam(), tau.first(t, q, v)))
        return q1, v1

    def _mover(self, dt: float) -> tuple[Move, Callable[[], Array]]:
        """Return the stepper of a size with the corrections behind it."""
        stepper = self.method.integrator.start(self.system, dt)
        # a correction reads what the solve of the next step leaves behind
        correct = self.method.drift.start(stepper.system or self.system, dt)
        if correct is None:
            return stepper.step, stepper.lam
        step, forces = stepper.step, [stepper.lam]

        def corrected(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            q1, v1, a = step(t, q, v)
            lam = stepper.lam()  # before the correction solves again
            forces[0] = lambda: lam
            return *correct(t + dt, q1, v1), a

        return corrected, lambda: forces[0]()


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
