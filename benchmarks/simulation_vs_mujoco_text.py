"""What is said and drawn of linkages in MuJoCo and here: rows of simulation_vs_mujoco.py."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import marks
from method_lines import Lines

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


def load(path: Path) -> tuple[list[Row], dict[str, str]]:
    """Return the rows that `main` wrote, and what they were taken on."""
    saved = json.loads(path.read_text(encoding="utf-8"))
    return [Row(**row) for row in saved["rows"]], saved["machine"]


def answer(rows: Sequence[Row], to: Row, by: str = PYTHON) -> Row | None:
    """Return our fastest way that is at least as accurate as one of MuJoCo, in gap and energy."""
    good = [
        row
        for row in rows
        if row.engine == by and row.problem == to.problem and row.status == "finished"
        if row.violation <= to.violation and row.energy <= to.energy
    ]
    return min(good, key=lambda row: row.us, default=None)


def markdown(rows: Sequence[Row], about: dict[str, str]) -> str:
    """Return the whole table, and what it says: every way of MuJoCo with steps of 1 and 4 ms."""
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
    where = (
        "`python benchmarks/simulation_vs_mujoco.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, Pinocchio {pinocchio}, MuJoCo {mujoco}, {date}."
    )
    return "\n".join([*lines, where.format(**about)])


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


def pages(rows: Sequence[Row], about: dict[str, str]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"mujoco": markdown(rows, about)}}


# MuJoCo's ways, all without lines: colours of its constraints, and markers of its integrators.
_STIFFNESS = {"default": "#F0A000", "solref .005": "#D55E00", "solref .002": "#802000"}
_STEPS = {"Euler": "x", "RK4": "+", "implicitfast": "1"}


def _of_mujoco(method: str) -> dict[str, Any]:
    """Return how a way of MuJoCo is drawn, from 'integrator, constraints'."""
    integrator, _, constraints = method.partition(", ")
    colour = next(c for key, c in _STIFFNESS.items() if constraints.startswith(key))
    return {"color": colour, "marker": _STEPS[integrator], "ls": "", "ms": 7, "zorder": 3}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw gap and energy error against time, a column a linkage."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.problem for row in rows))
    lines = Lines(dict.fromkeys(row.method for row in rows if row.engine == PYTHON))
    figure = Figure(figsize=(6 * len(names), 10), layout="constrained")
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
            ax.set(xscale="log", yscale="log", title=f"{name}: {field} error [{unit}]")
            ax.set(xlabel="CPU time per simulated ms [us]", ylim=(None, LOST))
            ax.grid(visible=True, color="0.92")
    theirs = [
        Line2D([], [], label=f"MuJoCo {method}", **_of_mujoco(method))
        for method in dict.fromkeys(row.method for row in rows if row.engine == "MuJoCo")
    ]
    shown = theirs + lines.legend()
    figure.legend(handles=shown, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)
