"""A task as numbers: what the compiled core has in place of a bound task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from condyn_pin._core.arrays import Array

# What its rows are of, by their number in the core (`native/src/tick/tick_spec.hpp`).
(
    POSITION, ORIENTATION, POSE, CENTER_OF_MASS, JOINT, POSTURE, ANGULAR_MOMENTUM, CONTACT_FORCE,
    CAPTURE_POINT,
) = range(9)  # fmt: skip

# References as numbers at t: x_r, v_r and a_r one after the other.
Follow = Callable[[float], Array]

NO_FEEDBACK: Final = (0.0, 0.0)


class CompiledTask(NamedTuple):
    """The rows of one task: a_r + kp (x_r - x) + kd (v_r - v), or x_r of a force.

    Of a capture point x_r is where the mass belongs, in the axes of the floor, and its edges.

    Attributes
    ----------
    kind : int
    sizes : (int, int)
        Of x_r, and of v_r and a_r.
    gains : (float, float)
        kp [1/s^2] and kd [1/s]; of a capture point k [1] and omega [1/s].
    follow : callable
        Returns the reference as a function of t; asked for once.
    changes : bool
        Whether it depends on t.
    at : int
        The joint of its frame, where q holds its joint, or the contact in the scene.
    placement : pin.SE3, optional
        Of its frame on the joint, or of the floor.
    columns : sequence of int
        Entries of v, where rows are entries of a.
    """

    kind: int
    sizes: tuple[int, int]
    gains: tuple[float, float]
    follow: Callable[[], Follow]
    changes: bool
    at: int = 0
    placement: Any = None
    columns: tuple[int, ...] = ()
