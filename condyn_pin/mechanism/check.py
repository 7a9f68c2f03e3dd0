"""Check: which loop is open and by how much, and which velocity does not fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised, renamed
from condyn_pin._core.arrays import finite
from condyn_pin.constraints.rows.bound import ConstraintViolation, beyond_text, closed
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    gaps,
    kept_rows,
    rounding,
    to_close,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import NotAssembled
from condyn_pin.mechanism.closed_chains import chains_of


@dataclass(frozen=True, eq=False)
class Check:
    """By how much a state violates the constraints.

    Attributes
    ----------
    violation : dict of str to ConstraintViolation
        How far each loop and each anchored contact is open [m, rad].
    constraint_velocity : dict of str to ConstraintViolation
        How fast the two sides of each constraint move apart, |J v| [m/s, rad/s].
    speed : float
        max abs(v), or 1, whichever is larger: what |J v| is compared with.
    beyond_limits : dict of str to ConstraintViolation
        Joints outside their limits, and how far [rad, m]. The dynamics know no limits.
    rounding : dict of str to float
        What rounding alone may leave of |J v|: 1e-13 of the velocities that it is the difference
        of [m/s, rad/s]. Looked at where |J v| is more than 1e-10 of `speed`.
    to_close : dict of str to ConstraintViolation, optional
        `violation` without what the digits of a file leave open, within `Robot.precision`; by
        default all of it. `constraint_velocity` is without that too.
    """

    violation: Mapping[str, ConstraintViolation]
    constraint_velocity: Mapping[str, ConstraintViolation]
    speed: float  # [rad/s, m/s]
    beyond_limits: Mapping[str, ConstraintViolation]  # [rad, m]
    rounding: Mapping[str, float] = field(default_factory=dict)  # [m/s, rad/s]
    to_close: Mapping[str, ConstraintViolation] | None = None

    gap = renamed("violation")
    slip = renamed("constraint_velocity")

    @property
    def closed(self) -> bool:
        """Whether every gap is within 1e-10, but for what digits leave open."""
        return closed(self._to_close)

    @property
    def _to_close(self) -> Mapping[str, ConstraintViolation]:
        return self.violation if self.to_close is None else self.to_close

    @property
    def consistent(self) -> bool:
        """Whether J v = 0 to 1e-10, relative to `speed`, or to `rounding`."""
        return not self._moving(tolerances.CONSISTENT)

    @property
    def ok(self) -> bool:
        """Whether the state satisfies the constraints."""
        return self.closed and self.consistent

    def raise_if_open(
        self,
        *,
        violation: float = tolerances.CLOSED,
        constraint_velocity: float = tolerances.CONSISTENT,
    ) -> None:
        """Raise if the state does not satisfy the constraints.

        Parameters
        ----------
        violation : float
            The largest violation that will do [m, rad].
        constraint_velocity : float
            The largest |J v| that will do, relative to `speed`.

        Raises
        ------
        NotAssembled
            The text names every loop that is open, and every constraint with J v other than zero.
        """
        wrong = self._open(violation)
        advice = ["Scene.assemble closes the loops"] if wrong else []
        if moving := self._moving(constraint_velocity):
            wrong += moving
            advice.append("mechanism.project_velocity makes v fit")
        if wrong:
            raise NotAssembled(f"{', '.join(wrong)}; {'; '.join(advice)}")

    def __str__(self) -> str:
        lines = self._open(tolerances.CLOSED) or ["every loop is closed"]
        lines += self._moving(tolerances.CONSISTENT) or (
            ["J v = 0"] if self.constraint_velocity else []
        )
        lines += [beyond_text(self.beyond_limits)] if self.beyond_limits else []
        return "\n".join(lines)

    def _open(self, most: float) -> list[str]:
        return [
            f"{name} is open by {gap}" for name, gap in self._to_close.items() if gap.size > most
        ]

    def _moving(self, most: float) -> list[str]:
        return [
            f"{name} has |J v| = {velocity.text('/s')}"
            for name, velocity in self.constraint_velocity.items()
            if not velocity.size <= max(most * self.speed, self.rounding.get(name, 0.0))
        ]


def check(scene: Scene, q: ArrayLike, v: ArrayLike | None) -> Check:
    """Return what a state leaves open; see `Scene.check`."""
    model, equations = scene.robot.model, equations_of(scene)
    q_ = normalised(model, "q", q)
    chains = chains_of(scene)
    velocities, speed, excused = {}, 1.0, {}
    if v is not None:
        v_ = finite("v", v, model.nv)
        J, rate = kept_rows(scene, equations.jacobian(q_), -equations.wanted[1])
        velocities = constraint_velocities(scene, J @ v_ + rate)
        speed = max(1.0, float(np.abs(v_).max(initial=0.0)))
        if any(each.size > tolerances.CONSISTENT * speed for each in velocities.values()):
            excused = rounding(scene, q_, v_)
    c = equations.violation(q_)
    beyond, closing = chains.limits.beyond(q_), gaps(scene, to_close(scene, q_, c))
    return Check(gaps(scene, c), velocities, speed, beyond, excused, closing)
