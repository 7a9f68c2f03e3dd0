"""An open chain of rods, as long and as badly conditioned as one likes."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.model.mechanisms.registry import (
    LICENCE,
    add_rod,
    mechanism,
    source,
)
from condyn_pin.model.robot import Robot
from condyn_pin.model.soundness import MOST_JOINTS


@mechanism
def chain(n: int = 10, *, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return an open chain of n equal rods in the world's x-z plane, hung up at one end.

    No loops. The first joint moves everything and the last one a single rod, so that

        cond(M) = 4 n^4, nearly,

    when the chain is straight, whatever length and mass: 4e4 for 10 rods, 4e8 for 100.

    Parameters
    ----------
    n : int
        Number of rods.
    length : float
        Of each rod [m].
    mass : float
        Of each rod [kg].

    Returns
    -------
    Robot
        A fixed base, n joints, no loops.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.
    """
    check_count("n", n, most=MOST_JOINTS)
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "chain"
    names = tuple(f"joint{k}" for k in range(n))
    joint, at = 0, 0.0
    for name in names:
        joint, at = add_rod(model, name, joint, at, length, mass), length
    down = np.zeros(n)
    down[0] = -math.pi / 2
    return Robot(
        "chain",
        model,
        postures={"hanging": down, "straight": np.zeros(n)},
        actuated=names,
        source=source("chain"),
        licence=LICENCE,
    )
