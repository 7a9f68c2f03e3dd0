"""What a file says of a robot, whatever its format, and doubts about its bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.model.spring import Spring, SpringDamper

# Name, mass [kg], and inertia about the centre of mass [kg m^2]
Body = tuple[str, float, Array]


@dataclass(frozen=True)
class Description:
    """What was read from a file; all fields but `reversed` are those of `Robot`.

    A file may have no name.

    Attributes
    ----------
    reversed : tuple of str
        Joints that the tree holds from child to parent.
    """

    model: Any
    loops: tuple[Constraint, ...] = ()
    actuated: tuple[str, ...] = ()
    springs: tuple[Spring, ...] = ()
    spring_dampers: tuple[SpringDamper, ...] = ()
    postures: Mapping[str, Array] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    unmodelled: tuple[str, ...] = ()
    name: str = ""
    reversed: tuple[str, ...] = ()


def tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric matrix of the moments and products of inertia [kg m^2]."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def doubts(bodies: Iterable[Body]) -> Iterator[str]:
    """Yield a sentence on the bodies that no solids are.

    A file may have such a body where nothing moves it by itself, and real files do. What a joint
    moves is checked again when the parts are one (`condyn_pin.model.soundness`).
    """
    reasons: dict[str, list[str]] = {}
    for name, mass, inertia in bodies:
        if reason := _fault(mass, inertia):
            reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        yield (
            f"doubts about the inertia of {', '.join(names)}: {reason}, as in no solid; used as "
            "written"
        )


def _fault(mass: float, inertia: Array) -> str:
    """Return why no solid has this inertia, if none has: of one, 0 <= A <= B <= C <= A + B."""
    A, B, C = np.linalg.eigvalsh(inertia)
    zero = tolerances.MOMENT * max(-A, C)
    if A + zero < 0:
        return f"the principal moment {A:.3g} kg m^2 is negative"
    if A + B + zero < C:
        return f"the principal moments {A:.3g} and {B:.3g} add up to less than {C:.3g} kg m^2"
    if mass == 0 and inertia.any():
        return "there is a moment of inertia and no mass"
    return ""
