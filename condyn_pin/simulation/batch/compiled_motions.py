"""Motions by the compiled core: which it takes, and what becomes of its samples.

It steps, and measures samples; energies are balanced here, for all motions at once. A motion that
it gives up, for whatever reason, is made again by Python, which says why.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.work import Arrays, Messages
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.workspace import LARGEST, Workspace
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import with_anchors
from condyn_pin.simulation.batch.compiled_steps import states_of, untaken_steps
from condyn_pin.simulation.batch.driven_path import driven_path_of
from condyn_pin.simulation.breakdown import LOST
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.drift.post_stabilization import PostStabilization
from condyn_pin.simulation.gaps import uses_the_solver
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.integrators.explicit import RungeKutta4, SemiImplicitEuler
from condyn_pin.simulation.integrators.midpoint import ImplicitMidpoint, LinearlyImplicitMidpoint
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.measures import Energy, damping_rate, doubt, is_accurate, work
from condyn_pin.simulation.motion_limits import MotionLimits
from condyn_pin.simulation.motion_status import Course, judged
from condyn_pin.simulation.outcome import RunStatus
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.plan import Plan
from condyn_pin.simulation.recorder import Phase

# Integrators by their number there.
_INTEGRATORS: Final[dict[Integrator, int]] = {
    SemiImplicitEuler(): 0,
    SemiImplicitEuler(implicit=False): 1,
    LinearlyImplicitMidpoint(): 2,
    ImplicitMidpoint(): 3,
    RungeKutta4(): 4,
}

# Numbers of a sample: violation, slip, kinetic and potential energy, that of springs, and what
# damping takes [m, m/s, J, J, J, W].
MEASURED: Final = 6


def untaken(plan: Plan, forces: bool) -> Iterator[str]:
    """Yield what the core does not take of a plan, in words."""
    if plan.tau.constant is None or forces:
        what = "TAU is a function" if plan.tau.constant is None else "there are forces from outside"
        yield f"{what}: its motions have constant torques alone"
    if plan.scene.contacts:
        yield from untaken_steps(plan.scene, plan.integrator)
        if not isinstance(plan.drift, NoDrift):
            yield f"drift = {plan.drift!r}: with contacts it has NoDrift alone"
        return
    if plan.integrator not in _INTEGRATORS:
        known = ", ".join(dict.fromkeys(type(each).__name__ for each in _INTEGRATORS))
        yield f"integrator = {plan.integrator!r}: it has {known}"
    if not isinstance(plan.drift, NoDrift | Baumgarte | PostStabilization):
        yield f"drift = {plan.drift!r}: it has NoDrift, Baumgarte and PostStabilization"


def untaken_rows(workspace: Workspace, drift: Drift) -> Iterator[str]:
    """Yield what it does not take of the constraints, beside what no solve by it takes."""
    found, solver = workspace.pinocchio_constraints, workspace.solver
    if not isinstance(solver, Proximal):
        if isinstance(drift, PostStabilization) and drift.metric != "mass":
            yield f"drift = {drift!r}: it corrects in the metric of M"
        return
    for name in found.approximated:
        yield f"constraint {name!r} stands for two points, which steps leave a little open"
    if isinstance(drift, PostStabilization) and not (
        drift.metric == "mass" and uses_the_solver(workspace, solver)
    ):
        yield f"drift = {drift!r}: it corrects by the factor of a solve, in the metric of M"


@dataclass(frozen=True)
class MovedRows:
    """What the core does to some states of a `simulate_batch`."""

    integrator: Integrator
    drift: Drift
    dt: float  # [s]
    steps: int
    every: int
    limits: MotionLimits

    def __call__(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Fill the outputs; return the rows that are left to Python, and why others are not ok."""
        model, count = workspace.model, len(inputs["q0"])
        kept, nv = len(range(0, self.steps, self.every)) + 1, workspace.model.nv
        drives = driven_path_of(workspace, self.dt, self.steps)
        # what a drive does is the work of its forces; that of dampers has accelerations in it
        damped = is_accurate(self.integrator) and workspace.model.damping.any()
        answers = kept if "samples_a" in outputs or drives.rows.size or damped else 0
        q0, v0, tau = states_of(workspace, inputs)
        found = {
            "t": np.zeros((count, kept)),
            "q": np.zeros((count, kept, model.nq)),
            "v": np.zeros((count, kept, nv)),
            "a": np.zeros((count, answers, nv)),
            "lam": np.zeros((count, answers, workspace.scene.rows)),
            "measures": np.zeros((count, kept, MEASURED)),
        }
        done = np.zeros(count, np.int32)
        corrects = self.drift.every if isinstance(self.drift, PostStabilization) else 0
        rank = chains_of(workspace.scene).rank if corrects and workspace.scene.rows else 0
        closed, reach = tolerances.NEARLY_CLOSED / 10, Manifold(model).reach
        limits = closed, LARGEST, LOST, reach, rank, tolerances.OUT_OF_REACH
        workspace.compiled.core.simulate(
            q0, v0, tau, integrator=_INTEGRATORS[self.integrator], dt=self.dt,
            steps=self.steps, every=self.every, correct_every=corrects, with_answers=answers > 0,
            limits=np.array(limits, float), driven=drives.rows, path=drives.wanted,
            **found, done=done, times=outputs["run_times"], threads=threads,
        )  # fmt: skip
        if drives.rows.size:
            found["driven"] = drives.power(found["lam"], self.every)
        made = Made(workspace.scene, self.integrator, workspace.solver, self.dt, self.limits)
        words = put_motions(outputs, np.flatnonzero(done), found, tau, made)
        return np.flatnonzero(done == 0), words


