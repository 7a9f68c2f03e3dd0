"""ContactProblem: which impulses keep bodies apart and obey Coulomb's law; it knows no robot.

    sigma = G lam + g + R lam

    ncp    K  contains lam,  K* contains d = sigma + (0, 0, mu |sigma_t|),  lam . d = 0
    ccp    K  contains lam,  K* contains sigma,                             lam . sigma = 0

sigma is the velocity of the contacts after the step, lam the impulse on the robot, z along the
normal from the ground to the robot. A ccp is convex: what slides lifts off by mu |sigma_t|.

References
----------
De Saxcé, Feng. The bipotential method. Mathematical and Computer Modelling 28, 1998.
Acary, Cadoux, Lemaréchal, Malick. A formulation of the linear discrete Coulomb friction problem via
convex optimization. ZAMM 91, 2011.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin._core.tolerances import HUGE
from condyn_pin.contact.sets import ContactSets
from condyn_pin.errors import InvalidArgument

Law = Literal["ncp", "ccp"]
Level = Literal["impulse", "acceleration"]

# Velocities below are none: numbers relative to them, or their squares, are not numbers [m/s].
STILL = 1e-150


@dataclass(frozen=True, eq=False, repr=False)
class ContactProblem:
    """A contact problem: G, g and the sets that the impulses belong to.

    K contains lam,  K* contains d,  lam . d = 0,    sigma = G lam + g + R lam

    with d = sigma in a ccp, and sigma + (0, 0, mu |sigma_t|) in an ncp.

    Rows: three of each cone (t1, t2, n), then one of each half-line, then one of each interval.

    Parameters
    ----------
    G : (m, m) array_like
        J M^-1 J^T along the constraints that never let go, symmetric, not negative [1/kg].
    g : (m,) array_like
        Velocity of the contacts without impulses, with what the scheme adds to it [m/s].
    friction : (k,) array_like
        Coefficients of the cones [1].
    half_lines : int
        Number of rows that can only push: stops of joints.
    limits : (b,) array_like
        Largest impulses of rows with dry friction [N s].
    R : (m,) array_like, optional
        Compliance on the diagonal [1/kg]; none by default.
    law : {"ncp", "ccp"}
        Coulomb's law with Signorini's condition, or its convex relaxation.
    level : {"impulse", "acceleration"}
        What lam and sigma are: [N s] and [m/s], or [N] and [m/s^2].
    names : sequence of str, optional
        Of cones, half-lines and intervals.

    Raises
    ------
    InvalidArgument
        If sizes do not fit, G is not symmetric, or a number is not finite or negative.
    """

    G: Array  # [1/kg]
    g: Array  # [m/s]
    friction: Array
    half_lines: int = 0
    limits: Array = ()  # type: ignore[assignment]  # [N s]
    R: Array | None = None  # [1/kg]
    law: Law = "ncp"
    level: Level = "impulse"
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        m = np.size(self.g)
        put(self, "g", _kept("g", self.g, (m,)))
        put(self, "G", read_only(_symmetric(_kept("G", self.G, (m, m)))))
        put(self, "friction", _not_negative("friction", self.friction, tolerances.MOST_FRICTION))
        put(self, "limits", _not_negative("limits", self.limits))
        if self.R is not None:
            put(self, "R", _not_negative("R", self.R))
            if len(self.R) != m:
                raise InvalidArgument(f"R: {len(self.R)} numbers; {m} are needed, one a row")
        if isinstance(self.half_lines, bool) or not isinstance(self.half_lines, int):
            raise InvalidArgument(f"half_lines = {self.half_lines!r}: a count is needed")
        if self.half_lines < 0 or self.sets.size != m:
            raise InvalidArgument(
                f"g has {m} rows; 3 x {len(self.friction)} of cones, {self.half_lines} of "
                f"half-lines and {len(self.limits)} of intervals are {self.sets.size}"
            )
        if self.law not in get_args(Law):
            raise InvalidArgument(f"law = {self.law!r}: ncp or ccp is needed")
        if self.level not in get_args(Level):
            raise InvalidArgument(f"level = {self.level!r}: impulse or acceleration is needed")
        blocks = len(self.friction) + self.half_lines + len(self.limits)
        put(self, "names", tuple(self.names) or tuple(f"contact {i}" for i in range(blocks)))
        if len(self.names) != blocks:
            raise InvalidArgument(f"names: {len(self.names)} for {blocks} contacts")

    @classmethod
    def trusted(cls, **values: Any) -> ContactProblem:
        """Return a problem of fields that are known to be right; the checks (30 us) are left out.

        `values` are all fields by name. What else is known may be among them: `sets`, of an earlier
        problem with the same, `stiffness` and `scale`.
        """
        made = object.__new__(cls)
        vars(made).update(values)
        return made

    def replaced(self, **changes: Any) -> ContactProblem:
        """Return the problem with `changes` of fields that are known to be right, unchecked."""
        kept = {each.name: getattr(self, each.name) for each in fields(self)}
        return self.trusted(**{**kept, **changes})

    @property
    def rows(self) -> int:
        """Number of rows, m."""
        return len(self.g)

    @cached_property
    def sets(self) -> ContactSets:
        """The sets of the rows."""
        return ContactSets(self.friction, self.half_lines, self.limits)

    @cached_property
    def stiffness(self) -> list[float]:
        """The diagonal of G + R (m,), as plain numbers: what an impulse does to its own row."""
        return stiffness_of(self.G, self.R)

    @cached_property
    def scale(self) -> tuple[float, float]:
        """The sizes that errors are measured by: mean diagonal of G + R [1/kg], and |g| [m/s].

        1 where there is nothing to measure by, or so little that its square is no number.
        """
        return scale_of(self.stiffness, self.g)

    def velocities(self, lam: Array) -> Array:
        """Return sigma = G lam + g + R lam (m,)."""
        sigma = self.G.dot(lam) + self.g
        if self.R is not None:
            sigma += self.R * lam
        return np.asarray(sigma)

    def dual(self, sigma: Array) -> Array:
        """Return what is dual to lam: sigma itself in a ccp, and with mu |sigma_t| in an ncp."""
        return self.sets.de_saxce(sigma) if self.law == "ncp" else sigma

    def __repr__(self) -> str:
        return (
            f"ContactProblem({self.law}, {len(self.friction)} cones, {self.half_lines} half-lines, "
            f"{len(self.limits)} intervals)"
        )


def stiffness_of(G: Array, R: Array | None) -> list[float]:
    """Return the diagonal of G + R as plain numbers; see `ContactProblem.stiffness`."""
    diagonal = G.diagonal() if R is None else G.diagonal() + R
    return diagonal.tolist()  # type: ignore[no-any-return]


def scale_of(stiffness: list[float], g: Array) -> tuple[float, float]:
    """Return the sizes that errors are measured by; see `ContactProblem.scale`."""
    # numpy's own mean and max take three times as long for the few rows of a robot
    stiff = sum(stiffness) / max(len(stiffness), 1)
    speed = max(map(abs, g.tolist()), default=0.0)
    return stiff or 1.0, 1.0 if speed < STILL else speed


def _symmetric(G: Array) -> Array:
    worst = float(np.abs(G - G.T).max(initial=0.0))
    if worst > tolerances.SYMMETRIC * float(np.abs(G).max(initial=0.0)):
        raise InvalidArgument(
            f"G: it differs from its transpose by {worst:.3g}; J M^-1 J^T is symmetric, "
            "(G + G.T) / 2 takes rounding out of it"
        )
    return (G + G.T) / 2


def _kept(name: str, value: ArrayLike, shape: tuple[int, ...], most: float = HUGE) -> Array:
    """Return a read-only copy of numbers that are finite and not too large."""
    array = finite(name, value, shape)
    largest = float(np.abs(array).max(initial=0.0))
    if largest > most:
        raise InvalidArgument(
            f"{name}: {largest:g} is in it, and {most:g} is the most; rounding or squares of what "
            "is larger hide the rest"
        )
    return read_only(np.array(array))


def _not_negative(name: str, value: ArrayLike, most: float = HUGE) -> Array:
    array = _kept(name, value, (np.size(value),), most)
    if (array < 0).any():
        k = int(array.argmin())
        raise InvalidArgument(f"{name}[{k}] = {array[k]:g}: a number >= 0 is needed")
    return array
