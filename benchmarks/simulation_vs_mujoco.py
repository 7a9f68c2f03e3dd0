"""The same linkages in MuJoCo and here: loop gap and energy error against time.

    python benchmarks/simulation_vs_mujoco.py [--quick]

Both engines read one file (`Robot.to_mjcf`), start from one state, and are measured with one
reference, Pinocchio's: the largest gap and change of energy among samples every 16 ms. Energy is
conserved: nothing dissipates. Time is CPU time of one thread, the median over interleaved blocks
of steps; MuJoCo takes the steps of a block in one call of `mj_step`, and the compiled core, if it
is built, those of 32 equal motions in one call of `simulate_batch`.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time, thread_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Table

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.show import line
from condyn_pin.simulation.drift import DRIFTS
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import follow
from condyn_pin.simulation.torques import PassiveForces

LOST = 1.0  # a loop that is open by so much is no loop [m]
CORE, PYTHON = "condyn_pin, compiled", "condyn_pin"


@dataclass(frozen=True)
class Row:
    """One way to simulate one linkage.

    `us` is CPU time per simulated millisecond [us]; gap [m], energy [J] and what happened.
    """

    problem: str
    engine: str
    method: str
    dt: float  # [s]
    violation: float  # [m]
    energy: float  # [J]
    us: float  # [us / ms]
    status: str

    @property
    def name(self) -> str:
        """Method and step."""
        return f"{self.method}, {1e3 * self.dt:g} ms"


SAMPLED = 1.6e-2  # [s]
BLOCK = 0.01  # CPU seconds of a block, about [s]
MOTIONS = 32  # of a block of the compiled core, which is called once for all of them


@dataclass(frozen=True, eq=False)
class Problem:
    """A linkage that conserves energy, and a state that it starts from."""

    name: str
    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    duration: float  # [s]

    def errors(self, Q: Sequence[np.ndarray], V: Sequence[np.ndarray]) -> tuple[float, float]:
        """Return the largest gap [m] and change of energy [J] among some states."""
        q, v = np.array(Q), np.array(V)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            return np.inf, np.inf
        found = gauge_of(self.scene).measure(np.zeros(len(q)), q, v)  # nothing is driven
        energy = found.kinetic + found.potential + PassiveForces.of(self.scene.robot).energy(q)
        return float(found.violation.max()), float(np.abs(energy - energy[0]).max())


def problems() -> tuple[Problem, ...]:
    """Return the four-bar for 2 s, and Cassie afloat on its springs without damping for 1 s."""
    bar, cassie = cp.load_robot("four_bar"), cp.load_robot("cassie")
    model = pin.Model(cassie.model)
    model.gravity = pin.Motion.Zero()
    model.damping[:] = 0.0
    cassie = replace(cassie, model=model)
    closed, legs = cp.Scene(bar, bar.loops), cp.Scene(cassie, cassie.loops)
    q, _ = legs.state()
    v = cp.mechanism.project_velocity(legs, q, np.random.default_rng(0).normal(size=cassie.nv))
    kinetic = 0.5 * v @ cp.Workspace(legs).terms(q, v).M @ v
    return (
        Problem("four_bar", closed, *closed.state(), duration=2.0),
        Problem("cassie", legs, q, v * np.sqrt(2.0 / kinetic), duration=1.0),
    )


Block = Callable[[], float]  # CPU time per simulated millisecond [us]


def ours(problem: Problem, integrator: Any, drift: Any, dt: float) -> tuple[Row, Block] | None:
    """Run a method of this library; return its errors and how to time it."""

    def planned(duration: float, record: int) -> Any:
        return plan(
            problem.scene, 0.0, duration=duration, dt=dt, integrator=integrator, drift=drift,
            solver=None, record=record,
        )  # fmt: skip

    whole = planned(problem.duration, max(round(SAMPLED / dt), 1))
    begun = thread_time()
    try:
        found, phase = follow(whole, problem.q, problem.v)
    except cp.errors.StepFailed as failed:
        print(f"{problem.name}: not even the first step: {failed}")
        return None
    step = (thread_time() - begun) / max(found.t[-1] / dt, 1)
    gap, energy = problem.errors(found.q, found.v)
    steps = max(int(BLOCK / step), 5)
    part = planned(steps * dt, steps)

    def block() -> float:
        nonlocal phase
        begun = thread_time()
        _, phase = follow(part, problem.q, problem.v, phase=phase)
        return 1e3 * (thread_time() - begun) / (steps * dt)

    chosen = whole.drift
    method = integrator.title if integrator.keeps_constraints else _title(integrator, chosen)
    return Row(problem.name, PYTHON, method, dt, gap, energy, 0.0, found.status.name.lower()), block


def compiled(problem: Problem, integrator: Any, drift: Any, dt: float) -> tuple[Row, Block] | None:
    """Run a method by the compiled core; None if it breaks down, as it does in Python too."""
    core, every = cp.Native(threads=1), max(round(SAMPLED / dt), 1)

    def run(motions: int, duration: float, record: int | None = None) -> Any:
        return cp.simulate_batch(
            problem.scene, np.tile(problem.q, (motions, 1)), np.tile(problem.v, (motions, 1)),
            duration=duration, dt=dt, integrator=integrator, drift=drift, record=record,
            executor=core,
        )  # fmt: skip

    found = run(1, problem.duration, every)
    if not found.ok:
        return None
    gap, energy = problem.errors(found.samples.q[0], found.samples.v[0])
    begun = process_time()
    run(MOTIONS, 8 * dt)
    steps = 8 * max(round(10 * BLOCK / (process_time() - begun)), 1)

    def block() -> float:
        begun = process_time()
        run(MOTIONS, steps * dt)
        return 1e3 * (process_time() - begun) / (MOTIONS * steps * dt)

    row = Row(problem.name, CORE, _title(integrator, drift), dt, gap, energy, 0.0, "finished")
    return row, block


def _title(integrator: Any, drift: Any) -> str:
    explicit = getattr(integrator, "implicit", None) is False
    return f"{integrator.title}{', explicit springs' if explicit else ''}, {drift.title}"


def theirs(problem: Problem, setting: str, integrator: str, dt: float) -> tuple[Row, Block]:
    """Run MuJoCo; return its errors and how to time it."""
    import mujoco

    twin = Twin.of(problem.scene.robot, setting, integrator, dt, conservative=True)
    twin.set(problem.q, problem.v)
    every, Q, V = max(round(SAMPLED / dt), 1), [problem.q], [problem.v]
    begun = thread_time()
    for _ in range(round(problem.duration / (every * dt))):
        mujoco.mj_step(twin.model, twin.data, every)
        q, v = twin.state()
        Q.append(q)
        V.append(v)
    step = (thread_time() - begun) * dt / problem.duration
    gap, energy = problem.errors(Q, V)
    warned = any(warning.number for warning in twin.data.warning)
    steps = max(int(BLOCK / step), 5)

    def block() -> float:
        twin.set(problem.q, problem.v)
        begun = thread_time()
        mujoco.mj_step(twin.model, twin.data, steps)
        return 1e3 * (thread_time() - begun) / (steps * dt)

    said = "diverged" if warned else "finished"
    return Row(
        problem.name, "MuJoCo", f"{integrator}, {setting}", dt, gap, energy, 0.0, said
    ), block


def candidates(problem: Problem, *, quick: bool) -> list[tuple[Row, Block]]:
    """Run everything once for its errors."""
    steps = (1e-3,) if quick else (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2)
    slow = (8e-3,) if quick else (4e-3, 8e-3, 1.6e-2)
    has_core = importlib.util.find_spec("condyn_pin_native") is not None
    semi, springs = cp.SemiImplicitEuler(implicit=False), cp.SemiImplicitEuler()
    eulers = (semi, springs) if problem.scene.robot.springs else (semi,)
    tried = [
        theirs(problem, setting, integrator, dt)
        for setting in SETTINGS
        for integrator in INTEGRATORS
        for dt in steps
    ]
    second = (cp.simulation.Leapfrog(), cp.simulation.LinearlyImplicitMidpoint())
    for integrator in (*eulers, *second, cp.RungeKutta4()):
        gain = 0.03 if integrator.order.q > 2 else 0.3
        for dt in steps:
            drifts = cp.Baumgarte.critical(gain / dt), cp.simulation.PostStabilization()
            tried += [ours(problem, integrator, drift, dt) for drift in drifts]
            tried.append(ours(problem, integrator, cp.simulation.Projection(), dt))
            if has_core and not isinstance(integrator, cp.simulation.Leapfrog):
                tried += [compiled(problem, integrator, drift, dt) for drift in drifts]
    for integrator in (cp.simulation.Rattle(), cp.simulation.GearGuptaLeimkuhler()):
        tried += [ours(problem, integrator, cp.simulation.NoDrift(), dt) for dt in slow]
    return [each for each in tried if each]


def measure(given: Namespace) -> script.Saved:
    """Measure all ways, with times from interleaved blocks."""
    import mujoco

    mujoco.set_mju_user_warning(lambda text: None)  # what diverges is a row that says so
    about = script.measured_on(mujoco=mujoco.__version__)
    rows = []
    for problem in problems():
        tried = candidates(problem, quick=given.quick)
        times: list[list[float]] = [[] for _ in tried]
        for r in range(3 if given.quick else 5):
            for i in np.roll(np.arange(len(tried)), r * 7):
                times[i].append(tried[i][1]())
        for (row, _), samples in zip(tried, times, strict=True):
            rows.append(asdict(row) | {"us": float(np.median(samples))})
    return {**about, "rows": rows}


# --- MuJoCo


# solref and solimp of equalities: MuJoCo's own, and two that are as stiff as they may be.
SETTINGS = {
    "default": None,
    "solref .002, solimp .9999": (0.002, 0.9999),
    "solref .005, solimp .9999": (0.005, 0.9999),
}

# As stiff as it may be at smaller steps: solref is no less than two of them.
SMALL_STEPS = {
    "solref .0005, solimp .9999": (0.0005, 0.9999),
    "solref .0002, solimp .9999": (0.0002, 0.9999),
}

INTEGRATORS = {"Euler": "EULER", "RK4": "RK4", "implicitfast": "IMPLICITFAST"}


@dataclass(frozen=True, eq=False)
class Twin:
    """A robot in both engines.

    Attributes
    ----------
    bridge : MujocoBridge
    model : mujoco.MjModel
        Of `Robot.to_mjcf`, without contacts and joint limits.
    data : mujoco.MjData
    """

    bridge: cp.study.MujocoBridge
    model: Any
    data: Any

    @classmethod
    def of(
        cls,
        robot: cp.Robot,
        setting: str,
        integrator: str,
        dt: float,
        *,
        conservative: bool,
    ) -> Twin:
        """Return a robot in MuJoCo; without damping if it is to conserve energy."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        if conservative:
            model.dof_damping[:] = 0.0
        stiff = (SETTINGS | SMALL_STEPS)[setting]
        if stiff:
            model.eq_solref[:, 0], model.eq_solref[:, 1] = stiff[0], 1.0
            model.eq_solimp[:, :2] = stiff[1]
        by = getattr(mujoco.mjtIntegrator, f"mjINT_{INTEGRATORS[integrator]}")
        model.opt.timestep, model.opt.integrator = dt, by
        return cls(cp.study.MujocoBridge(robot, model), model, mujoco.MjData(model))

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin at a state of Pinocchio."""
        import mujoco

        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.bridge.to_mujoco(q, v)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the present state as Pinocchio has it."""
        return self.bridge.from_mujoco(self.data.qpos, self.data.qvel)

    def physics(self) -> np.ndarray:
        """Return the present state as `mujoco.rollout` takes it."""
        import mujoco

        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state


