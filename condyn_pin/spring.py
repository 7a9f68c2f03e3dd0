"""Spring: what descriptions hang on a joint, and `Robot.passive_torque` applies."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin.arrays import finite
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
