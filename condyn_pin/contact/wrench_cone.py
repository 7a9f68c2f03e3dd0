"""WrenchCone: the wrenches that friction under a flat part of the robot, or an edge, can give.

In the axes of the floor, z along its normal, with f the force on the robot and m its moment about
the middle of the contact, X and Y half the size of a rectangle along x and y, and mu the
coefficient of friction of a pyramid,

    it does not pull      f_z >= 0
    it does not slip      |f_x|, |f_y| <= mu f_z
    it does not tip       |m_y| <= X f_z,    |m_x| <= Y f_z
    it does not twist     |Y f_x + s mu m_x| + |X f_y + s mu m_y| + s m_z <= mu (X + Y) f_z

with s = 1 and s = -1. It tips where the centre of pressure (-m_y, m_x) / f_z leaves the rectangle.
How much torque about the normal is left depends on where that centre is, and on what slipping has
used up. A wrench obeys all four if and only if it is that of four forces at the corners, each in a
pyramid of its own. An edge along x is the rectangle with Y = 0, and has m_x = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from numbers import Real
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint, check_lengths, check_size
from condyn_pin.contact.cone import Cone, Margin, Row
from condyn_pin.errors import InvalidArgument

_SIGNS: Final = (("+", 1.0), ("-", -1.0))


@dataclass(frozen=True)
class WrenchCone(Cone):
    """The wrenches that friction at the corners of a rectangle, or the ends of an edge, can give.

        |f_x|, |f_y| <= mu f_z,    |m_x| <= half_width f_z,    |m_y| <= half_length f_z

    and a bound on m_z that the other five decide.

    For `SurfaceContact` and `LineContact`. It has a closed form where the cones at the corners are
    pyramids, and none where they are round: `margin` and `rows` are both those of the pyramids.

    Parameters
    ----------
    friction : float
        Coefficient of friction mu [1]; 0 for a floor without.
    half_length, half_width : float, optional
        Half of the size along x and y of the floor [m]; by default that of the contact. An edge
        lies along x, and its half_width is 0.
    normal : (3,) sequence of float, optional
        Of the floor under a `LineContact`, in the world; any length. The vertical by default. A
        `SurfaceContact` has a normal of its own, and takes none.
    pyramid : {"inner", "outer"}
        Within round cones, mu / sqrt(2), so that the floor can give whatever has a margin, or
        around them, mu, so that it cannot give what has none.

    Raises
    ------
    InvalidArgument
        If friction is negative, the normal is zero, the kind of pyramid is unknown, or a size is
        not positive, but for the width 0 of an edge.

    References
    ----------
    S. Caron, Q.-C. Pham, Y. Nakamura, "Stability of surface contacts for humanoid robots:
    closed-form formulae of the contact wrench cone for rectangular support areas", ICRA 2015.
    """

    half_length: float | None = None  # [m]
    half_width: float | None = None  # [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        is_edge = isinstance(self.half_width, Real) and self.half_width == 0
        half_width = None if is_edge else self.half_width
        check_lengths(half_length=self.half_length, half_width=half_width)
        for name in ("half_length", "half_width"):
            if size := getattr(self, name):
                object.__setattr__(self, name, float(size))
                check_size(f"1 / {name}", 1.0 / float(size))

    def _table(self) -> Iterator[Row]:
        X, Y = self.half_length, self.half_width
        if X is None or Y is None:
            raise InvalidArgument(
                f"half_length = {X}, half_width = {Y}: neither the cone nor its contact has both; "
                "use WrenchCone(friction, half_length, half_width)"
            )
        yield "pulls", (0.0, 0.0, -1.0)
        yield from self._slips(4)
        for sign, s in _SIGNS:
            yield f"tips over {sign}x", (0.0, 0.0, -0.5, 0.0, -0.5 * s / X)
            if Y:
                yield f"tips over {sign}y", (0.0, 0.0, -0.5, 0.5 * s / Y)
        mu, size = self._flat(4), X + Y
        for (z, s), (x, i), (y, j) in product(_SIGNS, _SIGNS if Y else _SIGNS[:1], _SIGNS):
            entries = np.array([i * Y, j * X, -mu * size, s * mu * i if Y else 0.0, s * mu * j, s])
            yield f"twists {z}z {x}x {y}y", tuple(entries / size)

    def judge(self, force: Array, noise: Array | None = None) -> Margin:
        """Return the margin as `Cone.judge`; refuse a moment of an edge about itself."""
        if self.half_width == 0 and np.any(np.abs(force[..., 3]) > 0):
            raise InvalidArgument("force: an edge transmits no moment about itself, its x axis")
        return super().judge(force, noise)

    def fitted(self, contact: Constraint) -> WrenchCone:
        """Return the cone with the sizes of the `contact`; InvalidArgument if it is a point."""
        self._check(contact)
        support = contact.support
        if support is None or support.is_point:
            raise InvalidArgument(
                f"{contact.name}: a {type(contact).__name__} presses at a point; use FrictionCone"
            )
        is_edge = support.axis is not None
        if self.half_width is not None and is_edge != (self.half_width == 0):
            raise InvalidArgument(
                f"{contact.name}: half_width = {self.half_width:g}: it is 0 for a LineContact and "
                "positive for a SurfaceContact"
            )
        return replace(
            self,
            half_length=self.half_length or support.half_length,
            half_width=self.half_width or support.half_width,
        )

    def turn(self, contact: Constraint, R: Array, up: Array) -> Array:
        """Return T as `Cone.turn`; InvalidArgument if an edge does not lie in the floor."""
        support = contact.support
        if support is None or support.axis is None:
            return np.broadcast_to(np.eye(3), R.shape)
        x, n = np.eye(3)[support.axis], self.floor_normal(up) @ R
        off = float(np.abs(n @ x).max(initial=0.0))
        if off > tolerances.PARALLEL:
            raise InvalidArgument(
                f"{contact.name}: the edge is {np.degrees(np.arcsin(min(off, 1.0))):.3g} deg off "
                "the floor; give the cone the normal=(x, y, z) of the floor that it lies in"
            )
        z = n - (n @ x)[..., None] * x
        z /= np.linalg.norm(z, axis=-1, keepdims=True)
        return np.stack([np.broadcast_to(x, z.shape), np.cross(z, x), z], axis=-2)
