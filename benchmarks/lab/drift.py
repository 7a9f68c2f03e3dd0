"""Laboratory: what integrators do to constraints, energy and area, on the smallest example.

A point mass at the end of a rod, in Cartesian coordinates,

    x'' = lam x,    z'' = -g + lam z,    c = sqrt(x^2 + z^2) - 1 = 0,

from the horizontal, at rest: everything about it is known, and energy is conserved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import renamed
from condyn_pin._core.arrays import Array
from condyn_pin._core.show import COLOURS, axes, labelled_axes
from condyn_pin.constraints.drift import Baumgarte, Drift
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import Interrupted
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.drift import NoDrift, Projection
from condyn_pin.simulation.integrators.explicit import RungeKutta4, SemiImplicitEuler
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.integrators.rattle import Rattle
from condyn_pin.simulation.motion_status import uninterrupted
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.stability import growth, stability_limit
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.study.plots import save_panels

# Samples of a run whose largest errors are wanted.
_SAMPLES = 20_000


def rod_pendulum() -> Scene:
    """Return a point mass of 1 kg in the x-z plane, held at 1 m from the origin by a rod."""
    model = pin.Model()
    add_point(model, "mass", {"x": pin.JointModelPX(), "z": pin.JointModelPZ()}, 1.0)
    robot = Robot("rod pendulum", model, postures={"horizontal": np.array([1.0, 0.0])})
    return Scene(robot, [Loop("world", "mass", "rod", length=1.0)])


def add_point(model: Any, name: str, joints: Mapping[str, Any], mass: float) -> None:
    """Add a point mass [kg] on joints of the world, one on the other, and a frame at it."""
    here, parent = pin.SE3.Identity(), 0
    for joint, kind in joints.items():
        parent = model.addJoint(parent, kind, here, joint)
    model.appendBodyToJoint(parent, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), here)
    model.addFrame(pin.Frame(name, parent, 0, here, pin.FrameType.OP_FRAME))


@dataclass(frozen=True)
class DriftErrors:
    """What a run left of the constraints and of the energy, at worst."""

    violation: float  # abs(c) [m]
    constraint_velocity: float  # abs(J v) [m/s]
    energy: float  # abs(E - E(0)) [J]
    early: float  # the same in the first tenth of the run [J]
    late: float  # and in the last [J]
    status: str  # of the run, by its name; the numbers of one that diverged mean nothing


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
    run = _run(integrator, drift, dt, steps, record=every, progress=progress)
    energy = np.abs(run.energy.error)
    tenth = max(len(run) // 10, 1)
    return DriftErrors(
        float(run.violation.max()),
        float(run.constraint_velocity.max()),
        float(energy.max()),
        float(energy[:tenth].max()),
        float(energy[-tenth:].max()),
        run.run.status.name.lower(),
    )


@dataclass(frozen=True, eq=False)
class Growth:
    """How the gap of a run grows that nothing closes."""

    t: Array  # (k,) [s]
    violation: Array  # (k,) [m], the worst so far
    power: float  # of t, between the middle and the end of the run

    gap = renamed("violation")


def gap_growth(integrator: Integrator, *, dt: float, steps: int) -> Growth:
    """Return how the gap grows: as t^2 for high orders, as t for Euler's methods.

    A method of high order leaves an error of J v that adds up, and with it a gap that grows with
    its time integral. One of first order leaks into the gap itself at every step.
    """
    run = _run(integrator, NoDrift(), dt, steps, record=max(steps // 400, 1))
    # the worst so far: the gap swings with the pendulum
    worst = np.maximum.accumulate(run.violation)
    half = len(run) // 2
    power = np.log(worst[-1] / worst[half]) / np.log(run.t[-1] / run.t[half])
    return Growth(run.t, worst, float(power))


def stability_map(integrator: Integrator, alphas: Sequence[float], betas: Sequence[float]) -> Array:
    """Return the factor by which a gap grows in a step, (len(betas), len(alphas)).

    By the products alpha dt and beta dt of Baumgarte's gains and the step, for an integrator whose
    constraints are held by accelerations.
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
    run = _run(integrator, drift, dt, steps, record=steps, start=(out, omega * along))
    (x, z), (vx, vz) = run.q[-1], run.v[-1]
    return np.array([np.arctan2(x, -z), (x * vz - z * vx) / (x * x + z * z)])


