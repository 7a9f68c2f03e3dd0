"""Laboratory: what integrators do to constraints, energy and area, on the smallest example.

A point mass at the end of a rod, in Cartesian coordinates,

    x'' = lam x,    z'' = -g + lam z,    c = sqrt(x^2 + z^2) - 1 = 0,

from the horizontal, at rest: everything about it is known, and energy is conserved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.stability_limit import growth
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.simulation.uninterrupted import uninterrupted

# Samples of a run whose largest errors are wanted.
_SAMPLES = 20_000


def rod_pendulum() -> Scene:
    """Return a point mass of 1 kg in the x-z plane, held at 1 m from the origin by a rod."""
    model = pin.Model()
    x = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    z = model.addJoint(x, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    point = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(z, point, pin.SE3.Identity())
    model.addFrame(pin.Frame("mass", z, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    robot = Robot("rod pendulum", model, postures={"horizontal": np.array([1.0, 0.0])})
    return Scene(robot, [Loop("world", "mass", "rod", length=1.0)])


@dataclass(frozen=True)
class DriftErrors:
    """What a run left of the constraints and of the energy, at worst.

    Attributes
    ----------
    violation, constraint_velocity : float
        abs(c) [m] and abs(J v) [m/s].
    energy : float
        abs(E - E(0)) [J].
    early, late : float
        The same in the first tenth of the run, and in the last.
    status : str
        Of the run, by its name. The numbers of one that diverged mean nothing.
    """

    violation: float  # [m]
    constraint_velocity: float  # [m/s]
    energy: float  # [J]
    early: float  # [J]
    late: float  # [J]
    status: str


def errors(
    integrator: Integrator,
    drift: Drift,
    *,
    dt: float,
    steps: int,
    progress: Callable[[float], object] | None = None,
) -> DriftErrors:
    """Return what a run of so many steps leaves."""
    every = max(steps // _SAMPLES, 1)
    run = _run(integrator, drift, dt=dt, steps=steps, record=every, progress=progress)
    energy = np.abs(run.energy.error)
    tenth = max(len(run) // 10, 1)
    return DriftErrors(
        float(run.violation.max()),
        float(run.constraint_velocity.max()),
        float(energy.max()),
        float(energy[:tenth].max()),
        float(energy[-tenth:].max()),
        run.status.name.lower(),
    )


@dataclass(frozen=True, eq=False)
class Growth:
    """How the gap of a run grows that nothing closes.

    Attributes
    ----------
    t, gap : (k,) array
        [s], [m]
    power : float
        Of t, between the middle and the end of the run.
    """

    t: Array
    violation: Array
    power: float


def gap_growth(integrator: Integrator, *, dt: float, steps: int) -> Growth:
    """Return how the gap grows: as t^2 for high orders, as t for Euler's methods.

    A method of high order leaves a slip that adds up, and with it a gap that grows with its time
    integral. One of first order leaks into the gap itself at every step.
    """
    run = _run(integrator, NoDrift(), dt=dt, steps=steps, record=max(steps // 400, 1))
    # the worst so far: the gap swings with the pendulum
    worst = np.maximum.accumulate(run.violation)
    half = len(run) // 2
    power = np.log(worst[-1] / worst[half]) / np.log(run.t[-1] / run.t[half])
    return Growth(run.t, worst, float(power))


def stability_map(integrator: Integrator, alphas: Sequence[float], betas: Sequence[float]) -> Array:
    """Return the factor by which a gap grows in a step, (len(betas), len(alphas)).

    Parameters
    ----------
    integrator : Integrator
        One whose constraints are held by accelerations.
    alphas, betas : sequence of float
        The products alpha dt and beta dt of Baumgarte's gains and the step.
    """
    return np.array([[growth(integrator, Baumgarte(a, b), 1.0) for a in alphas] for b in betas])


def area(integrator: Integrator, drift: Drift, *, dt: float) -> float:
    """Return the factor by which a step changes areas in the phase plane, less 1.

    det d(theta1, omega1) / d(theta0, omega0) = 1    for a symplectic step

    where the angle theta and its rate omega are read from the mass. It is the mean over some
    steps, by differences of order 4. A factor below 1 takes energy in the long run, one above 1
    brings it.
    """
    steps, size, weights = 10, 1e-3, ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0))
    start = np.array([1.0, 1.0])  # theta [rad], omega [rad/s]
    columns = []
    for axis in np.eye(2):
        ends = [
            weight * _end(integrator, drift, dt, steps, start + k * size * axis)
            for k, weight in weights
        ]
        columns.append(sum(ends) / (12 * size))
    determinant = float(np.linalg.det(np.array(columns)))
    return float(np.sign(determinant) * abs(determinant) ** (1 / steps) - 1)


def _end(integrator: Integrator, drift: Drift, dt: float, steps: int, start: Array) -> Array:
    """Return angle and rate after some steps, from angle and rate."""
    theta, omega = start
    out = np.array([np.sin(theta), -np.cos(theta)])
    along = np.array([np.cos(theta), np.sin(theta)])
    motion = simulate(
        rod_pendulum(), out, omega * along, duration=steps * dt, dt=dt, integrator=integrator,
        drift=drift, record=steps,
    )  # fmt: skip
    run = uninterrupted(motion)
    (x, z), (vx, vz) = run.q[-1], run.v[-1]
    return np.array([np.arctan2(x, -z), (x * vz - z * vx) / (x * x + z * z)])


def _run(
    integrator: Integrator,
    drift: Drift,
    *,
    dt: float,
    steps: int,
    record: int,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    scene = rod_pendulum()
    motion = simulate(
        scene, *scene.state("horizontal"), duration=steps * dt, dt=dt, integrator=integrator,
        drift=drift, record=record, progress=progress,
    )  # fmt: skip
    return uninterrupted(motion)
