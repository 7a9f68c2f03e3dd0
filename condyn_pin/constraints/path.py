"""Paths of driven rows: functions of time with their first two derivatives.

    t -> (s(t), s'(t), s''(t))

Any function that returns the three will do; those here are frozen values, so that scenes with them
compare, pickle and are written to files.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import count_text, register
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.errors import InvalidArgument

# t [s] -> s, s' and s'', a number a row each
Along = Callable[[float], tuple[Array, Array, Array]]

# All paths by the names of their classes: archives find them there.
PATHS: dict[str, type[Path]] = {}

# On the circle about t: of s'' of a sine of 20 rad/s they leave 1e-13.
_POINTS: Final = 16


class Path(ABC):
    """Path that is a frozen value; a dataclass of numbers and tuples of numbers."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register(PATHS, cls.__name__, cls, f"a path named {cls.__name__}")

    @abstractmethod
    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Return s, s' and s'' at t [s]."""

    def _freeze(self) -> None:
        """Convert every number to a tuple; all tuples need one length."""
        longest = max(np.size(value) for value in vars(self).values())
        for name, value in tuple(vars(self).items()):
            if np.size(value) not in (1, longest):
                raise InvalidArgument(f"{name} = {text_of(value)}: {longest} numbers are needed")
            found = finite(name, np.atleast_1d(value), np.size(value))
            object.__setattr__(self, name, tuple(np.broadcast_to(found, longest).tolist()))


@dataclass(frozen=True)
class Sine(Path):
    """A sinusoidal motion about a value.

    s = offset + amplitude sin(2 pi frequency t + phase)

    Parameters
    ----------
    amplitude : float or (rows,) sequence of float
        Amplitude of each row [m, rad].
    frequency : float or (rows,) sequence of float
        Frequency of each row [Hz].
    phase : float or (rows,) sequence of float
        Phase at t = 0 [rad].
    offset : float or (rows,) sequence of float
        Mean of each row [m, rad].
    """

    amplitude: float | Sequence[float]  # [m, rad]
    frequency: float | Sequence[float] = 1.0  # [Hz]
    phase: float | Sequence[float] = 0.0  # [rad]
    offset: float | Sequence[float] = 0.0  # [m, rad]

    def __post_init__(self) -> None:
        self._freeze()

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Return s, s' and s'' at t [s]."""
        A, rate = np.array(self.amplitude), 2 * math.pi * np.array(self.frequency)
        angle = rate * t + np.array(self.phase)
        s = A * np.sin(angle)
        return s + np.array(self.offset), rate * A * np.cos(angle), -(rate**2) * s


@dataclass(frozen=True)
class Polynomial(Path):
    """A polynomial of time; a constant rate is ``Polynomial((s0, rate))``.

    s = c_0 + c_1 t + c_2 t^2 + ...

    Parameters
    ----------
    coefficients : (k,) or (rows, k) sequence of float
        Lowest power first [m, rad, over s, s^2, ...].

    Raises
    ------
    InvalidArgument
        If a coefficient is not finite.
    """

    coefficients: Sequence[float] | Sequence[Sequence[float]]

    def __post_init__(self) -> None:
        found = np.atleast_2d(np.array(self.coefficients, dtype=float))
        if found.ndim != 2 or not found.size or not np.isfinite(found).all():
            raise InvalidArgument(
                f"coefficients = {text_of(self.coefficients)}: finite numbers are needed, those "
                "of a row beside one another"
            )
        object.__setattr__(self, "coefficients", tuple(map(tuple, found.tolist())))

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Return s, s' and s'' at t [s]."""
        c = np.array(self.coefficients)
        power = np.arange(c.shape[1])
        rate, bend = power[1:] * c[:, 1:], power[2:] * (power[2:] - 1) * c[:, 2:]
        return tuple(each @ t ** np.arange(each.shape[1]) for each in (c, rate, bend))


@dataclass(frozen=True)
class MinimumJerk(Path):
    """A minimum-jerk motion from rest to rest; `condyn_pin.control.minimum_jerk` makes it.

    s = start + (10 x^3 - 15 x^4 + 6 x^5) (end - start),    x = (t - begin) / duration

    Parameters
    ----------
    start, end : (rows,) sequence of float
        Where it starts and ends [m, rad].
    duration : float
        Length of the motion [s].
    begin : float
        When it leaves the start [s].

    Raises
    ------
    InvalidArgument
        If start and end differ in size, or the duration is not positive.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    duration: float  # [s]
    begin: float = 0.0  # [s]

    def __post_init__(self) -> None:
        size = np.size(self.start)
        for name in ("start", "end"):
            value = finite(name, np.atleast_1d(getattr(self, name)), size)
            object.__setattr__(self, name, tuple(value.tolist()))
        check_positive("time [s]", duration=self.duration)
        for name in ("duration", "begin"):
            object.__setattr__(self, name, float(finite(name, getattr(self, name), ())))

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Return s, s' and s'' at t [s]."""
        T, start = self.duration, np.array(self.start)
        s = min(max((t - self.begin) / T, 0.0), 1.0)
        distance = np.array(self.end) - start
        x = s**3 * (10 - 15 * s + 6 * s**2)
        v = 30 * s**2 * (1 - s) ** 2 / T
        a = 60 * s * (1 - s) * (1 - 2 * s) / T**2
        return start + x * distance, v * distance, a * distance


