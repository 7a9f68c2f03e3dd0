"""Processor time of this process and of others: what a loaded machine does not change much."""

from __future__ import annotations

from collections.abc import Iterable
from time import clock_gettime, process_time


def processor_time(pids: Iterable[int] = ()) -> float:
    """Return what this process and some others have used so far [s], all threads; Linux."""
    # the number of another process's clock, as clock_getcpuclockid of the C library makes it
    return process_time() + sum(clock_gettime(~pid << 3 | 2) for pid in pids)