# --- the table


def answer(rows: Sequence[Row], to: Row, by: str = PYTHON) -> Row | None:
    """Return our fastest way that is at least as accurate as one of MuJoCo, in gap and energy."""
    good = [
        row
        for row in rows
        if row.engine == by and row.problem == to.problem and row.status == "finished"
        if row.violation <= to.violation and row.energy <= to.energy
    ]
    return min(good, key=lambda row: row.us, default=None)


def rows_of(saved: script.Saved) -> list[Row]:
    """Return the rows."""
    return [Row(**row) for row in saved["rows"]]


def table(saved: script.Saved) -> str:
    """Return the whole table, and what it says: every way of MuJoCo with steps of 1 and 4 ms."""
    rows = rows_of(saved)
    who = "us/ms | gap [m] | energy [J] | x |"
    lines = [
        f"| linkage | MuJoCo | gap [m] | energy [J] | us/ms | Python, no less accurate | {who} "
        f"compiled core, no less accurate | {who}",
        "|---" * 15 + "|",
    ]
    lines += [
        f"| {row.problem} | {row.name} | {row.violation:.0e} | {row.energy:.0e} | {row.us:.1f} | "
        f"{_cells(rows, row, PYTHON)} {_cells(rows, row, CORE)}"
        for row in of_mujoco(rows)
        if row.dt in (1e-3, 4e-3)
    ]
    lines += [
        "",
        "us/ms: CPU time per simulated millisecond. x: MuJoCo's time over ours, at no larger gap "
        "and no larger energy error; **below 1 MuJoCo is ahead**, 0 where no setting of condyn_pin "
        "is as accurate. Of its points with steps from 0.5 to 16 ms condyn_pin is ahead at "
        f"{_ahead(rows, PYTHON)} in Python, and at {_ahead(rows, CORE)} by the compiled core.",
    ]
    source = script.source("simulation_vs_mujoco", saved["machine"])
    return "\n".join([*lines, f"{source}; MuJoCo {saved['machine']['mujoco']}."])


