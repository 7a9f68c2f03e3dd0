"""Output of commands: consoles, files, progress, and partial results on Ctrl-C."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from time import monotonic
from typing import Any, Final, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from condyn_pin._core.files import check_writable, write_text
from condyn_pin.errors import Interrupted, InvalidArgument, printable

# As shells say that a program was interrupted.
INTERRUPTED: Final = 130

Report = Callable[[str, int, int], None]
_Found = TypeVar("_Found")

_PAPER: Final = 100  # columns of a file


# Patterns of what errors and advice say of arguments in Python, and how a line says it.
_OPTIONS: Final = {
    "pass within_limits=False": "say --no-limits",
    "pass save=False": "say --no-save",
    "say close_start=False": "close_start=False in Python",
    r"load_robot\(\.\.\., actuated=\[\.\.\.\]\) or Actuation\(robot, \[\.\.\.\]\)": "--actuated",
    r"model=(.+), or several, model=\[\.\.\.\]": r"--model \1, or several, a --model for each",
}


def with_options(text: str) -> str:
    """Return a text with the options of the command line in place of Python's arguments."""
    for argument, option in _OPTIONS.items():
        text = re.sub(argument, option, text)
    return text


class _Screen(Console):
    """Console that escapes unprintable characters."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Return the text to render, with unprintable characters escaped, in its final width."""
        return super().render_str(printable(text), **options)

    def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
        """Yield the segments for the terminal, with unprintable characters escaped."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(printable(segment.text), segment.style)


def _wide_console(*, stderr: bool = False) -> Console:
    """Console as wide as the terminal, or as paper in a file, for folded tables."""
    screen = _Screen(markup=False, stderr=stderr)
    return screen if screen.is_terminal else _Screen(width=_PAPER, markup=False, stderr=stderr)


console, _beside = _wide_console(), _wide_console(stderr=True)

_REDRAW: Final = 0.2  # [s]
STDOUT: Final = Path("-")


def print_text(text: str) -> None:
    """Print a text without wrapping its lines."""
    console.print(with_options(text), soft_wrap=True)


def warn(text: str) -> None:
    """Print a line to stderr."""
    typer.echo(printable(with_options(text)), err=True)


def text_table(*headings: str | Column) -> Table:
    """Return an empty table of text, whose columns wrap instead of cutting."""
    table = Table(*headings)
    for column in table.columns:
        column.overflow = "fold"
    return table


def for_people(as_json: Path | None) -> Console:
    """Return the console for people: stderr if json goes to stdout."""
    return _beside if as_json == STDOUT else console


def check_written(*paths: Path | None) -> None:
    """Refuse files that cannot be written, before anything is measured."""
    for path in paths:
        if path is not None and path != STDOUT:
            check_writable(path)


def check_ending(path: Path | None, *endings: str) -> None:
    """Refuse a file whose ending is of another format."""
    if path and path.suffix not in endings:
        raise InvalidArgument(f"{path}: the ending says the format: {', '.join(endings)}")


def check_picture(path: Path | None) -> None:
    """Refuse a picture that cannot be drawn, before anything is measured."""
    if path:
        from condyn_pin._core.show import PICTURES, require_matplotlib

        require_matplotlib()
        check_ending(path, *PICTURES)
        check_written(path)


def write_table(table: Any, *, csv: Path | None = None, as_json: Path | None = None) -> None:
    """Write a table to the files that are given; json to the path ``-`` goes to stdout."""
    if csv:
        table.to_csv(csv)
    if as_json == STDOUT:
        print_json(table.as_dict())
    elif as_json:
        table.to_json(as_json)


def write_json(answer: Any, path: Path) -> None:
    """Write an answer as json to a file, or to stdout if its name is ``-``; see `json_value`."""
    text = json.dumps(json_value(answer), indent=1)
    if path == STDOUT:
        typer.echo(text)
    else:
        write_text(path, text + "\n")


def print_json(answer: Any) -> None:
    """Print an answer as json."""
    write_json(answer, STDOUT)


def json_value(value: Any) -> Any:
    """Return a value as json types: None if it is not finite, a mapping for a dataclass."""
    if hasattr(value, "tolist"):  # arrays and numbers of numpy
        return json_value(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): json_value(entry) for key, entry in value.items()}
    if hasattr(value, "_asdict"):  # tuples with names
        return json_value(value._asdict())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: json_value(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, (list, tuple)):
        return [json_value(entry) for entry in value]
    if isinstance(value, float):
        return value if -float("inf") < value < float("inf") else None
    return value if isinstance(value, (bool, int, str, type(None))) else str(value)


@contextmanager
def progress_bar() -> Iterator[Report]:
    """Yield a progress callback (what, done, total), which shows a bar with the remaining time.

    Drawn when it is called, five times a second at most, and never in between: a thread that draws
    would take the interpreter from what is timed. Nothing is drawn into a file.
    """
    what = TextColumn("{task.description}", markup=False)  # has names of robots
    columns = (what, BarColumn(), TimeRemainingColumn())
    screen = _Screen(stderr=True)
    with Progress(
        *columns, console=screen, transient=True, auto_refresh=False, disable=not screen.is_terminal
    ) as bar:
        task, drawn = bar.add_task("", total=None), 0.0

        def show(what: str, done: int, total: int) -> None:
            nonlocal drawn
            now = monotonic()
            due = now - drawn > _REDRAW
            bar.update(task, description=what, completed=done, total=total, refresh=due)
            drawn = now if due else drawn

        yield show


def until_stopped(run: Callable[[Report], _Found]) -> tuple[_Found, bool]:
    """Return the measurements of a run, complete or up to Ctrl-C, and True if Ctrl-C stopped it."""
    try:
        with progress_bar() as progress:
            return run(progress), False
    except Interrupted as stop:
        return stop.table, True


def exit_with_status(*, ok: bool = True, stopped: bool = False) -> None:
    """Exit with the code of the answer: ok, not ok, or stopped by Ctrl-C."""
    if stopped or not ok:
        raise typer.Exit(INTERRUPTED if stopped else 1)
