"""Rows of relations, couplings and rolling.

Relations: rows that a kind writes itself as W s, with s the six relative velocities.

    J v = W s,        J a + gamma = W s' + W' s,        wrench at c2, in the axes of c1:  W^T lam

`condyn_pin.constraints.relation` says what W is, `frames` what s and s' are.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol, Self

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import lengths
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.rows.bound import (
    BoundConstraint,
    CompiledRows,
    RowPath,
    TwoFrameConstraint,
    length,
    tilt,
)
from condyn_pin.constraints.rows.frames import (
    Ends,
    FrameJacobian,
    cross,
    relative_velocities,
    rows_of,
)
from condyn_pin.errors import InvalidArgument

# Step of differences of rows [m and rad], and their weights: they are off by h^4 and by eps / h.
STEP: Final = 1e-3
STENCIL: Final = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))


class Relation(Protocol):
    """Equations of a kind between two frames: `condyn_pin.constraints.relation.FrameRelation`."""

    @property
    def row_words(self) -> tuple[str, ...]:
        """Name of each row, behind that of the constraint."""

    @property
    def angles(self) -> tuple[bool, ...]:
        """Flag of each row: angle, or else length."""

    def violation(self, R: Array, r: Array) -> Array:
        """Violation c (rows,)."""

    def weights(self, R: Array, r: Array) -> Array:
        """Weights W (rows, 6)."""

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Rate W' (rows, 6) of the weights while the frames move by s."""

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Return the partials of W' by moves of the frames (6, rows, 6)."""

    @property
    def of_cut(self) -> Mapping[str, Any] | None:
        """Fields of its `CompiledRows` as rows of a cut joint; None if the core lacks them."""


def differenced_bend(
    weights_rate: Callable[[Array, Array, Array], Array], R: Array, r: Array, s: Array
) -> Array:
    """Partials of W' by moves of the frames (6, rows, 6), s fixed, by fourth-order differences."""
    by = []
    for d in STEP * np.eye(6):
        moved = ((pin.exp3(-k * d[3:]) @ R, r - k * d[:3], w / STEP) for k, w in STENCIL)
        by.append(sum(w * weights_rate(turned, shifted, s) for turned, shifted, w in moved))
    return np.array(by)


@dataclass(frozen=True)
class BoundRelation(TwoFrameConstraint):
    """A relation of two frames, bound; its `relation` has the equations."""

    name: str
    rows: slice
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    relation: Relation
    anchored: bool = True
    sign: float = 1.0
    drive: RowPath | None = None
    drift: Baumgarte | None = None

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each row."""
        return tuple(f"{self.name}.{word}" for word in self.relation.row_words)

    @property
    def of_six(self) -> range:
        """Rows of W."""
        return range(self.size)

    @property
    def is_scalar(self) -> bool:
        """True: the force is recorded by its rows, as its direction turns with the state."""
        return True

    @property
    def is_held(self) -> bool:
        """False: the world enters the rows."""
        return False

    def force(self, lam: Array, ends: Any) -> Array:
        """Force and moment W^T lam in the axes of c1, at c2 (6,)."""
        c1, c2 = ends()
        between = c1.actInv(c2)
        W = self.relation.weights(between.rotation, between.translation)
        return np.asarray(W.T @ lam)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flag of each row: angle, or else length."""
        return np.array(self.relation.angles)

    @property
    def has_computed_axes(self) -> bool:
        """True if W changes with the state."""
        return not isinstance(self.relation, RelativePosition)

    def shares(self, oMi: Any) -> Array:
        """Sizes of W, and of its change by rounding of the frames' positions."""
        c1, c2 = self.placed(oMi)
        between = c1.actInv(c2)
        R, r = between.rotation, between.translation
        moves = np.diag(3 * [self.reach(oMi)] + 3 * [1.0])
        W, rate = self.relation.weights, self.relation.weights_rate
        sizes = np.abs(W(R, r)) + sum(np.abs(rate(R, r, move)) for move in moves)
        most = 1.0 / np.finfo(float).eps  # nothing is left of the direction
        return np.asarray(np.minimum(sizes, most).reshape(-1, 2, 3).max(axis=2))

    def compiled(self) -> CompiledRows | None:
        """Rows in the format of the compiled core, if it has this relation: some of a cut joint."""
        if (of_cut := self.relation.of_cut) is None:
            return None
        return CompiledRows(
            "cut", self.rows, self.joint1, self.joint2, self.placement1, self.placement2,
            sign=self.sign, **of_cut,
        )  # fmt: skip


