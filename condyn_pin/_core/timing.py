"""Times of calls, and the machine that they were measured on.

Timing in one process, interleaved: what drifts in the machine drifts for all.

Every round calls every candidate a few times, in an order that turns from round to round, on the
same state. A sample is the mean of the calls of one round, so that a clock read costs nothing.
"""

from __future__ import annotations

import gc
import os
import platform
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from time import perf_counter
from typing import TypeVar

import numpy as np

from condyn_pin import __version__
from condyn_pin._core._pin import VERSION_TEXT
from condyn_pin._core.arrays import Array

State = tuple[Array, Array, Array]
Call = Callable[[Array, Array, Array], object]
_Key = TypeVar("_Key", bound=Hashable)


@dataclass(frozen=True)
class Times:
    """Times of one candidate [us], one sample per round."""

    samples: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median over the rounds [us]."""
        return float(np.median(self.samples))

    @property
    def p95(self) -> float:
        """95th percentile over the rounds [us]."""
        return float(np.percentile(self.samples, 95))

    def ratio(self, other: Times) -> float:
        """Median over the rounds of this time over the other's."""
        return float(np.median(np.divide(self.samples, other.samples)))


def interleaved(
    calls: Mapping[_Key, Call],
    states: Sequence[State],
    *,
    rounds: int,
    repeats: int,
    enough: float = inf,
    tick: Callable[[], None] = lambda: None,
) -> dict[_Key, Times]:
    """Time callables on the same states, one a round, each in turn."""
    # A sample is `repeats` calls, or fewer of a slow callable, down to one, once it has lasted
    # `enough` [s]. `tick` is called after each round, for a progress bar.
    names = list(calls)
    if not names:
        return {}
    samples: dict[_Key, list[float]] = {name: [] for name in names}
    counts = {name: _warm_up(calls[name], states, repeats, enough) for name in names}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for r in range(rounds):
            q, v, tau = states[r % len(states)]
            shift = r % len(names)
            for name in names[shift:] + names[:shift]:
                call, count = calls[name], counts[name]
                call(q, v, tau)  # the first call after another candidate finds cold caches
                start = perf_counter()
                for _ in range(count):
                    call(q, v, tau)
                samples[name].append(1e6 * (perf_counter() - start) / count)
            tick()
    finally:
        if collecting:
            gc.enable()
    return {name: Times(tuple(values)) for name, values in samples.items()}


def _warm_up(call: Call, states: Sequence[State], most: int, enough: float) -> int:
    """Call at every state to fill memory, caches and lazy imports; return the calls per sample."""
    spent = []
    for state in states:
        start = perf_counter()
        call(*state)
        spent.append(perf_counter() - start)
    return max(1, int(min(most, enough / min(spent))))


# The machine that a measurement was taken on: processor, system, versions.


def machine() -> dict[str, str]:
    """Return processor, system, versions, threads and date, for every table of results."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pinocchio": VERSION_TEXT,
        "condyn_pin": __version__,
        "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "unset"),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    names = (line.split(":", 1)[1].strip() for line in text.splitlines() if "model name" in line)
    return next(names, platform.processor() or "unknown")
