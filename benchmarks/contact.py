"""Accuracy of steps with contacts: against closed forms, of their derivatives, of convex models.

    python benchmarks/contact.py convergence [--quick]
    python benchmarks/contact.py gradients [--quick]
    python benchmarks/contact.py models

convergence: orders of the time steps on motions that are known in closed form. The error is the
largest distance of the middle of the body from it, at times that all steps meet [m]. The order is
the slope of log(error) over log(dt), by least squares.

gradients: routes to derivatives through contact. A point of 1 kg on a floor with friction 0.5 is
pushed for one step, from rest; slides from 1 m/s until it stops; and a ball of restitution 0.8
falls half a metre, hits the floor once and is looked at after 0.6 s. Spread is the standard
deviation over seeds. Cost is processor time of one step's derivatives, relative to those of
`ActiveSet`, interleaved in one run. A second table is a study by `GradientMeasure`: Solo12 hits the
floor, slides and lets go within 10 ms, by steps of 1 ms, against differences of the same motion
with located events.

models: where convex models of contact differ from Coulomb's law, on a box that slides, rests and
sticks. Nothing is timed. MuJoCo is measured itself: its plane, its box, elliptic cones, and solref
and solimp as they are by default.
"""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from math import sqrt
from time import process_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Table

import condyn_pin as cp
from condyn_pin._core.show import labelled_axes, line
from condyn_pin.constraints import Ball, Box, Point
from condyn_pin.contact import ADMM, SAP
from condyn_pin.gradients import (
    ActiveSet,
    EventLocated,
    Kappa,
    Randomised,
    Route,
    Softened,
    trajectory_derivatives,
)
from condyn_pin.stepping import Anitescu, SoftStep
from condyn_pin.study import GradientMeasure, SampledStates, Study, TimingEffort

GRAVITY = 9.81  # [m/s^2]


# --- convergence

CONVERGENCE_STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)  # [s]
SAMPLED = 1e-2  # [s]
CONVERGENCE_SCHEMES = (
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


def path_error(motion: Known, scheme: Any, dt: float) -> float:
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
        for scheme in CONVERGENCE_SCHEMES:
            if scheme.takes_restitution or not rebounds:
                errors = tuple(path_error(motion, scheme, dt) for dt in steps)
                found.append(Order(motion.name, scheme.title, errors, order(errors, steps)))
    return found


def convergence(given: Namespace) -> script.Saved:
    """Measure the orders."""
    about, steps = script.measured_on(), CONVERGENCE_STEPS[: 3 if given.quick else None]
    return {**about, "steps": steps, "orders": [asdict(row) for row in orders(steps)]}


def convergence_table(saved: script.Saved) -> str:
    """Return errors and orders, a row a motion and scheme."""
    steps = saved["steps"]
    lines = [
        f"| motion | scheme | {' | '.join(f'{1e3 * dt:g} ms' for dt in steps)} | order |",
        "|---|---|" + "---|" * (len(steps) + 1),
    ]
    for row in (Order(**each) for each in saved["orders"]):
        errors = " | ".join(f"{e:.1e}" for e in row.errors)
        slope = "exact" if row.order is None else f"{row.order:.2f}"
        lines.append(f"| {row.motion} | {row.scheme} | {errors} | {slope} |")
    source = script.source("contact convergence", saved["machine"], script.OF_CORES)
    return "\n".join([*lines, "", f"Errors [m]; order: slope by least squares. {source}."])


# --- gradients


SLIPPING = 0.5  # friction [1]
SLOPE_DT = 1e-2  # [s]
SEEDS = 10
FORCES = (3.0, 4.8, 5.0, 8.0)  # [N]; it slips at 4.905
ROUTES: tuple[Route, ...] = (
    ActiveSet(), EventLocated(), Kappa(1e-2), Kappa(1e-4), Kappa(1e-6), Softened(),
    Randomised(50, 1e-3), Randomised(50, 1e-2),
)  # fmt: skip


@dataclass(frozen=True)
class Slope:
    """What a route finds of one slope, and how it differs from seed to seed."""

    problem: str
    route: str
    exact: float
    mean: float
    spread: float


def point() -> tuple[cp.Scene, np.ndarray]:
    """Return a point on the floor, a nanometre in it: no gap is about to open."""
    floor = cp.FrictionalContact("ball", Point(), friction=SLIPPING)
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=[floor])
    q = scene.state()[0].copy()
    q[2] = -1e-9
    return scene, q


