"""A four-bar linkage: the smallest closed chain."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.loop import Loop
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.mechanisms.registry import LICENCE, add_rod, mechanism, source
from condyn_pin.model.robot import Robot


@mechanism
def four_bar(
    *,
    ground: float = 0.7,
    crank: float = 0.3,
    coupler: float = 0.8,
    rocker: float = 0.6,
    density: float = 2.5,
) -> Robot:
    """Return a planar four-bar linkage of slender rods in the world's x-z plane.

    The tree is crank -> coupler and rocker, both on the ground; one ball loop joins coupler and
    rocker. Its 3 rows have rank 2 at every configuration, because nothing moves along y: the
    smallest mechanism on which an undamped solve gives NaN.

    Parameters
    ----------
    ground, crank, coupler, rocker : float
        Lengths of the four bars [m].
    density : float
        Mass of the rods per length [kg/m].

    Returns
    -------
    Robot
        Three joints, one ball loop, one motor: the crank.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number, or the bars cannot be closed.
    """
    check_positive(ground=ground, crank=crank, coupler=coupler, rocker=rocker, density=density)
    lengths = sorted((ground, crank, coupler, rocker))
    if lengths[3] >= sum(lengths[:3]):
        raise InvalidArgument(
            f"a bar of {lengths[3]} m cannot be closed by bars of {lengths[:3]} m: "
            "the longest must be shorter than the sum of the others"
        )
    model = pin.Model()
    model.name = "four_bar"
    first = add_rod(model, "crank", 0, 0.0, crank, density * crank)
    add_rod(model, "coupler", first, crank, coupler, density * coupler)
    add_rod(model, "rocker", 0, ground, rocker, density * rocker)
    return Robot(
        "four_bar",
        model,
        postures={"open": _open_posture(ground, crank, coupler, rocker)},
        loops=(Loop("coupler_tip", "rocker_tip", name="coupler_rocker"),),
        actuated=("crank",),
        source=source("four_bar"),
        licence=LICENCE,
    )


def _open_posture(ground: float, crank: float, coupler: float, rocker: float) -> Array:
    """Return angles at which the bars meet, in the middle of the crank's range."""
    # The crank's tip B is at a distance r from the rocker's pivot D; coupler and rocker reach it if
    # |coupler - rocker| < r < coupler + rocker, the crank if |ground - crank| < r < ground + crank.
    nearest = max(abs(coupler - rocker), abs(ground - crank))
    farthest = min(coupler + rocker, ground + crank)
    r = (nearest + farthest) / 2
    theta = math.acos((ground**2 + crank**2 - r**2) / (2 * ground * crank))
    B = crank * np.array([math.cos(theta), math.sin(theta)])
    D = np.array([ground, 0.0])
    along = (coupler**2 - rocker**2 + r**2) / (2 * r)
    up = math.sqrt(coupler**2 - along**2)
    e = (D - B) / r
    C = B + along * e + up * np.array([-e[1], e[0]])
    of_coupler, of_rocker = (math.atan2(*(C - end)[::-1]) for end in (B, D))
    return np.array([theta, of_coupler - theta, of_rocker])
