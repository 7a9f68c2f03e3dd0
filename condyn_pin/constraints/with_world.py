"""Between one frame of the robot and the world: what contacts, blades and wheels share."""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import z_along
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.constraint_fields import Vector3
from condyn_pin.constraints.protocols import Machine
from condyn_pin.constraints.support import Patch

USUAL: Final = 0.025  # half of what is drawn of a contact that says no size, of that of the scene
THIN: Final = 0.004  # thickness of what is drawn, the same


class WithWorld(Constraint, ABC):
    """Between one frame of the robot and the world."""

    frame: str

    @property
    def frames(self) -> tuple[str, ...]:
        """Its frame."""
        return (self.frame,)

    def sides(self, machine: Machine) -> tuple[int, int]:
        """Return the joint that carries the frame, and 0."""
        return machine.frame(self.frame)[0], 0

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return that its force is on the frame by the world, in the axes of the frame."""
        return self.frame, "world", self.frame

    def patch(self, size: float) -> Patch:
        """Return a small ball."""
        return Patch("ball", (0.012 * size,))


def plane(normal: Sequence[float] | Array, height: float | None) -> Any:
    """Return a frame in a plane of the world, z along its normal."""
    up = np.array(normal)
    return pin.SE3(z_along(up), (height or 0.0) * up)


def shifted(placement: Any, offset: Vector3) -> Any:
    """Return a placement shifted in its own axes."""
    return placement * pin.SE3(np.eye(3), np.array(offset))
