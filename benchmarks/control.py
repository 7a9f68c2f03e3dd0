"""Time of a control tick: assembly, program, proof; beside each solver on the same program.

    python benchmarks/control.py [--ticks 500] [--springs | --levels]

States move from tick to tick, as under a controller. Writes benchmarks/results/control.csv; "tick"
is all of `Controller.solve`, "program" what answers the program, and the columns of solvers are
their own time on it, with the memory that they keep. Times are medians [us]. "core" is the tick in
the compiled core, if it is there, and "core, share" the median of what it takes of Python's, both
called in turn; "core differs" says by how much torques do, "by the core" how many ticks are its
own. Where there are loops, the same solvers are timed in turn on the program that keeps them,

    x = (a, lam / m),    equations of joints without a motor,    J a = r  of loops and contacts,

and "loops out" is the median of the ratios, of programs that both solve; nan where it solves none
with loops. "a differs" says by how much accelerations do. The last row is that of Cassie on springs
that swing, and "locking" what it takes in Python to lock them.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import machine
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    DAQP,
    CapturePoint,
    CenterOfMass,
    Controller,
    Hierarchy,
    Orientation,
    Posture,
    ProxQP,
    Quadprog,
)
from condyn_pin.control.program import Program
from condyn_pin.control.qp.base import QuadraticProgram
from condyn_pin.control.qp.chain import SolverLadder, _independent
from condyn_pin.mechanism import project_velocity
from condyn_pin.study.tables import write_csv

RESULTS = Path(__file__).resolve().parent / "results" / "control.csv"
SOLVERS = (ProxQP(), DAQP(), Quadprog())
REGULARISATION = 1e-5  # that of a Controller
CASES = {
    "solo12": ("solo12", {}, FrictionCone(0.6, sides=8), "base_link"),
    "cassie": (
        "cassie", {"feet": "lines", "springs": "locked"}, WrenchCone(0.6), "pelvis",
    ),
    "talos": ("talos", {}, WrenchCone(0.5), "base_link"),
}  # fmt: skip


def measured(name: str, ticks: int, labels: Sequence[str]) -> list[dict[str, object]]:
    """Return the rows of one robot: weighted, weighted with cones active, and strict."""
    known, variant, cone, base = CASES[name]
    made = cp.load_robot(known, variant=variant) if variant else cp.load_robot(known)
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    rest = [Orientation(base, weight=50), Posture(weight=0.1)]
    stand = [CenterOfMass(kp=20, weight=100), *rest]
    push = [CenterOfMass(a=(6.0, 0.0, 0.0), weight=100), *rest]
    wished = {"standing": stand, "pushing": push, "levels": Hierarchy(*[[t] for t in stand])}
    rows = []
    for label in labels:
        controller = Controller(scene, wished[label], cones=cone)
        states = _states(scene, ticks)
        row = _ticks(f"{name}, {label}", controller, states)
        if label != "levels":
            row |= _solvers(controller, states)
        row |= _in_core(controller, states)
        rows.append(row)
        if made.loops and label != "levels":
            rows[-1] |= _loops_kept(controller, states)
        print(rows[-1], flush=True)
    return rows


def on_springs(ticks: int) -> dict[str, object]:
    """Return the row of Cassie on springs that swing, by the controller of `standing.py`."""
    made = cp.load_robot("cassie")
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    tasks = [
        CapturePoint(weight=1000),
        Orientation("pelvis", kp=100, weight=0.3),
        Posture(weight=0.1),
    ]
    rigid = [spring.joint for spring in made.springs]
    given = {"rigid": rigid, "drift": cp.Baumgarte.critical(10.0)}
    controller = Controller(scene, tasks, cones=FrictionCone(0.65, sides=8), **given)
    states = _states(scene, ticks)
    row = _ticks("cassie, on springs", controller, states)
    locking, _ = _timed(controller._program.without_swing, states)
    row |= {"locking": _us(locking)} | _in_core(controller, states, **given)
    print(row, flush=True)
    return row


def _ticks(
    case: str, controller: Controller, states: list[tuple[np.ndarray, np.ndarray]]
) -> dict[str, object]:
    """Return what ticks in Python take, and how good they are."""
    times, answers = _timed(controller.solve, states)
    return {
        "case": case,
        "tick": _us(times),
        "program": _us([answer.solve_time for answer in answers]),
        "active rows": max(len(answer.active) for answer in answers),
        "by the last active set": sum(answer.iterations == 0 for answer in answers),
        "worst kkt": max(answer.residuals.kkt for answer in answers),
        "not ok": sum(not answer.status.ok for answer in answers),
    }


def _solvers(controller: Controller, states: list[tuple[np.ndarray, np.ndarray]]) -> dict:
    """Return size of the program, and the time of each solver on it."""
    programs = [(controller.program(q, v),) for q, v in states[:100]]
    found: dict[str, object] = {"size": "x".join(map(str, programs[0][0].sizes))}
    for solver in SOLVERS:
        found[type(solver).__name__] = _us(_timed(solver.start(), programs)[0])
    return found


def _in_core(
    python: Controller, states: list[tuple[np.ndarray, np.ndarray]], **options: Any
) -> dict:
    """Return what ticks take in the compiled core, called in turn with those in Python."""
    try:
        cones = python._settings.cones
        core = Controller(python.scene, python.tasks, cones=cones, native=True, **options)
    except (cp.errors.MissingExtra, cp.errors.UnsupportedBackend):
        return {}
    pairs, differs, answered = [], 0.0, 0
    for state in states:
        of_python, (mine,) = _timed(python.solve, [state])
        of_core, (yours,) = _timed(core.solve, [state])
        pairs.append((of_core[0], of_python[0]))
        differs = max(differs, np.abs(yours.tau - mine.tau).max() / np.abs(mine.tau).max())
        answered += yours.path == ("compiled core",)
    times = np.array(pairs)
    return {
        "core": _us(times[:, 0].tolist()),
        "core, share": round(float(np.median(times[:, 0] / times[:, 1])), 3),
        "core differs": f"{differs:.0e}",
        "by the core": answered,
    }


def _loops_kept(controller: Controller, states: list[tuple[np.ndarray, np.ndarray]]) -> dict:
    """Return what programs without loops take, over what those take that keep them."""
    pairs = []
    for q, v in states[:100]:
        without = controller.program(q, v)  # first: it takes the program to the state
        kept = _independent(keeping_loops(controller._program))
        assert kept is not None
        pairs.append((without, kept))
    found: dict[str, object] = {"size with loops": "x".join(map(str, pairs[0][1].sizes))}
    for solver in SOLVERS:
        candidates = solver.start(), solver.start()
        ratios = []
        for programs in pairs:
            times = []
            for solve, program in zip(candidates, programs, strict=True):
                (taken,), (answer,) = _timed(solve, [(program,)])
                times.append(taken if answer.verdict == "solved" else np.nan)
            ratios.append(times[0] / times[1])
        solved = np.isfinite(ratios)
        ratio = round(float(np.median(np.array(ratios)[solved])), 3) if solved.any() else np.nan
        found[f"{type(solver).__name__}, loops out"] = ratio
    whole = SolverLadder(ProxQP()).solve(pairs[-1][1], lambda: (np.zeros(0), np.zeros(0))).answer
    a = controller.solve(*states[len(pairs) - 1]).a
    assert whole is not None
    differs = np.abs(whole.x[: len(a)] - a).max() / max(1.0, np.abs(a).max())
    return found | {"a differs": f"{differs:.0e}"}


def keeping_loops(program: Program) -> QuadraticProgram:
    """Return the program of the last tick over (a, lam / m), loops among its equations."""
    terms, mass, limits = program.motion.terms, program.mass, program.torque
    columns = program.actuation.columns
    m, n = terms.J.shape
    torques = np.hstack((terms.M / mass, -terms.J.T))  # of all joints, over the mass
    given = (terms.h - program.passive) / mass
    undriven = np.setdiff1d(np.arange(n), columns)
    A = np.vstack((torques[undriven], np.hstack((terms.J, np.zeros((m, m))))))
    b = np.concatenate((-given[undriven], terms.a_ref - terms.gamma))
    limited, most = columns[limits.L.argmax(axis=1)], limits.most / mass
    cones = np.zeros((len(program.cones.names), n + m))
    cones[:, n + program.cones.touching] = program.cones.rows(program.motion.data.oMi)
    C = np.vstack((torques[limited], cones))
    lower = np.concatenate((-most - given[limited], np.full(len(cones), -np.inf)))
    upper = np.concatenate((most - given[limited], np.zeros(len(cones))))
    stack = program.levels[0]
    J, F, wanted = stack.at(program.motion, 0.0)
    G = np.zeros((len(J) + len(F), n + m))
    G[: len(J), :n], G[len(J) :, n:] = J, mass * F
    WG = stack.weights[:, None] * G
    H = G.T @ WG + REGULARISATION * np.eye(n + m)
    return QuadraticProgram(H, -(wanted @ WG), A, b, C, lower, upper)


def _states(scene: cp.Scene, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the states of a slow motion that keeps the contacts."""
    q, _ = scene.state()
    rng = np.random.default_rng(0)
    wish = rng.normal(size=scene.robot.nv)
    found = []
    for k in range(count):
        v = project_velocity(scene, q, 0.1 * np.sin(0.02 * k) * wish)
        found.append((q, v))
        q = pin.integrate(scene.robot.model, q, 1e-3 * v)
    return found


