"""Programs with an answer and without: what the chain of solvers says, against HiGHS.

    python benchmarks/control_statuses.py [--programs 10000] [--states 500]

Random programs, and those of robots whose centre of mass is to be accelerated at random, as an
equation. HiGHS says how far all inequalities of a program can be kept from their bounds at once;
what is at the edge, within 1e-5, counts as neither. Writes benchmarks/results/control_statuses.csv,
and exits with 1 if a status is wrong or an answer does not satisfy its program.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import numpy as np
from programs import largest_slack, random_program

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import KKT
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import QPS, CenterOfMass, Controller, Orientation, Posture
from condyn_pin.control.qp.base import QuadraticProgram
from condyn_pin.control.qp.chain import SolverLadder
from condyn_pin.study.tables import write_csv

RESULTS = Path(__file__).resolve().parent / "results" / "control_statuses.csv"
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


def main() -> int:
    """Run, write the table, and say whether every status is right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=10_000)
    parser.add_argument("--states", type=int, default=500)
    parser.add_argument("--solvers", nargs="*", default=["proxqp", "daqp", "quadprog"])
    parser.add_argument("--csv", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    table: list[Count] = []
    for solver in arguments.solvers:
        counts = {"random": Count("random", solver)}
        rng = np.random.default_rng(0)
        for _ in range(arguments.programs):
            program = random_program(rng)
            counts["random"].add(program, np.ones(len(program.b)))
        for family, program, hard in of_robots(arguments.states):
            counts.setdefault(family, Count(family, solver)).add(program, hard)
        table += counts.values()
        for row in counts.values():
            print(row, flush=True)
    write_csv(arguments.csv, machine(), [each.name for each in fields(Count)], map(asdict, table))
    return int(any(row.wrong or row.unsolved for row in table))


if __name__ == "__main__":
    sys.exit(main())
