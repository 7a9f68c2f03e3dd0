"""Time steps as a user of Pinocchio writes them in Python: a(q, v) is all that a method brings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]
State = tuple[np.ndarray, np.ndarray]
Step = Callable[[pin.Model, Acceleration, np.ndarray, np.ndarray, float], State]


def semi_implicit(
    model: pin.Model, a: Acceleration, q: np.ndarray, v: np.ndarray, h: float
) -> State:
    """Return the state after v += h a, q += h v."""
    v = v + h * a(q, v)
    return pin.integrate(model, q, h * v), v


def rk4(model: pin.Model, a: Acceleration, q: np.ndarray, v: np.ndarray, h: float) -> State:
    """Return the state after a step of the classical method, each stage integrated from q.

    Of fourth order for hinges and sliders. The rates of a free or a ball joint are added up as if
    its turns commuted, as most people write it, and this makes it second order.
    """
    a1 = a(q, v)
    v2 = v + h / 2 * a1
    a2 = a(pin.integrate(model, q, h / 2 * v), v2)
    v3 = v + h / 2 * a2
    a3 = a(pin.integrate(model, q, h / 2 * v2), v3)
    v4 = v + h * a3
    a4 = a(pin.integrate(model, q, h * v3), v4)
    q = pin.integrate(model, q, h / 6 * (v + 2 * v2 + 2 * v3 + v4))
    return q, v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def end_of(
    step: Step,
    model: pin.Model,
    a: Acceleration,
    state: State,
    duration: float,
    h: float,
) -> np.ndarray:
    """Return q after a duration [s] in steps of h [s]."""
    q, v = state
    for _ in range(round(duration / h)):
        q, v = step(model, a, q, v, h)
    return q
