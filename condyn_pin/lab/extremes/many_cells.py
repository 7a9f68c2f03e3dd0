"""N four-bars in a row: many loops, a third of the rows redundant."""

from condyn_pin.lab.extremes.base import Case, Rng, alternating, closed, extreme
from condyn_pin.lab.extremes.parallelogram import cranks_as_one
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar


@extreme(2, 3, 5, 8, 12, 20, 30, 40)
def many_cells(severity: float, rng: Rng) -> Case:
    """How many cells there are; 40 have 120 rows of rank 80.

    All cranks turn as one (problem A02 of the IFToMM library).
    """
    n = round(severity)
    along = alternating(2 * n + 1)
    theta = rng.uniform(0.5, 2.5)
    q, v, tau = theta * along, rng.normal() * along, rng.normal(size=2 * n + 1)
    return Case(closed(n_four_bar(n)), q, v, tau, (cranks_as_one(n, theta, tau),))
