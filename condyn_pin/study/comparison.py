"""Comparison: two tables of the same questions, row by row, and what became worse.

Times of two runs are of two moods of a machine. What all rows have in common is taken out first:

    slower_i = (new_i / old_i) / common,      common = median over rows of new / old

and a row is worse only beyond what its own samples spread: p95 over median, of both runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from statistics import median
from typing import TYPE_CHECKING, Final

from condyn_pin.study.row import Row

if TYPE_CHECKING:
    from condyn_pin.study.table import Table

# Errors are the same to the bit on one build; another Pinocchio rounds otherwise, and the worst of
# twenty states moves by half. Below the floor they are rounding, and nobody's fault.
_ERROR_RATIO: Final = 2.0
_ERROR_FLOOR: Final = 1e-13

# A row whose samples do not spread at all still moves by some per cent with the layout of memory.
_LEAST_SPREAD: Final = 1.1

# Fewer rows have no common share that is not their own.
_ROWS_FOR_COMMON: Final = 4


@dataclass(frozen=True)
class Change:
    """One question asked twice.

    Attributes
    ----------
    old, new : Row
    slower : float or None
        How many times slower it is than before, what all rows share taken out; None without times.
    spread : float
        The factor within which this says nothing: p95 over median, the larger of both runs.
    error : float
        Worst error over that of before.
    """

    old: Row
    new: Row
    slower: float | None
    spread: float
    error: float

    @property
    def worse(self) -> tuple[str, ...]:
        """What became worse, a sentence each; empty if nothing."""
        found = []
        if self.slower is not None and self.slower > self.spread:
            found.append(f"{self.slower:.2f} times slower (spread {self.spread:.2f})")
        if self.error > _ERROR_RATIO and self.new.error_worst > _ERROR_FLOOR:
            found.append(
                f"worst error {self.new.error_worst:.1e}, {self.error:.3g} times that of before"
            )
        if self.old.answered and not self.new.answered:
            found.append(f"statuses {self.new.statuses}, before {self.old.statuses}")
        elif (
            self.new.statuses.get("ok", 0) * self.old.n
            < self.old.statuses.get("ok", 0) * self.new.n
        ):
            found.append(f"fewer say ok: {self.new.statuses}, before {self.old.statuses}")
        return tuple(found)

    def __str__(self) -> str:
        time = "not timed" if self.slower is None else f"{self.slower:.2f} of the time"
        said = "; ".join(self.worse) or f"{time}, {self.error:.3g} of the error"
        return f"{self.new.scene}, {self.new.short}, {self.new.measure}: {said}"


@dataclass(frozen=True)
class Comparison:
    """Two tables compared row by row.

    Attributes
    ----------
    changes : tuple of Change
        Rows that both tables have.
    common : float
        How many times slower the rows are in common, the median: how busy the machine was, or
        something that hits them all. 1 where fewer than four rows have times in both.
    missing, added : tuple of Row
        Rows of the old table only, and of the new one only.
    machines : tuple of str
        What differs between the machines, a sentence each.
    """

    changes: tuple[Change, ...]
    common: float
    missing: tuple[Row, ...]
    added: tuple[Row, ...]
    machines: tuple[str, ...]

    @property
    def worse(self) -> tuple[Change, ...]:
        """The rows that became worse."""
        return tuple(change for change in self.changes if change.worse)

    @property
    def ok(self) -> bool:
        """Whether nothing became worse and nothing is missing."""
        return not self.worse and not self.missing

    def __str__(self) -> str:
        lines = [
            f"{len(self.changes)} rows in both, {len(self.worse)} worse, {len(self.missing)} "
            f"missing, {len(self.added)} new; all together take {self.common:.2f} of the time"
        ]
        lines += [f"differs: {text}" for text in self.machines]
        lines += [f"worse: {change}" for change in self.worse]
        lines += [f"missing: {row.scene}, {row.short}, {row.measure}" for row in self.missing]
        return "\n".join(lines)


def compare(new: Table, old: Table) -> Comparison:
    """Return what changed between two tables; see `Table.compare`."""
    before = {row.key: row for row in old.rows}
    pairs = [(before[row.key], row) for row in new.rows if row.key in before]
    common = _common(pairs)
    now = {row.key for row in new.rows}
    return Comparison(
        changes=tuple(_change(one, other, common) for one, other in pairs),
        common=common,
        missing=tuple(row for row in old.rows if row.key not in now),
        added=tuple(row for row in new.rows if row.key not in before),
        machines=tuple(
            f"{key}: {new.machine.get(key)}, before {old.machine.get(key)}"
            for key in dict.fromkeys((*new.machine, *old.machine))
            if key != "date" and new.machine.get(key) != old.machine.get(key)
        ),
    )


def _common(pairs: Sequence[tuple[Row, Row]]) -> float:
    ratios = [
        new.median_us / old.median_us for old, new in pairs if old.median_us and new.median_us
    ]
    return median(ratios) if len(ratios) >= _ROWS_FOR_COMMON else 1.0


def _change(old: Row, new: Row, common: float) -> Change:
    slower = None
    if old.median_us and new.median_us:
        slower = new.median_us / old.median_us / common
    return Change(old, new, slower, max(_spread(old), _spread(new)), _ratio(new, old))


def _spread(row: Row) -> float:
    if not row.median_us or row.p95_us is None:
        return _LEAST_SPREAD
    return max(row.p95_us / row.median_us, _LEAST_SPREAD)


def _ratio(new: Row, old: Row) -> float:
    """Return the ratio of the worst errors; of two that are equal, 1, infinite ones as well."""
    if new.error_worst == old.error_worst:
        return 1.0
    return new.error_worst / old.error_worst if old.error_worst else inf
