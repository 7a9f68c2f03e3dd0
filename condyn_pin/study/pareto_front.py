"""The Pareto front: rows that no other row beats in both time and error."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from condyn_pin.study.row import Row

# Answers that are what they say: an inaccurate one says by how much it is.
ANSWERED = {"ok", "inaccurate"}


def answered(row: Row) -> bool:
    """Whether every state got an answer, with an error that is a number."""
    return bool(row.statuses) and set(row.statuses) <= ANSWERED and isfinite(row.error_worst)


def comparable(row: Row) -> bool:
    """Whether a row has both a time and an error, at every state."""
    return row.median_us is not None and answered(row)


def microseconds(row: Row) -> float:
    """Return the median time of a row that was timed [us]."""
    assert row.median_us is not None
    return row.median_us


def pareto_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows that no other is faster than with at most the same error, fastest first.

    Rows of different scenes or measures do not compare: hand in those of one.
    """
    kept: list[Row] = []
    for row in sorted(filter(comparable, rows), key=lambda r: (microseconds(r), r.error_worst)):
        if not kept or row.error_worst < kept[-1].error_worst:
            kept.append(row)
    return tuple(kept)
