"""Couplings: c = q_a - ratio q_b - offset, one row of J with two entries each, and no gamma."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.rows.any_bound import AnyBound, Drive
from condyn_pin.constraints.rows.compiled_rows import COUPLING, STILL, CompiledRows
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Coupled(AnyBound):
    """A coupling of two joints, bound: q_a = ratio q_b + offset.

    `configuration` and `velocity` say where q and v hold joint a and joint b. Of a joint that is
    held alone, b is a, and the ratio is zero.
    """

    name: str
    rows: slice
    configuration: tuple[int, int]
    velocity: tuple[int, int]
    ratio: float
    offset: float
    anchored: bool = True
    sign: float = 1.0
    drive: Drive | None = None

    @property
    def is_alone(self) -> bool:
        """Whether it holds one joint, and not two to each other."""
        return self.ratio == 0.0

    @property
    def columns(self) -> list[int]:
        """The columns of its row that are not zero: of joint a, and of joint b if there is one."""
        return list(self.velocity[:1] if self.is_alone else self.velocity)

    @property
    def entries(self) -> tuple[float, ...]:
        """What its row has in these columns."""
        return (1.0,) if self.is_alone else (1.0, -self.ratio)

    @property
    def row_names(self) -> tuple[str, ...]:
        """The constraint's name."""
        return (f"{self.name}.{'joint' if self.is_alone else 'ratio'}",)

    @property
    def is_scalar(self) -> bool:
        """True: it acts along joints."""
        return True

    def compiled(self) -> CompiledRows:
        """Return its row as the compiled core has it."""
        places = [*self.configuration, *self.velocity]
        integers = [COUPLING, self.rows.start, 1, 0, 0, 0, True, 0, False, False, *places]
        return CompiledRows(integers, [*STILL, *STILL, 1.0, self.ratio, self.offset])

    def moved(self, joints: Sequence[int]) -> Coupled:
        """Return it as it is: it knows columns, and they are the same."""
        return self

    def ends(self, oMi: Any) -> None:
        """Return None: it has no frames."""
        return

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Refuse: it acts along joints."""
        raise InvalidArgument(f"{self.name}: a coupling acts along joints, at no point")

    def reaction(self, *, on_first: bool) -> float:
        """Return the ratio: both forces do the same work."""
        if self.is_alone:
            return 1.0
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
        columns: Callable[[Sequence[int]], float | Array],
    ) -> Any:
        """Return what both coordinates give way."""
        return columns(self.columns)


class Couplings:
    """All couplings of one scene."""

    def __init__(self, bounds: Sequence[Coupled], nv: int) -> None:
        self._rows = np.array([b.rows.start for b in bounds], dtype=np.int_)
        self._a, self._b = np.array([b.configuration for b in bounds], dtype=np.int_).T
        self._ratio = np.array([b.ratio for b in bounds])
        self._offset = np.array([b.offset for b in bounds])
        self._J = np.zeros((len(bounds), nv))
        for row, b in zip(self._J, bounds, strict=True):
            row[b.columns] = b.entries

    def evaluate(self, q: Array, v: Array, a: Array, rows: tuple[Array, Array, Array]) -> None:
        """Write c, J v and J a into the three vectors of all rows."""
        c, velocity, acceleration = rows
        c[self._rows] = q[self._a] - self._ratio * q[self._b] - self._offset
        velocity[self._rows] = self._J.dot(v)
        acceleration[self._rows] = self._J.dot(a)

    def torque(self, lam: Array) -> Array:
        """Return J^T lam (nv,) of these rows."""
        return np.asarray(self._J.T.dot(lam[self._rows]))

    def jacobian(self, J: Array) -> None:
        """Write these rows into J (m, nv)."""
        J[self._rows] = self._J
