"""Motions that others are made of: Ctrl-C in one of them stops the whole."""

from __future__ import annotations

from condyn_pin.simulation.outcome import RunStatus
from condyn_pin.simulation.trajectory import Trajectory


def uninterrupted(motion: Trajectory) -> Trajectory:
    """Return a motion, unless Ctrl-C ended it.

    `simulate` keeps what it has and returns, which is right for who looks at the motion, and
    wrong for who compares it with others: a part of one is no measurement, and Ctrl-C was meant
    for the whole.

    Raises
    ------
    KeyboardInterrupt
        If the motion was interrupted.
    """
    if motion.status is RunStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return motion
