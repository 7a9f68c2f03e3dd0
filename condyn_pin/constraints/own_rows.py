"""Rows of functions that a user writes: c(q) = 0 with its Jacobian, or A(q) v = 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array, text_of
from condyn_pin.constraints.constraint import Constraint, FramedModel, text
from condyn_pin.constraints.rows.special import BoundOwn
from condyn_pin.errors import InvalidArgument, InvalidConstraint

# Differences of functions that bend over 1e-2 rad are off by less, relative to J and J'.
_OFF: Final = 1e-4
_ROUNDING: Final = 1e-9  # of c, in its rate by differences


@dataclass(frozen=True)
class OwnRows(Constraint):
    """Rows of your own functions of the whole q, on positions or on velocities.

        c(q) = 0,  J = dc/dq    or    J(q) v = 0;        J a + J' v = a_ref

    Parameters
    ----------
    jacobian : callable
        q (nq,) -> J (rows, nv) [m or rad, per unit of v]; dc/dq along Pinocchio's velocities.
    rows : int
        Number of rows.
    violation : callable, optional
        q -> c (rows,) [m or rad], whose rate is J v; without it the rows are on the velocity alone.
    rate : callable, optional
        (q, v) -> J' (rows, nv), the rate of J while q moves by v, linear in v. By default by
        differences of `jacobian`, off by 1e-12 of its size where it bends over 1 rad or m;
        derivatives of answers are then differences of differences, off by 1e-9.
    turns : bool
        Whether the rows are angles [rad], not lengths [m].
    name : str
        Name of the constraint, which it needs.

    Raises
    ------
    InvalidArgument
        If there is no name, no function or no row; in a scene also if a function returns another
        shape or no finite numbers, or if J v is not the rate of c.

    Notes
    -----
    Functions are called often, with a q that is theirs to change, and return the same for the same
    q. ``Driven(OwnRows(...), along)`` has c(q) = s(t), or J v = s'(t). The force is lam, J^T lam on
    all coordinates: ``solution.forces[name].generalized()``. Files, the compiled core, `Soft` and
    scenes of other coordinates (`Scene.lock`) refuse such rows.
    """

    jacobian: Callable[[Array], ArrayLike]
    rows: int = 1
    violation: Callable[[Array], ArrayLike] | None = None
    rate: Callable[[Array, Array], ArrayLike] | None = None
    turns: bool = False

    def __post_init__(self) -> None:
        text("name", self.name, "constraint")
        for argument in ("jacobian", "violation", "rate"):
            value = getattr(self, argument)
            if not callable(value) and (value is not None or argument == "jacobian"):
                raise InvalidArgument(f"{argument} = {text_of(value)}: a function is needed")
        check_type("rows", self.rows, int, "a number of rows is needed")
        if self.rows < 1:
            raise InvalidArgument(f"rows = {self.rows}: one row or more is needed")
        check_type("turns", self.turns, bool, "True or False is needed")
        self._set_name(self.name)

    def bind(self, machine: FramedModel, rows: slice) -> BoundOwn:
        """Return the rows on all coordinates of a machine, J compared with the rate of c."""
        bound = BoundOwn(
            self.name, rows, machine.model, self.jacobian, self.violation, self.rate,
            are_angles=self.turns, anchored=self.violation is not None,
        )  # fmt: skip
        self._check(bound)
        return bound

    def _check(self, bound: BoundOwn) -> None:
        """Raise InvalidArgument for J unlike differences of c, or J' unlike those of J."""
        rng = np.random.default_rng(0)
        model = bound.model
        at = pin.integrate(model, pin.neutral(model), 0.1 * rng.uniform(-1.0, 1.0, model.nv))
        v = rng.uniform(-1.0, 1.0, model.nv)
        J, rate = bound.J(at), bound.J_rate(at, v)
        least = _OFF * max(np.abs(J).max(), np.abs(rate).max())
        least += _ROUNDING * np.abs(bound.c(at)).max()
        if self.violation and (off := np.abs(bound.along(bound.c, at, v) - J @ v).max()) > least:
            raise InvalidArgument(
                f"{self.name}: jacobian(q) v is off the rate of violation(q) by {off:.3g}; columns "
                "of J are those of Pinocchio's v, by which pin.integrate moves q"
            )
        if self.rate and (off := np.abs(bound.along(bound.J, at, v) - rate).max()) > least:
            raise InvalidArgument(
                f"{self.name}: rate(q, v) is off the rate of jacobian(q) by {off:.3g}; correct it, "
                "or leave it out for differences"
            )

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundOwn:
        """Return the rows as they are: J v is the rate of c everywhere."""
        return self.bind(machine, rows)

    @property
    def on_velocity(self) -> bool:
        """True without a violation."""
        return self.violation is None

    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the world and all joints: any coordinate may be in a row."""
        return tuple(range(machine.model.njoints))

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return all joints, what holds them, and no axes."""
        return "all joints", "the bodies before them", ""

    def with_held(self, values: Mapping[str, float]) -> Self:
        """Raise: the functions read all of q."""
        raise InvalidConstraint(
            f"{self.name}: its functions read all of q, and joints that are left out are not in "
            "it; hold them by HeldJoint, or write the rows for the smaller robot"
        )

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Self:
        """Raise: functions have their own units."""
        raise InvalidArgument(f"{self.name}: nothing says what units its functions have")
