"""FrictionCone: the forces that friction at a point can give.

In the axes of the floor, z along its normal, with f the force on the robot and mu the coefficient
of friction,

    it does not pull      f_z >= 0
    it does not slip      |(f_x, f_y)| <= mu f_z
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import z_along
from condyn_pin.constraints.base import Constraint
from condyn_pin.contact.cone import Cone, Margin, Row
from condyn_pin.errors import InvalidArgument

_MOST_SIDES: Final = 1000


@dataclass(frozen=True)
class FrictionCone(Cone):
    """Coulomb's cone: the forces that a point contact can transmit, |f_t| <= mu f_n.

    For `PointContact`, `PlanarContact`, `RollingWheel` and `RollingBall`.

    Parameters
    ----------
    friction : float
        Coefficient of friction mu [1]; 0 for a floor without.
    normal : (3,) sequence of float, optional
        Of the floor at a `PointContact`, in the world; any length. The vertical by default. The
        others have a normal of their own, and take none.
    pyramid : {"inner", "outer"}
        Of `rows`: within the round cone, so that the floor can give whatever they allow, or around
        it, so that it cannot give what they forbid. `margin` is that of the round cone itself.
    sides : int
        Of the pyramid, 3 or more. The first faces x of the floor, and that of a level one is x of
        the world.

    Raises
    ------
    InvalidArgument
        If friction is negative, the normal is zero, the kind of pyramid is unknown, or it has fewer
        than 3 sides.
    """

    sides: int = field(default=4, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_count("sides", self.sides, least=3)
        if self.sides > _MOST_SIDES:
            raise InvalidArgument(f"sides = {self.sides}: at most {_MOST_SIDES}, round to 5e-6")

    def _table(self) -> Iterator[Row]:
        yield "pulls", (0.0, 0.0, -1.0)
        yield from self._slips(self.sides)

    def judge(self, force: Array, noise: Array | None = None) -> Margin:
        """Return the margin as `Cone.judge` does, with the round cone: mu f_z - |(f_x, f_y)|."""
        x, y, z = np.moveaxis(force, -1, 0)
        return replace(super().judge(force, noise), slips=self.friction * z - np.hypot(x, y))

    def fitted(self, contact: Constraint) -> FrictionCone:
        """Return the cone as it is; InvalidArgument if the `contact` is not a point."""
        if contact.support and not contact.support.is_point:
            raise InvalidArgument(
                f"{contact.name}: a {type(contact).__name__} can also tip and twist; "
                f"WrenchCone({self.friction:g}) takes that into account"
            )
        self._check(contact)
        return self

    def turn(self, contact: Constraint, R: Array, up: Array) -> Array:
        """Return T as `Cone.turn`; x and y of a level floor are those of the world."""
        if contact.has_normal:
            return np.broadcast_to(np.eye(3), R.shape)
        return np.asarray(z_along(self.floor_normal(up)).T @ R)
