"""Assembling: loops closed from a guess, on the branch of the start.

`condyn_pin.mechanism.closing` has the runs that are tried, one after the other;
`condyn_pin.mechanism.closed_chains` says what a branch is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, checked, normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.joints import Indices, indices
from condyn_pin._core.linalg import rank_of
from condyn_pin.dynamics.at_state import gaps, to_close
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.mechanism.assembly import Assembly, AssemblyStatus
from condyn_pin.mechanism.closed_chains import ClosedChains, chains_of
from condyn_pin.mechanism.closing import BUDGET, ORDINARY, Closer, Closing
from condyn_pin.model.joints import NO_LIMITS, Limits


@one_blas_thread
def assemble(
    scene: Scene,
    q0: ArrayLike,
    *,
    fixed: Sequence[str] = (),
    within_limits: bool = True,
    branch: Mapping[str, int] | None = None,
    budget: int = BUDGET,
    throw: bool = True,
) -> Assembly:
    """Close the loops of a scene; see `Scene.assemble`."""
    robot, chains = scene.robot, chains_of(scene)
    robot.check_unedited()
    start = normalised(robot.model, "q", q0)
    check_count("budget", budget)
    held = indices(robot.model, checked("fixed", fixed, robot.joints, "joint"))[1]
    if within_limits:
        check_held("fixed", chains.limits, start, held)
    if branch is not None:
        _check_branch(branch, chains.assembly_mode)
    moving = np.ones(robot.nv, dtype=bool)
    moving[held] = False
    assembly = assemble_from(
        scene, start, moving, within_limits=within_limits, branch=branch, budget=budget
    )
    if throw and not assembly.status.ok:
        raise assembly.error()
    return assembly


@one_blas_thread
def nominal_configuration(scene: Scene) -> Array:
    """Return the configuration that is the default: the nominal state, closed at its time."""
    q = scene.nominal.q
    if not scene.is_driven:
        return q
    found = assemble(scene, q, within_limits=False, throw=False)
    return found.q if found.closed else q


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
    budget: int = BUDGET,
) -> Assembly:
    """Close the loops of a scene with the velocity indices that may move; nothing is raised."""
    chains = chains_of(scene)
    closer = Closer.of(scene, moving, chains.limits if within_limits else NO_LIMITS)
    return assembly_of(scene, closer, start, *best_end(chains, closer, start, branch, budget))


def assembly_of(
    scene: Scene,
    closer: Closer,
    start: Array,
    end: Closing,
    status: AssemblyStatus,
    flipped: tuple[str, ...],
) -> Assembly:
    """Return what is to be said of the best end of `closer` from `start`."""
    chains = chains_of(scene)
    iterations, beyond = end.iterations, chains.limits.beyond(end.q)
    if closer.limits is chains.limits and status is AssemblyStatus.UNREACHABLE:
        free = replace(closer, limits=NO_LIMITS).close(end.q)
        iterations += free.iterations
        if free.size <= tolerances.CLOSED:
            status, beyond = AssemblyStatus.BEYOND_LIMITS, chains.limits.beyond(free.q)
    J = end.J
    c = closer.equations.violation(end.q)
    return Assembly(
        q=end.q,
        violation=gaps(scene, c),
        iterations=iterations,
        rank=rank_of(np.linalg.svd(J[chains.rows], compute_uv=False)),
        smallest_singular_value=chains.smallest(J),
        branch=chains.branch(J),
        flipped=flipped,
        beyond_limits=beyond,
        status=status,
        scene=scene,
        start=start,
        to_close=gaps(scene, to_close(scene, end.q, c)),
    )


def best_end(
    chains: ClosedChains,
    closer: Closer,
    start: Array,
    branch: Mapping[str, int] | None,
    budget: int = BUDGET,
) -> tuple[Closing, AssemblyStatus, tuple[str, ...]]:
    """Return the first end that is closed on the right branch, or else the best one.

    With the iterations of all runs, a status, and the clusters on the wrong side of a dead point.
    """
    wanted = chains.branch(closer.equations.jacobian(start)) if branch is None else branch
    best: Closing | None = None
    iterations, stopped = 0, False
    for end in closer.ends(start):
        iterations += end.iterations
        if end.size <= tolerances.CLOSED and not _across(wanted, chains.branch(end.J)):
            return replace(end, iterations=iterations), AssemblyStatus.CLOSED, ()
        if best is None or (best.size > tolerances.CLOSED and end.size <= best.size):
            best = end
        if stopped := iterations >= ORDINARY * budget:
            break
    assert best is not None
    best = replace(best, iterations=iterations)
    if best.size <= tolerances.CLOSED:
        return best, AssemblyStatus.BRANCH_CHANGED, _across(wanted, chains.branch(best.J))
    status = AssemblyStatus.UNREACHABLE if best.stationary else AssemblyStatus.STALLED
    return best, AssemblyStatus.OUT_OF_BUDGET if stopped else status, ()


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


def _check_branch(branch: Mapping[str, int], known: Mapping[str, int]) -> None:
    if not isinstance(branch, Mapping):
        raise InvalidArgument(f"branch = {branch!r}: the branch of an Assembly is needed")
    for name, side in branch.items():
        if name not in known:
            raise unknown_name("cluster of loops", str(name), known)
        if side not in (-1, 0, 1):
            raise InvalidArgument(f"branch[{name!r}] = {side!r}: one of -1, 0 and 1 is needed")
