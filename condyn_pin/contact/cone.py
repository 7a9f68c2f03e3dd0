"""Cone: what friction cones of every kind have, the sides of a pyramid, and margins.

In the axes of the floor, z along its normal, with f the force on the robot, a pyramid stands for
the round cone |(f_x, f_y)| <= mu f_z in inequalities that are linear, with k sides

    cos(2 pi i / k) f_x + sin(2 pi i / k) f_y <= mu' f_z,    i = 0, ..., k - 1

with mu' = mu around the cone and mu cos(pi / k) within it: mu / sqrt(2) for four sides.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import zip_longest
from math import cos, pi, sin
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, finite, finite_rows, read_only
from condyn_pin.constraints.base import WORLD, Constraint, Vector3, check_size, direction
from condyn_pin.dynamics.solution import ConstraintForce, upward
from condyn_pin.errors import InvalidArgument

Pyramid = Literal["inner", "outer"]
Row = tuple[str, tuple[float, ...]]  # its name and its entries of A

# What a contact does where its force leaves the cone. The later ones are often only consequences of
# the first: what pulls also slips, by numbers.
FAULTS: Final = ("pulls", "slips", "tips", "twists")


@dataclass(frozen=True, eq=False, repr=False)
class Margin:
    """How far forces are inside their cone; negative values are outside.

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
        """Which of the four is violated, the first of them if several are; empty if none is.

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
    """What every cone has; `FrictionCone` and `WrenchCone` say what it means."""

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
        return _made(self)[0]

    @property
    def flat_rows(self) -> list[int]:
        """Rows that are equations, A f = 0, because all of them together leave nothing else.

        Without friction those of tangential forces and of the torque about the normal.
        """
        _, (_, slips, _, twists) = _made(self)
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
        """Return how far a force is from leaving the cone.

        Parameters
        ----------
        force : ConstraintForce or (..., n) array_like
            Of a contact, on either body. Or numbers, n = 3 or 6 as in `rows`: force [N] and moment
            [N m] on the robot in the axes of the floor.
        """
        if isinstance(force, ConstraintForce):
            cone = self.fitted(force.constraint)
            T = cone.turn(force.constraint, force.rotation, upward(force.scene))
            return cone.judge(turned(T, force.components) * (-1.0 if force.on in WORLD else 1.0))
        numbers = finite_rows("force", force, self.rows().A.shape[1])
        check_size("force", np.abs(numbers).max(initial=0.0))
        return self.judge(numbers)

    def judge(self, force: Array, noise: Array | None = None) -> Margin:
        """Return the margin of a `force` (..., n) in the axes of the floor; NaN where it is NaN.

        `noise` (...) is the size of a force that counts as none [N]; 1e-8 of `force` by default.
        """
        rows, kinds = _made(self)
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


def turned(T: Array, force: Array) -> Array:
    """Return T f (...): forces (..., 3), or forces and moments (..., 6), three by three."""
    threes = force.reshape(*force.shape[:-1], force.shape[-1] // 3, 3)
    return np.asarray((threes @ np.swapaxes(T, -1, -2)).reshape(force.shape))


@lru_cache(maxsize=64)
def _made(cone: Cone) -> tuple[ConeRows, tuple[list[int], ...]]:
    """Return the rows of a cone, and which of them are violated by each fault."""
    names, entries = zip(*cone._table(), strict=True)
    A = np.array(list(zip_longest(*entries, fillvalue=0.0))).T
    kinds = ([i for i, name in enumerate(names) if name.startswith(fault)] for fault in FAULTS)
    return ConeRows(read_only(A), names), tuple(kinds)
