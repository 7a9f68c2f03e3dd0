"""Cones of contact forces: of points, of wrenches, of the contacts of a scene.

Cone: what friction cones of every kind have, the sides of a pyramid, and margins.

In the axes of the floor, z along its normal, with f the force on the robot, a pyramid stands for
the round cone |(f_x, f_y)| <= mu f_z in inequalities that are linear, with k sides

    cos(2 pi i / k) f_x + sin(2 pi i / k) f_y <= mu' f_z,    i = 0, ..., k - 1

with mu' = mu around the cone and mu cos(pi / k) within it: mu / sqrt(2) for four sides.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product, zip_longest
from math import cos, pi, sin
from numbers import Real
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, check_type, normalised
from condyn_pin._core.arrays import Array, finite, finite_rows, read_only
from condyn_pin._core.models import z_along
from condyn_pin.constraints.constraint import (
    Constraint,
    Vector3,
    check_lengths,
    check_size,
    direction,
)
from condyn_pin.constraints.places import WORLD
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import ConstraintForce, upward
from condyn_pin.errors import InvalidArgument, unknown_name

Pyramid = Literal["inner", "outer"]
Row = tuple[str, tuple[float, ...]]  # its name and its entries of A

# What a contact does where its force leaves the cone. The later ones are often only consequences of
# the first: what pulls also slips, by numbers.
FAULTS: Final = ("pulls", "slips", "tips", "twists")


@dataclass(frozen=True, eq=False, repr=False)
class Margin:
    """Distance of forces from the surface of their cone; negative outside.

    Each field has a number for each of k forces, or a single number for a single force. If a
    contact is open all are infinite, and if there is no answer NaN. For impulses the unit is [N s]
    instead of [N].

    Attributes
    ----------
    pulls : (k,) array
        Normal force [N].
    slips : (k,) array
        Tangential force that is left before it slips [N].
    tips : (k,) array
        Normal force on the edge that lifts first [N]; infinite for a point.
    twists : (k,) array
        Yaw torque that is left before it turns about the normal, over half_length + half_width, as
        a tangential force [N]; infinite for a point.
    noise : (k,) array
        The size of a force that counts as none [N].
    """

    pulls: Array
    slips: Array
    tips: Array
    twists: Array
    noise: Array  # [N]

    @property
    def least(self) -> Array:
        """The smallest of the four [N]; a floor can give the force if it is not negative."""
        return np.asarray(np.minimum.reduce(self._four))[()]

    @property
    def fault(self) -> str | Array:
        """The violated one of the four, the first of them if several are; empty if none is.

        An array of text for many forces. "unknown" where there is no answer.
        """
        left = [four < -self.noise for four in self._four]
        found = np.select([np.isnan(self.least), *left], ["unknown", *FAULTS], "")
        return found if found.ndim else str(found)

    @property
    def _four(self) -> tuple[Array, ...]:
        return self.pulls, self.slips, self.tips, self.twists

    def __repr__(self) -> str:
        faults, least = np.ravel(self.fault), np.ravel(self.least)
        if least.size == 1:
            return f"Margin({least[0]:.4g} N{f': {faults[0]}' if faults[0] else ''})"
        counts = ((int((faults == each).sum()), each) for each in (*FAULTS, "unknown"))
        said = ", ".join(f"{n} {fault}" for n, fault in counts if n) or "no faults"
        worst = float(np.fmin.reduce(least, initial=np.inf))
        return f"Margin({least.size} forces, {worst:.4g} N at least: {said})"


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Friction cones as linear inequalities of forces, A f <= b, for a quadratic program.

    Attributes
    ----------
    A : (r, m) array
        For the forces of a scene, columns in the order and sign of its `lam` [1, 1/m].
    names : tuple of str
        Of the rows: the contact, what it does where the row is violated, and on which side.
    """

    A: Array
    names: tuple[str, ...]

    @property
    def b(self) -> Array:
        """The right sides (r,) [N], zero because these are cones."""
        return np.zeros(len(self.A))


