"""HybridPhase: a part of a motion with the same constraints."""

from __future__ import annotations

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.plan import Plan, default_solver
from condyn_pin.simulation.recorder import Recorder, Row
from condyn_pin.simulation.system import CorrectedStepper, System


class HybridPhase:
    """One scene, every contact anchored, with its solver, its stepper and its samples.

    `stepper` takes steps of the plan's dt; `turn` says which of so many steps, as one is kept of,
    is the sample.
    """

    def __init__(self, scene: Scene, plan: Plan) -> None:
        self.scene, self.plan = scene, plan
        _check_rows(scene, plan.integrator)
        held = scene.bilateral.at(0.0)  # the system takes it through time
        self.solver = default_solver(held) if plan.solver is None else plan.solver
        workspace = Workspace(held, self.solver, drift=plan.drift.rows)
        _check_solver(self.solver, plan)
        effects = plan.effects
        self.system = System(
            workspace, plan.tau, springs=effects.springs, damping=effects.damping,
            contacts=scene.contact_bounds,
        )  # fmt: skip
        self._samples_start = plan.integrator.a_at == "start"
        self.turn = 0 if self._samples_start else plan.every - 1

    def use(self, scene: Scene) -> None:
        """Begin anew with a scene whose contacts may be anchored elsewhere, in the same memory."""
        if scene is not self.scene:
            self.scene = scene
            self.system.use(scene)

    def begin(self, t: float, q: Array, v: Array) -> Recorder:
        """Begin to keep samples, with another stepper; return what they go to."""
        self.recorder = Recorder(self.scene)
        self.plan.tau.begin(t, q, v)
        self.stepper = self._stepper_of(self.plan.dt)
        self.system.look = self.stepper.sample
        if not self._samples_start:  # else the first step keeps it
            self._sample(t, q, v)
        return self.recorder

    def step(self, t: float, q: Array, v: Array, k: int) -> tuple[Array, Array]:
        """Take step k, which ends at (k + 1) dt, and keep its sample if it is its turn."""
        # the first sample of a phase always is
        keep = k % self.plan.every == self.turn or not self.recorder.count
        if self._samples_start and self.recorder.last == t:
            keep = False  # an event of contacts has kept it
        t1 = (k + 1) * self.plan.dt
        return self.stepper.take(t, q, v, t1, self.recorder.add if keep else None)

    def part(
        self, t: float, q: Array, v: Array, t1: float, *, keep: bool = False
    ) -> tuple[Array, Array]:
        """Take a step to t1; `keep` says whether its end is to be a sample."""
        keep = not self.recorder.count if self._samples_start else keep
        return self._stepper_of(t1 - t).take(t, q, v, t1, self.recorder.add if keep else None)

    def split(self, before: Row, after: Row) -> Recorder:
        """Go on with another recorder behind an event; return it."""
        if self.recorder.last != before[0]:
            self.recorder.add(before)
        self.recorder = Recorder(self.scene)
        self.recorder.add(after)
        return self.recorder

    def take_back(self, t: float) -> None:
        """Forget the sample of a step from t that does not count."""
        if not self._samples_start:
            self.recorder.drop_after(t)

    def end(self, t: float, q: Array, v: Array) -> None:
        """Keep the last state, unless the last step did."""
        if self.recorder.last != t:
            self._sample(t, q, v)

    def _sample(self, t: float, q: Array, v: Array) -> None:
        """Keep a state, by the solve there; a step that begins with the same one finds it made."""
        self.recorder.add(self.stepper.sample(t, q, v))

    def _stepper_of(self, dt: float) -> CorrectedStepper:
        return CorrectedStepper(self.system, self.plan.integrator, self.plan.drift, dt)


def _check_solver(solver: Solver, plan: Plan) -> None:
    """Refuse constraints that are to give way and not to."""
    if solver.exact:
        return
    if plan.integrator.keeps_constraints:
        raise InvalidArgument(
            f"solver = {solver!r}: {plan.integrator.title} keeps hard constraints itself, and "
            "would leave none of them soft; use RungeKutta4() or another solver"
        )
    if plan.drift.corrects:
        raise InvalidArgument(
            f"drift = {plan.drift!r}: it closes what {solver.title} lets open, and would "
            "leave nothing soft; use NoDrift() or another solver"
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
