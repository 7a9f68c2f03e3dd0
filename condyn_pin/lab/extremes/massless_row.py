"""Rods without mass in a row, in a closed chain."""

from condyn_pin.lab.extremes.base import Case, Rng, alternating, extreme, hooked, rods
from condyn_pin.mechanism.projection import project_velocity


@extreme(0, 1, 2, 3, 5, 10)
def massless_row(severity: float, rng: Rng) -> Case:
    """How many rods without mass there are in a row, between two of 1 kg, the last held at its tip.

    Up to two of them move only with the last rod, which has three ways to go; of more, nothing
    says how they move.
    """
    n = round(severity) + 2
    q = alternating(n) * rng.uniform(0.5, 1.5, size=n)  # far from stretched
    scene = hooked(rods((1.0, *(n - 2) * (0.0,), 1.0)), q)
    v = project_velocity(scene, q, rng.normal(size=n))
    return Case(scene, q, v, rng.normal(size=n))
