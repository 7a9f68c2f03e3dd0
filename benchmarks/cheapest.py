"""Ask the committed study for the cheapest solver of every scene, and verify each at 1000 states.

    python benchmarks/cheapest.py [--states 1000] [--table benchmarks/results/trade.json]

writes benchmarks/results/cheapest.csv, and exits with 1 if a solver that was chosen to meet an
error does not meet it at one of the states, which neither the study nor the choice has seen; or if
a scene of the catalogue is not in the study, or nothing in it meets an error. What is measured here
are errors: they do not depend on what else the machine does, and every core is used.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import condyn_pin as cp
from condyn_pin._core.work import map_chunks
from condyn_pin.dynamics.scene import standard_scenes
from condyn_pin.study.fresh import FreshErrors
from condyn_pin.study.measures import MEASURES
from condyn_pin.study.states import SampledStates
from condyn_pin.study.tables import write_csv

RESULTS = Path(__file__).resolve().parent / "results"
LEVELS = (1e-3, 1e-6, 1e-9)
MEASURE = "acceleration"
SEED = 1000  # neither the study's nor that of `Table.cheapest`


@dataclass(frozen=True)
class Verdict:
    """The cheapest solver of a scene to an error, and what it gave where nobody had looked.

    Attributes
    ----------
    scene : str
    rows : int
    error : float
        What was asked for.
    solver : str
        With the parameters that are not as usual; empty if nothing meets the error.
    us : float
        Median time [us].
    study, fresh, expected : float
        Worst error in the study, at the fresh states of the choice, and expected over a
        hundred times as many.
    rejected : int
        Faster solvers that met the error in the study, and not at the fresh states.
    states : int
        Of the verification.
    worst : float
        Worst error there.
    holds : bool
    note : str
        Why nothing was chosen.
    """

    scene: str
    rows: int
    error: float
    solver: str = ""
    us: float = 0.0
    study: float = 0.0
    fresh: float = 0.0
    expected: float = 0.0
    rejected: int = 0
    states: int = 0
    worst: float = 0.0
    holds: bool = False
    note: str = ""


def verdicts(
    table: cp.study.Table,
    scenes: Mapping[str, cp.Scene],
    states: int,
    executor: Executor | None = None,
) -> Iterator[list[Verdict]]:
    """Yield what was chosen for a scene at every level, verified; scene by scene as they come."""
    known = table.of(measure=MEASURE)
    measured = {row.scene for row in known.rows}
    tasks = []
    for label, scene in scenes.items():
        if label in measured:
            rows = known.of(scene=label).rows
            tasks.append((replace(known, rows=rows, scenes={label: scene}), states))
        else:
            yield [Verdict(label, scene.rows, level, note="not in the study") for level in LEVELS]
    for _, found in map_chunks(verified, tasks, executor=executor):
        yield found


def verified(task: tuple[cp.study.Table, int]) -> list[Verdict]:
    """Choose for the one scene of a table at every level, and verify at some other states."""
    table, states = task
    ((label, scene),) = table.scenes.items()
    others = FreshErrors(scene, MEASURES[MEASURE](), SampledStates(states, SEED))
    return [verdict(table, label, level, others) for level in LEVELS]


def verdict(table: cp.study.Table, label: str, level: float, others: FreshErrors) -> Verdict:
    """Choose for one scene and level, and verify at other states."""
    rows = table.scenes[label].rows
    try:
        choice = table.cheapest(level, measure=MEASURE, scene=label)
    except cp.errors.NotReached as error:
        return Verdict(label, rows, level, note=str(error))
    there = others(choice.solver)
    return Verdict(
        scene=label,
        rows=rows,
        error=level,
        solver=choice.row.short,
        us=choice.row.median_us or 0.0,
        study=choice.row.error_worst,
        fresh=choice.fresh.error,
        expected=choice.fresh.expected,
        rejected=len(choice.rejected),
        states=there.states,
        worst=there.error,
        holds=there.error <= level,
    )


def catalogue(robots: Sequence[str] = ()) -> dict[str, cp.Scene]:
    """Return the standard scenes of every robot, or of some, that have constraints."""
    return {
        label: scene
        for name in robots or cp.io.available_robots()
        for label, scene in standard_scenes(cp.load_robot(name)).items()
        if scene.rows
    }


def read(path: Path = RESULTS / "cheapest.csv") -> list[Verdict]:
    """Return the verdicts that were written."""
    kinds = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
    with path.open(encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [Verdict(**{f.name: kinds[str(f.type)](row[f.name]) for f in fields(Verdict)})
                for row in rows]  # fmt: skip


def verify(table: cp.study.Table, scenes: Mapping[str, cp.Scene], states: int) -> list[Verdict]:
    """Return all verdicts in the order of the scenes, and print each scene's as they come."""
    found: dict[str, list[Verdict]] = {}
    with cp.Processes() as executor:
        for some in verdicts(table, scenes, states, executor):
            found[some[0].scene] = some
            for one in some:
                print(said(one), flush=True)
    return [one for label in scenes for one in found[label]]


def said(one: Verdict) -> str:
    """Return a verdict in a line."""
    what = f"{one.solver}: {one.us:.1f} us, worst {one.worst:.1e}" if one.solver else one.note
    return f"{one.scene}, {one.error:g}: {what}{'' if one.holds else '  FAILS'}"


def write(found: Sequence[Verdict], path: Path, where: Mapping[str, str]) -> None:
    """Write verdicts, after comment lines with the machine."""
    columns = [field.name for field in fields(Verdict)]
    write_csv(path, where, columns, (asdict(one) for one in found))


def main() -> int:
    """Choose, verify, write, and say whether every choice holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=1000)
    parser.add_argument("--table", type=Path, default=RESULTS / "trade.json")
    parser.add_argument("--csv", type=Path, default=RESULTS / "cheapest.csv")
    arguments = parser.parse_args()
    table = cp.study.Table.from_json(arguments.table)
    found = verify(table, catalogue(), arguments.states)
    write(found, arguments.csv, table.machine)
    return 0 if all(one.holds for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