def pushed(force: float, route: Route) -> float:
    """Return dv/df of the point after one step [m/s/N]."""
    scene, q = point()
    tau = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    now = cp.step(scene, q, np.zeros(6), tau, dt=SLOPE_DT)
    return float(now.derivatives(route=route).dv_dtau[0, 0])


def stopped(route: Route) -> float:
    """Return how far the point goes by how fast it begins, dx/dv = v / (mu g) [s]."""
    scene, q = point()
    v = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion = cp.simulate(scene, q, v, duration=0.3, dt=SLOPE_DT)
    return float(trajectory_derivatives(motion, route=route).dx_dx[0, 6])


def bounced(route: Route, dt: float = SLOPE_DT) -> float:
    """Return the height of the ball after 0.6 s by that of its fall [1]."""
    floor = cp.FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=[floor])
    q, v = scene.state()
    q = q.copy()
    q[2] = 0.55
    motion = cp.simulate(scene, q, v, duration=0.6, dt=dt, integrator=cp.Moreau())
    return float(trajectory_derivatives(motion, route=route).dx_dx[2, 2])


def bounce_exact(h: float = 0.5, t: float = 0.6, e: float = 0.8) -> float:
    """Return dz/dh of z = e g t0 (t - t0) - g (t - t0)^2 / 2, t0 = sqrt(2 h / g)."""
    first = sqrt(2 * h / GRAVITY)
    by_first = e * GRAVITY * (t - 2 * first) + GRAVITY * (t - first)
    return by_first / (GRAVITY * first)


def slopes(seeds: int) -> list[Slope]:
    """Return all rows."""
    problems = [
        *((f"dv/df at {f:g} N", 0.0 if f < SLIPPING * GRAVITY else SLOPE_DT,
           lambda r, f=f: pushed(f, r)) for f in FORCES),
        ("dx/dv of the stop", 1.0 / (SLIPPING * GRAVITY), stopped),
        ("dz/dh of the bounce", bounce_exact(), bounced),
    ]  # fmt: skip
    found = []
    for name, exact, slope in problems:
        for route in ROUTES:
            drawn = [replace(route, seed=k) for k in range(seeds)] if _noisy(route) else [route]
            values = [slope(each) for each in drawn]
            spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
            found.append(Slope(name, title(route), exact, float(np.mean(values)), spread))
            print(found[-1], flush=True)
    return found


def _noisy(route: Route) -> bool:
    return isinstance(route, Randomised)


def title(route: Route) -> str:
    """Return a route with what matters of its parameters."""
    if isinstance(route, Kappa):
        return f"Kappa({route.kappa:g})"
    if isinstance(route, Randomised):
        return f"Randomised({route.samples}, {route.sigma:g})"
    return f"{type(route).__name__}()"


def costs(repeats: int) -> dict[str, dict[str, float]]:
    """Return the processor time of each route, relative to ActiveSet; and its own to bilateral."""
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    q = cp.mechanism.place_on_ground(scene, scene.state()[0])
    v = 0.01 * np.random.default_rng(0).normal(size=18)
    ball, at = point()
    steps = {
        "point": cp.step(ball, at, np.full(6, 0.1), dt=1e-3),
        "Solo12": cp.step(scene, q, v, dt=1e-3),
    }
    held = cp.Workspace(scene.closed())
    found: dict[str, dict[str, float]] = {}
    for name, now in steps.items():
        calls = {title(route): (lambda route=route, now=now: now.derivatives(route=route))
                 for route in ROUTES if not isinstance(route, Randomised)}  # fmt: skip
        if name == "Solo12":
            calls["bilateral"] = lambda: held.derivatives(q, v, np.zeros(18), method="kkt").da_dq
        best = dict.fromkeys(calls, np.inf)
        for _ in range(repeats):
            for which, call in calls.items():
                begun = process_time()
                for _ in range(10):
                    call()
                best[which] = min(best[which], process_time() - begun)
        unit = best["ActiveSet()"]
        found[name] = {which: took / unit for which, took in best.items()}
    return found