@dataclass(frozen=True)
class RelativePosition:
    """Position of the origin of c2 in the axes of c1, some of its coordinates: -r = 0.

    A relation of two frames whose W, (1, 0), is constant: c' = J v wherever c2 is.
    """

    chosen: tuple[int, ...]

    @property
    def row_words(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple("xyz"[i] for i in self.chosen)

    @property
    def angles(self) -> tuple[bool, ...]:
        """Flags of the rows: none is an angle."""
        return (False,) * len(self.chosen)

    def violation(self, R: Array, r: Array) -> Array:
        """Violation c (rows,) [m]."""
        return -r[list(self.chosen)]

    def weights(self, R: Array, r: Array) -> Array:
        """Weights W (rows, 6)."""
        return np.eye(6)[list(self.chosen)]

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Rate W' (rows, 6): zero."""
        return np.zeros((len(self.chosen), 6))

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Partials of W' (6, rows, 6): zero."""
        return np.zeros((6, len(self.chosen), 6))

    @property
    def of_cut(self) -> dict[str, Any]:
        """Rows that are chosen."""
        return {"selection": self.chosen}


class Relations:
    """All relations of one scene."""

    def __init__(self, ends: Ends, bounds: Sequence[BoundRelation]) -> None:
        self._ends, self._bounds = ends, tuple(bounds)
        self._at: list[tuple[Array, Array, Array]] = []  # W, R and r of the last evaluation

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows into the three vectors of all rows."""
        self._at = []
        for b, R, r, s, s_dot in zip(self._bounds, *relative_velocities(self._ends), strict=True):
            s, s_dot = s.ravel(), s_dot.ravel()
            W = b.relation.weights(R, r)
            c[b.rows], velocity[b.rows] = b.relation.violation(R, r), W @ s
            acceleration[b.rows] = W @ s_dot + b.relation.weights_rate(R, r, s) @ s
            self._at.append((W, R, r))

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1 and c2, each in its axes."""
        for b, (W, R, r), on1, on2 in zip(
            self._bounds, self._at, f1.reshape(-1, 6), f2.reshape(-1, 6), strict=True
        ):
            six = W.T @ lam[b.rows]
            on1[:3], on1[3:] = six[:3], six[3:] + pin.skew(r) @ six[:3]
            on2[:3], on2[3:] = R.T @ six[:3], R.T @ six[3:]

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows into J (m, nv), at the last evaluation."""
        for b, (W, R, r) in zip(self._bounds, self._at, strict=True):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            linear = J1[:3] - pin.skew(r) @ J1[3:] - R @ J2[:3]
            J[b.rows] = W @ np.vstack([linear, J1[3:] - R @ J2[3:]])


class CoordinateRows(BoundConstraint, ABC):
    """Rows of the coordinates, between no frames; their forces act along joints."""

    @property
    def is_scalar(self) -> bool:
        """True: the force acts along joints."""
        return True

    def moved(self, joints: Sequence[int]) -> Self:
        """Constraint as it is: joint numbers do not change its columns."""
        return self

    def ends(self, oMi: Any) -> None:
        """None: there are no frames."""
        return

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Raise: the force acts along joints."""
        raise InvalidArgument(f"{self.name}: it acts along joints, at no point")

    def end(self, frame: str) -> Literal[1, 2]:
        """Raise: there are no frames."""
        raise InvalidArgument(f"name = {self.name!r}: it has no frames")


# Couplings: rows of joint coordinates, linear but for what bends them.
#
# c = sum w_i q_i + sum p_i(q_i) - offset,    p_i(x) = k_2 x^2 + k_3 x^3 + ... J = w_i + p_i',    J
# a + gamma = J a + sum p_i'' v_i^2


@dataclass(frozen=True)
class BoundCoupling(CoordinateRows):
    """Row of joint coordinates, bound."""

    name: str
    rows: slice
    # configuration, velocity: where q and v hold the joints
    configuration: tuple[int, ...]
    velocity: tuple[int, ...]
    weights: tuple[float, ...]  # of each joint
    offset: float
    # k_2, k_3, ... of each joint; empty where all rows are linear.
    bends: tuple[tuple[float, ...], ...] = ()
    anchored: bool = True
    sign: float = 1.0
    drive: RowPath | None = None
    drift: Baumgarte | None = None

    @property
    def is_alone(self) -> bool:
        """True if the row holds one joint alone."""
        return len(self.weights) == 1

    @property
    def columns(self) -> list[int]:
        """Nonzero columns of the row."""
        return list(self.velocity)

    def bent(self, q: Array, order: int) -> Array:
        """Derivative of sum w_i q_i + p_i(q_i) by each q_i, of an order from 0 on."""
        x = q[list(self.configuration)]
        bends = self.bends or ((),) * len(self.weights)
        terms = zip(self.weights, bends, x, strict=True)
        return np.array([Polynomial((0.0, w, *bend)).deriv(order)(at) for w, bend, at in terms])

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the constraint."""
        return (f"{self.name}.{'joint' if self.is_alone else 'ratio'}",)

    def compiled(self) -> CompiledRows | None:
        """Row in the format of the compiled core: q_a - ratio q_b, or one joint alone."""
        if self.bends or self.weights[0] != 1.0 or len(self.weights) > 2:
            return None
        at_q, at_v = ((p[0], p[-1]) for p in (self.configuration, self.velocity))
        ratio = 0.0 if self.is_alone else -self.weights[1]
        return CompiledRows(
            "coupling", self.rows, at_q=at_q, at_v=at_v, length=ratio, offset=self.offset
        )

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Force along the coordinate of the first joint."""
        return self.weights[0] * lam

    def reaction(self, *, on_first: bool) -> float:
        """Ratio of the coupling: both forces do the same work."""
        if self.is_alone:
            return 1.0
        if self.bends or len(self.weights) > 2:
            raise InvalidArgument(
                f"{self.name}: it acts on {len(self.weights)} joints, by ratios of their own; "
                "generalized() has the force on each"
            )
        ratio = -self.weights[1] / self.weights[0]
        return ratio if on_first else 1.0 / ratio

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """True if the coordinate of the first joint is an angle, in an array (1,)."""
        iv = self.velocity[0]
        joint = next(j for j in model.joints if j.idx_v <= iv < j.idx_v + j.nv)
        return np.array([not lengths(joint)[iv - int(joint.idx_v)]])

    def approximate_delassus(
        self,
        body: Callable[[int], Array],
        columns: Callable[[Sequence[int]], float | Array],
    ) -> Any:
        """Sum of the inverse inertias of the coupled coordinates."""
        return columns(self.columns)


class Couplings:
    """All couplings of one scene."""

    def __init__(self, bounds: Sequence[BoundCoupling], nv: int) -> None:
        self._rows = np.array([b.rows.start for b in bounds], dtype=np.int_)
        self._offset = np.array([b.offset for b in bounds])
        self._bent = [(k, b) for k, b in enumerate(bounds) if b.bends]
        self._J = np.zeros((len(bounds), nv))
        self._weights, columns = np.zeros((len(bounds), nv)), np.zeros(nv, dtype=np.int_)
        for k, b in enumerate(bounds):
            self._weights[k, b.columns] = self._J[k, b.columns] = b.weights
            columns[b.columns] = b.configuration
        self._columns = columns  # where q holds what v has in each column

    def evaluate(self, q: Array, v: Array, a: Array, rows: tuple[Array, Array, Array]) -> None:
        """Write c, J v and J a + gamma into the three vectors of all rows."""
        c, velocity, acceleration = rows
        c[self._rows] = self._weights.dot(q[self._columns]) - self._offset
        for k, b in self._bent:
            self._J[k, b.columns] = b.bent(q, 1)
            c[self._rows[k]] = b.bent(q, 0).sum() - b.offset
        velocity[self._rows] = self._J.dot(v)
        acceleration[self._rows] = self._J.dot(a)
        for k, b in self._bent:
            acceleration[self._rows[k]] += b.bent(q, 2).dot(v[b.columns] ** 2)

    def torque(self, lam: Array) -> Array:
        """Return J^T lam (nv,) of these rows, at the last evaluation."""
        return np.asarray(self._J.T.dot(lam[self._rows]))

    def jacobian(self, J: Array) -> None:
        """Write these rows into J (m, nv), at the last evaluation."""
        J[self._rows] = self._J


# Rolling: the lowest point of a wheel or of a ball has no velocity.
#
# In the axes of the body, with n the normal of the plane, w its angular velocity, and all that is
# fixed in the world turning backwards, n' = n x w:
#
#     wheel with axle e    t = e x n / |e x n|    r = radius e x t
#     ball                 t = x of the plane     r = -radius n
#
# The axes of the rows are T = (t, n x t, n), and with the slip of the lowest point s = v + w x r
#
#     J v = T s,        J a + gamma = T s' + T' s,        s' = v' + w' x r + w x r'
#
# v' and w' component by component. The last row is the rate of the point's height, c = n . (r - p),
# p a point of the plane.


DIRECTIONS: Final = ("rolling", "lateral", "normal")

# |e x n| of a wheel that lies flat: it has no lowest point, and rounding would choose one.
FLAT: Final = 1e-12

_SKEW: Final = np.array([pin.skew(e).ravel() for e in np.eye(3)])


@dataclass(frozen=True)
class BoundRolling(TwoFrameConstraint):
    """Wheel or ball that rolls on a plane of the world, bound."""

    name: str
    rows: slice
    # joint1, placement1: the joint that carries the frame c1 in the middle, and where
    joint1: int
    placement1: Any
    placement2: Any  # A frame c2 of the plane in the world, z along its normal
    selection: tuple[int, ...]  # which of forward, sideways and off the plane stay zero: 0, 1 and 2
    radius: float  # [m]
    axle: int | None  # the axis of c1 that a wheel turns about; None for a ball
    # whether the plane has a height, so that row 2 has a position error; the others have none
    anchored: bool
    joint2: int = 0
    sign: float = 1.0
    drive: RowPath | None = None
    drift: Baumgarte | None = None

    def arm(self, oMi: Any) -> float:
        """Distance from c1 to the contact point, the radius [m]."""
        return self.radius

    @property
    def positioned(self) -> range:
        """Row with a position error: the normal one, if the plane has a height."""
        held = self.anchored and 2 in self.selection
        return range(self.rows.stop - held, self.rows.stop)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each row: the constraint's and the direction."""
        return tuple(f"{self.name}.{DIRECTIONS[i]}" for i in self.selection)

    def compiled(self) -> CompiledRows:
        """Rows in the format of the compiled core."""
        return CompiledRows(
            "roll", self.rows, self.joint1, 0, self.placement1, self.placement2, self.selection,
            anchored=self.anchored, axis=-1 if self.axle is None else self.axle, sign=self.sign,
            length=self.radius,
        )  # fmt: skip

    def whole(self, lam: Array) -> Array:
        """Force (3,) with zeros for the directions that slip [N]."""
        return _whole(self.selection, lam)

    def ends(self, oMi: Any) -> tuple[Any, Any]:
        """Frame at the contact point, in the axes of the rows, and the frame of the plane."""
        return self.touching(oMi[self.joint1]), self.placement2

    def touching(self, oMi: Any) -> Any:
        """Frame of the rows: its origin the lowest point, its axes t, n x t and n."""
        # `oMi` is the placement of its joint in the world.
        return touching_frame(oMi * self.placement1, self.placement2, self.radius, self.axle)

    @property
    def has_computed_axes(self) -> bool:
        """True for a wheel: its rows are along e x n / |e x n|, and it may lie nearly flat."""
        return self.axle is not None

    def shares(self, oMi: Any) -> Array:
        """Sizes of a wheel's shifts, with the errors of their directions."""
        assert self.axle is not None
        e = oMi[self.joint1].rotation @ self.placement1.rotation[:, self.axle]
        size = length(pin.skew(e) @ self.placement2.rotation[:, 2])
        return np.tile([1.0 + tilt(size > FLAT, size), 0.0], (self.size, 1))

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Lowest point."""
        return np.array(c1.translation)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flags of the rows: none is an angle."""
        return np.zeros(self.size, dtype=bool)

    def end(self, frame: str) -> Literal[1, 2]:
        """Return 1 for the frame in the middle, the only one."""
        if frame == "second":
            raise InvalidArgument(
                f"{self.name!r} rolls on a plane of the world, which has no frame"
            )
        return 1


def _whole(selection: Sequence[int], lam: Array) -> Array:
    """Force (3,) with zeros for the directions that slip [N]."""
    force = np.zeros(3)
    force[list(selection)] = lam
    return force


def touching_frame(c1: Any, c2: Any, radius: float, axle: int | None) -> Any:
    """Frame of the rows: its origin the lowest point over c2, its axes t, n x t and n."""
    n, t = c2.rotation[:, 2], c2.rotation[:, 0]
    r = -radius * n
    if axle is not None:
        e = c1.rotation[:, axle]
        m = pin.skew(e) @ n
        size = float(np.linalg.norm(m))
        t = m / size if size > FLAT else t
        r = radius * pin.skew(e) @ t if size > FLAT else 0.0 * n
    return pin.SE3(np.stack([t, pin.skew(n) @ t, n], axis=1), c1.translation + r)


# On a plane that a body carries the same rows are a relation of two frames: with c1 in the middle,
# c2 in the plane, and all in the axes of c1,
#
#     n = R e_z,    d = r_low - r,    c = n . d,    W = T (1, -[d]x)
#
# r_low the lowest point from the middle: r above.


@dataclass(frozen=True)
class RollingOver:
    """Rows of a wheel or a ball over a plane of another body."""

    radius: float  # [m]
    axle: int | None  # the axis of c1 that a wheel turns about; None for a ball
    selection: tuple[int, ...]
    has_height: bool  # else the plane is where it rolls

    @property
    def row_words(self) -> tuple[str, ...]:
        """Names of the directions."""
        return tuple(DIRECTIONS[i] for i in self.selection)

    @property
    def angles(self) -> tuple[bool, ...]:
        """Flags of the rows: none is an angle."""
        return (False,) * len(self.selection)

    def violation(self, R: Array, r: Array) -> Array:
        """Height (rows,) over the plane, zero along it [m]."""
        T, low = self._touch(R)
        return np.array([0.0, 0.0, self.has_height * T[2] @ (low - r)])[list(self.selection)]

    def weights(self, R: Array, r: Array) -> Array:
        """Weights W (rows, 6)."""
        T, low = self._touch(R)
        return np.hstack((T, -T @ pin.skew(low - r)))[list(self.selection)]

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Rate W' (rows, 6) while the frames move by s."""
        T, low = self._touch(R)
        T_dot, low_dot = self._touch_rate(R, T, -pin.skew(s[3:]) @ R)
        turned = -T_dot @ pin.skew(low - r) - T @ pin.skew(low_dot + s[:3])
        return np.hstack((T_dot, turned))[list(self.selection)]

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Partials of W' by moves of the frames (6, rows, 6), by differences."""
        return differenced_bend(self.weights_rate, R, r, s)

    @property
    def of_cut(self) -> None:
        """None: the core has no such rows."""

    def _touch(self, R: Array) -> tuple[Array, Array]:
        """Axes T (3, 3) of the rows, and the lowest point from the middle; zeros of one flat."""
        n, t = R[:, 2], R[:, 0]
        if self.axle is None:
            return np.array([t, pin.skew(n) @ t, n]), -self.radius * n
        e = pin.skew(np.eye(3)[self.axle])
        m = e @ n
        size = length(m)
        t = m / size if size > FLAT else 0.0 * m
        return np.array([t, pin.skew(n) @ t, n]), self.radius * e @ t

    def _touch_rate(self, R: Array, T: Array, R_dot: Array) -> tuple[Array, Array]:
        """Rates of both while R changes by R_dot."""
        (t, _, n), n_dot, t_dot = T, R_dot[:, 2], R_dot[:, 0]
        low_dot = -self.radius * n_dot
        if self.axle is not None:
            e = pin.skew(np.eye(3)[self.axle])
            m_dot, size = e @ n_dot, length(e @ n)
            t_dot = (m_dot - t * (t @ m_dot)) / size if size > FLAT else 0.0 * t
            low_dot = self.radius * e @ t_dot
        across = pin.skew(n_dot) @ t + pin.skew(n) @ t_dot
        return np.array([t_dot, across, n_dot]), low_dot


@dataclass(frozen=True)
class BoundRollingOver(BoundRelation):
    """Wheel or ball that rolls on a plane of another body, bound."""

    relation: RollingOver

    @property
    def is_scalar(self) -> bool:
        """False: the force has the axes of the rows."""
        return False

    @property
    def positioned(self) -> range:
        """Row with a position error: the normal one, if the plane has a height."""
        held = self.anchored and 2 in self.relation.selection
        return range(self.rows.stop - held, self.rows.stop)

    def whole(self, lam: Array) -> Array:
        """Force (3,) with zeros for the directions that slip [N]."""
        return _whole(self.relation.selection, lam)

    def force(self, lam: Array, ends: Any) -> Array:
        """Force (3,) along t, n x t and n [N]."""
        return self.whole(lam)

    def ends(self, oMi: Any) -> tuple[Any, Any]:
        """Frame at the contact point, in the axes of the rows, and the frame of the plane."""
        c1, c2 = self.placed(oMi)
        return touching_frame(c1, c2, self.relation.radius, self.relation.axle), c2

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Lowest point."""
        return np.array(c1.translation)


class Rolling:
    """All rolling constraints of one scene; the ends are the body and the plane of each."""

    def __init__(self, ends: Ends, bounds: Sequence[BoundRolling]) -> None:
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
        """Compute the lowest points r and the axes T of the rows; return the rates of both."""
        # Of every array here the first half is the value and the second one its rate.
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
    """Matrices of x times, (..., 3, 3) for many (..., 3)."""
    return np.asarray((x @ _SKEW).reshape(*x.shape, 3))
