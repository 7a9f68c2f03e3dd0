"""Assembly: a configuration near a guess that closes the loops, and what is known of it.

`condyn_pin.mechanism.closing` has the runs that are tried, one after the other, until the loops are
closed on the branch of the start; `condyn_pin.mechanism.closed_chains` says what a branch is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.joints import Indices, indices
from condyn_pin._core.linalg.numerical_rank import rank_of
from condyn_pin._core.names import checked
from condyn_pin._core.renamed import renamed
from condyn_pin.constraints.violation import ConstraintViolation, beyond_text, closed, worst
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.contact_gaps import penetration
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import BranchChanged, InvalidArgument, NotAssembled, unknown_name
from condyn_pin.mechanism.closed_chains import ClosedChains, chains_of
from condyn_pin.mechanism.closing import Closer, Closing
from condyn_pin.model.limits import NO_LIMITS, Limits


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

    gap = renamed("violation")

    @property
    def closed(self) -> bool:
        """Whether every gap is within tolerance (1e-10)."""
        return closed(self.violation)

    @property
    def penetration(self) -> dict[str, ConstraintViolation]:
        """Contacts and stops of the scene that are passed at q, by name, and how far [m, rad]."""
        return penetration(self.scene, self.q)

    def error(self) -> NotAssembled | BranchChanged:
        """Return what `assemble` raises if the status is not CLOSED."""
        if self.status is AssemblyStatus.BRANCH_CHANGED:
            return BranchChanged(f"{', '.join(self.flipped)}: {self.status.value}", self)
        name, gap = worst(self.violation)
        text = f"{name} is open by {gap} after {self.iterations} iterations; "
        text += f"{beyond_text(self.beyond_limits)}; " if self.beyond_limits else ""
        return NotAssembled(text + self.status.value, self)

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


@one_blas_thread
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
    robot, chains = scene.robot, chains_of(scene)
    robot.check_unedited()
    start = normalised(robot.model, "q", q0)
    held = indices(robot.model, checked("fixed", fixed, robot.joints, "joint"))[1]
    if within_limits:
        check_held("fixed", chains.limits, start, held)
    if branch is not None:
        _check_branch(branch, chains.assembly_mode)
    moving = np.ones(robot.nv, dtype=bool)
    moving[held] = False
    assembly = assemble_from(scene, start, moving, within_limits=within_limits, branch=branch)
    if throw and not assembly.status.ok:
        raise assembly.error()
    return assembly


@one_blas_thread
def assemble_posture(scene: Scene, guess: Array) -> Assembly:
    """Close a posture: within the joint limits if it starts there and that can be, or without.

    On the side of its dead points where it is; or else on that of the first posture, for what a
    rough drawing is far from closed has no side.
    """
    inside = not chains_of(scene).limits.beyond(guess)
    for within_limits in (True, False) if inside else (False,):
        for branch in (None, chains_of(scene).assembly_mode):
            found = assemble(scene, guess, within_limits=within_limits, branch=branch, throw=False)
            if found.status is not AssemblyStatus.BRANCH_CHANGED:
                break
        if found.status.ok:
            return found
    raise found.error()


def assemble_from(
    scene: Scene,
    start: Array,
    moving: NDArray[np.bool_],
    *,
    within_limits: bool,
    branch: Mapping[str, int] | None = None,
) -> Assembly:
    """Close the loops of a scene with the velocity indices that may move; nothing is raised."""
    chains = chains_of(scene)
    closer = Closer.of(scene, moving, chains.limits if within_limits else NO_LIMITS)
    end, status, flipped = best_end(chains, closer, start, branch)
    iterations, beyond = end.iterations, chains.limits.beyond(end.q)
    if within_limits and status is AssemblyStatus.UNREACHABLE:
        free = Closer.of(scene, moving).close(end.q)
        iterations += free.iterations
        if free.size <= tolerances.CLOSED:
            status, beyond = AssemblyStatus.BEYOND_LIMITS, chains.limits.beyond(free.q)
    J = end.J
    return Assembly(
        q=end.q,
        violation=gaps(scene, closer.equations.violation(end.q)),
        iterations=iterations,
        rank=rank_of(np.linalg.svd(J[chains.rows], compute_uv=False)),
        smallest_singular_value=chains.smallest(J),
        branch=chains.branch(J),
        flipped=flipped,
        beyond_limits=beyond,
        status=status,
        scene=scene,
        start=start,
    )


def best_end(
    chains: ClosedChains, closer: Closer, start: Array, branch: Mapping[str, int] | None
) -> tuple[Closing, AssemblyStatus, tuple[str, ...]]:
    """Return the first end that is closed on the right branch, or else the best one.

    With the iterations of all runs, a status, and the clusters on the wrong side of a dead point.
    """
    wanted = chains.branch(closer.equations.jacobian(start)) if branch is None else branch
    best: Closing | None = None
    iterations = 0
    for end in closer.ends(start):
        iterations += end.iterations
        if end.size <= tolerances.CLOSED and not _across(wanted, chains.branch(end.J)):
            return replace(end, iterations=iterations), AssemblyStatus.CLOSED, ()
        if best is None or (best.size > tolerances.CLOSED and end.size <= best.size):
            best = end
    assert best is not None
    best = replace(best, iterations=iterations)
    if best.size <= tolerances.CLOSED:
        return best, AssemblyStatus.BRANCH_CHANGED, _across(wanted, chains.branch(best.J))
    status = AssemblyStatus.UNREACHABLE if best.stationary else AssemblyStatus.STALLED
    return best, status, ()


def _across(one: Mapping[str, int], other: Mapping[str, int]) -> tuple[str, ...]:
    """Return the clusters that two branches have on different sides of a dead point."""
    return tuple(name for name, side in one.items() if side * other.get(name, 0) < 0)


def check_held(argument: str, limits: Limits, q: Array, held: Indices) -> None:
    """Refuse a joint that is to stay where its limits do not allow it."""
    for joint, by in limits.beyond(q).items():
        if joint in limited(limits, held):
            raise InvalidArgument(
                f"{argument}: {joint!r} is {by} beyond its limits; "
                "give it another value, or pass within_limits=False"
            )


def limited(limits: Limits, of: Indices) -> set[str]:
    """Return the joints with limits among some velocity indices."""
    return {joint for joint, iv in zip(limits.joints, limits.iv, strict=True) if iv in of}


def _check_branch(branch: Mapping[str, int], home: Mapping[str, int]) -> None:
    if not isinstance(branch, Mapping):
        raise InvalidArgument(f"branch = {branch!r}: the branch of an Assembly is needed")
    for name, side in branch.items():
        if name not in home:
            raise unknown_name("cluster of loops", str(name), home)
        if side not in (-1, 0, 1):
            raise InvalidArgument(f"branch[{name!r}] = {side!r}: one of -1, 0 and 1 is needed")
