"""The angular momentum about the centre of mass: A_g a + Adot_g v is its rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core.arguments import check_accuracy, check_called
from condyn_pin._core.arrays import Array, finite
from condyn_pin.control.tasks.task import (
    BoundTask,
    CompiledTask,
    DefaultReference,
    Follow,
    RobotMotion,
    Task,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class AngularMomentum(Task):
    """The angular momentum about the centre of mass follows a reference: 3 rows.

    dL/dt wanted = Ldot_r + k (L_r - L)

    Parameters
    ----------
    reference : (3,) array_like or callable, optional
        In the axes of the world [kg m^2/s], or a function of t that returns it with its rate
        [N m]; zero by default.
    k : float
        Gain of the feedback [1/s].

    Raises
    ------
    InvalidArgument
        If the gain is negative, or the reference is neither three numbers nor a function of t.

    References
    ----------
    Orin, Goswami, Lee. Centroidal dynamics of a humanoid robot. Autonomous Robots, 2013.
    """

    reference: Any = None
    k: float = 10.0  # [1/s]

    def __post_init__(self) -> None:
        check_accuracy("k", self.k)
        if callable(self.reference):
            check_called("reference", self.reference, "t")
        else:
            L = np.zeros(3) if self.reference is None else finite("reference", self.reference, 3)
            object.__setattr__(self, "reference", tuple(L.tolist()))
        super().__post_init__()

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene."""

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            now = motion.angular_momentum()
            L, rate = self._at(t)
            return now.J, rate + self.k * (L - now.x) - now.drift

        def follow() -> Follow:
            def numbers(t: float) -> Array:
                L, rate = self._at(t)
                return np.concatenate((L, np.zeros(3), rate))

            return numbers

        compiled = CompiledTask(
            "angular momentum", (3, 3), (self.k, 0.0), follow, callable(self.reference)
        )
        return BoundTask("accelerations", self._row_names("xyz"), "N m", rows, compiled)

    def _at(self, t: float) -> tuple[Array, Array]:
        if not callable(self.reference):
            return np.array(self.reference), np.zeros(3)
        found = self.reference(t)
        if not isinstance(found, tuple | list) or len(found) != 2:
            raise InvalidArgument(f"{self.name}: reference({t:g}): (L, Ldot) is needed")
        L, rate = (finite(f"{self.name}: reference({t:g})", each, 3) for each in found)
        return L, rate
