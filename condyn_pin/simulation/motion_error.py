"""Error of a motion by fixed steps, estimated by doubled ones.

    e(window) = |x_dt - x_2dt| / (2^p - 1),    x = points of the bodies, p the order for q
    e = T / window * mean of e(window)

From samples spread over the motion a few steps are taken again, with dt and with 2 dt: at most a
twentieth of the steps of the motion. Points are the centre of mass of each body, and those at its
radii of gyration along its principal axes.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.simulation.recorder import Phase
from condyn_pin.simulation.system import CorrectedStepper, System
from condyn_pin.simulation.torques import Applied

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# Share of the steps of a motion that are taken again, steps of 2 dt in a window, and windows.
_SHARE: Final = 0.05
_DOUBLED, _WINDOWS = 4, 8

# Samples at which bodies are looked for, to know how far they have moved.
_LOOKS: Final = 50


class MotionError(NamedTuple):
    """An estimated error beside the motion it is an error of."""

    off: float  # how far points of bodies may be off at the end [m]; NaN if nothing is known
    moved: float  # how far points of bodies were from where they began, at most [m]
    size: float  # how far points of bodies are from each other where they began [m]
    turned: float  # what the fastest joint turns by in a step [rad]


class Points:
    """Points of the bodies of a model: centres of mass, and radii of gyration from them."""

    def __init__(self, model: Any) -> None:
        self._model, self._data = model, model.createData()
        self._of_bodies = [
            (i, _points(inertia))
            for i, inertia in enumerate(list(model.inertias))
            if i > 0 and inertia.mass > 0
        ]

    def at(self, q: Array) -> Array:
        """Return the points (k, 3) in the world at q [m]."""
        pin.forwardKinematics(self._model, self._data, q)
        placements = self._data.oMi
        found = [
            points @ placements[i].rotation.T + placements[i].translation
            for i, points in self._of_bodies
        ]
        return np.concatenate(found) if found else np.zeros((0, 3))

    def apart(self, q: Array, other: Array) -> float:
        """Return how far a point is between two configurations, at most [m]."""
        return float(np.linalg.norm(self.at(q) - self.at(other), axis=1).max(initial=0.0))


def _points(inertia: Any) -> Array:
    """Return four points (4, 3) of a body, in its axes [m]."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    radii = np.sqrt(np.maximum(moments.sum() / 2 - moments, 0.0) / inertia.mass)
    return np.vstack((inertia.lever, inertia.lever + (axes * radii).T))


@one_blas_thread
def estimated_error(trajectory: Trajectory) -> MotionError:
    """Return the estimated error of a motion, and how far it moved."""
    run, points = trajectory.run, Points(trajectory.scene.robot.model)
    t, q = trajectory.t, trajectory.q
    looks = np.unique(np.linspace(0, len(t) - 1, _LOOKS).astype(int))
    moved = max(points.apart(q[0], q[i]) for i in looks)
    size = float(np.ptp(points.at(q[0]), axis=0).max()) if moved else 0.0
    turned = run.dt * float(np.abs(trajectory.v).max(initial=0.0))
    steps = round(float(t[-1]) / run.dt)
    if run.integrator.between_events.is_adaptive or steps < 2 or not moved:
        return MotionError(nan, moved, size, turned)
    budget = _SHARE * steps
    doubled = int(np.clip(budget // 9, 1, _DOUBLED))
    windows = int(np.clip(budget // (3 * doubled), 1, _WINDOWS))
    window = 2 * doubled * run.dt
    again, shares = _Again(trajectory, points, doubled), (np.arange(windows) + 0.5) / windows
    errors = [again.error_from(share * (float(t[-1]) - window)) for share in shares]
    known = [error for error in errors if isfinite(error)]
    if not known:
        return MotionError(nan, moved, size, turned)
    # an impact in one window is not in all of them
    typical = np.median(known) if trajectory.contact else np.mean(known)
    return MotionError(float(typical) * float(t[-1]) / window, moved, size, turned)


class _Again:
    """Some steps of a motion taken again, from where they began."""

    def __init__(self, trajectory: Trajectory, points: Points, doubled: int) -> None:
        self._motion, self._points, self._doubled = trajectory, points, doubled
        self._systems: dict[int, System] = {}
        self._torque = _Line(trajectory.scene.robot.nv)

    def error_from(self, t: float) -> float:
        """Return the error at the end of a window that begins at the sample before t [m]."""
        motion, dt = self._motion, self._motion.run.dt
        i = max(int(np.searchsorted(motion.t, t, side="right")) - 1, 0)
        phase = next(p for p in motion.phases if p.samples.start <= i < p.samples.stop)
        t0, window = float(motion.t[i]), 2 * self._doubled * dt
        end = min(int(np.searchsorted(motion.t, t0 + window)), phase.samples.stop - 1)
        self._torque.through(t0, motion.tau[i], float(motion.t[end]), motion.tau[end])
        try:
            fine = self._end(phase, i, t0, dt, 2 * self._doubled)
            coarse = self._end(phase, i, t0, 2 * dt, self._doubled)
        except CondynError:
            return nan  # steps of 2 dt do not follow the motion
        order = motion.run.integrator.order.q
        return float(self._points.apart(fine, coarse) / (2.0**order - 1.0))

    def _end(self, phase: Phase, i: int, t: float, dt: float, steps: int) -> Array:
        run, system = self._motion.run, self._system(phase)
        q, v = self._motion.q[i].copy(), self._motion.v[i].copy()
        system.applied.begin(t, q, v)
        stepper = CorrectedStepper(system, run.integrator, run.drift, dt)
        with np.errstate(all="ignore"):
            for k in range(steps):
                q, v = stepper.take(t + k * dt, q, v, t + (k + 1) * dt)
        return np.asarray(q)

    def _system(self, phase: Phase) -> System:
        """Return the system of a phase, with torques on a line between two samples."""
        key = phase.samples.start
        if key not in self._systems:
            run, scene = self._motion.run, phase.scene
            workspace = Workspace(scene.bilateral.at(0.0), run.solver, drift=run.drift.rows)
            torque = Applied(scene.robot, self._torque, self._torque.slopes)
            self._systems[key] = System(
                workspace, torque, springs=run.effects.springs, damping=run.effects.damping,
                contacts=scene.contact_bounds,
            )  # fmt: skip
        return self._systems[key]


class _Line:
    """Torques that go from those of one sample to those of another along a line."""

    def __init__(self, nv: int) -> None:
        self._none = np.zeros((nv, nv))
        self.through(0.0, np.zeros(nv), 0.0, np.zeros(nv))

    def through(self, t0: float, tau0: Array, t1: float, tau1: Array) -> None:
        """Lead from tau0 at t0 to tau1 at t1 [s]."""
        self._t, self._tau = t0, tau0
        self._rate: Array = (tau1 - tau0) / (t1 - t0) if t1 > t0 else 0.0 * tau0

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques (nv,) at t [s]."""
        return np.asarray(self._tau + (t - self._t) * self._rate)

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return how they change with q and v: not at all."""
        return self._none, self._none
