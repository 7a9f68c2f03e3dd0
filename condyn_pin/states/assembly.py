"""Assembly: a configuration near a guess that closes the loops, and what is known of it.

`condyn_pin.states.closing` has the runs that are tried, one after the other, until the loops are
closed on the branch of the start; `condyn_pin.states.chains` says what a branch is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array
from condyn_pin.errors import BranchChanged, InvalidArgument, NotAssembled, unknown_name
from condyn_pin.rows.equations import Equations
from condyn_pin.states.closing import NO_LIMITS, Closer, Closing, Limits
from condyn_pin.states.gaps import Gap, gaps

if TYPE_CHECKING:
    from condyn_pin.robot import Robot
    from condyn_pin.scene import Scene
    from condyn_pin.states.chains import Chains


class AssemblyStatus(Enum):
    """How an assembly ended; the value is advice."""

    CLOSED = "every loop is closed"
    BRANCH_CHANGED = (
        "the loops are closed, but on the other side of a dead point; start nearer, or move there "
        "in smaller steps"
    )
    BEYOND_LIMITS = (
        "within the joint limits this is the smallest gap near the start; beyond them it closes: "
        "start elsewhere, or pass within_limits=False"
    )
    UNREACHABLE = (
        "this is the smallest gap near the start; start nearer to a closed configuration, or fix "
        "fewer joints"
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
        The configuration with the smallest gap found.
    gap : dict of str to Gap
        How far each loop is open at q: a length [m] and an angle [rad].
    iterations : int
        Of all runs that were needed.
    rank : int
        Independent rows among those of the loops, at q.
    smallest_singular_value : float
        Of J_D, the columns of the joints that the others determine, in m and rad, not whitened:
        zero in a dead point. Without motors, the smallest nonzero one of J.
    branch : dict of str to int
        For every cluster of loops that share such joints: +1 on the side of its dead points where
        the first posture is, -1 across one, 0 in one; `condyn_pin.states.chains` defines them.
        Empty for a robot without motors: what is not driven has no branches.
    flipped : tuple of str
        The clusters that changed sides, if the status is BRANCH_CHANGED.
    beyond_limits : dict of str to float
        Joints that the closure takes out of their limits, and how far [rad, m]. Of q; or, if the
        status is BEYOND_LIMITS, of the closure that was not taken.
    status : AssemblyStatus
    """

    q: Array
    gap: Mapping[str, Gap]
    iterations: int
    rank: int
    smallest_singular_value: float  # [m, rad]
    branch: Mapping[str, int]
    flipped: tuple[str, ...]
    beyond_limits: Mapping[str, float]  # [rad, m]
    status: AssemblyStatus

    @property
    def closed(self) -> bool:
        """Whether every gap is within tolerance (1e-10)."""
        return all(gap.size <= tolerances.CLOSED for gap in self.gap.values())

    def error(self) -> NotAssembled | BranchChanged:
        """Return what `assemble` raises if the status is not CLOSED."""
        if self.status is AssemblyStatus.BRANCH_CHANGED:
            return BranchChanged(f"{', '.join(self.flipped)}: {self.status.value}", self)
        name, gap = max(self.gap.items(), key=lambda item: item[1].size)
        text = f"{name} is open by {gap} after {self.iterations} iterations; "
        text += "".join(f"{_out(*item)}; " for item in self.beyond_limits.items())
        return NotAssembled(text + self.status.value, self)

    def __str__(self) -> str:
        lines = [str(self.status), f"{self.iterations} iterations, rank {self.rank}"]
        lines[1] += f", smallest singular value {self.smallest_singular_value:.3g}"
        lines += [f"{name:<28} open by {gap}" for name, gap in self.gap.items()]
        lines += [f"branch of {name}: {side:+d}" for name, side in self.branch.items()]
        lines += [_out(name, by) for name, by in self.beyond_limits.items()]
        return "\n".join(lines)


def assemble(
    scene: Scene,
    q0: ArrayLike,
    *,
    fixed: Sequence[str] = (),
    within_limits: bool = True,
    branch: Mapping[str, int] | None = None,
    throw: bool = True,
) -> Assembly:
    """Close the loops of a scene; see `Scene.assemble`."""
    robot, chains = scene.robot, scene.chains
    robot.check_unedited()
    start = normalised(robot.model, "q", q0)
    moving = _moving(robot, fixed)
    if within_limits:
        _check_fixed(chains.limits, start, moving)
    if branch is not None:
        _check_branch(branch, chains.home)
    assembly = assemble_from(scene, start, moving, within_limits=within_limits, branch=branch)
    if throw and not assembly.status.ok:
        raise assembly.error()
    return assembly


def assemble_posture(scene: Scene, guess: Array) -> Assembly:
    """Close a posture: within the joint limits if it starts there and that can be, or without."""
    if not scene.chains.limits.beyond(guess):
        found = assemble(scene, guess, throw=False)
        if found.status.ok:
            return found
    return assemble(scene, guess, within_limits=False)


