"""Assembly: a configuration near a guess that closes the loops, and what is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from condyn_pin._core.arguments import renamed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import ConstraintViolation, beyond_text, closed, worst
from condyn_pin.dynamics.at_state import penetration
from condyn_pin.dynamics.nominal import digits_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import BranchChanged, NotAssembled


class AssemblyStatus(Enum):
    """How an assembly ended; the value is advice."""

    CLOSED = "every loop is closed"
    BRANCH_CHANGED = (
        "the loops are closed, but on the other side of a dead point; start nearer, or move there "
        "in smaller steps"
    )
    BEYOND_LIMITS = (
        "the loops close only beyond the joint limits; start elsewhere, or pass within_limits=False"
    )
    UNREACHABLE = (
        "this is the smallest gap near the start; start nearer to a closed configuration, or fix "
        "fewer joints"
    )
    OUT_OF_BUDGET = (
        "the budget ended before the loops were closed; start nearer to a closed configuration, or "
        "raise it, assemble(q0, budget=1000)"
    )
    STALLED = "the gap was still getting smaller when the steps ran out; start from where it ended"

    @property
    def ok(self) -> bool:
        """Whether the configuration can be used as it is."""
        return self is AssemblyStatus.CLOSED

    def __str__(self) -> str:
        return f"{self.name.lower()}: {self.value}"


@dataclass(frozen=True, eq=False)
class Assembly:
    """How an assembly ended.

    Attributes
    ----------
    q : (nq,) array
        The configuration with the smallest gap found [rad, m].
    violation : dict of str to ConstraintViolation
        How far each loop is open at q: a length [m] and an angle [rad].
    iterations : int
        Of all runs that were needed.
    rank : int
        Independent rows among those of the loops, at q.
    smallest_singular_value : float
        Of J_D, the columns of the joints that the others determine, [1, m], not whitened:
        zero in a dead point. Without motors, the smallest nonzero one of J.
    branch : dict of str to int
        For every cluster of loops that share such joints: +1 on the side of its dead points where
        the first posture is, -1 across one, 0 in one; `condyn_pin.mechanism.closed_chains` defines
        them. Empty for a robot without motors: what is not driven has no branches. Nor have loops
        in space with redundant rows.
    flipped : tuple of str
        The clusters that changed sides, if the status is BRANCH_CHANGED.
    beyond_limits : dict of str to ConstraintViolation
        Joints that the closure takes out of their limits, and how far [rad, m]. Of q; or, if the
        status is BEYOND_LIMITS, of the closure that was not taken.
    status : AssemblyStatus
    scene : Scene
    start : (nq,) array
        What was assembled, and from where.
    to_close : dict of str to ConstraintViolation
        `violation` without what the digits of a file leave open, within `Robot.precision`.
    """

    q: Array
    violation: Mapping[str, ConstraintViolation]
    iterations: int
    rank: int
    smallest_singular_value: float  # [m, rad]
    branch: Mapping[str, int]
    flipped: tuple[str, ...]
    beyond_limits: Mapping[str, ConstraintViolation]  # [rad, m]
    status: AssemblyStatus
    scene: Scene
    start: Array
    to_close: Mapping[str, ConstraintViolation]

    gap = renamed("violation")

    @property
    def closed(self) -> bool:
        """Whether every gap is within tolerance (1e-10), but for what digits leave open."""
        return closed(self.to_close)

    @property
    def penetration(self) -> dict[str, ConstraintViolation]:
        """Contacts and stops of the scene that are passed at q, by name, and how far [m, rad]."""
        return penetration(self.scene, self.q)

    def error(self) -> NotAssembled | BranchChanged:
        """Return what `assemble` raises if the status is not CLOSED."""
        if self.status is AssemblyStatus.BRANCH_CHANGED:
            return BranchChanged(f"{', '.join(self.flipped)}: {self.status.value}", self)
        name, gap = worst(self.to_close)
        text = f"{name} is open by {gap} after {self.iterations} iterations; "
        text += f"{beyond_text(self.beyond_limits)}; " if self.beyond_limits else ""
        text += self.status.value
        digits = digits_of(self.scene)
        return NotAssembled(f"{text}; {digits.note}" if digits else text, self)

    def __str__(self) -> str:
        lines = [str(self.status), f"{self.iterations} iterations, rank {self.rank}"]
        lines[1] += f", smallest singular value {self.smallest_singular_value:.3g}"
        lines += [f"{name:<28} open by {gap}" for name, gap in self.violation.items()]
        lines += [
            f"branch of {name}: {f'{side:+d}' if side else 'in a dead point'}"
            for name, side in self.branch.items()
        ]
        lines += [f"{name:<28} penetrates by {by}" for name, by in self.penetration.items()]
        lines += [beyond_text(self.beyond_limits)] if self.beyond_limits else []
        return "\n".join(lines)
