"""The force of a contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.constraint import text
from condyn_pin.control.tasks.task import (
    NO_FEEDBACK,
    BoundTask,
    CompiledTask,
    DefaultReference,
    RobotMotion,
    Task,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name


@dataclass(frozen=True)
class ContactForce(Task):
    """The force of a contact on the robot follows a reference: 3 rows.

    min w |f - reference|^2

    Parameters
    ----------
    contact : str
        Name of a constraint of the scene that has a cone.
    reference : (3,) array_like or callable, optional
        In the axes of the world [N], or a function of t; zero by default.

    Raises
    ------
    InvalidArgument
        If `contact` is no name, or the reference is neither three numbers nor a function of t.
    """

    contact: str
    reference: Any = None

    def __post_init__(self) -> None:
        text("contact", self.contact, "contact")
        if callable(self.reference):
            check_called("reference", self.reference, "t")
        else:
            f = np.zeros(3) if self.reference is None else finite("reference", self.reference, 3)
            object.__setattr__(self, "reference", tuple(f.tolist()))
        super().__post_init__()

    @property
    def _called(self) -> str:
        return f"{self.contact} force"

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; its columns are all rows of the scene."""
        if self.contact not in scene.names:
            raise unknown_name("contact", self.contact, scene.names)
        place = scene.names.index(self.contact)
        bound: Any = scene.bounds[place]
        if not scene.constraints[place].presses:
            raise InvalidArgument(f"contact = {self.contact!r}: it does not press on a floor")
        W = np.array([bound.whole(row)[:3] for row in np.eye(bound.size)])

        def wanted(t: float) -> Array:
            f = self.reference(t) if callable(self.reference) else self.reference
            return finite(f"{self.name}: reference({t:g})", f, 3)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            R = bound.ends(motion.data.oMi)[0].rotation
            F = np.zeros((3, scene.rows))
            F[:, bound.rows] = R @ W.T
            return F, wanted(t)

        rest, changes = np.zeros(6), callable(self.reference)
        compiled = CompiledTask(
            "contact force", (3, 3), NO_FEEDBACK,
            lambda: lambda t: np.concatenate((wanted(t), rest)), changes, at=place,
        )  # fmt: skip
        return BoundTask("forces", self._row_names("xyz"), "N", rows, compiled)