def assemble_from(
    scene: Scene,
    start: Array,
    moving: NDArray[np.bool_],
    *,
    within_limits: bool = True,
    branch: Mapping[str, int] | None = None,
) -> Assembly:
    """Close the loops of a scene with the velocity indices that may move; nothing is raised."""
    chains, equations = scene.chains, Equations(scene.robot.model, scene.bounds)
    closer = Closer(equations, chains.rows, moving, chains.limits if within_limits else NO_LIMITS)
    end, iterations, status, flipped = _best(chains, closer, start, branch)
    beyond = chains.limits.beyond(end.q)
    if within_limits and status is AssemblyStatus.UNREACHABLE:
        free = Closer(equations, chains.rows, moving).close(end.q)
        iterations += free.iterations
        if free.size <= tolerances.CLOSED:
            status, beyond = AssemblyStatus.BEYOND_LIMITS, chains.limits.beyond(free.q)
    J = equations.jacobian(end.q)
    S = np.linalg.svd(J[chains.rows], compute_uv=False)
    return Assembly(
        q=end.q,
        gap=gaps(scene, equations.violation(end.q)),
        iterations=iterations,
        rank=int(np.count_nonzero(tolerances.RANK * S.max(initial=0.0) < S)),
        smallest_singular_value=chains.smallest(J),
        branch=chains.branch(J),
        flipped=flipped,
        beyond_limits=beyond,
        status=status,
    )


def _best(
    chains: Chains, closer: Closer, start: Array, branch: Mapping[str, int] | None
) -> tuple[Closing, int, AssemblyStatus, tuple[str, ...]]:
    """Return the first end that is closed on the right branch, or else the best one."""

    def side(q: Array) -> dict[str, int]:
        return chains.branch(closer.equations.jacobian(q)) if chains.clusters else {}

    wanted = side(start) if branch is None else branch
    best: Closing | None = None
    iterations = 0
    for end in closer.ends(start):
        iterations += end.iterations
        if end.size <= tolerances.CLOSED:
            flipped = _across(wanted, side(end.q))
            moved = np.abs(pin.difference(closer.equations.model, start, end.q)).max()
            if not flipped or (branch is None and moved > tolerances.REACH):
                return end, iterations, AssemblyStatus.CLOSED, ()
        if best is None or (best.size > tolerances.CLOSED and end.size <= best.size):
            best = end
    assert best is not None
    if best.size <= tolerances.CLOSED:
        return best, iterations, AssemblyStatus.BRANCH_CHANGED, _across(wanted, side(best.q))
    status = AssemblyStatus.UNREACHABLE if best.stationary else AssemblyStatus.STALLED
    return best, iterations, status, ()


def _across(one: Mapping[str, int], other: Mapping[str, int]) -> tuple[str, ...]:
    """Return the clusters that two branches have on different sides of a dead point."""
    return tuple(name for name, side in one.items() if side * other.get(name, 0) < 0)


def _out(joint: str, by: float) -> str:
    return f"{joint} is {by:.3g} rad or m beyond its limits"


def _moving(robot: Robot, fixed: Sequence[str]) -> NDArray[np.bool_]:
    model = robot.model
    if isinstance(fixed, str) or not isinstance(fixed, Iterable):
        raise InvalidArgument(f"fixed = {fixed!r}: a list of names of joints is needed")
    moving = np.ones(robot.nv, dtype=bool)
    for name in fixed:
        if not isinstance(name, str):
            raise InvalidArgument(f"fixed: {name!r} is not the name of a joint")
        if not model.existJointName(name):
            raise unknown_name("joint", name, robot.joints)
        joint = model.joints[model.getJointId(name)]
        moving[joint.idx_v : joint.idx_v + joint.nv] = False
    return moving


def _check_fixed(limits: Limits, q: Array, moving: NDArray[np.bool_]) -> None:
    """Refuse a joint that is to stay where its limits do not allow it."""
    held = dict(zip(limits.joints, ~moving[limits.iv], strict=True))
    for joint, by in limits.beyond(q).items():
        if held[joint]:
            raise InvalidArgument(
                f"fixed: {joint!r} is {by:.3g} rad or m beyond its limits in q; "
                "give it another value, or pass within_limits=False"
            )


def _check_branch(branch: Mapping[str, int], home: Mapping[str, int]) -> None:
    if not isinstance(branch, Mapping):
        raise InvalidArgument(f"branch = {branch!r}: the branch of an Assembly is needed")
    for name, side in branch.items():
        if name not in home:
            raise unknown_name("cluster of loops", str(name), home)
        if side not in (-1, 0, 1):
            raise InvalidArgument(f"branch[{name!r}] = {side!r}: one of -1, 0 and 1 is needed")
