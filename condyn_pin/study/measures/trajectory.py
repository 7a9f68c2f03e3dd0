"""Motions: the final state of a simulation, against that of a converged one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import lru_cache
from math import isfinite
from typing import Any, ClassVar, Final, TypeVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Grid, read_call
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.contact.restitution import RESTITUTION_LAWS
from condyn_pin.contact.solvers import CONTACT_SOLVERS
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace, default_solver
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.drift import DRIFTS, Drift
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.integrators import INTEGRATORS, Integrator
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.outcome import uninterrupted
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.stepping.schemes.moreau import Moreau
from condyn_pin.study.measures.measure import Answer, Measure, relative
from condyn_pin.study.tables import Parameter

# As far as doubles go: a thousandth of what any integrator with a fixed step reaches.
_CONVERGED = DormandPrince(relative_tolerance=1e-13, absolute_tolerance=1e-14)
_PARTS = 10

# As near as a scheme of first order comes in a second or two.
_FINE, _FINE_PARTS = Moreau(), 5000

# What parameters of a measure may be.
SCHEMES: Final[Mapping[str, type]] = {
    **INTEGRATORS, **DRIFTS, **CONTACT_SOLVERS, **RESTITUTION_LAWS,
}  # fmt: skip


def schemes_made(how: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return parameters with the schemes that their texts name, such as ``"Moreau()"``."""
    return {
        name: read_call(parameter).made(SCHEMES) if isinstance(parameter, str) else parameter
        for name, parameter in how.items()
    }


_T = TypeVar("_T")


def _default_entries(registry: Mapping[str, type[_T]]) -> tuple[_T, ...]:
    """Entries of a registry with default parameters; those with a required one are left out."""
    kinds = registry.values()
    return tuple(kind() for kind in kinds if not any(f.default is MISSING for f in fields(kind)))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class MotionBench:
    """A scene, and the workspace of its bilateral constraints."""

    scene: Scene
    held: Workspace


@dataclass(frozen=True)
class TrajectoryMeasure(Measure):
    """The error of q and v at the end of a motion, under the torques of the state, held constant.

    Of q relative to the larger of the distance moved and that of a free fall, of v relative to the
    larger of |v|_inf and the speed of a free fall; the larger of the two. The truth is the same
    motion by an adaptive method of order 8 with tolerances of rounding, and without drift control.
    With contacts that may open it is that of `Moreau` in 5000 steps: an error below some 1e-3 is
    not known, for every scheme that lets contacts close is of first order.

    In a row of this measure `constraint_error` is the largest gap of a constraint, or penetration,
    on the way [m, rad], `dynamics_error` the largest error of the energy balance [J], and
    `iterations` the steps.

    Parameters
    ----------
    duration : float
        [s]. The only parameter that changes the question.
    dt : float
        Step [s].
    integrator, drift : Integrator, Drift, optional
        As in `simulate`.

    Raises
    ------
    InvalidArgument
        If dt or the duration is not positive.
    """

    name: ClassVar[str] = "trajectory"
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {
            "dt": (1e-2, 3e-3, 1e-3, 3e-4),
            "integrator": _default_entries(INTEGRATORS),
            "drift": (None, *_default_entries(DRIFTS)),
        },
    )

    duration: float = 0.1  # [s]
    dt: float = 1e-3  # [s]
    integrator: Integrator | None = None
    drift: Drift | None = None

    def __post_init__(self) -> None:
        for parameter in ("duration", "dt"):
            value = getattr(self, parameter)
            if not isinstance(value, (int, float)) or not 0 < value < np.inf:
                raise InvalidArgument(f"{parameter} = {value!r}: a number > 0 [s] is needed")

    @property
    def label(self) -> str:
        """The name, with the duration if it differs from its default."""
        usual = self.duration == type(self).duration
        return self.name if usual else f"{self.name}(duration={self.duration!r})"

    @property
    def how(self) -> Mapping[str, Parameter]:
        """Step, integrator and drift scheme; None where `simulate` chooses."""
        chosen = {"integrator": self.integrator, "drift": self.drift}
        return {"dt": self.dt} | {k: v if v is None else repr(v) for k, v in chosen.items()}

    def with_how(self, how: Mapping[str, Parameter]) -> Measure:
        """Return the measure with a step, an integrator and a drift scheme, as `how` has them."""
        return replace(self, **schemes_made(how))

    def open(self, scene: Scene, method: Solver) -> MotionBench:
        """Return a scene, and the workspace of a solver on its bilateral constraints."""
        return MotionBench(scene, Workspace(scene.bilateral, method))

    def truth(self, scene: Scene, state: State) -> Array:
        """Return q and v at the end (nq + nv,)."""
        return _converged_end(scene, self.duration, *(x.tobytes() for x in state))

    def answer(self, workspace: MotionBench, state: State, truth: Array, accuracy: float) -> Answer:
        """Return the answer of a motion with a workspace's solver."""
        motion, model = self._motion(workspace, state), workspace.held.model
        q, v = truth[: model.nq], truth[model.nq :]
        off = np.array(pin.difference(model, q, motion.q[-1]))
        way = np.array(pin.difference(model, state[0], q))
        gravity = workspace.held.scene.nominal.estimator.gravity
        gaps = motion.gaps.values()
        penetration = max((_largest(np.minimum(gap, 0.0)) for gap in gaps), default=0.0)
        return Answer(
            error=max(
                relative(way + off, way, gravity * self.duration**2 / 2),
                relative(motion.v[-1], v, gravity * self.duration),
            ),
            status="ok" if motion.run.status.ok else motion.run.status.word,
            dynamics_error=_largest(motion.energy.error),
            constraint_error=max(_largest(motion.violation), penetration),
            iterations=len(motion.t) - 1,
        )

    def calls(self, workspace: MotionBench) -> Mapping[str, Call]:
        """Return the whole simulation, its workspace included."""

        def once(q: Array, v: Array, tau: Array) -> Trajectory:
            return self._motion(workspace, (q, v, tau))

        return {"once": once}

    def _motion(self, workspace: MotionBench, state: State) -> Trajectory:
        motion = simulate(
            workspace.scene,
            *state,
            duration=self.duration,
            dt=self.dt,
            integrator=self.integrator,
            drift=self.drift,
            solver=workspace.held.solver,
        )
        return uninterrupted(motion)


@lru_cache(maxsize=1000)
def _converged_end(scene: Scene, duration: float, q: bytes, v: bytes, tau: bytes) -> Array:
    """Final q and v of the converged motion (nq + nv,), cached for all steps and schemes."""
    integrator, parts = (_FINE, _FINE_PARTS) if scene.contacts else (_CONVERGED, _PARTS)
    motion = simulate(
        scene,
        *map(np.frombuffer, (q, v, tau)),
        duration=duration,
        dt=duration / parts,
        integrator=integrator,
        drift=None if scene.contacts else NoDrift(),
        solver=default_solver(scene.bilateral),
        record=parts,
    )
    if not uninterrupted(motion).run.status.ok:
        raise InvalidArgument(f"duration = {duration!r}: no converged motion: {motion.run.reason}")
    return np.concatenate([motion.q[-1], motion.v[-1]])


def _largest(x: Array) -> float:
    worst = float(np.abs(x).max(initial=0.0))
    return worst if isfinite(worst) else np.inf