def _run(
    integrator: Integrator,
    drift: Drift,
    dt: float,
    steps: int,
    *,
    record: int,
    start: tuple[Array, Array] | None = None,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Return a run of the pendulum, by default from the horizontal."""
    scene = rod_pendulum()
    motion = simulate(
        scene, *(start or scene.state("horizontal")), duration=steps * dt, dt=dt,
        integrator=integrator, drift=drift, record=record, progress=progress,
    )  # fmt: skip
    return uninterrupted(motion)


@dataclass(frozen=True)
class Contest:
    """One way of keeping the rod's length, over many steps."""

    integrator: Integrator
    drift: Drift
    dt: float  # [s]
    errors: DriftErrors
    area: float  # by how much a step changes areas in the phase plane, as a share of them

    @property
    def title(self) -> str:
        """The name of a contender."""
        if self.integrator.keeps_constraints:
            return self.integrator.title
        return f"{self.integrator.title}, {self.drift.title}"


def contenders(dt: float) -> tuple[tuple[Integrator, Drift], ...]:
    """Return ways of keeping the rod's length: gains, projections, RATTLE."""
    semi, rk4 = SemiImplicitEuler(), RungeKutta4()
    return (
        (semi, Baumgarte.critical(0.3 / dt)),
        (semi, Projection()),
        (rk4, NoDrift()),
        (rk4, Baumgarte.critical(0.03 / dt)),
        (rk4, Projection()),
        (Rattle(), NoDrift()),
    )


def contest(
    dt: float, steps: int, *, progress: Callable[[float], object] | None = None
) -> tuple[Contest, ...]:
    """Return how all `contenders` do over some steps of dt [s]; progress gets the share done.

    Raises
    ------
    Interrupted
        With those that went to their end before Ctrl-C.
    """
    ways = contenders(dt)
    results: list[Contest] = []
    try:
        for i, (integrator, drift) in enumerate(ways):

            def tick(share: float, before: int = i) -> None:
                if progress:
                    progress((before + share) / len(ways))

            found = errors(integrator, drift, dt=dt, steps=steps, progress=tick)
            results.append(Contest(integrator, drift, dt, found, area(integrator, drift, dt=dt)))
    except KeyboardInterrupt as stop:
        raise Interrupted(tuple(results)) from stop
    return tuple(results)


# Pictures; each draws on `ax` or new axes, which it returns


# the lines tell the colours apart in print
_LINES = ("-", "--", "-.", ":", "-", "--")


def draw_growth(found: Mapping[str, Growth], ax: Any = None) -> Any:
    """Draw the gap against time of runs that nothing closes; the slope is the power of t.

    `found` is by the title of the integrator.
    """
    ax = axes(ax)
    for (title, one), colour, line in zip(found.items(), COLOURS, _LINES, strict=False):
        seen = one.violation > 0
        t, gap = one.t[seen], one.violation[seen]
        ax.plot(t, gap, line, color=colour)
        ax.annotate(
            f"{title}: t^{one.power:.2f}", (t[-1], gap[-1]), xytext=(0, 6), color=colour,
            textcoords="offset points", ha="right", fontsize=8,
        )  # fmt: skip
    ax.set(xscale="log", yscale="log")
    ax.margins(y=0.15)
    return labelled_axes(
        ax, title="gap without stabilisation", x="t [s]", y="max abs(c) so far [m]"
    )


def draw_stability(integrator: Integrator, ax: Any = None, *, points: int = 60) -> Any:
    """Draw the factor by which a gap grows in a step over Baumgarte's gains.

    With so many points in each direction, for an integrator whose constraints are held by
    accelerations.
    """
    ax = axes(ax)
    end = 1.3 * stability_limit(integrator)
    products = np.linspace(end / points, end, points)
    factor = stability_map(integrator, products.tolist(), products.tolist())
    levels = [0.0, 0.25, 0.5, 0.75, 0.9, 1.0]
    shown = ax.contourf(products, products, factor, levels=levels, cmap="cividis")
    ax.contour(products, products, factor, levels=[1.0], colors="k", linewidths=1.0)
    ax.plot([0, end], [0, end], ":", color="0.4", lw=0.8)
    ax.set(title=integrator.title, xlabel="alpha dt [1]", ylabel="beta dt [1]")
    ax.set(xlim=(0, end), ylim=(0, end))
    ax.figure.colorbar(shown, ax=ax, label="factor of a gap per step")
    return ax


def draw_contest(found: Sequence[Contest], ax: Any = None) -> Any:
    """Draw gap against energy error of each way to keep a constraint: both are wanted small.

    The hollow mark is the energy error in the first tenth of the run, the full one in the last.
    """
    ax = axes(ax)
    for one, colour in zip(found, COLOURS, strict=False):
        gap = max(one.errors.violation, 1e-17)
        ax.plot([gap] * 2, [one.errors.early, one.errors.late], "-", color=colour, lw=1.0)
        ax.plot(gap, one.errors.early, "o", color=colour, mfc="none", ms=7)
        ax.plot(gap, one.errors.late, "o", color=colour, ms=7, label=one.title)
    ax.set(xscale="log", yscale="log")
    title = "first (hollow) and last tenth of a run"
    return labelled_axes(ax, title=title, x="max abs(c) [m]", y="max abs(E - E0) [J]")


def save_laboratory(
    growths: Mapping[str, Growth],
    integrators: Sequence[Integrator],
    found: Sequence[Contest],
    path: str | Path,
) -> None:
    """Draw all of it into one picture; the ending of `path` says which format."""
    draw = [
        partial(draw_growth, growths),
        *(partial(draw_stability, integrator) for integrator in integrators),
        partial(draw_contest, found),
    ]
    save_panels(draw, path, size=(4.4, 3.4), columns=2)
