"""Ticks of whole-body control: their time, what they say of hard programs, and tsid and placo.

    python benchmarks/control.py ticks [--ticks 500] [--springs | --levels]
    python benchmarks/control.py statuses [--programs 10000] [--states 500]
    python benchmarks/control.py peers [--quick] [--folder build/peers] [--passes 5]

ticks: states move from tick to tick, as under a controller. "tick" is all of `Controller.solve`,
"program" what answers the program, and the columns of solvers are their own time on it, with the
memory that they keep. Times are medians [us]. "core" is the tick in the compiled core, if it is
there, and "core, share" the median of what it takes of Python's, both called in turn; "core
differs" says by how much torques do, "by the core" how many ticks are its own. Where there are
loops, the same solvers are timed in turn on the program that keeps them,

    x = (a, lam / m),    equations of joints without a motor,    J a = r  of loops and contacts,

and "loops out" is the median of the ratios, of programs that both solve; nan where it solves none
with loops. "a differs" says by how much accelerations do. The last row is that of Cassie on springs
that swing, and "locking" what it takes in Python to lock them.

statuses: programs with an answer and without: what the chain of solvers says, against HiGHS. Random
programs, and those of robots whose centre of mass is to be accelerated at random, as an equation.
HiGHS says how far all inequalities of a program can be kept from their bounds at once; what is at
the edge, within 1e-5, counts as neither. 1 if a status is wrong or an answer does not satisfy its
program.

peers: Talos stands; times as factors of Pinocchio's ABA. `peers/control/` has the question, the
clock, and a script for each library, run in an environment of its own.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any
from xml.etree import ElementTree

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests"))

import numpy as np
import script
from peers.environments import Environment, Missing
from peers.run import run_script
from programs import largest_slack, random_program
from script import Printed, Table

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import KKT
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    DAQP,
    QPS,
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
from condyn_pin.control.qp.chain import SolverLadder, _independent
from condyn_pin.control.qp.qp_solver import QuadraticProgram
from condyn_pin.io.description import example_robot_data
from condyn_pin.mechanism import project_velocity

# --- ticks

SOLVERS = (ProxQP(), DAQP(), Quadprog())
REGULARISATION = 1e-5  # that of a Controller
CASES = {
    "solo12": ("solo12", {}, FrictionCone(0.6, sides=8), "base_link"),
    "cassie": (
        "cassie", {"feet": "lines", "springs": "locked"}, WrenchCone(0.6), "pelvis",
    ),
    "talos": ("talos", {}, WrenchCone(0.5), "base_link"),
}  # fmt: skip


def rows_of_robot(name: str, ticks: int, labels: Sequence[str]) -> list[dict[str, object]]:
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
        core = Controller(python.scene, python.tasks, cones=cones, engine="core", **options)
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


def ticks(given: Namespace) -> int:
    """Measure and write; 1 if a tick is not ok."""
    labels = ["levels"] if given.levels else ["standing", "pushing", "levels"]
    rows = []
    if not given.springs:
        rows = [row for name in CASES for row in rows_of_robot(name, given.ticks, labels)]
    if not given.levels:
        rows.append(on_springs(given.ticks))
    if not (given.springs or given.levels):
        script.write(given.csv, rows, machine())
    return int(any(row["not ok"] for row in rows))


# --- statuses

EDGE = 1e-5


@dataclass
class Count:
    """One solver at the head of the chain, on one family of programs.

    Attributes
    ----------
    feasible, infeasible, edge : int
        Programs, as HiGHS has them.
    wrong : int
        Where the chain says otherwise, or an answer does not satisfy its program.
    unsolved : int
        Feasible, said to be so, and without an answer.
    by_itself : int
        Feasible, and answered by the solver at the head.
    kkt : float
        The largest residual of an answer.
    """

    family: str
    solver: str
    feasible: int = 0
    infeasible: int = 0
    edge: int = 0
    wrong: int = 0
    unsolved: int = 0
    by_itself: int = 0
    kkt: float = 0.0

    def add(self, program: QuadraticProgram, hard: np.ndarray) -> None:
        """Ask the chain, from a cold start, and compare."""
        slack = largest_slack(program)
        if slack is not None and abs(slack) < EDGE:
            self.edge += 1
            return
        chain = SolverLadder(QPS[self.solver]())
        found = chain.solve(program, lambda: (hard, np.ones(len(program.lower))))
        if slack is None or slack < 0:
            self.infeasible += 1
            self.wrong += found.elastic is None
            return
        self.feasible += 1
        self.wrong += found.elastic is not None
        self.unsolved += found.elastic is None and not found.solved
        if found.answer is not None and found.solved:
            self.by_itself += len(found.path) == 1
            self.kkt = max(self.kkt, found.answer.residual)
            x = found.answer.x
            off = max(
                np.abs(program.A @ x - program.b).max(initial=0.0),
                np.maximum(program.C @ x - program.upper, program.lower - program.C @ x).max(),
            )
            self.wrong += bool(off > KKT)


def of_robots(count: int) -> Iterator[tuple[str, QuadraticProgram, np.ndarray]]:
    """Yield programs of robots that are to accelerate in any direction."""
    for name, cone, base in (
        ("solo12", FrictionCone(0.6, sides=8), "base_link"),
        ("talos", WrenchCone(0.5), "base_link"),
    ):
        made = cp.load_robot(name)
        scene = cp.Scene(made, made.contacts)
        rng = np.random.default_rng(0)
        for _ in range(count):
            q, v = scene.sample(rng, spread=0.02, speed=0.3)
            push = CenterOfMass(a=rng.normal(size=3) * (4.0, 4.0, 8.0), weight=np.inf)
            tasks = [push, Orientation(base, weight=50), Posture(weight=0.1)]
            program = Controller(scene, tasks, cones=cone).program(q, v)
            # what gives is the push, whose rows are the last
            hard = np.where(np.arange(len(program.b)) < len(program.b) - 3, np.inf, 1.0)
            yield name, program, hard


def statuses(given: Namespace) -> int:
    """Count and write; 1 if a status is wrong."""
    table: list[Count] = []
    for solver in given.solvers:
        counts = {"random": Count("random", solver)}
        rng = np.random.default_rng(0)
        for _ in range(given.programs):
            program = random_program(rng)
            counts["random"].add(program, np.ones(len(program.b)))
        for family, program, hard in of_robots(given.states):
            counts.setdefault(family, Count(family, solver)).add(program, hard)
        table += counts.values()
        for row in counts.values():
            print(row, flush=True)
    script.write(given.csv, map(asdict, table), machine())
    return int(any(row.wrong or row.unsolved for row in table))


# --- peers

STATES = 100

OURS = "condyn_pin"
# wheels of Pinocchio before 4 leave open which urdfdom and tinyxml2 they were built with
OLD_PARSERS = ("cmeel-urdfdom<5", "cmeel-tinyxml2<11")
ENVIRONMENTS = (
    # tsid 1.10 asks for any Pinocchio, takes 4.1, and crashes in its RobotWrapper
    Environment("tsid", ("tsid==1.7.1", "pin==3.4.0", *OLD_PARSERS, "numpy"), ("with_tsid",)),
    Environment("placo", ("placo==0.10.2", "numpy"), ("with_placo",)),
)


def peers(given: Namespace) -> script.Saved:
    """Measure all passes; kept are rows, and who is missing, with the reason."""
    from peers.control.with_condyn import active, question_of

    about, folder = script.measured_on(), given.folder.resolve()
    passes, effort = (1, 0.2) if given.quick else (given.passes, 1.0)
    folder.mkdir(parents=True, exist_ok=True)
    first = question_of(str(bare_description(folder)), STATES)
    told = [first.save(folder / "question.json")]
    told += [each.save(folder / f"active{i}.json") for i, each in enumerate(active(first))]
    jobs = [(name, Path(sys.executable)) for name in ("with_condyn", "with_condyn_core")]
    missing = {}
    for environment in ENVIRONMENTS:
        try:
            python = environment.make(folder)
            jobs += [(name, python) for name in environment.scripts]
        except Missing as why:
            missing[environment.name] = str(why)
    rows = []
    for number in range(passes):
        for name, python in jobs:
            print(f"pass {number + 1} of {passes}: {name}", flush=True)
            output = folder / f"control-{name}.json"
            try:
                rows.append(run_script(python, f"control.{name}", told, output, effort))
            except Missing as why:
                missing[name] = str(why)
    # NaN is no number of json
    kept = [{key: None if x != x else x for key, x in row.items()} for row in rows]
    return {**about, "missing": missing, "rows": kept}


def rows_of(saved: script.Saved) -> list[dict[str, Any]]:
    """Return the rows."""
    return [
        {key: float("nan") if x is None else x for key, x in row.items()} for row in saved["rows"]
    ]


def peers_table(saved: script.Saved) -> str:
    """Return the table, and what it means."""
    rows, on = rows_of(saved), script.EVERYTHING.replace(", Pinocchio {pinocchio}", "")
    lines = [
        "| library | program solved [x ABA] | whole tick [x ABA] | tick [us] | ABA [us] | size "
        "| equations of motion [N m] | feet [m/s^2] | CoM [m/s^2] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for peer in dict.fromkeys(row["peer"] for row in rows):
        mine = [row for row in rows if row["peer"] == peer]
        last = mine[-1]
        cells = (
            f"{peer} {last['version']}, Pinocchio {last['pinocchio']}",
            _factor(mine, "program"),
            _factor(mine, "tick"),
            f"{min(r['tick_min_us'] for r in mine):.0f} "
            f"({median(r['tick_median_us'] for r in mine):.0f})",
            f"{min(r['aba_min_us'] for r in mine):.1f}",
            last["size"],
            f"{last['dynamics']:.0e}",
            f"{last['feet']:.0e}",
            f"{last['com']:.0e}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", *_active(rows)]
    notes = {row["peer"]: row["note"] for row in rows if row["note"]}
    lines += [
        "",
        "Talos on both feet, the same tasks, weights, limits and states; no inequality is active. "
        "Factors are relative to Pinocchio's ABA, called from Python in the same environment "
        "between the ticks: the ratio of minima, as the median of the passes with the smallest and "
        "the largest, and the ratio of medians in brackets. Times: the minimum, and the median. "
        "Errors are the worst over the states: the equations of motion by Newton-Euler; the "
        "acceleration of the feet, which should be zero; and the error of the centre of mass, "
        "against which other tasks weigh.",
        "",
        *(f"- {peer}: {note}." for peer, note in notes.items()),
        *(f"- Not there: {name}: {why}." for name, why in saved["missing"].items()),
        "",
        f"{script.source('control peers', saved['machine'], on)}; {STATES} states.",
    ]
    return "\n".join(lines)


def bare_description(folder: Path) -> Path:
    """Write Talos without its meshes, which not every parser finds, and return the path."""
    tree = ElementTree.parse(example_robot_data() / "talos_data/robots/talos_reduced.urdf")
    for link in tree.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    path = folder / "talos.urdf"
    tree.write(path)
    return path


def _active(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the table of questions in which inequalities are active."""
    last = {row["peer"]: row["active"] for row in rows}
    peers = [peer for peer in last if peer != OURS]
    lines = [
        f"| the mass is drawn | {OURS}: objective | motors at their limit | "
        + " | ".join(f"{peer}: more by | motors" for peer in peers)
        + " |",
        "|---" * (3 + 2 * len(peers)) + "|",
    ]
    for i, ours in enumerate(last[OURS]):
        cells = [ours["title"]]
        for peer in (OURS, *peers):
            row = last[peer][i]
            if row["answer"] != "ok":
                cells += [row["answer"].splitlines()[0], ""]
                continue
            more = row["objective"] - ours["objective"]
            cells.append(f"{ours['objective']:.7g}" if peer == OURS else f"{more:+.1e}")
            cells.append(str(row["motors"]))
        lines.append("| " + " | ".join(cells) + " |")
    return [
        *lines,
        "",
        "At rest in the posture, where soles, friction and motors give no more. The objective is "
        "sum w |J a - wanted|^2 of mass, trunk and joints [m^2/s^4, rad^2/s^4], of each answer by "
        "its own Pinocchio; a smaller one is better, and ours has to be that of tsid, whose cones "
        "are the same and whose forces have a weight of 1e-9 here. placo does not limit "
        "the moment about the normal of a sole, which lets it do more where friction counts.",
    ]


