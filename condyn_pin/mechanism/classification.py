"""Classification: what kind of system a scene is, in the words of analytical mechanics.

    holonomic       all rows restrict the position, c(q, t) = 0, or are rates of what does
    scleronomic     time is in none of them; rheonomic if it is
    bilateral       J v = 0 both ways; unilateral if a contact may let go
    LICQ            the rows are independent: lam is unique

The index of the equations is how often they have to be differentiated before a and lam can be
solved for, and once more: 3 with c(q) = 0, 2 with A v = 0, 1 with J a + gamma = 0, and 0 for an
ordinary differential equation.
"""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import NotAssembled
from condyn_pin.mechanism.integrability import is_integrable
from condyn_pin.mechanism.rank import Rank


@dataclass(frozen=True)
class Classification:
    """What kind of system a scene is.

    Attributes
    ----------
    holonomic : bool or None
        Whether the rows restrict the position, and not the velocity alone; None if loops are open,
        so that it cannot be told.
    rheonomic : bool
        Whether time is in some rows: they follow a path.
    unilateral : bool
        Whether contacts may let go.
    rows, velocity_rows, rank : int
        All rows; those without a position; independent ones.
    """

    holonomic: bool | None
    rheonomic: bool
    unilateral: bool
    rows: int
    velocity_rows: int
    rank: int

    @property
    def licq(self) -> bool:
        """Whether every row counts: linear independence constraint qualification."""
        return self.rank == self.rows

    @property
    def index(self) -> int:
        """Index of the differential-algebraic equations as they are posed, before J a + gamma."""
        if not self.rows:
            return 0
        return 2 if self.velocity_rows == self.rows else 3

    def __str__(self) -> str:
        letting_go = "unilateral" if self.unilateral else "bilateral"
        if not self.rows:
            return f"{letting_go} contacts only" if self.unilateral else "no constraints: an ODE"
        kinds = {True: "holonomic", False: "nonholonomic", None: "holonomic or not: loops are open"}
        words = [
            kinds[self.holonomic],
            "rheonomic" if self.rheonomic else "scleronomic",
            "bilateral, with unilateral contacts" if self.unilateral else letting_go,
            "independent rows (LICQ)" if self.licq else f"rank {self.rank} of {self.rows} rows",
            f"DAE of index {self.index}",
        ]
        return ", ".join(words)


def classification(scene: Scene, rank: Rank) -> Classification:
    """Return what kind of system a scene is at a configuration, whose rank is known."""
    # a contact that belongs where it is has no gap either, but holds the position
    velocity_rows = sum(
        bound.size - len(bound.positioned)
        for constraint, bound in zip(scene.constraints, scene.bounds, strict=True)
        if constraint.on_velocity
    )
    holonomic: bool | None = True
    if velocity_rows:
        try:
            holonomic = is_integrable(scene, rank.q)
        except NotAssembled:
            holonomic = None
    return Classification(
        holonomic=holonomic,
        rheonomic=scene.is_driven,
        unilateral=bool(scene.contacts),
        rows=rank.rows,
        velocity_rows=velocity_rows,
        rank=rank.rank,
    )
