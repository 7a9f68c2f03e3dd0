"""Between two frames of the robot, of which one may belong to the world: what loops share."""

from __future__ import annotations

from abc import ABC
from typing import Any, ClassVar

import numpy as np

from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.protocols import Machine


class BetweenFrames(Constraint, ABC):
    """Between two frames."""

    closes: ClassVar[bool] = True

    frame_a: str
    frame_b: str

    @property
    def frames(self) -> tuple[str, ...]:
        """Both frames."""
        return self.frame_a, self.frame_b

    def sides(self, machine: Machine) -> tuple[int, int]:
        """Return the joints that carry the two frames."""
        return machine.frame(self.frame_a)[0], machine.frame(self.frame_b)[0]

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return that its force is on the first frame by the second, in the axes of its rows."""
        return self.frame_a, self.frame_b, self.frame_b if swapped else self.frame_a


def lever(machine: Machine, *placements: Any) -> float:
    """Return the size of the bodies that meet: two points of them are to be that far apart.

    A short lever turns rounding of the points into moments: 1/lever^2 enters the condition. A frame
    near the middle of its joint says nothing about the size; then it is that of the robot's links.
    """
    own = max(float(np.linalg.norm(p.translation)) for p in placements)
    links = machine.longest_link
    return own if own > 0.1 * links else links or 1.0
