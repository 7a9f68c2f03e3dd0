"""Accelerations of a hanging planar chain to 50 digits, by articulated bodies in decimals.

Every rod hangs at the tip of the one before. With a = (acceleration of its pivot, angular), the
joint turning about s = (0, 0, 1), and d the vector from pivot to tip,

    f = I a + p               on the rod at its pivot, from everything outwards
    D = s.I s,  u = tau - s.p
    I^ = I - I s s.I / D,     p^ = p + I s u / D

and the rod before feels X^T I^ X and X^T (p^ + I^ c), where a_tip = X a + c, c = (-omega^2 d, 0).
Then outwards q'' = (u - s.I a) / D.

Source: Featherstone. Rigid body dynamics algorithms, chapter 7. Springer, 2008.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array

Decimals = NDArray[np.object_]

_DIGITS = 50
_GRAVITY = Decimal(float("9.81"))  # Pinocchio's double
_ABOUT_CENTRE = Decimal(1.0 / 12)  # of a rod of 1 kg and 1 m, as `mechanisms.registry.rod` has it


def accelerations(q: Array, v: Array, tau: Array, masses: Sequence[float] = ()) -> Array:
    """Return q'' of `chain(n)`, rounded once.

    Parameters
    ----------
    q, v, tau : (n,) array
        [rad], [rad/s], [N m].
    masses : sequence of float
        Of the rods, in place of 1 kg each [kg].
    """
    with localcontext() as context:
        context.prec = _DIGITS
        angles, speeds = (np.cumsum([Decimal(x) for x in row.tolist()]) for row in (q, v))
        tips = [_along(angle) for angle in angles]
        rods = [Decimal(mass) for mass in masses or len(q) * (1.0,)]
        inwards = _inwards(tips, speeds, rods, [Decimal(x) for x in tau.tolist()])
        return _outwards(tips, speeds, inwards)


def _inwards(
    tips: list[Decimals], speeds: Any, masses: list[Decimal], tau: list[Decimal]
) -> list[tuple[Any, ...]]:
    """Return (I s, D, u) of every rod, the first one first."""
    steps = []
    I, p = _nothing(3, 3), _nothing(3)  # noqa: E741
    for d, omega, mass, torque in reversed(list(zip(tips, speeds, masses, tau, strict=True))):
        own, bias = _rod(d, omega)
        I, p = I + mass * own, p + mass * bias  # noqa: E741
        Is, D, u = I[:, 2], I[2, 2], torque - p[2]
        steps.append((Is.copy(), D, u))
        I, p = I - np.outer(Is, Is) / D, p + Is * (u / D)  # noqa: E741
        before = len(tips) - len(steps) - 1
        if before >= 0:
            X, c = _to_tip(tips[before], speeds[before])
            I, p = X.T @ I @ X, X.T @ (p + I @ c)  # noqa: E741
    return steps[::-1]


def _outwards(tips: list[Decimals], speeds: Any, steps: list[tuple[Any, ...]]) -> Array:
    """Return q''."""
    a = _nothing(3)
    a[1] = _GRAVITY  # a world that falls upwards in place of weight
    found = []
    for d, omega, (Is, D, u) in zip(tips, speeds, steps, strict=True):
        alpha = (u - Is @ a) / D
        found.append(float(alpha))
        a[2] += alpha
        X, c = _to_tip(d, omega)
        a = X @ a + c
    return np.array(found)


def _rod(d: Decimals, omega: Decimal) -> tuple[Decimals, Decimals]:
    """Return I and p of one rod of 1 kg that reaches from its pivot to d."""
    x, y = d / 2
    inertia = _nothing(3, 3)
    inertia[0, 0] = inertia[1, 1] = Decimal(1)
    inertia[0, 2] = inertia[2, 0] = -y
    inertia[1, 2] = inertia[2, 1] = x
    inertia[2, 2] = _ABOUT_CENTRE + x * x + y * y
    return inertia, np.array([-omega * omega * x, -omega * omega * y, Decimal(0)])


def _to_tip(d: Decimals, omega: Decimal) -> tuple[Decimals, Decimals]:
    """Return X and c: the acceleration of the tip from that of the pivot."""
    X = _nothing(3, 3)
    X[0, 0] = X[1, 1] = X[2, 2] = Decimal(1)
    X[0, 2], X[1, 2] = -d[1], d[0]
    return X, np.array([-omega * omega * d[0], -omega * omega * d[1], Decimal(0)])


def _along(angle: Decimal) -> Decimals:
    """Return (cos, sin) of an angle of a few turns, by their series."""
    found = [Decimal(0), Decimal(0)]
    term, k = Decimal(1), 0
    while k <= abs(angle) or abs(term) > Decimal(10) ** -(_DIGITS + 5):
        found[k % 2] += -term if k % 4 > 1 else term
        k += 1
        term = term * angle / k
    return np.array(found)


def _nothing(*shape: int) -> Decimals:
    return np.full(shape, Decimal(0))
