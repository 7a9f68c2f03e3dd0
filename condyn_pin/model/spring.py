"""Springs: on a joint, and between two frames; `Robot.passive_torque` applies them."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin._core.arrays import finite
from condyn_pin.constraints.base import check_size, text
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Spring:
    """A linear spring on a joint: tau = -stiffness (q - reference).

    Parameters
    ----------
    joint : str
        A joint with one degree of freedom.
    stiffness : float
        [N m/rad] or [N/m].
    reference : float
        Where it is relaxed [rad or m].

    Raises
    ------
    InvalidArgument
        If a number is not finite, or the joint is no name.
    """

    joint: str
    stiffness: float  # [N m/rad] or [N/m]
    reference: float = 0.0  # [rad] or [m]

    def __post_init__(self) -> None:
        if not isinstance(self.joint, str) or not self.joint:
            raise InvalidArgument(f"joint = {self.joint!r}: the name of a joint is needed")
        for argument in ("stiffness", "reference"):
            finite(argument, getattr(self, argument), ())


@dataclass(frozen=True)
class SpringDamper:
    """A spring and a damper in parallel, between the origins of two frames.

    f = stiffness (l - rest_length) + damping l'

    with l the distance of the origins: f > 0 pulls the two bodies towards each other, each at the
    origin of its frame. If the origins coincide there is no direction and no force. Near there the
    direction changes from one step to the next, so to hold two points together use a `Loop`.

    Parameters
    ----------
    frame_a, frame_b : str
        Frames of two bodies, or one of a body and one of the world.
    stiffness : float
        Stiffness [N/m].
    damping : float
        Damping along the line between the frames [N s/m].
    rest_length : float
        Where it is relaxed [m].

    Raises
    ------
    InvalidArgument
        If a number is negative or not finite, or the frames are no two names.
    """

    frame_a: str
    frame_b: str
    stiffness: float  # [N/m]
    damping: float = 0.0  # [N s/m]
    rest_length: float = 0.0  # [m]

    def __post_init__(self) -> None:
        for argument in ("frame_a", "frame_b"):
            text(argument, getattr(self, argument))
        if self.frame_a == self.frame_b:
            raise InvalidArgument(
                f"frame_b = {self.frame_b!r} is frame_a too: a frame of another body is needed"
            )
        for argument in ("stiffness", "damping", "rest_length"):
            value = getattr(self, argument)
            if not finite(argument, value, ()) >= 0:
                raise InvalidArgument(f"{argument} = {value!r}: zero or more is needed")
            check_size(argument, float(value))
