"""Overconstrained machines at states as sensors measure them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, moving, powers
from condyn_pin.model.mechanisms.bricard import bricard
from condyn_pin.model.mechanisms.delta import delta
from condyn_pin.model.mechanisms.stewart import stewart
from condyn_pin.model.robot import Robot

# An answer may be off by this multiple of what the noise changes a by to first order, and by no
# more than a third of a in any case.
_TIMES: Final = 3.0
_MOST: Final = 1.0 / 3.0

_STEPS: Final = 12


def _by_hinges(robot: Robot) -> Scene:
    pairs = [(ball.name, *ball.frames[:2]) for ball in robot.loops]
    return Scene(robot, [Loop(a, b, "hinge", axis="z", name=name) for name, a, b in pairs])


_MACHINES: Final[tuple[Callable[[], Scene], ...]] = (
    lambda: closed(load_robot("cassie")),
    lambda: closed(bricard()),
    lambda: _by_hinges(delta()),
    lambda: _by_hinges(stewart()),
)


@extreme(0.0, *powers(-12, -2))
def noisy_states(severity: float, rng: Rng) -> Case:
    """Noise of q and of v on loops with redundant rows [rad, m; rad/s, m/s].

    Right is the closed machine beside the state, to first order in the noise.
    """
    scene = _MACHINES[int(rng.integers(len(_MACHINES)))]()
    q, v, tau = moving(scene, rng)
    model, nv, rank = scene.robot.model, scene.robot.nv, scene.nominal.rank
    noisy = pin.integrate(model, q, severity * rng.normal(size=nv))
    v = v + severity * rng.normal(size=nv)
    equations = Equations(model, scene.bounds)

    def factors_at(q: Array) -> MinimumNorm:
        return factorise(equations.mass(q), equations.jacobian(q), 0.0).at_most(rank)

    def answer(q: Array, v: Array) -> Array:
        terms = equations.terms(q, v)
        return factors_at(q).solve(tau - terms.h, -terms.gamma)[0]

    there = noisy
    for _ in range(_STEPS):
        step = factors_at(there).closing(equations.violation(there))
        there = pin.integrate(model, there, step)
    right = answer(there, factors_at(there).tangent(v))
    given = answer(noisy, v)
    size = max(float(np.abs(right).max()), scene.nominal.gravity)
    changed = float(np.abs(given - right).max()) / size
    within = min(_TIMES * changed + tolerances.SOLVED, _MOST)
    return Case(scene, noisy, v, tau, right=(right,), within=within)
