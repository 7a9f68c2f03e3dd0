"""Normal path: one contact through an impact, along its normal impulse p (Darboux, Keller).

    d sigma / dp = G d,    d = (-mu sigma_t / |sigma_t|, 1)      while it slips
                           d = (-G_tt^-1 G_tn, 1)                once it has stopped, if it sticks
    compression up to sigma_n = 0 takes the normal work |W_c|; then expansion ends
    where it has given back  e^2 |W_c|  (Stronge),  or where  p = (1 + e) p_c  (Poisson)

Where slip keeps its direction, as in every plane mechanism, and once it has stopped, the path is a
line, and the end of a phase the root of a quadratic. Where slip turns it is an ODE, in a time in
which dp = |sigma_t| dt: smooth where slip comes to its end. What has stopped and cannot stick slips
on along the one direction in which (G d)_t is parallel to it: a line again.

References
----------
Stronge. Impact mechanics. Cambridge University Press, 2000.
Keller. Impact with friction. Journal of Applied Mechanics 53, 1986.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, pi, sin, sqrt
from typing import Final, Literal

import numpy as np

from condyn_pin._core.arrays import Array

End = Literal["stronge", "poisson"]

# Velocities that are none, relative to the largest before the impact, and normal rates that are,
# relative to G_nn: what does not move by its own impulse to ten digits is jammed.
_STILL: Final = 1e-12
_JAMMED: Final = 1e-10

# Slip that turns by less than rounding keeps its direction.
_STRAIGHT: Final = 1e-12

# Legs of one path, at most: two phases with a stop of slip in one of them are three.
_LEGS: Final = 12

# Accuracy of paths that turn, and the time in which slip has fallen by e^-1000.
_ACCURATE: Final = 1e-12
_LONGEST: Final = 1e3

# Directions in which the one is looked for along which slip goes on.
_DIRECTIONS: Final = 360


def normal_path(G: Array, before: Array, mu: float, e: float, end: End = "stronge") -> Array:
    """Impulses (t1, t2, n) of one contact that strikes [N s], with sigma (3,) `before` it [m/s]."""
    # G is (3, 3) [1/kg]; `end` is where expansion ends. Nothing comes back of a contact that jams:
    # one that its own impulse does not move.
    return _Path(G, np.asarray(before, dtype=float), mu, e, end).impulses()


@dataclass
class _Path:
    """A path under way."""

    G: Array
    sigma: Array  # (3,), where it is [m/s]
    mu: float
    e: float
    end: End

    def __post_init__(self) -> None:
        self.still = _STILL * float(np.abs(self.sigma).max())
        self.lam = np.zeros(3)
        self.taken = self.given = 0.0  # normal work of compression and of expansion [J]
        self.compressed: float | None = None  # p where compression has ended [N s]
        self.has_stopped = hypot(*self.sigma[:2]) <= self.still or not self.mu

    def impulses(self) -> Array:
        """Return lam (3,) at the end of the path."""
        if self.sigma[2] >= 0.0:
            return self.lam
        for _ in range(_LEGS):
            d = self._direction()
            rate, s = self.G.dot(d), self.sigma
            jams = s[2] <= self.still and rate[2] <= _JAMMED * self.G[2, 2]
            if self.compressed is not None and jams:
                break
            turn = abs(s[0] * rate[1] - s[1] * rate[0])
            is_line = turn <= _STRAIGHT * hypot(s[0], s[1]) * np.abs(self.G).max()
            straight = self.has_stopped or is_line
            ended = self._go_straight(d, rate) if straight else self._go_round()
            if not ended:
                continue
            if self.compressed is not None or not self.e:
                break
            self.compressed, self.sigma[2] = float(self.lam[2]), 0.0
        return self.lam

    def _direction(self) -> Array:
        """Return d lam / dp."""
        if not self.mu:
            return np.array([0.0, 0.0, 1.0])
        if self.has_stopped:
            return direction_after_stop(self.G, self.mu)
        x, y = self.sigma[:2] / hypot(*self.sigma[:2])
        return np.array([-self.mu * x, -self.mu * y, 1.0])

    def _go_straight(self, d: Array, rate: Array) -> bool:
        """Go along a line to where slip stops, or the phase ends; return whether that is so."""
        s, stop = self.sigma, inf
        if not self.has_stopped and (towards := float(s[:2].dot(rate[:2]))) < 0.0:
            stop = -float(s[:2].dot(s[:2])) / towards
        end = self._end_of_line(float(s[2]), float(rate[2]))
        p = min(stop, end)
        self._count(float(s[2]) * p + 0.5 * float(rate[2]) * p * p)
        self.sigma, self.lam = s + rate * p, self.lam + d * p
        if stop <= end:
            self._stop()
        return end <= stop

    def _end_of_line(self, sn: float, rate: float) -> float:
        """Return the normal impulse up to the end of the phase, along a line."""
        if self.compressed is None:
            return -sn / rate if rate > 0.0 else inf
        if self.end == "poisson":
            left = (1.0 + self.e) * self.compressed - float(self.lam[2])
            jams = -sn / rate if rate < 0.0 else inf
            return min(left, jams)
        missing = self.given + self.e**2 * self.taken  # sn p + rate p^2 / 2 = -missing
        root = sn**2 - 2.0 * rate * missing
        if root < 0.0:  # jams before it has given that back
            return -sn / rate
        speeds = sn + sqrt(root)
        return -2.0 * missing / speeds if speeds > 0.0 else 0.0

    def _go_round(self) -> bool:
        """Go along a path that turns, to where slip stops or the phase ends; whether that is so."""
        from scipy.integrate import solve_ivp

        G, mu, still, compressed = self.G, self.mu, self.still, self.compressed
        poisson = compressed is not None and self.end == "poisson"
        most = 0.0 if compressed is None else (1.0 + self.e) * compressed
        wanted = -(self.e**2) * self.taken - self.given

        def rates(_: float, y: Array) -> Array:
            slip = hypot(y[0], y[1])
            d = np.array([-mu * y[0], -mu * y[1], slip])
            return np.concatenate((G.dot(d), d, (slip * y[2],)))

        def stops(_: float, y: Array) -> float:
            return hypot(y[0], y[1]) - still

        def ends(_: float, y: Array) -> float:
            if compressed is None:
                return float(y[2])
            return float(y[5] - most if poisson else y[6] - wanted)

        def jams(t: float, y: Array) -> float:
            return float(y[2]) if compressed is not None and t > 0.0 else 1.0

        for event, way in ((stops, -1.0), (ends, 1.0), (jams, -1.0)):
            vars(event).update(terminal=True, direction=way)
        start = np.concatenate((self.sigma, self.lam, (0.0,)))
        size = float(np.abs(G).max()) * max(1.0, mu)
        got = solve_ivp(
            rates, (0.0, _LONGEST / size * 1e3), start, method="DOP853", rtol=_ACCURATE,
            atol=_ACCURATE * float(np.abs(self.sigma).max()) * min(1.0, 1.0 / size),
            events=(stops, ends, jams),
        )  # fmt: skip
        y = got.y[:, -1]
        self.sigma, self.lam = y[:3].copy(), y[3:6].copy()
        self._count(float(y[6]))
        if len(got.t_events[0]):
            self._stop()
            return False
        return True

    def _count(self, work: float) -> None:
        if self.compressed is None:
            self.taken += work
        else:
            self.given += work

    def _stop(self) -> None:
        self.has_stopped = True
        self.sigma[:2] = 0.0


def direction_after_stop(G: Array, mu: float) -> Array:
    """Return d lam / dp of a contact whose slip has just ended: it sticks, or slips on."""
    t = -np.linalg.lstsq(G[:2, :2], G[:2, 2], rcond=_STILL)[0]
    if hypot(*t) <= mu * (1.0 + _STILL):
        return np.array([*t, 1.0])
    from scipy.optimize import brentq

    def across(angle: float) -> float:
        x, y = cos(angle), sin(angle)
        rate = G[:2, 2] - mu * G[:2, :2].dot((x, y))
        return float(x * rate[1] - y * rate[0])

    angles = np.linspace(0.0, 2.0 * pi, _DIRECTIONS + 1).tolist()
    values = [across(angle) for angle in angles]
    for a, b, first, last in zip(angles, angles[1:], values, values[1:], strict=False):
        if first * last > 0.0:
            continue
        angle = brentq(across, a, b, xtol=1e-15)
        d = np.array([-mu * cos(angle), -mu * sin(angle), 1.0])
        if G[0].dot(d) * cos(angle) + G[1].dot(d) * sin(angle) > 0.0:
            return d
    return np.array([*(t * mu / hypot(*t)), 1.0])