def _cells(rows: Sequence[Row], row: Row, by: str) -> str:
    """Return our answer to one way of MuJoCo, as five cells."""
    found = answer(rows, row, by)
    if not found:
        return "none | | | | 0.00 |"
    errors = f"{found.violation:.0e} | {found.energy:.0e}"
    return f"{found.name} | {found.us:.1f} | {errors} | {ratio(rows, row, by):.2f} |"


def _ahead(rows: Sequence[Row], by: str) -> str:
    """Return at how many points of MuJoCo we are ahead, by linkage."""
    ratios: dict[str, list[float]] = {}
    for row in of_mujoco(rows):
        ratios.setdefault(row.problem, []).append(ratio(rows, row, by))
    return ", ".join(
        f"{sum(r >= 1 for r in found)} of {len(found)} on {name} (x from {min(found):.2g} to "
        f"{max(found):.2g})"
        for name, found in ratios.items()
    )


def of_mujoco(rows: Sequence[Row]) -> list[Row]:
    """Return MuJoCo's rows that came to their end with closed loops."""
    return [
        r for r in rows if r.engine == "MuJoCo" and r.status == "finished" and r.violation < LOST
    ]


def ratio(rows: Sequence[Row], row: Row, by: str = PYTHON) -> float:
    """Return MuJoCo's time over ours at no larger errors; 0 where ours are all larger."""
    found = answer(rows, row, by)
    return row.us / found.us if found else 0.0


