"""What drift schemes leave of a pendulum's rod and of its energy, beside verified figures.

    python benchmarks/drift.py [--steps 100000]

A point mass of 1 kg on a rod of 1 m, in Cartesian
coordinates, from the horizontal at rest. Beside each run stand three figures: that of `plain`,
twenty lines that know nothing but the two scalar equations of a rod; that of the table which is
often shown, for (|r|^2 - 1) / 2 = 0 and not |r| - 1 = 0; and that of the same integrator on this
constraint, which is the table's to all its digits.

The two constraints are one on the circle, and ask for accelerations that differ by (n . r')^2 n
beside it. The stages of RK4 leave the circle by (dt |r'|)^2 / 8 and have slips of dt^2, so that
the difference is of the order of its error. From r = n with the speed w and g = (g_n, g_t) along
and across the rod, one step leaves the slip

    -dt^5 / 48 (g_n^2 w^2 - g_n g_t^2 + 9 g_t^2 w^2)    with (|r|^2 - 1) / 2,
    -dt^5 / 48 (g_n^2 w^2 - g_n g_t^2 + 7 g_t^2 w^2)    with |r| - 1.

Where the pendulum falls by phi, g_n = g sin(phi), g_t = g cos(phi), w^2 = 2 g_n, and over a swing
the slips add up as (1 + 15/2 * 2/5) to (1 + 11/2 * 2/5): 5 to 4. So RK4 leaves four fifths of the
table here where no gain corrects it.

``--steps 0`` keeps the long runs of the committed results.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, cast

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
import script
from script import Table

import condyn_pin as cp
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.stability import stability_limit
from lab.drift import contest, errors, gap_growth, save_laboratory

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System

ROUNDING = 1e-9  # gaps [m] and slips [m/s] that projections leave: their tolerance is 1e-10

SEMI, RK4, RATTLE = cp.SemiImplicitEuler(), cp.RungeKutta4(), cp.simulation.Rattle()
DIVERGES = (float("nan"),) * 3

# Critical gains, T = 10 s: alpha dt, and the largest gap [m], |J v| [m/s] and energy error [J].
SEMI_GAINS = {
    0.0: (4.36e-02, 1.96e-02, 8.98e-01),
    0.001: (9.72e-03, 1.42e-02, 1.57e-01),
    0.01: (1.77e-03, 6.09e-03, 3.06e-01),
    0.03: (6.45e-04, 9.25e-03, 6.88e-02),
    0.1: (1.96e-04, 9.76e-03, 1.96e-02),
    0.3: (6.54e-05, 9.80e-03, 1.44e-02),
    0.8: (2.45e-05, 9.81e-03, 1.37e-02),
    0.84: DIVERGES,
    1.0: DIVERGES,
    2.0: DIVERGES,
    2.5: DIVERGES,
    2.7: DIVERGES,
}
RK4_GAINS = {
    0.0: (3.59e-05, 7.20e-06, 4.74e-04),
    0.001: (1.90e-05, 2.74e-06, 2.52e-04),
    0.01: (6.96e-07, 3.43e-07, 1.01e-05),
    0.03: (5.10e-08, 2.26e-07, 1.80e-06),
    0.1: (3.56e-07, 4.59e-06, 2.27e-05),
    0.3: (2.70e-06, 1.39e-04, 1.43e-04),
    0.8: (2.64e-05, 3.62e-03, 4.31e-04),
    0.84: (3.00e-05, 4.30e-03, 4.52e-04),
    1.0: (4.82e-05, 8.07e-03, 7.17e-04),
    2.0: (7.38e-04, 1.98e-01, 4.05e-02),
    2.5: (1.73e-02, 5.09e00, 1.06e01),
    2.7: DIVERGES,
}


@dataclass(frozen=True)
class Case:
    """One run, and what is known about it; None where nothing is, NaN where it diverges."""

    label: str
    integrator: Any
    drift: Any
    dt: float  # [s]
    steps: int
    violation: float | None
    constraint_velocity: float | None
    energy: float | None

    @property
    def diverges(self) -> bool:
        """Whether it is known to."""
        return self.energy is not None and self.energy != self.energy


def cases() -> list[Case]:
    """Return all runs."""
    found = []
    for integrator, dt, table in ((SEMI, 1e-3, SEMI_GAINS), (RK4, 1e-2, RK4_GAINS)):
        for product, known in table.items():
            gains = cp.Baumgarte.critical(product / dt)
            label = f"{integrator.title}, alpha dt = {product:g}"
            found.append(Case(label, integrator, gains, dt, round(10 / dt), *known))
    position, velocity = (
        cp.simulation.Projection(velocity=False),
        cp.simulation.Projection(position=False),
    )
    found += [
        Case("RK4, 40 s, nothing", RK4, cp.Baumgarte(0, 0), 1e-2, 4000, 5.7e-4, None, 7.8e-3),
        Case("RK4, 40 s, position", RK4, position, 1e-2, 4000, 0.0, None, 5.2e-3),
        Case("RK4, 40 s, velocity", RK4, velocity, 1e-2, 4000, 1.6e-7, 0.0, 5.5e-6),
        Case(
            "RK4, 40 s, both",
            RK4,
            cp.simulation.Projection(tolerance=1e-14),
            1e-2,
            4000,
            0.0,
            0.0,
            6.6e-6,
        ),
    ]
    for dt, energy in ((4e-2, 5.79e-2), (2e-2, 1.44e-2), (1e-2, 3.61e-3), (5e-3, 9.02e-4)):
        label = f"RATTLE, dt = {dt:g} s"
        found.append(
            Case(label, RATTLE, cp.simulation.NoDrift(), dt, round(10 / dt), 0.0, 0.0, energy)
        )
    return found


def plain(case: Case) -> tuple[float, float, float] | None:
    """Return gap, slip and energy error of a case with gains; None if it has none.

    c = |r| - 1, n = r / |r|:  r'' = g + lam n,  c'' = n r'' + (|r'|^2 - c'^2) / |r| = a_ref
    """
    gains = case.drift.rows
    if gains is None:
        return None
    h, down, alpha, beta = case.dt, np.array([0.0, -9.81]), gains.alpha, gains.beta

    def acceleration(r: np.ndarray, v: np.ndarray) -> np.ndarray:
        length = np.hypot(*r)
        n = r / length
        wanted = -2 * alpha * (n @ v) - beta**2 * (length - 1)
        return down + (wanted - n @ down - (v @ v - (n @ v) ** 2) / length) * n

    r, v, worst = np.array([1.0, 0.0]), np.zeros(2), np.zeros(3)
    for _ in range(case.steps):
        if case.integrator == SEMI:
            v = v + h * acceleration(r, v)
            r = r + h * v
        else:
            a1 = acceleration(r, v)
            v2 = v + h / 2 * a1
            a2 = acceleration(r + h / 2 * v, v2)
            v3 = v + h / 2 * a2
            a3 = acceleration(r + h / 2 * v2, v3)
            v4 = v + h * a3
            a4 = acceleration(r + h * v3, v4)
            r, v = r + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        length = np.hypot(*r)
        now = length - 1, r @ v / length, v @ v / 2 + 9.81 * r[1]
        worst = np.maximum(worst, np.abs(now))
        if not worst.max() < 1e10:
            return DIVERGES
    return float(worst[0]), float(worst[1]), float(worst[2])


def plane() -> pin.Model:
    """Return the model of a point that slides along two axes."""
    model = pin.Model()
    for i, slide in enumerate((pin.JointModelPX(), pin.JointModelPZ())):
        model.addJoint(i, slide, pin.SE3.Identity(), f"slide {i}")
    return model


class Squared:
    """What an integrator sees of the pendulum with the constraint of the table.

    c = (|r|^2 - 1) / 2:  r'' = g + lam r,  c'' = r . r'' + |r'|^2 = -2 alpha c' - beta^2 c
    """

    lam: Any = staticmethod(lambda: np.zeros(1))

    def __init__(self, gains: cp.Baumgarte) -> None:
        self._gains, self.manifold = gains, Manifold(plane())

    def acceleration(self, t: float, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return r''."""
        down, gains = np.array([0.0, -9.81]), self._gains
        wanted = -gains.Kd * (r @ v) - gains.Kp * (r @ r - 1) / 2
        return down + (wanted - r @ down - v @ v) / (r @ r) * r

    def integrate(self, r: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return r moved by a step."""
        return r + step

    def slope(
        self, t: float, r0: np.ndarray, y: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rates of y = r - r0 and of v."""
        return v, self.acceleration(t, r0 + y, v)

    def implicit(self, dt: float) -> Squared:
        """Return the same: it has no springs and no damping."""
        return self


def squared(case: Case) -> tuple[float, float, float] | None:
    """Return gap, slip and energy error of a case with the constraint of the table."""
    gains = case.drift.rows
    if gains is None:
        return None
    step = case.integrator.start(cast("System", Squared(gains)), case.dt).step
    r, v, worst = np.array([1.0, 0.0]), np.zeros(2), np.zeros(3)
    with np.errstate(all="ignore"):
        for k in range(case.steps):
            r, v, _ = step(k * case.dt, r, v)
            worst = np.maximum(worst, np.abs([(r @ r - 1) / 2, r @ v, v @ v / 2 + 9.81 * r[1]]))
            if not worst.max() < 1e10:
                return DIVERGES
    return float(worst[0]), float(worst[1]), float(worst[2])


def run(case: Case) -> dict[str, Any]:
    """Return what a case leaves; gains beyond the wall are refused, and diverge in that sense."""
    names = ("violation", "constraint_velocity", "energy")
    row: dict[str, Any] = {"label": case.label, "dt": case.dt, "steps": case.steps}
    figures = {
        "plain": plain(case),
        "squared": squared(case), "table": (case.violation, case.constraint_velocity, case.energy)
    }  # fmt: skip
    for name, three in figures.items():
        diverges = three is None or three[2] != three[2]
        row[name] = None if diverges else dict(zip(names, three, strict=True))
    try:
        found = errors(case.integrator, case.drift, dt=case.dt, steps=case.steps)
    except cp.InvalidArgument:
        return row | {"status": "refused"}
    return row | {
        "status": found.status,
        "violation": found.violation, "constraint_velocity": found.constraint_velocity,
        "energy": found.energy
    }  # fmt: skip


def agrees(row: dict[str, Any], case: Case) -> bool:
    """Return whether a row is what is known: within 2 % of `plain`, else within 20 % of the table.

    With gains, the integrator has to have the table's figures too, with the table's constraint.
    What the table has at rounding is below the tolerance of projections; what diverges is refused,
    or does.
    """
    if case.drift.rows is not None and not _near(row["squared"], row["table"], 0.02):
        return False
    if row["status"] != "finished":
        return case.diverges or row["plain"] is None
    if case.drift.rows is not None:
        return _near(row, row["plain"], 0.02)
    known = {name: value for name, value in row["table"].items() if value is not None}
    return all(
        row[name] < ROUNDING if value == 0 else abs(row[name] / value - 1) < 0.2
        for name, value in known.items()
    )


def _near(found: dict[str, Any] | None, known: dict[str, Any] | None, share: float) -> bool:
    """Return whether figures are those that are known, or there are none of both."""
    if found is None or known is None:
        return found is known
    return all(
        abs(found[name] / value - 1) < share for name, value in known.items() if value is not None
    )


def measure(given: Namespace) -> script.Saved:
    """Run every case, and the long runs."""
    about, rows = script.measured_on(), []
    for case in cases():
        row = run(case)
        rows.append(row)
        print(line(row, "" if agrees(row, case) else "  DISAGREES"), flush=True)
    return (
        (long_runs(given.steps) if given.steps else script.load("drift")) | about | {"rows": rows}
    )


def line(row: dict[str, Any], said: str = "") -> str:
    """Return a row in a line."""
    names = ("violation", "constraint_velocity", "energy")
    numbers = " ".join(f"{row[name]:.2e}" for name in names if row.get(name) is not None)
    return f"{row['label']:45} {row['status']:9} {numbers}{said}"


def long_runs(steps: int) -> dict[str, Any]:
    """Return walls, growth, and energy over many steps; draw them."""
    growths = {
        "explicit Euler": gap_growth(cp.simulation.ExplicitEuler(), dt=1e-3, steps=10_000),
        "Runge-Kutta 4": gap_growth(RK4, dt=1e-2, steps=4000),
    }
    found = contest(1e-2, steps)
    save_laboratory(growths, (SEMI, RK4), found, script.result("drift", ".png"))
    return {
        "stability_limits": {
            i.title: stability_limit(i) for i in (cp.simulation.ExplicitEuler(), SEMI, RK4)
        },
        "growth": {name: growth.power for name, growth in growths.items()},
        "contest": [
            {"label": one.title, "dt": one.dt, "steps": steps, "area": one.area}
            | asdict(one.errors)
            for one in found
        ],
    }


def _steps(parser: ArgumentParser) -> None:
    parser.add_argument("--steps", type=int, default=100_000, help="of the long runs")


SUBJECTS = [
    Table(
        "drift",
        "a pendulum's rod and energy under every scheme",
        measure,
        lambda saved: "\n".join(map(line, saved["rows"])),
        options=_steps,
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
