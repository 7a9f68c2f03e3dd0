"""What every method made of every family: counts, maps of severity by method, and advice."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np

from condyn_pin._core.files import atomic_write, read_text
from condyn_pin._core.show import axes, panels, write_figure
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.errors import InvalidArgument
from lab.extremes.base import families
from lab.extremes.verdicts import Outcome, Verdict

# From bad to worse: a cell with several seeds is as bad as its worst.
_ORDER = tuple(Verdict)


@dataclass(frozen=True)
class Cell:
    """One method at one severity of a family, over all seeds."""

    verdicts: tuple[Verdict, ...]  # those that occurred, from good to bad
    error: float  # the worst of a, relative; NaN where there is none

    @property
    def worst(self) -> Verdict:
        """The worst verdict."""
        return self.verdicts[-1]

    def __str__(self) -> str:
        names = "/".join(verdict.name.lower() for verdict in self.verdicts)
        return f"{names} {self.error:.0e}"

    @staticmethod
    def parse(text: str) -> Cell:
        """Return the cell of its text, `str` of it."""
        names, _, error = text.rpartition(" ")
        return Cell(tuple(Verdict[name.upper()] for name in names.split("/")), float(error))


@dataclass(frozen=True)
class Map:
    """One family on one robot: severity by method."""

    family: str
    robot: str
    severities: tuple[float, ...]
    methods: tuple[str, ...]
    cells: dict[tuple[float, str], Cell]

    @property
    def label(self) -> str:
        """Family and robot."""
        return f"{self.family}, {self.robot}" if self.robot else self.family

    def advice(self, method: str) -> str:
        """Return in one line how far a method goes in this family."""
        cells = {s: self.cells[s, method] for s in self.severities if (s, method) in self.cells}
        fine = [s for s, cell in cells.items() if cell.verdicts == (Verdict.OK,)]
        said = [s for s, cell in cells.items() if Verdict.SAID_SO in cell.verdicts]
        refused = [s for s, cell in cells.items() if cell.worst is Verdict.REFUSED]
        bad = [s for s, cell in cells.items() if cell.worst.defect]
        lost = max((cells[s].error for s in fine), default=0.0)
        right = f"right to {short(lost, 1)}" if lost else "right"
        words = ((right, fine), ("says inaccurate", said), ("refused", refused), ("WRONG", bad))
        parts = [f"{word} at {_runs(tuple(cells), which)}" for word, which in words if which]
        return f"{method}: {'; '.join(parts)}"


def maps(outcomes: Iterable[Outcome]) -> list[Map]:
    """Return a map for every family and robot, in the order of the outcomes."""
    groups: dict[tuple[str, str], dict[tuple[float, str], list[Outcome]]] = {}
    for outcome in outcomes:
        severity = outcome.task.severity
        if math.isnan(severity):
            severity = math.nan  # found in a dict only as one and the same object
        cells = groups.setdefault((outcome.task.family, outcome.task.robot), {})
        cells.setdefault((severity, outcome.method), []).append(outcome)
    return [
        Map(
            family,
            robot,
            _by_severity(family, dict.fromkeys(severity for severity, _ in cells)),
            tuple(dict.fromkeys(method for _, method in cells)),
            {key: _cell(some) for key, some in cells.items()},
        )
        for (family, robot), cells in groups.items()
    ]


def counts(outcomes: Iterable[Outcome]) -> dict[str, int]:
    """Return how many cases ended with each verdict; all verdicts are there."""
    counted = Counter(outcome.verdict for outcome in outcomes)
    return {verdict.name.lower(): counted[verdict] for verdict in Verdict}


_NEEDED: Final = {"pinocchio", "family", "robot", "severity"}  # of each line


def write_csv(found: Sequence[Map], path: str | Path, pinocchio: str) -> None:
    """Write one line a severity and one column a method; lines of other Pinocchios are kept."""
    path = Path(path)
    kept = [row for row in read_csv(path) if row["pinocchio"] != pinocchio] if path.exists() else []
    rows = [
        {"pinocchio": pinocchio, "family": m.family, "robot": m.robot, "severity": repr(severity)}
        | {method: str(m.cells[severity, method]) for method in m.methods}
        for m in found
        for severity in m.severities
    ]
    rows = sorted(kept + rows, key=lambda row: row["pinocchio"])
    columns = dict.fromkeys(key for row in reversed(rows) for key in row)
    with atomic_write(path) as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_csv(path: str | Path) -> list[dict[str, str]]:
    """Return the lines of a file that `write_csv` wrote; InvalidArgument if it is another."""
    try:
        rows = list(csv.DictReader(read_text(path).splitlines()))
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidArgument(
            f"{path}: no table of `python benchmarks/lab stress` ({error})"
        ) from error
    for row in rows:
        if not {key for key, value in row.items() if isinstance(value, str)} >= _NEEDED:
            raise InvalidArgument(
                f"{path}: no table of `python benchmarks/lab stress`; choose another file"
            )
    return rows


def maps_of_csv(rows: Iterable[dict[str, str]], pinocchio: str) -> list[Map]:
    """Return the maps of lines of `read_csv`, those of one Pinocchio."""
    groups: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        if row["pinocchio"] == pinocchio:
            groups.setdefault((row["family"], row["robot"]), []).append(row)
    found = []
    for (family, robot), its in groups.items():
        severities = [float(row["severity"]) for row in its]
        methods = tuple(key for key in its[0] if key not in _NEEDED and any(r[key] for r in its))
        cells = {
            (severity, method): Cell.parse(row[method])
            for severity, row in zip(severities, its, strict=True)
            for method in methods
            if row[method]
        }
        found.append(Map(family, robot, tuple(severities), methods, cells))
    return found


def short(number: float, digits: int = 6) -> str:
    """Return a number as few characters as say it: 1e-8 for 1e-08."""
    plain = f"{number:.{digits}g}"
    mantissa, e, exponent = f"{number:.{digits - 1}e}".partition("e")
    if not e:  # nan, inf
        return plain
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return min(plain, f"{mantissa}e{int(exponent)}", repr(float(number)), key=len)


def _by_severity(family: str, found: Iterable[float]) -> tuple[float, ...]:
    """Return severities from tame to absurd: with little time, cases come in a mixed order."""
    known = families()
    severities = known[family].severities if family in known else ()
    places = {repr(severity): i for i, severity in enumerate(severities)}  # NaN is unlike itself
    return tuple(sorted(found, key=lambda severity: places.get(repr(severity), len(places))))


def _cell(outcomes: Sequence[Outcome]) -> Cell:
    verdicts = {outcome.verdict for outcome in outcomes}
    errors = [outcome.error for outcome in outcomes if not math.isnan(outcome.error)]
    return Cell(tuple(v for v in _ORDER if v in verdicts), max(errors, default=math.nan))


def _runs(severities: Sequence[float], some: Sequence[float]) -> str:
    """Return some severities in words: those that follow each other in the family as one run."""
    places = [i for i, severity in enumerate(severities) if severity in some]
    if len(places) == len(severities):
        return "every severity"
    texts = []
    for _, group in groupby(enumerate(places), lambda pair: pair[1] - pair[0]):
        run = [short(severities[i]) for _, i in group]
        texts.append(f"{run[0]} ... {run[-1]}" if len(run) > 2 else ", ".join(run))
    return ", ".join(texts)


# Maps of severity by method in colour: the error of a, and what was said of it.


_MARKS = {Verdict.OK: "", Verdict.SAID_SO: "s", Verdict.REFUSED: "r"}
_BEST, _WORST = -16.0, 0.0  # of the colours, in digits
_SMALL = 7.5  # [points]
_LEGEND = (
    "no letter: said ok, and is right; s: said inaccurate; r: refused; X: a defect; "
    "white: nothing to compare with"
)


def severity_map(found: Map, ax: Any = None) -> Any:
    """Draw one family: a column a severity, a line a method, dark where digits are lost.

    A letter says what the answer said of itself: s inaccurate, r refused, X a defect. Drawn on `ax`
    or new axes, which are returned.
    """
    ax = axes(ax)
    grid = np.full((len(found.methods), len(found.severities)), np.nan)
    for i, method in enumerate(found.methods):
        for j, severity in enumerate(found.severities):
            cell = found.cells.get((severity, method))
            if cell is None:
                continue
            if not math.isnan(cell.error):
                grid[i, j] = math.log10(min(max(cell.error, 1e-16), 1.0))
            mark = _MARKS.get(cell.worst, "X")
            dark = grid[i, j] > -6
            ax.text(
                j, i, mark, ha="center", va="center", fontsize=_SMALL, color="w" if dark else "k"
            )
    ax.imshow(grid, aspect="auto", cmap="cividis_r", vmin=_BEST, vmax=_WORST)
    ax.set_xticks(range(len(found.severities)), [short(s, 4) for s in found.severities])
    ax.tick_params(axis="x", rotation=90)
    ax.set_yticks(range(len(found.methods)), found.methods)
    ax.tick_params(labelsize=_SMALL)
    known = families()
    if found.family in known:
        ax.set_xlabel(fill(known[found.family].title, 48), fontsize=_SMALL)
    ax.set_title(found.label, fontsize=9, fontweight="bold")
    return ax


def overview(found: Sequence[Map], ax: Any = None) -> Any:
    """Draw all families in one picture: how many severities each method answers rightly.

    A line a family, a column a method: severities that are ok, of all; dark where there are few. An
    X is a defect. Drawn on `ax` or new axes, which are returned.
    """
    ax = axes(ax)
    methods = list(dict.fromkeys(method for each in found for method in each.methods))
    shares = np.full((len(found), len(methods)), np.nan)
    for i, each in enumerate(found):
        for j, method in enumerate(methods):
            cells = [c for (_, name), c in each.cells.items() if name == method]
            if not cells:
                continue
            right = sum(cell.worst is Verdict.OK for cell in cells)
            shares[i, j] = right / len(cells)
            text = "X" if any(cell.worst.defect for cell in cells) else f"{right}/{len(cells)}"
            dark = shares[i, j] < 0.5
            ax.text(
                j, i, text, ha="center", va="center", fontsize=_SMALL, color="w" if dark else "k"
            )
    ax.imshow(shares, aspect="auto", cmap="cividis", vmin=0.0, vmax=1.0)
    ax.set_xticks(range(len(methods)), methods, rotation=35, ha="left")
    ax.set_yticks(range(len(found)), [each.label for each in found])
    ax.tick_params(
        labelsize=_SMALL, length=0, top=True, bottom=False, labeltop=True, labelbottom=False
    )
    return ax


def save_overview(found: Sequence[Map], path: str | Path, note: str) -> None:
    """Draw the overview into a picture; the ending of `path` says which format."""
    figure, (ax,) = panels(1, width=7.2, height=0.9 + 0.19 * len(found), columns=1)
    overview(found, ax)
    figure.supxlabel(
        f"{note}severities answered rightly, of all; the others were refused or inaccurate",
        fontsize=8,
    )
    write_figure(figure, path, dpi=130)


def save_maps(found: Sequence[Map], path: str | Path, note: str, *, columns: int = 2) -> None:
    """Draw every map into one picture, so many side by side; the ending says which format."""
    columns = min(columns, len(found))
    figure, places = panels(len(found), width=4.6, height=3.1, columns=columns, above=0.8)
    for ax, each in zip(places, found, strict=False):
        severity_map(each, ax)
    drawn, shrink, pad = places[0].images[0], min(1.0, 2 / columns), 0.05 * columns / len(places)
    colours = figure.colorbar(drawn, ax=places, location="top", shrink=shrink, aspect=40, pad=pad)
    digits = range(int(_BEST), int(_WORST) + 1, 4)
    colours.set_ticks(list(digits), labels=[f"1e{k}" if k else "1" for k in digits])
    colours.set_label("error of a, relative; ok promises 1e-8")
    colours.ax.axvline(math.log10(SOLVED), color="w")
    figure.suptitle(fill(f"{note}{_LEGEND}", int(13 * 4.6 * columns)), fontsize=10)
    write_figure(figure, path, dpi=120)