# --- the picture

_MARKERS = "osd^vP*"  # of the drift schemes, in the order of their registry


def split(method: str) -> tuple[str, str]:
    """Return integrator and drift scheme of 'integrator, scheme'; one that needs none has 'none'.

    Both are named by their titles, or both by their classes.
    """
    integrator, _, scheme = method.rpartition(", ")
    if any(scheme in (kind.title, kind.__name__) for kind in DRIFTS.values()):
        return integrator, scheme
    return method, "none"


class Lines:
    """The lines of some methods, and the legend that explains them."""

    def __init__(self, methods: Iterable[str]) -> None:
        pairs = [split(method) for method in methods]
        self._lines = {name: line(i) for i, name in enumerate(dict.fromkeys(p[0] for p in pairs))}
        used = dict.fromkeys(p[1] for p in pairs)
        self._markers = dict(zip(used, _MARKERS, strict=False))

    def of(self, method: str) -> dict[str, Any]:
        """Return how a method is drawn."""
        integrator, scheme = split(method)
        return self._lines[integrator] | {"marker": self._markers[scheme], "ms": 4, "lw": 1.0}

    def legend(self) -> list[Any]:
        """Return what the legend shows: lines without a marker, and markers without a line."""
        from matplotlib.lines import Line2D

        lines = [Line2D([], [], label=name, **style) for name, style in self._lines.items()]
        markers = [
            Line2D([], [], color="k", ls="", marker=marker, ms=5, label=f"drift: {scheme}")
            for scheme, marker in self._markers.items()
        ]
        return lines + markers


