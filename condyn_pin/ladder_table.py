"""LadderTable: the rungs of a ladder with their speed and their price."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class LadderRow:
    """One rung; NaN where no solver said ok at every state.

    Attributes
    ----------
    label, why : str
    nv, rows, rank, mobility : int
    solver : str
        The fastest that says ok at every state.
    us : float
        `Workspace.acceleration` with it, median [us].
    speedup : float
        Times faster than the first rung, median of ratios within a round.
    a_worst, a_median : float
        Error of the accelerations of floating base and motors against the first rung, relative to
        the larger of |a| and gravity.
    force_worst, force_median : float
        Error of the wrench of all contacts, relative to the larger of it and the weight.
    """

    label: str
    why: str
    nv: int
    rows: int
    rank: int
    mobility: int
    solver: str
    us: float
    speedup: float
    a_worst: float
    a_median: float
    force_worst: float
    force_median: float


@dataclass(frozen=True)
class LadderTable:
    """The rungs of one ladder, the states that they were compared at, and the machine."""

    name: str
    rows: tuple[LadderRow, ...]
    states: int
    machine: dict[str, str]

    def fastest(self, error: float) -> LadderRow:
        """Return the fastest rung whose errors all stay below `error`."""
        good = [r for r in self.rows if max(r.a_worst, r.force_worst) <= error]
        return max(good, key=lambda row: row.speedup if math.isfinite(row.speedup) else 0.0)

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, after comment lines with the machine."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            for key, value in self.machine.items():
                file.write(f"# {key}: {value}\n")
            writer = csv.DictWriter(file, ["ladder", *(f.name for f in fields(LadderRow))])
            writer.writeheader()
            writer.writerows({"ladder": self.name} | asdict(row) for row in self.rows)

    def to_json(self, path: str | Path) -> None:
        """Write name, machine and rows; what was not measured is null."""
        Path(path).write_text(json.dumps(self.as_dict(), indent=1) + "\n", encoding="utf-8")

    def as_dict(self) -> dict[str, Any]:
        """Return the table as plain values."""
        rows = [{k: _plain(x) for k, x in asdict(row).items()} for row in self.rows]
        return {"ladder": self.name, "states": self.states, "machine": self.machine, "rows": rows}

    def markdown(self) -> str:
        """Return the table for a README."""
        lines = [
            f"| {self.name} | nv | rows | solver | a [us] | x faster | error of a, worst (median) "
            "| of the contact wrench |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for row in self.rows:
            cells = (
                row.label,
                str(row.nv),
                f"{row.rows}, rank {row.rank}",
                row.solver,
                f"{row.us:.1f}",
                f"{row.speedup:.2f}",
                _errors(row.a_worst, row.a_median),
                _errors(row.force_worst, row.force_median),
            )
            lines.append("| " + " | ".join(cells) + " |")
        return "\n".join(lines)

    def __str__(self) -> str:
        lines = []
        for row in self.rows:
            lines.append(
                f"{row.label}: nv {row.nv}, {row.rows} rows, {row.us:.1f} us ({row.solver}), "
                f"x {row.speedup:.2f}, error of a {_errors(row.a_worst, row.a_median)}, "
                f"of the contact wrench {_errors(row.force_worst, row.force_median)}"
            )
        return "\n".join(lines)


def _errors(worst: float, median: float) -> str:
    return f"{worst:.1e} ({median:.1e})" if worst >= 1e-9 else "none"


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