def studied(states: int, rounds: int) -> list[dict[str, Any]]:
    """Return the rows of a study of routes on Solo12, with times relative to ActiveSet."""
    study = Study(
        "solo12", ROUTES, states=SampledStates(states, loads=["zero"]),
        measure=GradientMeasure(), effort=TimingEffort(rounds=rounds),
    )  # fmt: skip
    rows = study.run().rows
    unit = next(row.us for row in rows if row.solver == "ActiveSet()")
    return [
        {
            "route": title(route), "median": row.error_median, "worst": row.error_worst,
            "spread": row.dynamics_error, "end": row.constraint_error, "states": states,
            "cost": row.us / unit,
        }
        for route, row in zip(ROUTES, rows, strict=True)
    ]  # fmt: skip


def study_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of the study."""
    lines = ["| route | error, median | worst | spread | end | cost |", "|---|---|---|---|---|---|"]
    for row in rows:
        spread = f"{row['spread']:.1e}" if row["spread"] else ""
        lines.append(
            f"| `{row['route']}` | {row['median']:.1e} | {row['worst']:.1e} | {spread} | "
            f"{row['end']:.1e} | {row['cost']:.1f} |"
        )
    lines += [
        "",
        f"Solo12, {rows[0]['states']} random states on its lowest foot, 10 ms in steps of 1 ms by "
        "`Moreau()`, directions of v and tau; end: how far the end of the steps is from that of "
        "the motion [m/s]; cost relative to `ActiveSet()`. Same script, machine and day.",
    ]
    return "\n".join(lines)


def gradients(given: Namespace) -> script.Saved:
    """Measure slopes, costs and the study, and draw."""
    if not given.quick:
        draw()
    return {
        **script.measured_on(),
        "slopes": [asdict(row) for row in slopes(2 if given.quick else SEEDS)],
        "costs": costs(25),
        "study": studied(1, 1) if given.quick else studied(8, 3),
    }


def slope_table(saved: script.Saved) -> str:
    """Return the slopes and costs of all routes."""
    found, times = [Slope(**row) for row in saved["slopes"]], saved["costs"]
    problems = list(dict.fromkeys(row.problem for row in found))
    exact = {row.problem: row.exact for row in found}
    lines = [f"| route | {' | '.join(problems)} | cost |", "|---|" + "---|" * (len(problems) + 1)]
    lines.append("| exact | " + " | ".join(f"{exact[p]:.5g}" for p in problems) + " | |")
    for route in dict.fromkeys(row.route for row in found):
        rows = {row.problem: row for row in found if row.route == route}
        cells = [
            f"{rows[p].mean:.4g}" + (f" ± {rows[p].spread:.1g}" if rows[p].spread else "")
            for p in problems
        ]
        cost = times["Solo12"].get(route)
        lines.append(f"| `{route}` | {' | '.join(cells)} | {f'{cost:.1f}' if cost else ''} |")
    source = script.source("contact gradients", saved["machine"], script.OF_CORES)
    lines += [
        "",
        "dt 10 ms; ±: standard deviation over seeds; cost: of Solo12 on four feet, relative to "
        f"`ActiveSet()`, which takes {1 / times['Solo12']['bilateral']:.1f} times what the "
        f"derivatives of the held robot take. {source}.",
    ]
    return "\n".join(lines)


def draw() -> None:
    """Write the figure: the slope of stick and slip beside the force at which it slips."""
    import matplotlib.pyplot as plt

    forces = np.linspace(3.5, 6.5, 61)
    figure, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    routes = (ActiveSet(), Kappa(1e-2), Kappa(1e-4), Kappa(1e-6), Randomised(50, 1e-2))
    for i, route in enumerate(routes):
        slopes = [1e3 * pushed(float(f), route) for f in forces]
        ax.plot(forces, slopes, label=title(route), **line(i))
    ax.axvline(SLIPPING * GRAVITY, color="0.6", lw=0.8)
    labelled_axes(ax, title="", x="force [N]", y="dv/df [mm/s/N]")
    figure.savefig(script.result("contact gradients", ".png"), dpi=150)


# --- models


HALF = (0.1, 0.06, 0.04)  # half of the edges of the box [m]
MASS = 1.0  # [kg]
MODEL_STEPS = (1e-2, 1e-3, 1e-4)  # [s]
SLIDE, SPEED, ANGLE = 0.5, 1.0, 0.3  # friction, [m/s], [rad]
SLOPE, STICK = 0.3, 0.7  # [rad], friction: tan(0.3) = 0.309


def stiffest(dt: float) -> SoftStep:
    """Return the stiffest contacts that MuJoCo allows: a timeconst of two steps."""
    return SoftStep(SAP(), solref=(2 * dt, 1.0), solimp=(0.99, 0.999, 1e-3, 0.5, 2.0))


MODELS: dict[str, Callable[[float], cp.simulation.Integrator]] = {
    "`StewartTrinkle`": lambda dt: cp.StewartTrinkle(ADMM(polish=True)),
    "`Moreau`": lambda dt: cp.Moreau(ADMM(polish=True)),
    "`Anitescu`": lambda dt: Anitescu(ADMM(polish=True)),
    "`SoftStep`": lambda dt: SoftStep(SAP()),
    "`SoftStep`, stiffest": stiffest,
}
MUJOCO = "MuJoCo"


@dataclass(frozen=True)
class BoxMotion:
    """What one model makes of both questions with one step.

    Attributes
    ----------
    model : str
    dt : float
        [s]
    way, heading : float
        Of the box that slides until it stops [m], [rad].
    hop : float
        How far its lowest corner comes off the floor [m].
    deep : float
        How far its deepest corner comes below it, in either question [m].
    creep : float
        What the box that friction holds comes down the slope in a second [m].
    """

    model: str
    dt: float
    way: float
    heading: float
    hop: float
    deep: float
    creep: float


Run = Callable[[np.ndarray, np.ndarray, float, float, float], tuple[np.ndarray, np.ndarray]]


def by_scheme(scheme: Callable[[float], cp.simulation.Integrator]) -> Run:
    """Return what simulates a box on a floor by a scheme."""

    def run(
        gravity: np.ndarray, v: np.ndarray, friction: float, dt: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        box = cp.model.free_box(mass=MASS, size=tuple(2 * x for x in HALF))
        box.model.gravity.linear = gravity
        box = cp.Robot("box", box.model, postures=box.postures)
        scene = cp.Scene(box, contacts=[cp.FrictionalContact("box", Box(*HALF), friction=friction)])
        motion = cp.simulate(
            scene, scene.state()[0], v, duration=duration, dt=dt, integrator=scheme(dt)
        )
        lowest = np.min(list(motion.gaps.values()), axis=0)
        return motion.q[:, :2], lowest

    return run


def by_mujoco(
    gravity: np.ndarray, v: np.ndarray, friction: float, dt: float, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the same by MuJoCo."""
    import mujoco

    x, y, z = HALF
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{dt!r}" cone="elliptic" gravity="{gravity[0]} {gravity[1]} {gravity[2]}"/>
      <worldbody>
        <geom type="plane" size="5 5 1" friction="{friction} 0 0" condim="3"/>
        <body pos="0 0 {z}"><freejoint/>
          <geom type="box" size="{x} {y} {z}" mass="{MASS}" friction="{friction} 0 0" condim="3"/>
        </body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:] = v
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1) * np.array(HALF)[:, None]
    places, lowest = [data.qpos[:2].copy()], [0.0]
    for _ in range(round(duration / dt)):
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        places.append(data.qpos[:2].copy())
        corners = data.xmat[1].reshape(3, 3) @ signs + data.xpos[1][:, None]
        lowest.append(float(corners[2].min()))
    return np.array(places), np.array(lowest)


