"""Inertia of a body as files give it, and doubts about it: the same for every format.

A file may have such a body where nothing moves it by itself, and real files do: the reader tells
the user of it. What a joint moves is checked again when the parts are one
(`condyn_pin.model.soundness`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

Body = tuple[str, float, Array]


def tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric matrix of the moments and products of inertia [kg m^2]."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def fault(inertia: Array) -> str:
    """Return why no solid has these moments of inertia; nothing if one has.

    Parameters
    ----------
    inertia : (3, 3) array
        About the centre of mass [kg m^2]. Of a solid, 0 <= A <= B <= C <= A + B.
    """
    A, B, C = np.linalg.eigvalsh(inertia)
    zero = tolerances.MOMENT * max(-A, C)
    if A + zero < 0:
        return f"the principal moment {A:.3g} kg m^2 is negative"
    if A + B + zero < C:
        return f"the principal moments {A:.3g} and {B:.3g} add up to less than {C:.3g} kg m^2"
    return ""


def inertia_in(mass: float, linkMc: Any, inertia: Array) -> Any:
    """Return the pin.Inertia of a body in the axes of its link.

    The constructor refuses a moment that is zero but for the digits of the file; the attribute
    takes it.

    Parameters
    ----------
    mass : float
        [kg].
    linkMc : pin.SE3
        The centre of mass, and the axes of `inertia`.
    inertia : (3, 3) array
        About the centre of mass [kg m^2].
    """
    R = linkMc.rotation
    Y = pin.Inertia(mass, linkMc.translation, np.eye(3))
    Y.inertia = R @ inertia @ R.T
    return Y


def doubts(bodies: Iterable[Body]) -> Iterator[str]:
    """Yield a sentence on the bodies, by name, mass and inertia, that no solids are."""
    reasons: dict[str, list[str]] = {}
    for name, mass, inertia in bodies:
        reason = fault(inertia)
        if not reason and mass == 0 and inertia.any():
            reason = "there is a moment of inertia and no mass"
        if reason:
            reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        yield (
            f"doubts about the inertia of {', '.join(names)}: {reason}, as in no solid; used as "
            "written"
        )