@dataclass(frozen=True)
class Made:
    """How motions were made that the core has taken: what they are judged by."""

    scene: Scene
    integrator: Integrator
    solver: Solver
    dt: float  # [s]
    limits: MotionLimits


def put_motions(
    outputs: Arrays, ok: NDArray[np.intp], found: dict[str, Any], tau: Array, made: Made
) -> Messages:
    """Put the motions that went to their end into their rows; return why some are not ok.

    `found` has their samples: t, q, v, a, lam and measures, the power of what is driven, and of
    contacts and drives their work and columns.
    """
    if not ok.size:
        return {}
    found = {name: its[ok] for name, its in found.items()}
    t, q, v, measures = (found[name] for name in ("t", "q", "v", "measures"))
    outputs["t"][ok], outputs["q"][ok], outputs["v"][ok] = t[:, -1], q[:, -1], v[:, -1]
    violation, slip, *_ = np.moveaxis(measures, 2, 0)
    outputs["violation"][ok] = violation.max(axis=1)
    outputs["constraint_velocity"][ok] = slip.max(axis=1)
    energy = _energies(found, tau[ok], made)
    outputs["energy_error"][ok] = np.abs(energy.error).max(axis=0)
    if "samples_t" in outputs:
        for name in ("t", "q", "v", "a", "lam", "contact"):
            if name in found:
                outputs[f"samples_{name}"][ok] = found[name]
        outputs["samples_tau"][ok] = tau[ok, None]
    words = {}
    for k, row in enumerate(ok.tolist()):
        scene = with_anchors(made.scene, q[k, 0], {})
        course = Course(
            (Phase(scene, slice(0, len(t[k])), ()),), t[k], q[k], v[k], violation[k], slip[k],
            energy.of(k), made.dt, made.integrator, made.solver, made.limits,
        )  # fmt: skip
        status, said = judged(course)
        outputs["statuses"][row] = tuple(RunStatus).index(status)
        if said:
            words[row] = said
    return words


def _energies(found: dict[str, Any], tau: Array, made: Made) -> Energy:
    """Return the energies of motions, each (k, N), work integrated over the samples."""
    t, q, v = found["t"][0], found["q"], found["v"]
    _, _, kinetic, potential, springs, damping = np.moveaxis(found["measures"], 2, 0)
    passive, mean = Passive.of(made.scene.robot), 0.5 * (v[:, 1:] + v[:, :-1])
    flat = (-1, *q.shape[2:]), (-1, *v.shape[2:])
    taken = passive.dissipation(q[:, :-1].reshape(flat[0]), mean.reshape(flat[1]))
    between = np.einsum("ni,nki->kn", tau, mean), -taken.reshape(mean.shape[:2]).T
    power = np.einsum("ni,nki->kn", tau, v), -damping.T
    rate = None
    if is_accurate(made.integrator) and found["a"].shape[1] == v.shape[1]:
        rate = damping_rate(passive, v, found["a"])
    done = work(t, power[0]), work(t, power[1], None if rate is None else rate.T)
    along = v.transpose(1, 0, 2)
    off = sum(doubt(t, *each, along) for each in zip(power, done, between, strict=True))
    none = np.zeros_like(power[0])
    contact, correction, algorithmic, driven = none, none, none, none
    if "work" in found:
        contact, correction, algorithmic, driven = found["work"].T[:4]
    elif "driven" in found:
        drives = found["driven"].T
        driven = work(t, drives)
        off = off + doubt(t, drives, driven, 0.5 * (drives[1:] + drives[:-1]))
    return Energy(
        kinetic.T, potential.T, springs.T, *done, none, driven, contact, correction, algorithmic,
        np.asarray(off),
    )  # fmt: skip
