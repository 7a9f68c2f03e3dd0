"""Subjects of scripts: measured or read again, printed, kept in results, shown by pages.

    python benchmarks/SCRIPT.py SUBJECT [--quick] [--from-json] ...

A script lists its subjects in `SUBJECTS`. The table of one is in benchmarks/results/, named as the
command: contact_step.json of `contact_step.py`, native_core.json of `native.py core`; pictures and
texts have the same name. With --from-json they and the pages are made of what is committed.

A page shows a table between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->``, so that no figure is
copied by hand: `Table.pages` gives each page its blocks, and a test compares.
"""

from __future__ import annotations

import json
import os
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import clock_gettime, process_time
from typing import Any

# Figures name their engine: what none names is Python's.
os.environ.setdefault("CONDYN_ENGINE", "python")

from condyn_pin._core.files import write_text
from condyn_pin._core.timing import machine
from condyn_pin.study.tables import write_csv

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
README = "README.md"
RESULTS_PAGE = "docs/results.md"
SIMULATORS_PAGE = "docs/simulators.md"

# What is said of a machine: of one thread, of several, on a page that is short.
EVERYTHING = (
    "{processor} ({cores} cores, one thread), {system}, Python {python}, Pinocchio {pinocchio}, "
    "{date}"
)
OF_CORES = EVERYTHING.replace(", one thread", "")
SHORT = "{processor}, {date}"

Saved = dict[str, Any]
Pages = Mapping[str, Mapping[str, str]]  # by path, by name of the block


# --- results


def result(command: str, ending: str = ".json") -> Path:
    """Return the file of a command's results."""
    return RESULTS / (command.replace(" ", "_") + ending)


def load(command: str) -> Any:
    """Return the committed results of a command."""
    return json.loads(result(command).read_text(encoding="utf-8"))


def write(path: Path, found: Any, about: Mapping[str, str] | None = None) -> None:
    """Write results by the ending of the path: values (.json), text (.md) or rows (.csv).

    Rows come after comment lines `about` the machine. What has a `to_json` writes itself.
    """
    if path.suffix == ".csv":
        rows = list(found)
        write_csv(
            path, about or {}, list(dict.fromkeys(name for row in rows for name in row)), rows
        )
    elif path.suffix == ".md":
        write_text(path, found.rstrip() + "\n")
    elif hasattr(found, "to_json"):
        found.to_json(path)
    else:
        text = json.dumps(found, indent=1, default=float)
        write_text(path, text.replace("Infinity", "1e999") + "\n")


def measured_on(**versions: str) -> Saved:
    """Return the machine, the versions of others on it, and its load before a measurement."""
    return {"machine": machine() | versions, "load": os.getloadavg()[0]}


def source(command: str, about: Mapping[str, Any], on: str = "") -> str:
    """Return command, result file and machine of a table, as the line below it names them.

    `on` is what is said of the machine, by default all of it.
    """
    script, _, subject = command.partition(" ")
    python = f"python benchmarks/{script}.py {subject}".rstrip()
    kept = result(command).relative_to(ROOT)
    return f"`{python}` (`{kept}`) on {(on or EVERYTHING).format(**about)}"


# --- pages


def filled(page: str, blocks: Mapping[str, str]) -> str:
    """Return a page with its blocks replaced."""
    for name, text in blocks.items():
        begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
        head, rest = page.split(begin)
        page = f"{head}{begin}\n{text}\n{end}{rest.split(end)[1]}"
    return page


def fill(pages: Pages) -> None:
    """Replace the blocks of some pages, given by their paths."""
    for path, blocks in pages.items():
        page = (ROOT / path).read_text(encoding="utf-8")
        (ROOT / path).write_text(filled(page, blocks), encoding="utf-8")


# --- subjects


@dataclass(frozen=True)
class Table:
    """A subject with committed results.

    Attributes
    ----------
    command : str
        Script and subject: "contact convergence".
    about : str
    measure : callable
        given -> what is kept, with `measured_on`.
    text : callable
        kept -> the printed table.
    pages, beside : callable
        kept -> blocks of pages; kept -> None, writes pictures and texts.
    quick : str
        What ``--quick`` does; without there is none.
    options : callable
        parser -> None, adds further ones.
    draft : tuple of str
        Options with which nothing is written.
    wrong : callable
        kept -> bool, for the exit code.
    read : callable
        path -> kept.
    """

    command: str
    about: str
    measure: Callable[[Namespace], Any]
    text: Callable[[Any], str]
    pages: Callable[[Any], Pages] = lambda _: {}
    beside: Callable[[Any], None] = lambda _: None
    quick: str = ""
    options: Callable[[ArgumentParser], None] = lambda _: None
    draft: tuple[str, ...] = ("quick",)
    wrong: Callable[[Any], bool] = lambda _: False
    read: Callable[[Path], Any] = lambda path: json.loads(path.read_text(encoding="utf-8"))

    def load(self) -> Any:
        """Return what is committed."""
        return self.read(result(self.command))

    def add_options(self, parser: ArgumentParser) -> None:
        """Add the options that all tables have, and its own."""
        if self.quick:
            parser.add_argument("--quick", action="store_true", help=self.quick)
        parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
        self.options(parser)

    def run(self, given: Namespace) -> int:
        """Measure or read, print, write; 1 if anything is wrong."""
        kept = self.load() if given.from_json else self.measure(given)
        print(self.text(kept))
        if given.from_json or not any(getattr(given, name, None) for name in self.draft):
            if not given.from_json:
                write(result(self.command), kept)
            self.beside(kept)
            fill(self.pages(kept))
        return int(self.wrong(kept))


@dataclass(frozen=True)
class Printed:
    """A subject that is printed, or writes by itself: given -> exit code, or None."""

    command: str
    about: str
    show: Callable[[Namespace], int | None]
    options: Callable[[ArgumentParser], None] = lambda _: None

    def add_options(self, parser: ArgumentParser) -> None:
        """Add its options."""
        self.options(parser)

    def run(self, given: Namespace) -> int:
        """Run."""
        return self.show(given) or 0


def main(
    about: str | None, subjects: Sequence[Table | Printed], words: Sequence[str] | None = None
) -> int:
    """Run the subject of a command line; a script with one subject does not name it."""
    parser = ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)
    if len(subjects) == 1:
        subjects[0].add_options(parser)
        return subjects[0].run(parser.parse_args(words))
    commands = parser.add_subparsers(dest="subject", required=True, metavar="SUBJECT")
    known = {each.command.partition(" ")[2]: each for each in subjects}
    for name, each in known.items():
        each.add_options(commands.add_parser(name, help=each.about, description=each.about))
    given = parser.parse_args(words)
    return known[given.subject].run(given)


# --- clocks


def processor_time(pids: Iterable[int] = ()) -> float:
    """Return what this process and some others have used so far [s], all threads; Linux."""
    # the number of another process's clock, as clock_getcpuclockid of the C library makes it
    return process_time() + sum(clock_gettime(~pid << 3 | 2) for pid in pids)
