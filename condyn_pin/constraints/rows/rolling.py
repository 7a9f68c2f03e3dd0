"""Rolling: the lowest point of a wheel or of a ball has no velocity.

In the axes of the body, with n the normal of the plane, w its angular velocity, and all that is
fixed in the world turning backwards, n' = n x w:

    wheel with axle e    t = e x n / |e x n|    r = radius e x t
    ball                 t = x of the plane     r = -radius n

The axes of the rows are T = (t, n x t, n), and with the slip of the lowest point s = v + w x r

    J v = T s,        J a + gamma = T s' + T' s,        s' = v' + w' x r + w x r'

v' and w' component by component. The last row is the rate of the point's height, c = n . (r - p),
p a point of the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import Drive, OnFrames, length, tilt
from condyn_pin.constraints.rows.compiled_rows import ROLL, CompiledRows, placement
from condyn_pin.constraints.rows.cut_joints import cross
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import FrameJacobian, rows_of
from condyn_pin.errors import InvalidArgument

DIRECTIONS: Final = ("rolling", "lateral", "normal")

# |e x n| of a wheel that lies flat: it has no lowest point, and rounding would choose one.
FLAT: Final = 1e-12

_SKEW: Final = np.array([pin.skew(e).ravel() for e in np.eye(3)])


@dataclass(frozen=True)
class Rolled(OnFrames):
    """A wheel or a ball that rolls on a plane of the world, bound.

    Attributes
    ----------
    joint1, placement1 : int, pin.SE3
        The joint that carries the frame c1 in the middle, and where.
    placement2 : pin.SE3
        A frame c2 of the plane in the world, z along its normal.
    selection : tuple of int
        Which of forward, sideways and off the plane stay zero: 0, 1 and 2.
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
    drive: Drive | None = None

    def arm(self, oMi: Any) -> float:
        """Return the radius: the rows are about the point that touches [m]."""
        return self.radius

    @property
    def positioned(self) -> range:
        """The row that has a position error: the one off the plane, if the plane has a height."""
        held = self.anchored and 2 in self.selection
        return range(self.rows.stop - held, self.rows.stop)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the direction."""
        return tuple(f"{self.name}.{DIRECTIONS[i]}" for i in self.selection)

    def compiled(self) -> CompiledRows:
        """Return its rows as the compiled core has them."""
        chosen = sum(1 << row for row in self.selection)
        axle = -1 if self.axle is None else self.axle
        integers = [
            ROLL, self.rows.start, self.size, self.joint1, 0, chosen, self.anchored, axle,
            False, False, 0, 0, 0, 0,
        ]  # fmt: skip
        placed = [*placement(self.placement1), *placement(self.placement2)]
        return CompiledRows(integers, [*placed, self.sign, self.radius, 0.0])

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
            m = pin.skew(e) @ n
            size = float(np.linalg.norm(m))
            t = m / size if size > FLAT else t
            r = self.radius * pin.skew(e) @ t if size > FLAT else 0.0 * n
        return pin.SE3(np.stack([t, pin.skew(n) @ t, n], axis=1), oMc1.translation + r)

    @property
    def leans(self) -> bool:
        """True of a wheel: its rows are along e x n / |e x n|, and it may lie nearly flat."""
        return self.axle is not None

    def shares(self, oMi: Any) -> Array:
        """Sizes of a wheel's shifts, with the errors of their directions."""
        assert self.axle is not None
        e = oMi[self.joint1].rotation @ self.placement1.rotation[:, self.axle]
        size = length(pin.skew(e) @ self.placement2.rotation[:, 2])
        return np.tile([1.0 + tilt(size > FLAT, size), 0.0], (self.size, 1))

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


class Rolling:
    """All that rolls in one scene; the ends are the body and the plane of each."""

    def __init__(self, ends: Ends, bounds: Sequence[Rolled]) -> None:
        self._bounds, self._ends = tuple(bounds), ends
        k = len(bounds)
        self._rows = rows_of(bounds)
        chosen = [3 * i + j for i, b in enumerate(bounds) for j in b.selection]
        self._chosen = np.array(chosen, dtype=np.int_)  # of the k x 3 components
        self._heights = np.array([[float(b.anchored)] for b in bounds])
        radius = np.array([[[b.radius]] for b in bounds])
        is_ball = np.array([[[float(b.axle is None)]] for b in bounds])
        axle = np.array([np.zeros(3) if b.axle is None else np.eye(3)[b.axle] for b in bounds])
        # t is along e x n or x, and r = radius e x t or -radius n
        self._t_of_n, self._t_of_x = skews(axle), is_ball * np.eye(3)
        self._r_of_t, self._r_of_n = radius * self._t_of_n, -radius * is_ball
        self._T, self._r = np.zeros((k, 3, 3)), np.zeros((k, 3, 1))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows into the three vectors of all rows."""
        E, p = self._ends.apart()
        (v, _), (a, _) = self._ends.linear()[..., None]
        W, A = skews(self._ends.angular()[:, 0])
        r_dot, T_dot = self._point(E, -W @ E)
        T, r = self._T, self._r
        s = v + W @ r
        s_dot = a + A @ r + W @ (r_dot - v)  # a is the classical one
        height = np.zeros_like(p)
        height[:, 2] = (self._heights * (T[:, 2:] @ (r - p[:, :, None]))[:, :, 0])[:, 0]
        rows = height, T @ s, T @ s_dot + T_dot @ s
        for three, out in zip(rows, (c, velocity, acceleration), strict=True):
            out[self._rows] = three.reshape(-1)[self._chosen]

    def stack(self, lam: Array, f1: Array, _: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1, in its axes."""
        three = np.zeros((len(self._bounds), 1, 3))
        three.reshape(-1)[self._chosen] = lam[self._rows]
        force = (three @ self._T)[:, 0]
        f1.reshape(-1, 6)[:] = np.hstack([force, cross(self._r[:, :, 0], force)])

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows into J (m, nv), at the last evaluation."""
        for b, T, r in zip(self._bounds, self._T, self._r, strict=True):
            of = of_frame(b.joint1, b.placement1)
            J[b.rows] = (T @ (of[:3] - pin.skew(r[:, 0]) @ of[3:]))[list(b.selection)]

    def _point(self, E: Array, E_dot: Array) -> tuple[Array, Array]:
        """Find the lowest points r and the axes T of the rows; return the rates of both.

        Of every array here the first half is the value and the second one its rate.
        """
        both = np.stack([E, E_dot])
        n = both[..., 2:]
        t = self._t_of_n @ n + self._t_of_x @ both[..., :1]
        size = np.sqrt((t[0] * t[0]).sum(axis=1, keepdims=True))
        t *= np.divide(1.0, size, out=np.zeros_like(size), where=size > FLAT)
        t[1] -= t[0] * (t[0] * t[1]).sum(axis=1, keepdims=True)
        r = self._r_of_t @ t + self._r_of_n * n
        N = skews(n[..., 0])
        across = N @ t[0]
        across[1] += N[0] @ t[1]
        T, T_dot = np.concatenate([t, across, n], axis=-1).transpose(0, 1, 3, 2)
        self._T, self._r = T, r[0]
        return r[1], T_dot


def skews(x: Array) -> Array:
    """Return the matrices of x times, (..., 3, 3) for many (..., 3)."""
    return np.asarray((x @ _SKEW).reshape(*x.shape, 3))
