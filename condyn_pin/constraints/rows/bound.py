"""A constraint between two bodies, bound to a model: joints, placements and rows for names.

The rest of the program asks it what every `AnyBound` answers. Its own fields, and those of
`Coupled`, `Rolled` and `Related`, are for the groups that evaluate them together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import Drive, OnFrames, tilt
from condyn_pin.constraints.rows.compiled_rows import (
    BALL,
    CUT,
    HELD,
    ROD,
    WELD,
    CompiledRows,
    placement,
)

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

POINT: Final[tuple[int, ...]] = (0, 1, 2)
FRAME: Final[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Bound(OnFrames):
    """One constraint between two bodies, bound.

    Attributes
    ----------
    joint1, placement1 : int, pin.SE3
        The joint that carries frame c1, and where.
    joint2, placement2 : int, pin.SE3
        The same of c2. The world is joint 0.
    selection : tuple of int
        The rows x y z rx ry rz of the relative velocity that stay zero; empty for a rod.
    axis : int
        What a hinge or an edge turns about: 0, 1 or 2 for x, y or z of c1.
    length : float
        Of a rod [m]; NaN for all else.
    lever : float
        Half the distance of two points on `axis` that stand for a hinge, and what points that are
        nearly one are moved apart by (`condyn_pin.constraints.rows.point_pairs`) [m].
    """

    name: str
    rows: slice
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    selection: tuple[int, ...]
    anchored: bool = True
    sign: float = 1.0
    axis: int = 2
    length: float = nan  # [m]
    lever: float = nan  # [m]
    drive: Drive | None = None

    @property
    def is_rod(self) -> bool:
        """Whether its row is a distance."""
        return not self.selection

    @property
    def is_hinge(self) -> bool:
        """Whether its rows are all but one turn."""
        return self.size == 5 and self.selection[:3] == POINT

    @property
    def hinge_axis(self) -> int | None:
        """Its axis, if it is a hinge."""
        return self.axis if self.is_hinge else None

    @property
    def is_planar(self) -> bool:
        """Whether its rows are all shifts but one."""
        return self.size == 2

    @property
    def is_plain(self) -> bool:
        """Whether Pinocchio has a constraint of these very rows."""
        return self.selection in (POINT, FRAME)

    @property
    def is_point(self) -> bool:
        """Whether it is a point on another one, or on one of the world, and nothing else."""
        return self.selection == POINT

    @property
    def is_ball(self) -> bool:
        """Whether it is a point of one moving body on one of another, and nothing else."""
        return self.selection == POINT and self.joint1 > 0 and self.joint2 > 0

    @property
    def is_scalar(self) -> bool:
        """Whether it is a rod."""
        return self.is_rod

    @property
    def meets(self) -> bool:
        """Whether it has a place."""
        return self.anchored

    @property
    def is_held(self) -> bool:
        """Whether the rows are those of c1 in its own axes: but for c, no world enters them."""
        return self.joint2 == 0 and (self.is_plain or not self.anchored)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the axis."""
        axes = [_AXES[i] for i in self.selection] or ["length"]
        return tuple(f"{self.name}.{axis}" for axis in axes)

    def compiled(self) -> CompiledRows:
        """Return its rows as the compiled core has them."""
        if self.is_held:
            how = HELD
        elif self.is_rod:
            how = ROD
        else:
            how = {POINT: BALL, FRAME: WELD}.get(self.selection, CUT)
        chosen = sum(1 << row for row in self.selection)
        slider = self.size == 5 and not self.is_hinge
        integers = [
            how, self.rows.start, self.size, self.joint1, self.joint2, chosen, self.anchored,
            self.axis, self.is_hinge, slider, 0, 0, 0, 0,
        ]  # fmt: skip
        length = self.length if self.is_rod else 0.0
        placed = [*placement(self.placement1), *placement(self.placement2)]
        return CompiledRows(integers, [*placed, self.sign, length, 0.0])

    def whole(self, lam: Array) -> Array:
        """Return the force with the components that the kind does not transmit: they are zero.

        (3,) [N], or (6,) [N, N m] for kinds that transmit moments. A rod's direction is not known
        here.
        """
        force = np.zeros(6 if self.selection[-1] > 2 else 3)
        force[list(self.selection)] = lam
        return force

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Return the components of the force in the axes of c1; `ends` finds c1 and c2."""
        if not self.is_rod:
            return self.whole(lam)
        c1, c2 = ends()
        along: Array = c1.actInv(c2).translation
        return np.asarray(lam[0] * np.asarray(along / np.linalg.norm(along)))

    @property
    def leans(self) -> bool:
        """True of a rod: its direction is the difference of two places over its length."""
        return self.is_rod

    def shares(self, oMi: Any) -> Array:
        """Size of a rod's shifts, with the error of its direction."""
        return np.array([[1.0 + tilt(self.reach(oMi), self.arm(oMi)), 0.0]])

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Return the origin of c2, where nothing else is known of the pair of forces."""
        if not self.anchored and self.joint2 == 0:
            return np.array(c1.translation)  # nothing says where c2 is
        if self.is_plain:  # a weld keeps its wrench whole, a ball acts at each body's own point
            at_two = self.selection == POINT and on_first != (self.sign > 0)
            return np.array((c2 if at_two else c1).translation)
        return super().acts_at(c1, c2, on_first=on_first)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Return for each row whether it is an angle."""
        return np.array([row > 2 for row in self.selection] or [False])

    def opening(self, model: Any, c: Array) -> tuple[float, float]:
        """Return how far it is open, from its rows of c: length [m] and angle [rad].

        Those of a weld are log6 of the placement of one frame in the other: the length of that is
        no distance, but along a screw. What is told is how far the frames are apart, and turned.
        """
        if self.selection == FRAME:
            apart = pin.exp6(pin.Motion(np.ascontiguousarray(c))).translation
            return math.hypot(*apart), math.hypot(*c[3:])
        return self.rates(model, c)


@dataclass(frozen=True)
class PinocchioConstraint:
    """A constraint that Pinocchio has itself: one of 3 or of 6 rows.

    `approximates` says whether it stands for rows of another kind; all else is as in `Bound`.
    """

    name: str
    size: int
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    anchored: bool
    lever: float  # [m]
    approximates: bool

    @classmethod
    def of(
        cls, b: Bound, size: int, d1: Array | None = None, d2: Array | None = None
    ) -> PinocchioConstraint:
        """Return a point or a frame, shifted by d1 in the axes of c1 and by d2 in those of c2."""
        # where a contact is unanchored, c2 is not read
        one, two = (
            placement if d is None else placement * pin.SE3(np.eye(3), d)
            for placement, d in ((b.placement1, d1), (b.placement2, d2))
        )
        name = b.name
        if size != b.size:
            name += "-" if d2 is not None and d2.sum() < 0 else "+"
        return cls(
            name, size, b.joint1, one, b.joint2, two, b.anchored, b.lever,
            approximates=size != b.size,
        )  # fmt: skip

    def to_pinocchio(self, model: Any) -> Any:
        """Return the RigidConstraintModel."""
        kind = pin.ContactType.CONTACT_3D if self.size == 3 else pin.ContactType.CONTACT_6D
        made = pin.RigidConstraintModel(
            kind, model, self.joint1, self.placement1, self.joint2, self.placement2, LOCAL
        )
        made.name = self.name
        return made