@dataclass(frozen=True)
class Cone(ABC):
    """Base of the cones, those of a point and `WrenchCone` of a rectangle or an edge."""

    friction: float
    normal: Vector3 | None = field(default=None, kw_only=True)
    pyramid: Pyramid = field(default="inner", kw_only=True)

    def __post_init__(self) -> None:
        friction = float(finite("friction", self.friction, ()))
        check_size("friction", friction)
        if friction < 0:
            raise InvalidArgument(f"friction = {friction:g}: a coefficient is not negative")
        object.__setattr__(self, "friction", friction)
        if self.normal is not None:
            object.__setattr__(self, "normal", direction("normal", self.normal))
        if not isinstance(self.pyramid, str) or self.pyramid not in get_args(Pyramid):
            raise InvalidArgument(f"pyramid = {self.pyramid!r}: inner or outer is needed")

    def rows(self) -> ConeRows:
        """Return the inequalities of the pyramid, A f <= b, in the axes of the floor.

        f is the force [N], followed by the moment [N m] for a `WrenchCone`; each row counts in [N].
        """
        return _rows_and_faults(self)[0]

    @property
    def flat_rows(self) -> list[int]:
        """Rows that are equations, A f = 0, because all of them together leave nothing else.

        Without friction those of tangential forces and of the torque about the normal.
        """
        _, (_, slips, _, twists) = _rows_and_faults(self)
        return [*slips, *twists] if self.friction <= tolerances.FRICTIONLESS else []

    @abstractmethod
    def _table(self) -> Iterator[Row]:
        """Yield name and entries of each row; entries that are left out at the end are zero."""

    @abstractmethod
    def fitted(self, contact: Constraint) -> Cone:
        """Return the cone with the sizes of a `contact`; InvalidArgument if it is not for it."""

    @abstractmethod
    def turn(self, contact: Constraint, R: Array, up: Array) -> Array:
        """Return T (..., 3, 3) that takes forces to the axes of the floor: f_floor = T f.

        f is in the axes R (..., 3, 3) of the `contact` in the world; `up` (3,) is the vertical.
        """

    def margin(self, force: ConstraintForce | ArrayLike) -> Margin:
        """Return the margin of a force to its cone.

        Parameters
        ----------
        force : ConstraintForce or (..., n) array_like
            Of a contact, on either body. Or numbers, n = 3 or 6 as in `rows`: force [N] and moment
            [N m] on the robot in the axes of the floor.
        """
        if isinstance(force, ConstraintForce):
            force = force.own
            cone = self.fitted(force.constraint)
            T = cone.turn(force.constraint, force.rotation, upward(force.scene))
            return cone.judge(
                forces_in_floor_axes(T, force.components) * (-1.0 if force.on in WORLD else 1.0)
            )
        numbers = finite_rows("force", force, self.rows().A.shape[1])
        check_size("force", np.abs(numbers).max(initial=0.0))
        return self.judge(numbers)

    def judge(self, force: Array, noise: Array | None = None) -> Margin:
        """Return the margin of a `force` (..., n) in the axes of the floor; NaN where it is NaN.

        `noise` (...) is the size of a force that counts as none [N]; 1e-8 of `force` by default.
        """
        rows, kinds = _rows_and_faults(self)
        slack = -force @ rows.A.T
        pulls, slips, tips, twists = (slack[..., k].min(axis=-1, initial=np.inf) for k in kinds)
        if noise is None:
            noise = tolerances.SOLVED * np.abs(force[..., :3]).max(axis=-1)
        return Margin(pulls, slips, tips, twists, noise)

    def _check(self, contact: Constraint) -> None:
        """Refuse what does not press on a floor, and a normal for what has one of its own."""
        kind = type(contact).__name__
        if not contact.presses:
            raise InvalidArgument(f"{contact.name}: this {kind} does not press on a floor")
        if self.normal is not None and contact.has_normal:
            raise InvalidArgument(
                f"{contact.name}: a {kind} has its own normal; leave out that of its cone"
            )

    def floor_normal(self, up: Array) -> Array:
        """Return the normal of the floor: its own, or else the vertical."""
        n = up if self.normal is None else np.array(self.normal)
        if not n.any():
            raise InvalidArgument("no gravity, so no vertical: give the cone a normal=(x, y, z)")
        return n

    def _flat(self, sides: int) -> float:
        """Return the coefficient of friction of the pyramid."""
        return self.friction * (cos(pi / sides) if self.pyramid == "inner" else 1.0)

    def _slips(self, sides: int) -> Iterator[Row]:
        """Yield the sides of the pyramid."""
        for i in range(sides):
            angle = 2 * pi * i / sides
            name = f"slips at {360 * i / sides:.4g} deg"
            yield name, (cos(angle), sin(angle), -self._flat(sides))


