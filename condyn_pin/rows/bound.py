"""A constraint bound to a model: joints, placements, columns and rows in place of names."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np

from condyn_pin.arrays import Array

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

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
        Half the distance of two points on `axis` that stand for a hinge [m].
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
    def is_rod(self) -> bool:
        """Whether its row is a distance."""
        return not self.selection

    @property
    def is_hinge(self) -> bool:
        """Whether its rows are all but one turn."""
        return self.size == 5 and self.selection[:3] == POINT

    @property
    def is_plain(self) -> bool:
        """Whether Pinocchio has a constraint of these very rows."""
        return self.selection in (POINT, FRAME)

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