def box_motions() -> Iterator[BoxMotion]:
    """Yield what every model makes of both questions, with every step."""
    runs = {name: by_scheme(scheme) for name, scheme in MODELS.items()} | {MUJOCO: by_mujoco}
    down, still = np.array([0.0, 0.0, -GRAVITY]), np.zeros(6)
    along = GRAVITY * np.array([np.sin(SLOPE), 0.0, -np.cos(SLOPE)])
    push = np.array([SPEED * np.cos(ANGLE), SPEED * np.sin(ANGLE), 0, 0, 0, 0])
    for title, run in runs.items():
        for dt in MODEL_STEPS:
            places, lowest = run(down, push, SLIDE, dt, 0.4)
            x, y = places[-1] - places[0]
            rested, under = run(along, still, STICK, dt, 1.0)
            yield BoxMotion(
                title, dt, float(np.hypot(x, y)), float(np.arctan2(y, x)),
                float(max(lowest.max(), 0.0)), float(-min(lowest.min(), under.min(), 0.0)),
                float(rested[-1, 0] - rested[0, 0]),
            )  # fmt: skip


def _mm(length: float) -> str:
    """Return a length in mm, as zero what is rounding."""
    return f"{1e3 * length:.3g}" if abs(length) > 1e-9 else "0"