def _timed(function: Callable, cases: list[tuple]) -> tuple[list[float], list]:
    """Return seconds and answers, one a call, after one that counts for nothing."""
    function(*cases[0])
    times, answers = [], []
    for case in cases:
        start = perf_counter()
        answers.append(function(*case))
        times.append(perf_counter() - start)
    return times, answers


def _us(times: list[float]) -> float:
    return round(1e6 * float(np.median(times)), 1)


def main() -> int:
    """Run, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=500)
    parser.add_argument("--csv", type=Path, default=RESULTS)
    alone = parser.add_mutually_exclusive_group()
    alone.add_argument("--springs", action="store_true", help="that row alone, not written")
    alone.add_argument("--levels", action="store_true", help="those rows alone, not written")
    arguments = parser.parse_args()
    labels = ["levels"] if arguments.levels else ["standing", "pushing", "levels"]
    few = arguments.springs or arguments.levels
    rows = []
    if not arguments.springs:
        rows = [row for name in CASES for row in measured(name, arguments.ticks, labels)]
    if not arguments.levels:
        rows.append(on_springs(arguments.ticks))
    columns = list(dict.fromkeys(name for row in rows for name in row))
    if not few:
        write_csv(arguments.csv, machine(), columns, rows)
    return int(any(row["not ok"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
