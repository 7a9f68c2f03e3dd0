"""Orders of the time steps with contacts, by closed forms.

    python benchmarks/contact_convergence.py [--quick]

Writes benchmarks/results/contact_convergence.json and docs/results.md; with --from-json the table
is made from the committed results, without running anything.

The error is the largest distance of the middle of the body from the closed form, at times that all
steps meet [m]. The order is the slope of log(error) over log(dt), by least squares.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.constraints import Ball, Box

RESULTS = Path(__file__).resolve().parent / "results"
JSON = RESULTS / "contact_convergence.json"

GRAVITY = 9.81  # [m/s^2]
STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)  # [s]
SAMPLED = 1e-2  # [s]
SCHEMES = (
    cp.StewartTrinkle(),
    cp.Moreau(),
    cp.stepping.Anitescu(),
    cp.stepping.SoftStep(),
    cp.stepping.EventDriven(),
)
EXACT = 1e-11  # errors below are rounding [m]


@dataclass(frozen=True, eq=False)
class Known:
    """A motion that is known in closed form: `path(t)` is (len(t), 3) [m]."""

    name: str
    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    duration: float  # [s]
    path: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Order:
    """Errors of a scheme on a motion [m], a step each, and the slope."""

    motion: str
    scheme: str
    errors: tuple[float, ...]
    order: float | None  # None where there is nothing to fit


def motions() -> tuple[Known, ...]:
    """Return a ball that bounces, a box that slides and stops, a ball that slides and rolls."""
    return bouncing(), sliding(), rolling()


def bouncing(*, e: float = 0.8, height: float = 0.5, radius: float = 0.05) -> Known:
    """Return a ball that falls from a height, and bounces five times within 1.5 s."""
    scene = ball(radius, friction=0.2, restitution=e)
    q, v = scene.state()
    q[2] = radius + height

    def path(t: np.ndarray) -> np.ndarray:
        hits, speed = [np.sqrt(2 * height / GRAVITY)], np.sqrt(2 * GRAVITY * height)
        z = height - GRAVITY * t**2 / 2
        while hits[-1] < t[-1]:
            speed *= e
            s = t - hits[-1]
            z = np.where(s > 0, speed * s - GRAVITY * s**2 / 2, z)
            hits.append(hits[-1] + 2 * speed / GRAVITY)
        return np.column_stack((0 * t, 0 * t, radius + z))

    return Known("ball bounces, e = 0.8", scene, q, v, 1.5, path)


def sliding(*, mu: float = 0.5, speed: float = 1.0, heading: float = 0.3) -> Known:
    """Return a box that slides, and stops after v^2 / (2 mu g)."""
    robot = cp.model.free_box()
    touch = cp.FrictionalContact("box", Box(0.1, 0.1, 0.1), friction=mu)
    scene = cp.Scene(robot, contacts=[touch])
    q, v = scene.state("resting")
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    v[:3] = speed * along

    def path(t: np.ndarray) -> np.ndarray:
        s = np.minimum(t, speed / (mu * GRAVITY))
        return q[:3] + np.outer(speed * s - mu * GRAVITY * s**2 / 2, along)

    return Known("box slides and stops", scene, q, v, 0.4, path)


def rolling(*, mu: float = 0.2, speed: float = 1.0, radius: float = 0.05) -> Known:
    """Return a ball that slides until it rolls: after 2 v / (7 mu g), with 5 v / 7."""
    scene = ball(radius, friction=mu, restitution=0.0)
    q, v = scene.state("resting")
    v[0] = speed

    def path(t: np.ndarray) -> np.ndarray:
        s = np.minimum(t, 2 * speed / (7 * mu * GRAVITY))
        x = speed * s - mu * GRAVITY * s**2 / 2 + 5 / 7 * speed * (t - s)
        return q[:3] + np.outer(x, (1.0, 0.0, 0.0))

    return Known("ball slides and rolls", scene, q, v, 0.4, path)


def ball(radius: float, *, friction: float, restitution: float) -> cp.Scene:
    """Return a ball over the floor."""
    touch = cp.FrictionalContact("ball", Ball(radius), friction=friction, restitution=restitution)
    return cp.Scene(cp.model.free_ball(radius=radius), contacts=[touch])


def error(motion: Known, scheme: Any, dt: float) -> float:
    """Return the largest distance from the closed form [m]."""
    run = cp.simulate(
        motion.scene, motion.q, motion.v, duration=motion.duration, dt=dt,
        integrator=scheme, record=round(SAMPLED / dt),
    )  # fmt: skip
    if not run.status.ok:
        raise RuntimeError(f"{motion.name}, {scheme}: {run.reason}")
    missed = run.q[:, :3] - motion.path(run.t)
    return float(np.linalg.norm(missed, axis=1).max())


def order(errors: Sequence[float], steps: Sequence[float]) -> float | None:
    """Return the slope of log(error) over log(dt); None where errors are rounding."""
    if max(errors) < EXACT:
        return None
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def orders(steps: Sequence[float]) -> list[Order]:
    """Return errors and orders of all schemes that take a motion."""
    found = []
    for motion in motions():
        rebounds = any(contact.restitution for contact in motion.scene.contacts)
        for scheme in SCHEMES:
            if scheme.takes_restitution or not rebounds:
                errors = tuple(error(motion, scheme, dt) for dt in steps)
                found.append(Order(motion.name, scheme.title, errors, order(errors, steps)))
    return found


def markdown(found: Sequence[Order], steps: Sequence[float], about: dict[str, str]) -> str:
    """Return the table."""
    lines = [
        f"| motion | scheme | {' | '.join(f'{1e3 * dt:g} ms' for dt in steps)} | order |",
        "|---|---|" + "---|" * (len(steps) + 1),
    ]
    for row in found:
        errors = " | ".join(f"{e:.1e}" for e in row.errors)
        slope = "exact" if row.order is None else f"{row.order:.2f}"
        lines.append(f"| {row.motion} | {row.scheme} | {errors} | {slope} |")
    lines += [
        "",
        "Errors [m]; order: slope by least squares. "
        "`python benchmarks/contact_convergence.py` on {processor} ({cores} cores), {system}, "
        "Python {python}, Pinocchio {pinocchio}, {date}.".format(**about),
    ]
    return "\n".join(lines)


def load() -> tuple[list[Order], tuple[float, ...], dict[str, str]]:
    """Return what `main` wrote."""
    saved = json.loads(JSON.read_text(encoding="utf-8"))
    found = [Order(**row | {"errors": tuple(row["errors"])}) for row in saved["orders"]]
    return found, tuple(saved["steps"]), saved["machine"]


def pages(*measured: Any) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"contact_convergence": markdown(*measured)}}


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few steps, nothing is written")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    if given.from_json:
        marks.write(pages(*load()))
        return
    steps = STEPS[:3] if given.quick else STEPS
    found, about = orders(steps), machine()
    print(markdown(found, steps, about))
    if given.quick:
        return
    saved = {
        "machine": about,
        "steps": steps,
        "orders": [asdict(row) for row in found],
    }
    JSON.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    marks.write(pages(*load()))


if __name__ == "__main__":
    main()
