"""A Table as csv, json and Markdown, and back from json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from condyn_pin._core import table_text
from condyn_pin._core.files.beside import write_text
from condyn_pin._core.files.text import parse_json, read_text
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.row import Row

if TYPE_CHECKING:
    from condyn_pin.study.table import Table

FORMAT = 1  # of the json file; one more whenever a field changes its meaning


def write_csv(table: Table, path: str | Path) -> None:
    """Write the rows, after comment lines with the machine."""

    def in_words(row: Row) -> dict[str, Any]:
        words = {name: words_of(getattr(row, name)) for name in ("parameters", "how")}
        return asdict(row) | words | {"statuses": status_words(row)}

    columns = [field.name for field in fields(Row)]
    table_text.write_csv(path, table.machine, columns, map(in_words, table.rows))


def as_dict(table: Table) -> dict[str, Any]:
    """Return machine, floors and rows as plain values."""
    return {
        "format": FORMAT,
        "machine": table.machine,
        "floors": table.floors,
        "rows": [row.as_dict() for row in table.rows],
    }


def write_json(table: Table, path: str | Path) -> None:
    """Write machine, floors and rows, a line each; what was not measured is null."""
    parts = as_dict(table)
    rows = ",\n".join(json.dumps(row, allow_nan=False) for row in parts.pop("rows"))
    head = json.dumps(parts, indent=1, allow_nan=False).removesuffix("\n}")
    write_text(path, f'{head},\n "rows": [\n{rows}\n]}}\n')


def read_json(path: str | Path) -> tuple[tuple[Row, ...], dict[str, str], dict[str, float]]:
    """Return rows, machine and floors of a file that `write_json` wrote."""
    try:
        saved = parse_json(read_text(path))
        if saved["format"] != FORMAT:
            raise ValueError(f"its format is {saved['format']!r}, and {FORMAT} is known here")
        rows = tuple(Row.from_dict(row) for row in saved["rows"])
        return rows, dict(saved["machine"]), dict(saved["floors"])
    except (OSError, LookupError, TypeError, ValueError) as error:
        raise InvalidArgument(
            f"{path}: not a table that Table.to_json wrote ({error}); run the study again"
        ) from error


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a table in Markdown."""
    return table_text.markdown(COLUMNS, map(cells, rows))


COLUMNS = (
    "scene",
    "solver",
    "measure",
    "median [us]",
    "p95 [us]",
    "error",
    "worst error",
    "status",
)


def cells(row: Row) -> tuple[str, ...]:
    """Return a row as text, the columns being `COLUMNS`."""
    return (
        f"{row.scene} ({row.rows} rows)",
        short(row),
        row.measure,
        _number(row.median_us, ".1f"),
        _number(row.p95_us, ".1f"),
        _number(row.error_median, ".1e"),
        _number(row.error_worst, ".1e"),
        status_words(row),
    )


def short(row: Row) -> str:
    """Return the solver as one would type it, with what was set, and what `how` says."""
    name = row.solver.split("(")[0]
    chosen = {
        key: value for key, value in row.parameters.items() if value != _defaults(name).get(key)
    }
    how = f", {words_of(row.how)}" if row.how else ""
    return f"{name}({words_of(chosen)}){how}"


def _defaults(name: str) -> dict[str, Any]:
    from condyn_pin.dynamics.solvers import SOLVERS
    from condyn_pin.dynamics.solvers.base import parameter_fields

    kind = SOLVERS.get(name.lower())
    return {} if kind is None else {f.name: f.default for f in parameter_fields(kind)}


def words_of(parameters: dict[str, Any]) -> str:
    """Return parameters as they stand in a call."""
    return ", ".join(f"{key}={value!r}" for key, value in parameters.items())


def status_words(row: Row) -> str:
    """Return how many states ended how: ``18 ok, 2 singular``."""
    return ", ".join(f"{count} {status}" for status, count in sorted(row.statuses.items()))


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)
