"""A constraint bound to a model: joints, placements, columns and rows in place of names."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

DIRECTIONS: Final = ("rolling", "lateral", "normal")  # of what rolls on a plane

POINT: Final[tuple[int, ...]] = (0, 1, 2)
FRAME: Final[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Bound:
    """One constraint between two bodies, bound.

    Attributes
    ----------
    name : str
    rows : slice
        Its rows among those of the scene.
    joint1, placement1 : int, pin.SE3
        The joint that carries frame c1, and where.
    joint2, placement2 : int, pin.SE3
        The same of c2. The world is joint 0.
    selection : tuple of int
        The rows of the slip x y z rx ry rz that stay zero; empty for a rod.
    anchored : bool
        False for a contact that belongs wherever it is: it has no position error.
    sign : float
        +1 if the force on the first-named body is the one on joint 1, else -1.
    axis : int
        What a hinge or an edge turns about: 0, 1 or 2 for x, y or z of c1.
    length : float
        Of a rod [m]; NaN for all else.
    lever : float
        Half the distance of two points on `axis` that stand for a hinge, and what points that are
        nearly one are moved apart by (`condyn_pin.constraints.rows.spread`) [m].
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

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    @property
    def positioned(self) -> range:
        """Its rows that have a position error."""
        return range(self.rows.start, self.rows.stop if self.anchored else self.rows.start)

    @property
    def is_rod(self) -> bool:
        """Whether its row is a distance."""
        return not self.selection

    @property
    def is_hinge(self) -> bool:
        """Whether its rows are all but one turn."""
        return self.size == 5 and self.selection[:3] == POINT

    @property
    def is_planar(self) -> bool:
        """Whether its rows are all shifts but one."""
        return self.size == 2

    @property
    def is_plain(self) -> bool:
        """Whether Pinocchio has a constraint of these very rows."""
        return self.selection in (POINT, FRAME)

    @property
    def is_held(self) -> bool:
        """Whether the rows are those of c1 in its own axes: but for c, no world enters them."""
        return self.joint2 == 0 and (self.is_plain or not self.anchored)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the axis."""
        axes = [_AXES[i] for i in self.selection] or ["length"]
        return tuple(f"{self.name}.{axis}" for axis in axes)

    def whole(self, lam: Array) -> Array:
        """Return the force with the components that the kind does not transmit: they are zero.

        (3,) [N], or (6,) [N, N m] for kinds that transmit moments. A rod's direction is not known
        here.
        """
        force = np.zeros(6 if self.selection[-1] > 2 else 3)
        force[list(self.selection)] = lam
        return force


@dataclass(frozen=True)
class Coupled:
    """A coupling of two joints, bound.

    Attributes
    ----------
    name : str
    rows : slice
    configuration, velocity : pair of int
        Where q and v hold joint a and joint b.
    ratio, offset : float
        q_a = ratio q_b + offset.
    """

    name: str
    rows: slice
    configuration: tuple[int, int]
    velocity: tuple[int, int]
    ratio: float
    offset: float

    @property
    def size(self) -> int:
        """Number of rows: 1."""
        return 1

    @property
    def row_names(self) -> tuple[str, ...]:
        """The constraint's name."""
        return (f"{self.name}.ratio",)

    @property
    def anchored(self) -> bool:
        """True: the two joints have a place to be in."""
        return True

    @property
    def positioned(self) -> range:
        """Its row: it has a position error."""
        return range(self.rows.start, self.rows.stop)


@dataclass(frozen=True)
class Rolled:
    """A wheel or a ball that rolls on a plane of the world, bound.

    Attributes
    ----------
    name : str
    rows : slice
    joint1, placement1 : int, pin.SE3
        The joint that carries the frame c1 in the middle, and where.
    placement2 : pin.SE3
        A frame c2 of the plane in the world, z along its normal.
    selection : tuple of int
        Which of forward, sideways and off the plane stay zero: 0, 1 and 2.
    radius : float
        [m].
    axle : int or None
        The axis of c1 that a wheel turns about; None for a ball.
    anchored : bool
        Whether the plane has a height, so that row 2 has a position error; the others have none.
    """

    name: str
    rows: slice
    joint1: int
    placement1: Any
    placement2: Any
    selection: tuple[int, ...]
    radius: float  # [m]
    axle: int | None
    anchored: bool
    joint2: int = 0
    sign: float = 1.0

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.selection)

    @property
    def positioned(self) -> range:
        """The row that has a position error: the one off the plane, if the plane has a height."""
        held = self.anchored and 2 in self.selection
        return range(self.rows.stop - held, self.rows.stop)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the direction."""
        return tuple(f"{self.name}.{DIRECTIONS[i]}" for i in self.selection)

    def whole(self, lam: Array) -> Array:
        """Return the force (3,) with zero for the directions that slip [N]."""
        force = np.zeros(3)
        force[list(self.selection)] = lam
        return force


AnyBound = Bound | Coupled | Rolled


def is_scalar(bound: AnyBound) -> bool:
    """Whether the force of a constraint is one number: that of a rod or a coupling."""
    return isinstance(bound, Coupled) or (isinstance(bound, Bound) and bound.is_rod)
