"""Rows of functions of the whole q, and of time.

    c(q, t) = 0,    J v = b(q, t),    J a + gamma = a_ref,    gamma = J' v - b'

Rows at rest have b = 0; where c has the time in it, b = -dc/dt. With K = dJ/dq the rates of a
motion are

    J' = K v + dJ/dt,    b' = (db/dq) v + db/dt,
    dgamma/dv = K_v + J' - db/dq,    K_v = v . K, the partials of J v by q.

A rate that has no closed form is differenced to fourth order along a move of unit size, off by
1e-12 of its bends; differences of differences by 1e-9.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.rows.bound import RowPath
from condyn_pin.constraints.rows.special import STENCIL, STEP, CoordinateRows
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class BoundFunctions(CoordinateRows, ABC):
    """Rows of functions, bound to a model whose q they read."""

    name: str
    rows: slice
    model: Any
    anchored: bool = True
    sign: float = 1.0
    drive: RowPath | None = None
    drift: Baumgarte | None = None

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the constraint and number of the row."""
        return tuple(f"{self.name}.{i + 1}" for i in range(self.size))

    def at_work(self) -> BoundFunctions:
        """The rows with what memory they need, not to be shared between threads: as they are."""
        return self

    @property
    def rheonomic(self) -> bool:
        """True if time enters the functions, and not just a path that they follow."""
        return False

    def wanted_rate(self, q: Array, t: float) -> Array:
        """Rate J v (size,) that the rows follow at q and t [s]."""
        return super().wanted_rate(q, t) + self.b(q, t)

    @property
    def time(self) -> float:
        """Time of the scene [s]; 0 where it has none."""
        return (self.drive.time if self.drive else None) or 0.0

    @abstractmethod
    def c(self, q: Array, t: float) -> Array:
        """Violation c (size,); zero of rows on the velocity."""

    @abstractmethod
    def J(self, q: Array, t: float) -> Array:
        """Jacobian J (size, nv)."""

    def b(self, q: Array, t: float) -> Array:
        """Wanted J v (size,), besides that of a path."""
        return np.zeros(self.size)

    def J_rate(self, q: Array, v: Array, t: float, dt: float) -> Array:
        """Rate J' (size, nv) of J while q moves by v and t by dt."""
        return self.along(self.J, q, v, t, dt)

    def b_rate(self, q: Array, v: Array, t: float, dt: float) -> Array:
        """Rate b' (size,) while q moves by v and t by dt."""
        return self.along(self.b, q, v, t, dt) if self.rheonomic else np.zeros(self.size)

    def drift_of(self, q: Array, v: Array, t: float) -> Array:
        """Rate J' v (size,), without b'."""
        return np.asarray(self.J_rate(q, v, t, float(self.rheonomic)) @ v)

    def bend(self, q: Array, t: float) -> Array:
        """Partials K (size, nv, nv) of J by q: the last index is that of the move."""
        return np.stack([self.J_rate(q, e, t, 0.0) for e in np.eye(self.model.nv)], axis=-1)

    def b_q(self, q: Array, t: float) -> Array:
        """Partials (size, nv) of b by q."""
        return np.stack([self.b_rate(q, e, t, 0.0) for e in np.eye(self.model.nv)], axis=-1)

    def gamma_q(self, q: Array, v: Array, t: float) -> Array:
        """Partials (size, nv) of gamma by q."""

        def gamma(at: Array, t: float) -> Array:
            return self.drift_of(at, v, t) - self.b_rate(at, v, t, float(self.rheonomic))

        by = [self.along(gamma, q, e, t, 0.0) for e in np.eye(self.model.nv)]
        return np.stack(by, axis=-1)

    def along(
        self, f: Callable[[Array, float], Array], q: Array, v: Array, t: float, dt: float
    ) -> Array:
        """Derivative of a function of q and t along v and dt."""
        size = max(float(np.abs(v).max(initial=0.0)), abs(dt))
        h = STEP / (size or 1.0)
        return sum(
            w / h * f(pin.integrate(self.model, q, k * h * v), t + k * h * dt) for k, w in STENCIL
        )  # type: ignore[return-value]

    def reaction(self, *, on_first: bool) -> float:
        """Raise: the force acts on all coordinates."""
        raise InvalidArgument(
            f"{self.name}: it acts on all coordinates; generalized() has the force on each"
        )

    def approximate_delassus(
        self,
        body: Callable[[int], Array],
        columns: Callable[[Sequence[int]], float | Array],
    ) -> Any:
        """Raise: MuJoCo has no such rows."""
        raise InvalidArgument(
            f"{self.name}: MuJoCo has no rows of functions, so that Soft has no stiffness for "
            "them; choose another solver"
        )


