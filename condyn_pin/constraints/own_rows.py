"""Rows of functions that a user writes: c(q, t) = 0 with its Jacobian, or J(q, t) v = b(q, t)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import finite, text_of
from condyn_pin.constraints.constraint import Constraint, FramedModel, text
from condyn_pin.constraints.path import Polynomial
from condyn_pin.constraints.rows.bound import RowPath
from condyn_pin.constraints.rows.functions import BoundOwn
from condyn_pin.errors import InvalidArgument, InvalidConstraint

# Differences of functions that bend over 1e-2 rad are off by less, relative to J and J'.
_OFF: Final = 1e-4
_ROUNDING: Final = 1e-9  # of c, in its rate by differences
_SOME_TIME: Final = 0.37  # at which functions are compared with their rates [s]


@dataclass(frozen=True)
class OwnRows(Constraint):
    """Rows of your own functions of the whole q, and of time, on positions or on velocities.

        c(q, t) = 0,  J = dc/dq    or    J(q, t) v = b(q, t);        J a + J' v - b' = a_ref

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
    rheonomic : bool
        Whether time enters: then the functions are of (q, t) [s], and `rate` of (q, v, t), with
        dJ/dt in it.
    speed : callable, optional
        (q, t) -> b (rows,) [m/s or rad/s] of rows with time, J v = b: -dc/dt, which is differenced
        by default, or the wanted velocity where there is no violation.
    time : float, optional
        The time at which they are evaluated [s]; ``scene.at(t)`` sets it.
    name : str, optional
        Name of the constraint, which it needs.

    Raises
    ------
    InvalidArgument
        If there is no name, no function or no row; in a scene also if a function returns another
        shape or no finite numbers, or if J v - b is not the rate of c.

    Notes
    -----
    Functions are called often, with a q that is theirs to change, and return the same for the same
    q and t. ``Driven(OwnRows(...), along)`` has c(q) = s(t), or J v = s'(t). The force is lam,
    J^T lam on all coordinates: ``solution.forces[name].generalized()``; where time enters, its
    power lam . b is part of a trajectory's `energy`. Files, the compiled core, `Soft`, scenes of
    other coordinates (`Scene.lock`), and derivatives of steps where time enters, refuse such rows.
    """

    jacobian: Callable[..., ArrayLike]
    rows: int = 1
    violation: Callable[..., ArrayLike] | None = None
    rate: Callable[..., ArrayLike] | None = None
    turns: bool = False
    rheonomic: bool = False
    speed: Callable[..., ArrayLike] | None = None
    time: float | None = None  # [s]

    def __post_init__(self) -> None:
        text("name", self.name, "constraint")
        for argument in ("jacobian", "violation", "rate", "speed"):
            value = getattr(self, argument)
            if not callable(value) and (value is not None or argument == "jacobian"):
                raise InvalidArgument(f"{argument} = {text_of(value)}: a function is needed")
        check_type("rows", self.rows, int, "a number of rows is needed")
        if self.rows < 1:
            raise InvalidArgument(f"rows = {self.rows}: one row or more is needed")
        for argument in ("turns", "rheonomic"):
            check_type(argument, getattr(self, argument), bool, "True or False is needed")
        if self.time is not None:
            object.__setattr__(self, "time", float(finite("time", self.time, ())))
        if (self.speed or self.time is not None) and not self.rheonomic:
            raise InvalidArgument(
                f"{self.name}: speed and time are for rows with time in them: rheonomic=True, and "
                "functions of (q, t)"
            )
        self._set_name(self.name)

    def bind(self, machine: FramedModel, rows: slice) -> BoundOwn:
        """Return the rows on all coordinates of a machine, J compared with the rate of c."""
        # time enters as in rows that follow a path, and none of them moves them besides
        at_rest = RowPath(Polynomial(((0.0,),) * self.rows), self.time) if self.rheonomic else None
        bound = BoundOwn(
            self.name, rows, machine.model, anchored=self.violation is not None, drive=at_rest,
            own=self,
        )  # fmt: skip
        self._check(bound)
        return bound

    def _check(self, bound: BoundOwn) -> None:
        """Raise InvalidArgument for J unlike differences of c, or J' unlike those of J."""
        rng = np.random.default_rng(0)
        model, t, dt = bound.model, _SOME_TIME, float(self.rheonomic)
        at = pin.integrate(model, pin.neutral(model), 0.1 * rng.uniform(-1.0, 1.0, model.nv))
        v = rng.uniform(-1.0, 1.0, model.nv)
        J, b, rate = bound.J(at, t), bound.b(at, t), bound.J_rate(at, v, t, dt)
        least = _OFF * max(np.abs(J).max(), np.abs(rate).max(), np.abs(b).max())
        least += _ROUNDING * np.abs(bound.c(at, t)).max()
        off = np.abs(bound.along(bound.c, at, v, t, dt) - (J @ v - b)).max()
        if self.violation and off > least:
            words = ("(q, t) v - speed(q, t)", "(q, t)") if self.rheonomic else ("(q) v", "(q)")
            raise InvalidArgument(
                f"{self.name}: jacobian{words[0]} is off the rate of violation{words[1]} by "
                f"{off:.3g}; columns of J are those of Pinocchio's v, by which pin.integrate "
                "moves q"
            )
        if self.rate and (off := np.abs(bound.along(bound.J, at, v, t, dt) - rate).max()) > least:
            words = ("(q, v, t)", "(q, t)") if self.rheonomic else ("(q, v)", "(q)")
            raise InvalidArgument(
                f"{self.name}: rate{words[0]} is off the rate of jacobian{words[1]} by {off:.3g}; "
                "correct it, or leave it out for differences"
            )

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundOwn:
        """Return the rows as they are: J v is the rate of c everywhere."""
        if self.rheonomic:
            raise InvalidConstraint(
                f"{self.name}: time is in its functions already; add the path to its violation"
            )
        return self.bind(machine, rows)

    def at(self, t: float) -> Self:
        """Return the rows at a time t [s]."""
        return replace(self, time=t) if self.rheonomic else self

    @property
    def is_rheonomic(self) -> bool:
        """True if time enters the functions."""
        return self.rheonomic

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
