"""A constraint bound to a model: joints, placements, columns and rows in place of names.

`AnyBound` is what the rest of the program asks (`condyn_pin.constraints.rows.any_bound`). `Bound`,
`Coupled`, `Rolled` and `Related` (`condyn_pin.constraints.rows.related`) are what groups evaluate
together, inside of this room.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.rows.any_bound import AnyBound as AnyBound
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.errors import InvalidArgument

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

DIRECTIONS: Final = ("rolling", "lateral", "normal")  # of what rolls on a plane

# |e x n| of a wheel that lies flat: it has no lowest point, and rounding would choose one.
FLAT: Final = 1e-12

POINT: Final[tuple[int, ...]] = (0, 1, 2)
FRAME: Final[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Bound(OnFrames):
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

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Return the origin of c2, where nothing else is known of the pair of forces."""
        if not self.anchored and self.joint2 == 0:
            return np.array(c1.translation)  # nothing says where c2 is
        if self.is_plain:  # a weld keeps its wrench whole, a ball acts at each body's own point
            at_two = self.selection == POINT and on_first != (self.sign > 0)
            return np.array((c2 if at_two else c1).translation)
        return np.array(c2.translation)

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
class Coupled(AnyBound):
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
    anchored: bool = True
    sign: float = 1.0

    @property
    def row_names(self) -> tuple[str, ...]:
        """The constraint's name."""
        return (f"{self.name}.ratio",)

    @property
    def is_scalar(self) -> bool:
        """True: it acts along joints."""
        return True

    def moved(self, joints: Sequence[int]) -> Coupled:
        """Return it as it is: it knows columns, and they are the same."""
        return self

    def ends(self, oMi: Any) -> None:
        """Return None: it has no frames."""
        return

    def whole(self, lam: Array) -> Array:
        """Return the force along the coordinate of joint a (1,) [N m or N]."""
        return lam.copy()

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Refuse: it acts along joints."""
        raise InvalidArgument(f"{self.name}: a coupling acts along joints, at no point")

    def reaction(self, *, on_first: bool) -> float:
        """Return the ratio: both forces do the same work."""
        return self.ratio if on_first else 1.0 / self.ratio

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Return whether the coordinate of joint a is an angle."""
        iv = self.velocity[0]
        joint = next(j for j in model.joints if j.idx_v <= iv < j.idx_v + j.nv)
        return np.array([not lengths(joint)[iv - int(joint.idx_v)]])

    def end(self, frame: str) -> Literal[1, 2]:
        """Refuse: it has no frames."""
        raise InvalidArgument(f"name = {self.name!r}: a coupling has no frames")

    def yields(
        self,
        body: Callable[[int], Array],
        columns: Callable[[Sequence[int]], float],
    ) -> Any:
        """Return what both coordinates give way."""
        return columns(self.velocity)


@dataclass(frozen=True)
class Rolled(OnFrames):
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

    def ends(self, oMi: Any) -> tuple[Any, Any]:
        """Return where it touches, in the axes of its rows, and the plane."""
        return self.touching(oMi[self.joint1]), self.placement2

    def touching(self, oMi: Any) -> Any:
        """Return the frame of the rows: its origin the lowest point, its axes t, n x t and n.

        `oMi` is the placement of its joint in the world.
        """
        oMc1, R2 = oMi * self.placement1, self.placement2.rotation
        n, t = R2[:, 2], R2[:, 0]
        r = -self.radius * n
        if self.axle is not None:
            e = oMc1.rotation[:, self.axle]
            m = np.cross(e, n)
            size = float(np.linalg.norm(m))
            t = m / size if size > FLAT else t
            r = self.radius * np.cross(e, t) if size > FLAT else 0.0 * n
        return pin.SE3(np.column_stack([t, np.cross(n, t), n]), oMc1.translation + r)

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Return the lowest point."""
        return np.array(c1.translation)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Return that no row is an angle."""
        return np.zeros(self.size, dtype=bool)

    def end(self, frame: str) -> Literal[1, 2]:
        """Return 1 for the frame in its middle; it has no other."""
        if frame == "second":
            raise InvalidArgument(
                f"{self.name!r} rolls on a plane of the world, which has no frame"
            )
        return 1