@dataclass(frozen=True, kw_only=True)
class BoundOwn(BoundFunctions):
    """Rows of functions that a user writes, bound."""

    own: Any  # the `OwnRows` with the functions

    @property
    def rheonomic(self) -> bool:
        """True if time enters the functions."""
        return bool(self.own.rheonomic)

    def c(self, q: Array, t: float) -> Array:
        """Violation c (size,); zero of rows on the velocity."""
        if self.own.violation is None:
            return np.zeros(self.size)
        return self._called("violation", self.own.violation, (self.size,), q, t)

    def J(self, q: Array, t: float) -> Array:
        """Jacobian J (size, nv)."""
        return self._called("jacobian", self.own.jacobian, (self.size, self.model.nv), q, t)

    def b(self, q: Array, t: float) -> Array:
        """Wanted J v (size,): that of the user, or -dc/dt."""
        if self.own.speed is not None:
            return self._called("speed", self.own.speed, (self.size,), q, t)
        if not self.rheonomic or self.own.violation is None:
            return np.zeros(self.size)
        return -self.along(self.c, q, np.zeros(self.model.nv), t, 1.0)

    def J_rate(self, q: Array, v: Array, t: float, dt: float) -> Array:
        """Rate J' (size, nv) of J while q moves by v and t by dt."""
        if self.own.rate is None:
            return self.along(self.J, q, v, t, dt)
        shape = (self.size, self.model.nv)
        found = self._called("rate", self.own.rate, shape, q, t, v)
        if self.rheonomic and not dt:  # the user's has dJ/dt in it
            found -= self._called("rate", self.own.rate, shape, q, t, 0.0 * v)
        return found

    def _called(
        self, what: str, f: Callable[..., ArrayLike], shape: tuple[int, ...], q: Array, t: float,
        *v: Array,
    ) -> Array:  # fmt: skip
        """Result of a function of the user as an array, or InvalidArgument."""
        of = (q.copy(), *(each.copy() for each in v), *([t] if self.rheonomic else []))
        words = f"{what}({', '.join(('q', *('v' for _ in v), *(['t'] * self.rheonomic)))})"
        # a copy: it may be memory that the next call overwrites
        return np.array(finite(f"{self.name}: {words}", f(*of), shape))

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flag of each row: angle, or else length."""
        return np.full(self.size, self.own.turns)


class Functions:
    """All rows of functions of one scene."""

    def __init__(self, bounds: Sequence[BoundFunctions], nv: int) -> None:
        self._rows = [(b.at_work(), np.zeros((b.size, nv))) for b in bounds]
        self._moving = [b for b in bounds if b.rheonomic]
        self.t: float | None = None  # that of each constraint, if None [s]

    def evaluate(self, q: Array, v: Array, a: Array, rows: tuple[Array, Array, Array]) -> None:
        """Write c, J v and J a + J' v into the three vectors of all rows."""
        c, velocity, acceleration = rows
        for b, J in self._rows:
            t = self._time(b)
            c[b.rows], J[:] = b.c(q, t), b.J(q, t)
            velocity[b.rows], acceleration[b.rows] = J @ v, J @ a + b.drift_of(q, v, t)

    def demand(self, q: Array, v: Array, wanted: Array) -> None:
        """Write b and b' of rows with time in them into `wanted` (3, m)."""
        for b in self._moving:
            t = self._time(b)
            wanted[1, b.rows], wanted[2, b.rows] = b.b(q, t), b.b_rate(q, v, t, 1.0)

    def torque(self, lam: Array) -> Array:
        """Return J^T lam (nv,) of these rows, at the last evaluation."""
        return np.asarray(sum(J.T @ lam[b.rows] for b, J in self._rows))

    def jacobian(self, J: Array) -> None:
        """Write these rows into J (m, nv), at the last evaluation."""
        for b, its in self._rows:
            J[b.rows] = its

    def _time(self, b: BoundFunctions) -> float:
        return b.time if self.t is None else self.t
