"""The same contact problem in units where its numbers are near one.

With S positive, the same in the rows of one contact, and w a velocity,

    G' = S (G + R) S,   g' = S g / w,   limits' = limits / (S w),   lam = w S lam'

has the same contacts that open, stick and slide. All factors are powers of two: no digit changes.
Where all rows are cones and bodies are about as heavy, S is one number, by the mean diagonal of G;
rows of joints have other units than those of points, and each contact has its own then.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import STILL, ContactProblem

# Ratio of how far impulses move contacts from which each has its own S. Feet of a robot are closer;
# with one S, bodies of 1 kg on others of 1 t take ADMM ten times the iterations, and Newton stalls.
_APART = 64.0


def normalised(problem: ContactProblem) -> tuple[ContactProblem, float | Array]:
    """Return the normalised problem, without R, and the unit (m,) or one number of its impulses."""
    if problem.half_lines or len(problem.limits) or _differ(problem):
        return _normalised_by_contact(problem)
    stiff, speed = problem.scale
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    softened, slowed = 1.0 / _power_of_two(stiff), 1.0 / _power_of_two(speed)  # S^2 and S / w
    made = ContactProblem.trusted(
        G=G * softened, g=problem.g * slowed, friction=problem.friction, half_lines=0,
        limits=problem.limits, R=None, law=problem.law, level=problem.level, names=problem.names,
        sets=problem.sets,
    )  # fmt: skip
    return made, softened / slowed


def _differ(problem: ContactProblem) -> bool:
    """Whether impulses move some contacts of cones far more than others."""
    diagonal: list[float] = problem.G.diagonal().tolist()
    axes = (diagonal[axis] for axis in problem.sets.axes)
    stiff = [sum(each) for each in zip(*axes, strict=True)]
    return max(stiff, default=0.0) > _APART * min(stiff, default=0.0)


def _normalised_by_contact(problem: ContactProblem) -> tuple[ContactProblem, Array]:
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    S = _by_contact(problem, G.diagonal())
    g = problem.g * S
    fast = float(np.abs(g).max())
    w = 1.0 if fast < STILL else _power_of_two(fast)
    limits = problem.limits / S[problem.sets.parts[2]] / w
    made = problem.replaced(G=G * np.multiply.outer(S, S), g=g / w, limits=limits, R=None)
    return made, S * w


def _by_contact(problem: ContactProblem, diagonal: Array) -> Array:
    """Return S (m,), by the mean of the diagonal over each contact."""
    blocks = problem.sets.blocks
    mean = (np.bincount(blocks, diagonal) / np.bincount(blocks))[blocks]
    exponents = np.frexp(np.where(mean > 0, mean, 1.0))[1]
    return np.asarray(np.ldexp(1.0, -(exponents // 2)))


def _power_of_two(x: float) -> float:
    """Return the power of two below x > 0."""
    return float(2.0 ** (frexp(x)[1] - 1))