def _factor(rows: Sequence[dict[str, Any]], name: str) -> str:
    """Return a time over that of ABA: of least times with its spread, and of medians."""
    least = [row[f"{name}_min_us"] / row["aba_min_us"] for row in rows]
    if any(value != value for value in least):
        return ""
    middle = median(row[f"{name}_median_us"] / row["aba_median_us"] for row in rows)
    return f"{median(least):.1f}, {min(least):.1f}-{max(least):.1f} ({middle:.1f})"


def _ticks_options(parser: ArgumentParser) -> None:
    parser.add_argument("--ticks", type=int, default=500)
    parser.add_argument("--csv", type=Path, default=script.result("control ticks", ".csv"))
    alone = parser.add_mutually_exclusive_group()
    alone.add_argument("--springs", action="store_true", help="that row alone, not written")
    alone.add_argument("--levels", action="store_true", help="those rows alone, not written")


def _statuses_options(parser: ArgumentParser) -> None:
    parser.add_argument("--programs", type=int, default=10_000)
    parser.add_argument("--states", type=int, default=500)
    parser.add_argument("--solvers", nargs="*", default=["proxqp", "daqp", "quadprog"])
    parser.add_argument("--csv", type=Path, default=script.result("control statuses", ".csv"))


def _peers_options(parser: ArgumentParser) -> None:
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=script.ROOT / "build" / "peers")


SUBJECTS = [
    Printed("control ticks", "time of a tick, beside each solver", ticks, _ticks_options),
    Printed("control statuses", "hard programs, against HiGHS", statuses, _statuses_options),
    Table(
        "control peers",
        "a tick beside tsid and placo, as factors of Pinocchio's ABA",
        peers,
        peers_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"control_peers": peers_table(saved)}},
        quick="one short pass; nothing is written",
        options=_peers_options,
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
