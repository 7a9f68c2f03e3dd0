"""A plane that bodies rest on, n . x = height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from condyn_pin.constraints.constraint_fields import Vector3, direction, floats
from condyn_pin.constraints.with_world import plane


@dataclass(frozen=True)
class Plane:
    """The half-space n . x <= height is solid: the world's, or that of a body in its axes.

    Parameters
    ----------
    normal : (3,) sequence of float
        Out of the ground; any length.
    height : float
        Of the plane, along the normal from the origin [m].
    """

    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float = 0.0  # [m]

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", direction("normal", self.normal))
        object.__setattr__(self, "height", floats("height", [self.height], 1)[0])

    @property
    def placement(self) -> Any:
        """A frame in the plane: z is the normal, x and y those of the world if it is level."""
        return plane(self.normal, self.height)