@dataclass(frozen=True)
class _Analytic:
    values: Callable[[Any], Any]
    radius: float  # [s]

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        around = np.exp(2j * math.pi * np.arange(_POINTS) / _POINTS)
        on_circle = np.array([self._at(complex(t + self.radius * z)) for z in around])
        s, rate, bend = (
            math.factorial(k) * (around**-k @ on_circle).real / (_POINTS * self.radius**k)
            for k in range(3)
        )
        there = self._at(t)
        if np.abs(s - there).max() > tolerances.ANALYTIC * np.abs(on_circle).max():
            raise InvalidArgument(
                f"values: at t = {t:g} s they are {there}, and {s} on average around it, within "
                f"{self.radius:g} s: a formula without abs, min and conditions is needed, or a "
                "smaller radius"
            )
        return s, rate, bend

    def _at(self, t: complex) -> NDArray[Any]:
        try:
            return np.atleast_1d(self.values(t))
        except TypeError as error:
            raise InvalidArgument(
                f"values(t) of a complex t: {error}; numpy's functions take it, math's do not"
            ) from error


def analytic(values: Callable[[Any], ArrayLike], *, radius: float = 0.05) -> Along:
    """Return the path of an analytic formula for s; its rates are by Cauchy's formula.

    s^(k)(t) = k! / (N r^k) sum_j s(t + r z^j) z^-jk,    z = exp(2 pi i / N),  N = 16

    Parameters
    ----------
    values : callable
        s of a complex t [s]: sums, products, quotients, powers and numpy's functions, without
        abs, min, or conditions on t.
    radius : float
        r [s]: well below the times in which s changes, and the distance to its nearest pole.

    Returns
    -------
    callable
        t -> (s, s', s''), for `Driven`.

    Raises
    ------
    InvalidArgument
        If the radius is not positive; when it is asked, if the formula is not analytic.

    Notes
    -----
    Of a sine of rate w [rad/s] the error is (w r)^16 / 16!, and 1e-16 / r^2 of s'' is rounding:
    4e-14 with the default, up to w = 20. Cost: 16 values.

    References
    ----------
    Lyness, Moler. Numerical differentiation of analytic functions. SIAM Journal on Numerical
    Analysis 4, 1967.
    """
    check_positive("time [s]", radius=radius)
    return _Analytic(values, float(radius))


# What a path is at a time, and whether its rates are those of its values.


# Where the derivatives of a path are compared with its differences [s], and what may be between.
_NEAR: Final = 1e-4
_OFF: Final = 0.05

# Rates that are none [m/s, rad/s, and per second]: a path that leaves rest as t^5 bends within the
# differences.
_STILL: Final = 1e-9


def along_at(along: Along, t: float, rows: int, name: str) -> Array:
    """Path s, s' and s'' (3, rows) at a time, or InvalidArgument."""
    value = along(t)
    try:
        found = np.array([np.atleast_1d(np.asarray(each, dtype=float)) for each in value])
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (3, rows):
        raise InvalidArgument(
            f"{name}: along({t:g}) = {text_of(value)}: three arrays are needed, s, its rate and "
            f"the rate of that, {count_text(rows, 'number')} each"
        )
    if not np.isfinite(found).all():
        raise InvalidArgument(f"{name}: along({t:g}) = {text_of(value)} is not finite")
    return found


def check_along(along: Along, rows: int, name: str, at: Sequence[float] = (0.0,)) -> None:
    """Raise InvalidArgument for a path of a wrong size, or with rates unlike its differences."""
    # It is checked at some times [s], twice at each, because a path may have a kink.
    if not callable(along):
        raise InvalidArgument(
            f"along = {text_of(along)}: a Path is needed, or a function of t that returns s and "
            "its first two derivatives"
        )
    for t in at:
        faults = [_fault(along, rows, name, t + k * _NEAR) for k in (0, 4)]
        if all(faults):
            raise InvalidArgument(f"{name}: of along(t) the {faults[0]}")


def _fault(along: Along, rows: int, name: str, t: float) -> str:
    """Contradiction between the rates of a path and its differences; empty if there is none."""
    before, here, after = (along_at(along, t + k * _NEAR, rows, name) for k in (0, 1, 2))
    size = np.abs([before, here, after]).max(axis=(0, 2))
    for i, what in ((0, "second value is not the rate of the first"),
                    (1, "third value is not the rate of the second")):  # fmt: skip
        rate = (after[i] - before[i]) / (2 * _NEAR)
        # what rounding leaves of a difference, and the bend within it
        least = 1e-12 * size[i] / _NEAR + 1e-6 * size[i + 1] + _NEAR * size[2] + _STILL
        if (np.abs(rate - here[i + 1]) > _OFF * np.abs(rate) + least).any():
            return (
                f"{what}: {text_of(here[i + 1])} at t = {t + _NEAR:g} s, where differences have "
                f"{text_of(rate)}"
            )
    return ""
