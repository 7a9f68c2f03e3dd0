"""A constraint that Pinocchio has itself: one of 3 or of 6 rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from condyn_pin._core._pin import LOCAL, pin


@dataclass(frozen=True)
class PinocchioConstraint:
    """A constraint that Pinocchio has itself.

    Attributes
    ----------
    name : str
    size : int
        3 or 6.
    joint1, placement1, joint2, placement2, anchored, lever
        As in `Bound`.
    approximates : bool
        Whether it stands for rows of another kind.
    """

    name: str
    size: int
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    anchored: bool
    lever: float  # [m]
    approximates: bool

    def to_pinocchio(self, model: Any) -> Any:
        """Return the RigidConstraintModel."""
        kind = pin.ContactType.CONTACT_3D if self.size == 3 else pin.ContactType.CONTACT_6D
        made = pin.RigidConstraintModel(
            kind, model, self.joint1, self.placement1, self.joint2, self.placement2, LOCAL
        )
        made.name = self.name
        return made
