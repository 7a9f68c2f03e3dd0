"""The N-four-bar: n square cells in a row that pass through a singular posture all at once."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.loop import Loop
from condyn_pin.model.mechanisms.registry import (
    LICENCE,
    add_rod,
    mechanism,
    source,
)
from condyn_pin.model.robot import Robot
from condyn_pin.model.soundness import MOST_JOINTS


@mechanism
def n_four_bar(n: int = 2, *, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return n + 1 cranks side by side, each tip joined to the next by a coupler.

    All 2 n + 1 rods are equal, and the pivots of the cranks one length apart, in the world's x-z
    plane. All cranks turn by the same angle theta, counted from x towards z, with

        ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta)

    as long as the cranks are not flat. At theta = 0 and pi each cell can also leave the
    parallelogram, the rank of J drops by n, and the mobility jumps from 1 to n + 1.

    Parameters
    ----------
    n : int
        Number of cells.
    length : float
        Of each rod [m].
    mass : float
        Of each rod [kg].

    Returns
    -------
    Robot
        2 n + 1 joints and n ball loops.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    nv = 2 n + 1, and n ball loops: 3 n rows of rank 2 n, since no joint moves along y. The
    benchmark starts at the posture ``square`` with the cranks at -1 rad/s; ``flat`` is singular.

    Source: problem A02 of the IFToMM library of computational benchmark problems.
    """
    check_count("n", n, most=MOST_JOINTS)
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "n_four_bar"
    for k in range(n + 1):
        crank = add_rod(model, f"crank{k}", 0, k * length, length, mass)
        if k < n:
            add_rod(model, f"coupler{k}", crank, length, length, mass)
    loops = (
        Loop(f"coupler{k}_tip", f"crank{k + 1}_tip", name=f"coupler{k}_crank{k + 1}")
        for k in range(n)
    )
    return Robot(
        "n_four_bar",
        model,
        postures={"square": _parallel(n, math.pi / 2), "flat": _parallel(n, 0.0)},
        loops=tuple(loops),
        actuated=("crank0",),
        source=source("n_four_bar"),
        licence=LICENCE,
    )


def _parallel(n: int, theta: float) -> Array:
    """Return the posture with all cranks at theta and all couplers level."""
    q = np.full(2 * n + 1, theta)
    q[1::2] = -theta
    return q