# MuJoCo's ways, all without lines: colours of its constraints, and markers of its integrators.
_STIFFNESS = {"default": "#F0A000", "solref .005": "#D55E00", "solref .002": "#802000"}
_STEPS = {"Euler": "x", "RK4": "+", "implicitfast": "1"}


def _of_mujoco(method: str) -> dict[str, Any]:
    """Return how a way of MuJoCo is drawn, from 'integrator, constraints'."""
    integrator, _, constraints = method.partition(", ")
    colour = next(c for key, c in _STIFFNESS.items() if constraints.startswith(key))
    return {"color": colour, "marker": _STEPS[integrator], "ls": "", "ms": 7, "zorder": 3}


_ERRORS = {"violation": "largest gap", "energy": "largest energy error"}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw gap and energy error against time, a column a linkage."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.problem for row in rows))
    lines = Lines(dict.fromkeys(row.method for row in rows if row.engine == PYTHON))
    figure = Figure(figsize=(4.6 * len(names), 8.4), layout="constrained")
    places = figure.subplots(2, len(names), squeeze=False)
    for j, name in enumerate(names):
        kept = [
            r for r in rows
            if r.problem == name and r.status == "finished" and r.engine != CORE
        ]  # fmt: skip
        curves: dict[tuple[str, str], list[Row]] = {}
        for row in kept:
            curves.setdefault((row.engine, row.method), []).append(row)
        for i, (field, unit) in enumerate((("violation", "m"), ("energy", "J"))):
            ax = places[i, j]
            for (engine, method), points in curves.items():
                x = [row.us for row in points]
                y = [max(getattr(row, field), 1e-17) for row in points]
                ax.plot(x, y, **(_of_mujoco(method) if engine == "MuJoCo" else lines.of(method)))
            ax.set(xscale="log", yscale="log", title=name, ylabel=f"{_ERRORS[field]} [{unit}]")
            ax.set(xlabel="CPU time per simulated ms [us]", ylim=(None, LOST))
            ax.grid(visible=True, color="0.92")
    theirs = [
        Line2D([], [], label=f"MuJoCo {method}", **_of_mujoco(method))
        for method in dict.fromkeys(row.method for row in rows if row.engine == "MuJoCo")
    ]
    shown = theirs + lines.legend()
    figure.legend(handles=shown, loc="outside lower center", ncols=3, frameon=False, fontsize=7)
    figure.savefig(path, dpi=150)


SUBJECTS = [
    Table(
        "simulation_vs_mujoco",
        "error against time of linkages, both engines",
        measure,
        table,
        pages=lambda saved: {script.RESULTS_PAGE: {"mujoco": table(saved)}},
        beside=lambda saved: draw(rows_of(saved), script.result("simulation_vs_mujoco", ".png")),
        quick="one step size; nothing is written",
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
