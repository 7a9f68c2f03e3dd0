"""minimum_jerk: a smooth path from one value to another, as the reference of a task."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.base import check_positive
from condyn_pin.constraints.path import MinimumJerk


def minimum_jerk(
    start: ArrayLike, end: ArrayLike, duration: float, *, begin: float = 0.0
) -> Callable[[float], tuple[Array, Array, Array]]:
    """Return a minimum-jerk path between two values, a function of t that returns (x, v, a).

    x(s) = start + (10 s^3 - 15 s^4 + 6 s^5) (end - start),    s = (t - begin) / duration

    Use it as the `reference` of a task, or as the path of `Driven` rows. Before and after, it is at
    rest without acceleration.

    Parameters
    ----------
    start, end : (n,) array_like or float
        Such as two points of the world [m], or two angles of a joint [rad].
    duration : float
        Length of the motion [s].
    begin : float
        When it leaves the start [s].

    Returns
    -------
    callable
        Of t [s]; frozen, so that tasks with it compare, hash and pickle.

    Raises
    ------
    InvalidArgument
        If start and end are no arrays of one size, or the duration is not positive.

    References
    ----------
    Flash, Hogan. The coordination of arm movements: an experimentally confirmed mathematical model.
    Journal of Neuroscience 5, 1985.
    """
    size = np.size(start)
    here, there = (
        finite(name, np.atleast_1d(value), size) for name, value in (("start", start), ("end", end))
    )
    check_positive("time [s]", duration=duration)
    since = float(finite("begin", begin, ()))
    return MinimumJerk(tuple(here.tolist()), tuple(there.tolist()), float(duration), since)
