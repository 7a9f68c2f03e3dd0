"""Marks of balance: the edges of the support polygon, and points of pressure and of capture.

What they are and where they are valid is said in `control.balancing`. The number of corners may
change from instant to instant, and a part is a shape that does not: each edge is a part of its own,
which is not to be seen while the polygon has fewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.balancing import Balance
from condyn_pin.io import meshes
from condyn_pin.viewing import palette
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.part import Part, at_point, span

_THIN = 0.004  # radius of an edge, of the size of the scene
_POINT = 0.014  # radius of a point, of the size of the scene
_LABEL = 0.024  # height of its words, of the size of the scene

# What is drawn as a point: the field of `Balance`, its words, its colour.
POINTS = (
    ("cop", "centre of pressure", palette.PRESSURE),
    ("capture_point", "capture point", palette.CAPTURE),
    ("dcm", "DCM", palette.DIVERGENT),
)


def balance_parts(instants: Sequence[Instant], size: float) -> Iterator[Part]:
    """Yield the marks of instants that know their balance, in a scene of this size [m]."""
    known = [at.balance for at in instants if at.balance is not None]
    corners = max((len(each.polygon.corners) for each in known if each.polygon), default=0)
    edge = meshes.cylinder(_THIN * size, 1.0).moved(at_point(np.array([0.0, 0.0, 0.5])))
    for i in range(corners):
        pose = partial(_edge, i)
        yield Part(f"balance/support/{i}", pose, ((edge, palette.SUPPORT),), on_top=True)
    ball = meshes.sphere(_POINT * size)
    for name, words, colour in POINTS:
        pose = partial(_point, name)
        if all(pose(at) is None for at in instants):
            continue
        path = f"balance/{name}"
        yield Part(f"{path}/point", pose, ((ball, colour),), opacity=0.9, on_top=True)
        yield label(f"{path}/label", words, colour, pose, _LABEL * size)


def balance_notes(instants: Sequence[Instant]) -> tuple[str, ...]:
    """Return why nothing of the balance is drawn of instants that know it, if so."""
    known = [at.balance for at in instants if at.balance is not None]
    if not known or any(each.polygon for each in known):
        return ()
    return (
        "no balance: no contacts press on one plane, so there is no support polygon, centre of "
        "pressure or capture point",
    )


def _edge(i: int, at: Instant) -> Array | None:
    """Return the pose of edge i of the polygon; a line has one edge, and a point none."""
    polygon = None if at.balance is None else at.balance.polygon
    if polygon is None or i >= len(polygon.corners) - (len(polygon.corners) < 3):
        return None
    corners = polygon.in_world
    return span(corners[i], corners[(i + 1) % len(corners)])


def _point(name: str, at: Instant) -> Array | None:
    balance: Balance | None = at.balance
    point = None if balance is None else getattr(balance, name)
    return None if point is None or not np.isfinite(point).all() else at_point(point)
