"""Motions with contacts by the compiled core, and the steps of them that it leaves to Python."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.work import Arrays, Messages
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.simulation.batch.compiled_motions import MEASURED, Made, put_motions
from condyn_pin.simulation.batch.compiled_steps import contacts_of, states_of, step_plan
from condyn_pin.simulation.batch.driven_path import driven_path_of
from condyn_pin.simulation.breakdown import LOST, is_lost
from condyn_pin.simulation.contact_record import touch_of
from condyn_pin.simulation.contact_work import ContactWork
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.contact_steps import ContactSteps
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.motion_limits import MotionLimits
from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class SteppedMotions:
    """What the core does to some states of a `simulate_batch` with contacts.

    A motion goes on in the core behind a step that Python has taken.
    """

    contacts: tuple[Contact, ...]
    integrator: Integrator
    dt: float  # [s]
    steps: int
    every: int
    limits: MotionLimits

    def __call__(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Fill the outputs; return the rows that are left to Python, and why others are not ok."""
        q, v, tau = states_of(workspace, inputs)
        ways = _Ways(self, workspace, outputs, q, v.copy())
        core = contacts_of(workspace, self.contacts)
        outputs["run_times"][:] = 0.0
        ahead = self.steps % self.every > 0  # the last sample is that of a step not taken
        paths = driven_path_of(workspace, self.dt, self.steps + ahead)
        python = None
        while True:
            core.simulate(
                step=ways.step, Q=ways.q, V=ways.v, works=ways.works, TAU=tau,
                plan=step_plan(self.integrator, self.dt), steps=self.steps, every=self.every,
                closed=tolerances.NEARLY_CLOSED / 10, lost=LOST, **ways.found, done=ways.done,
                times=outputs["run_times"], driven=paths.rows, path=paths.wanted, threads=threads,
            )  # fmt: skip
            stopped = np.flatnonzero((ways.done == 0) & (ways.step >= 0))
            if not stopped.size:
                break
            python = python or _Steps(self, workspace)
            for i in stopped:
                python.take(ways, int(i), tau[i])
        scene = replace(workspace.scene, contacts=self.contacts)
        made = Made(scene, self.integrator, workspace.solver, self.dt, self.limits)
        words = put_motions(outputs, np.flatnonzero(ways.done), ways.found, tau, made)
        return np.flatnonzero(ways.done == 0), words


class _Ways:
    """Motions on their way, as the core has them."""

    def __init__(
        self, of: SteppedMotions, workspace: Workspace, outputs: Arrays, q: Array, v: Array
    ) -> None:
        count, model, kept = len(q), workspace.model, len(range(0, of.steps, of.every)) + 1
        self.q, self.v, self.works = q, v, np.zeros((count, 4))
        self.step, self.done = np.zeros((2, count), np.int32)
        widths = {"q": model.nq, "v": model.nv, "measures": MEASURED, "work": 4}
        self.found = {name: np.zeros((count, kept, size)) for name, size in widths.items()}
        self.found["t"] = np.zeros((count, kept))
        for name in ("a", "lam", "contact"):  # where samples are asked for
            shape = outputs.get(f"samples_{name}", np.zeros((0, 0, 0))).shape[1:]
            self.found[name] = np.zeros((count, *shape))


class _Steps:
    """Steps of motions by Python."""

    def __init__(self, of: SteppedMotions, workspace: Workspace) -> None:
        assert isinstance(of.integrator, ContactScheme)
        self._of, self._gauge = of, gauge_of(workspace.scene)
        scene = replace(workspace.scene, contacts=of.contacts)
        self._system = System(workspace, contacts=scene.contact_bounds)
        self._steps = ContactSteps(of.integrator, self._system, of.dt)
        self._slow = self._system.manifold.slow(of.dt)
        self._is_driven = scene.is_driven
        self._is_anchored = all(bound.anchored for bound in scene.bounds)

    @one_blas_thread
    def take(self, ways: _Ways, i: int, tau: Array) -> None:
        """Take the next step of motion i; it is not to go on where there is none."""
        of, k = self._of, int(ways.step[i])
        q, v, work = ways.q[i].copy(), ways.v[i].copy(), ContactWork(*ways.works[i].tolist())
        ways.step[i] = -1
        if not self._is_anchored:  # but where its motion has begun, which nobody knows here
            return
        self._system.applied.hold(tau, ())
        self._system.contact_work = work
        try:
            with np.errstate(all="ignore"):
                q1, v1, a = self._steps.step(k * of.dt, q, v)
                if self._is_driven and k < of.steps:
                    self._system.check_reach((k + 1) * of.dt, q1, v1)
        except CondynError:
            return
        if is_lost(v1) or (self._slow and v1.dot(v1) > self._slow):
            return
        if k == 0:
            self._keep(ways, i, 0, (0.0, q, v, a), work)
        if k == of.steps:  # the step of the last sample is not taken
            self._keep(ways, i, k // of.every + 1, (k * of.dt, q, v, a), work)
            ways.done[i] = 1
            return
        work, end = self._system.contact_work, k + 1
        ways.q[i], ways.v[i], ways.works[i], ways.step[i] = q1, v1, work, end
        if end % of.every == 0:
            self._keep(ways, i, end // of.every, (end * of.dt, q1, v1, a), work)
            ways.done[i] = end == of.steps

    def _keep(
        self, ways: _Ways, i: int, row: int, state: tuple[float, Array, Array, Array],
        work: ContactWork,
    ) -> None:  # fmt: skip
        t, q, v, a = state
        found = ways.found
        found["t"][i, row], found["q"][i, row], found["v"][i, row] = t, q, v
        found["work"][i, row] = work
        measured = self._gauge.measure(np.array([t]), q[None], v[None])
        passive = self._system.passive
        acting = passive.energy(q), passive.dissipation(q[None], v[None])[0]
        found["measures"][i, row] = [*(float(each[0]) for each in measured), *acting]
        if found["a"].shape[1]:
            found["a"][i, row], found["lam"][i, row] = a, self._steps.lam()
            found["contact"][i, row] = touch_of(
                self._steps.last.natural, work, self._steps.modes(), is_driven=self._is_driven
            )
