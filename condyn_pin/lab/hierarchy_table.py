"""HierarchyTable: the models of a ladder with their speed and their price."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from condyn_pin._core import tolerances
from condyn_pin._core.files.beside import write_text
from condyn_pin._core.table_text import markdown, nulled, write_csv


@dataclass(frozen=True)
class HierarchyRow:
    """One model; NaN where no solver said ok at every state.

    Attributes
    ----------
    label, why : str
    nv, rows, rank, mobility : int
    solver : str
        The fastest that says ok at every state.
    us : float
        `Workspace.acceleration` with it, median [us].
    speedup : float
        Times faster than the first model, median of ratios within a round.
    a_worst, a_median : float
        Error of the accelerations of floating base and motors against the first model, relative to
        the larger of |a| and gravity.
    force_worst, force_median : float
        Error of the wrench of all contacts, relative to the larger of it and the weight.
    a_step, force_step : float
        The worst errors against the model above: the price of this step alone.
    slower_as : str
        Why it is slower than a model above, if the solver of that one cannot take it; empty if not.
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
    a_step: float
    force_step: float
    slower_as: str = ""


@dataclass(frozen=True)
class HierarchyTable:
    """The models of one ladder, the states that they were compared at, and the machine.

    Attributes
    ----------
    name : str
        Of the ladder.
    rows : tuple of HierarchyRow
        The first model, and those below it.
    states : int
        How many motions they were compared at.
    machine : dict of str to str
    """

    name: str
    rows: tuple[HierarchyRow, ...]
    states: int
    machine: dict[str, str]

    def fastest(self, error: float) -> HierarchyRow:
        """Return the fastest model whose errors all stay below `error`."""
        good = [r for r in self.rows if max(r.a_worst, r.force_worst) <= error]
        return max(good, key=lambda row: row.speedup if math.isfinite(row.speedup) else 0.0)

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, after comment lines with the machine."""
        write_ladders([self], path)

    def to_json(self, path: str | Path) -> None:
        """Write name, machine and rows; what was not measured is null."""
        write_text(path, json.dumps(self.as_dict(), indent=1) + "\n")

    def as_dict(self) -> dict[str, Any]:
        """Return the table as plain values."""
        rows = [nulled(asdict(row)) for row in self.rows]
        return {"ladder": self.name, "states": self.states, "machine": self.machine, "rows": rows}

    def to_markdown(self) -> str:
        """Return the table for a README."""
        return markdown((self.name, *COLUMNS[1:]), self.cells())

    def cells(self) -> list[tuple[str, ...]]:
        """Return the table as text, the columns being `COLUMNS`."""
        return [
            (
                row.label,
                str(row.nv),
                f"{row.rows}, rank {row.rank}",
                row.solver + (f"; {row.slower_as}" if row.slower_as else ""),
                f"{row.us:.1f}",
                f"{row.speedup:.2f}",
                f"{_text(row.a_worst)} / {_text(row.a_step)}",
                f"{_text(row.force_worst)} / {_text(row.force_step)}",
            )
            for row in self.rows
        ]

    def __str__(self) -> str:
        rows = [COLUMNS, *self.cells()]
        widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        return "\n".join(lines)


COLUMNS = (
    "model", "nv", "rows", "solver", "a [us]", "x faster",
    "error of a: all / this step", "of contact wrench: all / this step",
)  # fmt: skip


def write_ladders(tables: Sequence[HierarchyTable], path: str | Path) -> None:
    """Write the rows of ladders that were measured together, after lines with the machine."""
    columns = ["ladder", *(field.name for field in fields(HierarchyRow))]
    rows = ({"ladder": table.name} | asdict(row) for table in tables for row in table.rows)
    write_csv(path, tables[0].machine, columns, rows)


def _text(error: float) -> str:
    return f"{100 * error:.2g} %" if error >= tolerances.EXACT else "0"