def models(given: Namespace) -> script.Saved:
    """Measure both questions."""
    import mujoco

    about = script.measured_on(mujoco=mujoco.__version__)
    return {**about, "rows": [asdict(one) for one in box_motions()]}


def model_table(saved: script.Saved) -> str:
    """Return what every model makes of both questions, beside Coulomb's law."""
    way = SPEED**2 / (2 * SLIDE * GRAVITY)
    lines = [
        "| model | dt [s] | stops after [m] | at [rad] | hop [mm] | deepest [mm] | creep [mm/s] |",
        "|---|---|---|---|---|---|---|",
        f"| Coulomb's law | | {way:.6f} | {ANGLE:.4f} | 0 | 0 | 0 |",
        *(
            f"| {one.model} | {one.dt:g} | {one.way:.6f} | {one.heading:.4f} | {_mm(one.hop)} | "
            f"{_mm(one.deep)} | {_mm(one.creep)} |"
            for one in (BoxMotion(**row) for row in saved["rows"])
        ),
    ]
    on = f"{script.SHORT}; Pinocchio {{pinocchio}}, MuJoCo {{mujoco}}"
    source = script.source("contact models", saved["machine"], on)
    return "\n".join([*lines, "", f"{source}; no figure is a time."])


SUBJECTS = [
    Table(
        "contact convergence",
        "orders of the time steps, by closed forms",
        convergence,
        convergence_table,
        pages=lambda saved: {
            script.RESULTS_PAGE: {"contact_convergence": convergence_table(saved)}
        },
        quick="few steps; nothing is written",
    ),
    Table(
        "contact gradients",
        "bias, spread and cost of routes to derivatives",
        gradients,
        lambda saved: f"{slope_table(saved)}\n\n{study_table(saved['study'])}",
        pages=lambda saved: {
            script.RESULTS_PAGE: {
                "contact_gradients": slope_table(saved),
                "route_study": study_table(saved["study"]),
            }
        },
        quick="two seeds; nothing is written",
    ),
    Table(
        "contact models",
        "convex models of contact beside Coulomb's law",
        models,
        model_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"contact_models": model_table(saved)}},
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
