"""Timing in one process, interleaved: what drifts in the machine drifts for all.

Every round calls every candidate a few times, in an order that turns from round to round, on the
same state. A sample is the mean of the calls of one round, so that a clock read costs nothing.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from condyn_pin.arrays import Array

State = tuple[Array, Array, Array]
Call = Callable[[Array, Array, Array], object]


@dataclass(frozen=True)
class Times:
    """Times of one candidate [us], a sample a round."""

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
        """Return the median over the rounds of this time over the other's."""
        return float(np.median(np.divide(self.samples, other.samples)))


def interleaved(
    calls: Mapping[str, Call],
    states: Sequence[State],
    *,
    rounds: int = 300,
    repeats: int = 10,
    tick: Callable[[], None] = lambda: None,
) -> dict[str, Times]:
    """Time callables on the same states.

    Parameters
    ----------
    calls : mapping of str to callable
        Each is called with (q, v, tau).
    states : sequence of (q, v, tau)
        Round r uses state r modulo their number.
    rounds, repeats : int
        Samples of each callable, and calls in a sample.
    tick : callable
        Called after each round, for a progress bar.

    Returns
    -------
    dict of str to Times
    """
    names = list(calls)
    samples: dict[str, list[float]] = {name: [] for name in names}
    for name in names:  # warm-up: memory, caches, lazy imports
        for state in states:
            calls[name](*state)
    collecting = gc.isenabled()
    gc.disable()
    try:
        for r in range(rounds):
            q, v, tau = states[r % len(states)]
            shift = r % len(names)
            for name in names[shift:] + names[:shift]:
                call = calls[name]
                call(q, v, tau)  # the first call after another candidate finds cold caches
                start = perf_counter()
                for _ in range(repeats):
                    call(q, v, tau)
                samples[name].append(1e6 * (perf_counter() - start) / repeats)
            tick()
    finally:
        if collecting:
            gc.enable()
    return {name: Times(tuple(values)) for name, values in samples.items()}
