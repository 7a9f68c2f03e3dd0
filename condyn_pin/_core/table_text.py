"""Tables as text: csv below lines with the machine, Markdown, and null for what is not a number."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from condyn_pin._core.files.beside import written_beside


def write_csv(
    path: str | Path,
    machine: Mapping[str, str],
    columns: Sequence[str],
    rows: Iterable[Mapping[str, Any]],
) -> None:
    """Write rows, after comment lines with the machine."""
    with written_beside(path) as new, new.open("w", newline="", encoding="utf-8") as file:
        for key, value in machine.items():
            file.write(f"# {key}: {value}\n")
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return rows of text as a table in Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(cells) + " |" for cells in rows)])


def nulled(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row for json, which has no NaN: None for what is not finite."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in row.items()
    }
