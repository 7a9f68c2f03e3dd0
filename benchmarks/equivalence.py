"""Every solver against Reference at random closed states of every robot's scenes.

    python benchmarks/equivalence.py [--states 1000] [--solvers all] [robot ...]

writes benchmarks/results/equivalence.csv, where the rows of solvers that are not named stay, and
exits with 1 if an answer that says ok is off by more than it promises.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.cli.words import solvers_of
from condyn_pin.dynamics.scene import motor_torque, standard_scenes
from condyn_pin.dynamics.workspace import unsupported
from condyn_pin.study.tables import write_csv

RESULTS = Path(__file__).resolve().parent / "results" / "equivalence.csv"


@dataclass(frozen=True)
class Agreement:
    """One solver on one scene.

    Attributes
    ----------
    scene, solver : str
    rows, rank, states : int
    ok, inaccurate, singular, not_finite : int
        How many states ended with which status.
    error : float
        Worst error of a among those that say ok, relative to the larger of |a| and gravity.
    force_error : float
        The same of J^T lam, relative to the larger of it and the weight.
    iterations : int
        The most.
    """

    scene: str
    solver: str
    rows: int
    rank: int
    states: int
    ok: int
    inaccurate: int
    singular: int
    not_finite: int
    error: float
    force_error: float
    iterations: int

    @property
    def is_honest(self) -> bool:
        """Whether every answer that says ok is within what ok promises."""
        return not self.ok or self.error < SOLVED


def agreements(label: str, scene: cp.Scene, count: int, solvers: str = "all") -> list[Agreement]:
    """Compare solvers that take the scene with Reference, on the same random states."""
    contenders = list(_contenders(scene, solvers))
    if not contenders:
        return []
    rng = np.random.default_rng(0)
    states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    reference = cp.Workspace(scene, cp.dynamics.Reference())
    truth = [reference.solve(*state) for state in states]
    forces = [reference.jacobian(state[0]).T for state in states]
    return [
        _agreement(label, name, cp.Workspace(scene, solver), states, truth, forces)
        for name, solver in contenders
    ]


def _contenders(scene: cp.Scene, solvers: str) -> Iterator[tuple[str, cp.dynamics.Solver]]:
    """Yield every named solver that takes the scene, and damped those that need it."""
    mu = float(f"{1e-11 * scene.nominal.delassus_norm:.1e}")
    for solver in solvers_of(solvers):
        if not unsupported(scene, solver):
            name = type(solver).__name__
            yield name, solver
            if scene.nominal.redundant and not solver.takes_redundant:
                yield f"{name}(mu={mu})", type(solver)(mu=mu)


def _agreement(
    label: str,
    name: str,
    workspace: cp.Workspace,
    states: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    truth: Sequence[cp.dynamics.Solution],
    transposed: Sequence[np.ndarray],
) -> Agreement:
    scene = workspace.scene
    found = [workspace.solve(*state, throw=False) for state in states]
    error = force_error = 0.0
    for one, right, JT in zip(found, truth, transposed, strict=True):
        if one.status.ok:
            error = max(error, _relative(one.a, right.a, scene.nominal.estimator.gravity))
            force = _relative(JT @ one.lam, JT @ right.lam, scene.nominal.weight)
            force_error = max(force_error, force)
    count = {status: sum(one.status is status for one in found) for status in cp.Status}
    return Agreement(
        label,
        name,
        scene.rows,
        scene.nominal.rank,
        len(states),
        **{status.name.lower(): number for status, number in count.items()},
        error=error,
        force_error=force_error,
        iterations=max(one.iterations for one in found),
    )


def _relative(x: np.ndarray, right: np.ndarray, floor: float) -> float:
    return float(np.abs(x - right).max() / max(np.abs(right).max(), floor))


def _others(path: Path, solvers: str) -> tuple[list[dict[str, str]], dict[str, str]]:
    """Return the rows of a table that are of none of these solvers, and what its head is to say."""
    if solvers == "all":
        return [], {}
    named = {type(solver).__name__ for solver in solvers_of(solvers)}
    lines = path.read_text().splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("#"))
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    kept = [row for row in rows if row["solver"].partition("(")[0] not in named]
    others = f"of {head['date']}, condyn_pin {head['condyn_pin']}"
    return kept, {"rows but of " + ", ".join(sorted(named)): others}


def main() -> int:
    """Run, write the table, and say whether every ok is one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(cp.io.available_robots()))
    parser.add_argument("--states", type=int, default=1000)
    parser.add_argument("--solvers", default="all", help="names of `condyn solvers`, with commas")
    parser.add_argument("--csv", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    table: list[Agreement] = []
    for name in arguments.robots:
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            table += agreements(label, scene, arguments.states, arguments.solvers)
            print(label, flush=True)
    columns = [field.name for field in fields(Agreement)]
    others, said = _others(arguments.csv, arguments.solvers)
    rows = [*others, *map(asdict, table)]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    rows.sort(key=lambda row: scenes.index(row["scene"]))
    write_csv(arguments.csv, machine() | said, columns, rows)
    lies = [row for row in table if not row.is_honest]
    for row in lies:
        print(f"{row.scene}, {row.solver}: off by {row.error:.1e} where it says ok")
    return 1 if lies else 0


if __name__ == "__main__":
    sys.exit(main())
