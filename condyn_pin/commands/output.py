"""What all commands share: where they print, and which files they may write."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from time import monotonic
from typing import Any, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from condyn_pin.errors import InvalidArgument

# Tables keep their columns: a narrow terminal, or a file, gets long lines rather than cut numbers.
console = Console(width=max(Console().width, 118), markup=False)

_REDRAW: Final = 0.2  # [s]


def check_files(
    csv: Path | None, as_json: Path | None, plot: Path | None, native: Path | None
) -> None:
    """Refuse what would only fail when everything has been measured."""
    from condyn_pin.bench_table import BenchTable
    from condyn_pin.plots import PICTURES, require_matplotlib

    for path in (csv, as_json, plot):
        if path and not path.absolute().parent.is_dir():
            raise InvalidArgument(f"{path}: there is no folder {path.parent}; make it first")
    if plot:
        require_matplotlib()
        if plot.suffix not in PICTURES:
            raise InvalidArgument(f"{plot}: the ending says the format: {', '.join(PICTURES)}")
    if native:
        BenchTable((), {}).with_native(native)


def print_json(answer: Any) -> None:
    """Print an answer as json; see `plain`."""
    typer.echo(json.dumps(plain(answer), indent=1))


def plain(value: Any) -> Any:
    """Return a value in the words of json: None for what is not finite, tables for dataclasses."""
    if hasattr(value, "tolist"):  # arrays and numbers of numpy
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if hasattr(value, "_asdict"):  # tuples with names
        return plain(value._asdict())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return value if -float("inf") < value < float("inf") else None
    return value if isinstance(value, (bool, int, str, type(None))) else str(value)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, int, int], None]]:
    """Give what is called with (what, done, total), and shows it with the time that is left.

    Drawn when it is called, five times a second at most, and never in between: a thread that draws
    would take the interpreter from what is timed.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, auto_refresh=False) as bar:
        task, drawn = bar.add_task("", total=None), 0.0

        def show(what: str, done: int, total: int) -> None:
            nonlocal drawn
            now = monotonic()
            due = now - drawn > _REDRAW
            bar.update(task, description=what, completed=done, total=total, refresh=due)
            drawn = now if due else drawn

        yield show