def forces_in_floor_axes(T: Array, force: Array) -> Array:
    """Return T f (...): forces (..., 3), or forces and moments (..., 6), three by three."""
    threes = force.reshape(*force.shape[:-1], force.shape[-1] // 3, 3)
    return np.asarray((threes @ np.swapaxes(T, -1, -2)).reshape(force.shape))


@lru_cache(maxsize=64)
def _rows_and_faults(cone: Cone) -> tuple[ConeRows, tuple[list[int], ...]]:
    """Return the rows of a cone, and which of them are violated by each fault."""
    names, entries = zip(*cone._table(), strict=True)
    A = np.array(list(zip_longest(*entries, fillvalue=0.0))).T
    kinds = ([i for i, name in enumerate(names) if name.startswith(fault)] for fault in FAULTS)
    return ConeRows(read_only(A), names), tuple(kinds)


# FrictionCone: the forces that friction at a point can give.
#
# In the axes of the floor, z along its normal, with f the force on the robot and mu the coefficient
# of friction,
#
#     it does not pull      f_z >= 0
#     it does not slip      |(f_x, f_y)| <= mu f_z


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


@dataclass(frozen=True)
class RoundCone(FrictionCone):
    """Coulomb's cone of a point as it is, |f_t| <= mu f_n, and no pyramid: for a `Controller`.

    A pyramid within the cone gives up some of what the floor can give, mu (1 - cos(pi / k)) of k
    sides, and more in some directions than in others. This one makes the program of a tick one of
    second-order cones; where it takes linear rows, as in `cone_rows`, it is the pyramid of eight
    sides around it.

    Parameters
    ----------
    friction : float
        Coefficient of friction mu [1]; 0 for a floor without.
    normal : (3,) sequence of float, optional
        Of the floor at a `PointContact`, in the world, as for a `FrictionCone`.

    Raises
    ------
    InvalidArgument
        If friction is negative, or the normal is zero.
    """

    pyramid: Pyramid = field(default="outer", init=False, repr=False)
    sides: int = field(default=8, init=False, repr=False)

    def _slips(self, sides: int) -> Iterator[Row]:
        """Yield the sides of the pyramid around it; a controller turns the first to the force."""
        for name, entries in super()._slips(sides):
            angle = name.removeprefix("slips at ")
            yield "slips" if angle == "0 deg" else f"slips, {angle} aside", entries


# Tension: the force of a cable, T >= 0.


@dataclass(frozen=True)
class Tension(Cone):
    """The forces of a cable that stays taut: it pulls, and does not push."""

    friction: float = 0.0

    def _table(self) -> Iterator[Row]:
        yield "pushes", (-1.0,)

    def fitted(self, contact: Constraint) -> Tension:
        """Return the cone as it is; InvalidArgument if the `contact` is no cable."""
        if not contact.only_pulls:
            raise InvalidArgument(f"{contact.name}: this {contact.called} is no cable")
        return self

    def turn(self, contact: Constraint, R: Array, up: Array) -> Array:
        """Return the identity: a tension has no axes."""
        return np.broadcast_to(np.eye(3), R.shape)


# WrenchCone: the wrenches that friction under a flat part of the robot, or an edge, can give.
#
# In the axes of the floor, z along its normal, with f the force on the robot and m its moment about
# the middle of the contact, X and Y half the size of a rectangle along x and y, and mu the
# coefficient of friction of a pyramid,
#
#     it does not pull      f_z >= 0
#     it does not slip      |f_x|, |f_y| <= mu f_z
#     it does not tip       |m_y| <= X f_z,    |m_x| <= Y f_z
#     it does not twist     |Y f_x + s mu m_x| + |X f_y + s mu m_y| + s m_z <= mu (X + Y) f_z
#
# with s = 1 and s = -1. It tips where the centre of pressure (-m_y, m_x) / f_z leaves the
# rectangle. How much torque about the normal is left depends on where that centre is, and on what
# slipping has used up. A wrench obeys all four if and only if it is that of four forces at the
# corners, each in a pyramid of its own. An edge along x is the rectangle with Y = 0, and has m_x =
# 0.


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


# The verbs margins and cone_rows: all contacts of an answer, or of a scene, at once.
#
# Contacts stay bilateral: a cone is judged here, and enforced nowhere.


Cones: TypeAlias = Cone | Mapping[str, Cone]


def margins(answer: Any, cones: Cones) -> dict[str, Margin]:
    """Judge the contact forces of an answer, or of a motion, by friction cones.

    Parameters
    ----------
    answer : Solution, BatchSolution, Trajectory, BatchTrajectory, InverseDynamics or Impact
        What has contact forces.
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name, and then only these are
        judged.

    Returns
    -------
    dict of str to Margin
        By contact [N]; of a batch or a motion with a number for each state, (N, k) of both.

    Raises
    ------
    InvalidArgument
        If a cone is not for that kind of contact, a size or a normal is not known, or there is no
        contact to judge.
    UnknownName
        If no constraint has that name.

    Notes
    -----
    Costs half a millisecond, and for many states tens of microseconds each.
    """
    if hasattr(answer, "phases"):  # a motion, in which contacts come and go
        return _margins_of_motion(answer, cones)
    at: Any = getattr(answer, "samples", answer)  # of a batch of motions
    if not (hasattr(answer, "scene") and hasattr(at, "q") and hasattr(at, "lam")):
        raise InvalidArgument(
            f"answer = {type(answer).__name__}: it has no contact forces; a batch of motions keeps "
            "them with record=..."
        )
    _check(cones, [answer.scene])
    return _margins(answer.scene, at.q, at.lam, _noise(at.lam, axis=-1), cones)


def cone_rows(scene: Scene, q: ArrayLike, cones: Cones) -> ConeRows:
    """Return the friction cones of a scene as rows for your own program: A lam <= b.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration. Where points and edges touch, the rows turn with it.
    cones : Cone or dict of str to Cone
        As in `margins`; the rows are those of their pyramids.

    Returns
    -------
    ConeRows
        Columns in the order and sign of `Solution.lam`, as the rows of `Terms.J`; zero where a
        constraint has no cone.

    Raises
    ------
    InvalidArgument, UnknownName
        As in `margins`.

    Notes
    -----
    Costs half a millisecond.
    """
    check_scene(scene)
    _check(cones, [scene])
    blocks, names = [], []
    for name, columns, cone, T, W in _grounded(scene, normalised(scene.robot.model, "q", q), cones):
        rows = cone.rows()
        blocks.append(np.zeros((len(rows.A), scene.rows)))
        blocks[-1][:, columns] = forces_in_floor_axes(T.T, rows.A) @ W.T
        names += [f"{name}: {row}" for row in rows.names]
    return ConeRows(np.vstack(blocks), tuple(names))


def _margins(scene: Scene, q: Array, lam: Array, noise: Array, cones: Cones) -> dict[str, Margin]:
    """Return the margins at the states q (..., nq) with the forces lam (..., m)."""
    return {
        name: cone.judge(forces_in_floor_axes(T, lam[..., rows] @ W), noise)
        for name, rows, cone, T, W in _grounded(scene, q, cones)
    }


def _margins_of_motion(motion: Any, cones: Cones) -> dict[str, Margin]:
    """Return margins for each sample, infinite while a contact is away."""
    _check(cones, [phase.scene for phase in motion.phases])
    noise = np.full(len(motion), _noise(motion.lam, axis=None))
    four: dict[str, Array] = {}
    for phase in motion.phases:
        at, lam = phase.samples, motion.lam[phase.samples][:, list(phase.columns)]
        for name, part in _margins(phase.scene, motion.q[at], lam, noise[at], cones).items():
            whole = four.setdefault(name, np.full((len(FAULTS), len(motion)), np.inf))
            whole[:, at] = part.pulls, part.slips, part.tips, part.twists
    return {name: Margin(w[0], w[1], w[2], w[3], noise) for name, w in four.items()}


def _noise(lam: Array, axis: int | None) -> Array:
    """Return the size below which a force is none, beside the largest of lam [N]."""
    sizes = np.abs(np.where(np.isfinite(lam), lam, 0.0))
    return np.asarray(tolerances.SOLVED * sizes.max(axis=axis, initial=0.0))


def _grounded(
    scene: Scene, q: Array, cones: Cones
) -> Iterator[tuple[str, slice, Cone, Array, Array]]:
    """Yield name, rows, cone, T and W of each contact: f = T (lam W) in the axes of the floor."""
    # T (..., 3, 3) is at q (..., nq); W (rows, 3 or 6) has what the kind does not transmit.
    fitted = _fitted_cones(scene, cones)
    equations, states = equations_of(scene), q.shape[:-1]
    R = np.zeros((len(fitted), *states, 3, 3))
    for state in np.ndindex(states):
        ends: list[Any] = equations.placements(q[state])
        for k, i in enumerate(fitted):
            R[(k, *state)] = ends[i][0].rotation
    for (i, cone), axes in zip(fitted.items(), R, strict=True):
        bound: Any = scene.bounds[i]
        W = np.array([bound.whole(row) for row in np.eye(bound.size)])
        T = cone.turn(scene.constraints[i], axes, upward(scene))
        yield bound.name, bound.rows, cone, T, W


def _fitted_cones(scene: Scene, cones: Cones) -> dict[int, Cone]:
    """Return the cones of the contacts that are judged, by their places in the scene."""
    chosen = cones
    if not isinstance(chosen, Mapping):
        chosen = {c.name: chosen for c in scene.constraints if c.presses}
    pairs = enumerate(scene.constraints)
    return {i: chosen[c.name].fitted(c) for i, c in pairs if c.name in chosen}


def _check(cones: Cones, scenes: Sequence[Scene]) -> None:
    """Refuse what is no cone, names that no scene knows, and scenes without a contact."""
    named = cones if isinstance(cones, Mapping) else {"cones": cones}
    known = {name: None for scene in scenes for name in scene.names}
    for name, cone in named.items():
        check_type(name, cone, Cone, "a FrictionCone or a WrenchCone is needed")
        if isinstance(cones, Mapping) and name not in known:
            raise unknown_name("constraint", name, known)
    if not any(_fitted_cones(scene, cones) for scene in scenes):
        raise InvalidArgument("no contact to judge: nothing in this scene presses on a floor")
