"""Couplings: rows of joint coordinates, linear but for what bends them.

c = sum w_i q_i + sum p_i(q_i) - offset,    p_i(x) = k_2 x^2 + k_3 x^3 + ...
J = w_i + p_i',    J a + gamma = J a + sum p_i'' v_i^2
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.rows.any_bound import AnyBound, Drive
from condyn_pin.constraints.rows.compiled_rows import COUPLING, STILL, CompiledRows
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Coupled(AnyBound):
    """A row of joint coordinates, bound.

    Attributes
    ----------
    configuration, velocity : tuple of int
        Where q and v hold the joints.
    weights : tuple of float
        Of each joint.
    bends : tuple of tuple of float
        k_2, k_3, ... of each joint; empty where all rows are linear.
    """

    name: str
    rows: slice
    configuration: tuple[int, ...]
    velocity: tuple[int, ...]
    weights: tuple[float, ...]
    offset: float
    bends: tuple[tuple[float, ...], ...] = ()
    anchored: bool = True
    sign: float = 1.0
    drive: Drive | None = None

    @property
    def is_alone(self) -> bool:
        """True if it holds one joint, and not several to each other."""
        return len(self.weights) == 1

    @property
    def columns(self) -> list[int]:
        """The columns of its row that are not zero."""
        return list(self.velocity)

    def bent(self, q: Array, order: int) -> Array:
        """Derivative of sum w_i q_i + p_i(q_i) by each q_i, of an order from 0 on."""
        x = q[list(self.configuration)]
        bends = self.bends or ((),) * len(self.weights)
        terms = zip(self.weights, bends, x, strict=True)
        return np.array([Polynomial((0.0, w, *bend)).deriv(order)(at) for w, bend, at in terms])

    @property
    def row_names(self) -> tuple[str, ...]:
        """The constraint's name."""
        return (f"{self.name}.{'joint' if self.is_alone else 'ratio'}",)

    @property
    def is_scalar(self) -> bool:
        """True: it acts along joints."""
        return True

    def compiled(self) -> CompiledRows | None:
        """Return its row as the compiled core has it: q_a - ratio q_b, or one joint alone."""
        if self.bends or self.weights[0] != 1.0 or len(self.weights) > 2:
            return None
        places = [p[i] for p in (self.configuration, self.velocity) for i in (0, -1)]
        ratio = 0.0 if self.is_alone else -self.weights[1]
        integers = [COUPLING, self.rows.start, 1, 0, 0, 0, True, 0, False, False, *places]
        return CompiledRows(integers, [*STILL, *STILL, 1.0, ratio, self.offset])

    def moved(self, joints: Sequence[int]) -> Coupled:
        """Return it as it is: it knows columns, and they are the same."""
        return self

    def ends(self, oMi: Any) -> None:
        """Return None: it has no frames."""
        return

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Return the force along the coordinate of its first joint."""
        return self.weights[0] * lam

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Refuse: it acts along joints."""
        raise InvalidArgument(f"{self.name}: a coupling acts along joints, at no point")

    def reaction(self, *, on_first: bool) -> float:
        """Return the ratio: both forces do the same work."""
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
        """Return whether the coordinate of its first joint is an angle."""
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
        """Return what its coordinates give way."""
        return columns(self.columns)


class Couplings:
    """All couplings of one scene."""

    def __init__(self, bounds: Sequence[Coupled], nv: int) -> None:
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
