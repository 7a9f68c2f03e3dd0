"""Assembly from where a robot is, of one configuration or many, on its feet.

Assembling: loops closed from a guess, on the branch of the start.

`condyn_pin.mechanism.closing` has the runs that are tried, one after the other;
`condyn_pin.mechanism.closed_chains` says what a branch is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, check_type, checked_names, normalised
from condyn_pin._core.arrays import Array, finite_rows
from condyn_pin._core.linalg import rank_of
from condyn_pin._core.models import Indices, algorithms, data_of, indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.at_state import equations_of, gaps, to_close
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import upward
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.mechanism.closed_chains import ClosedChains, chains_of
from condyn_pin.mechanism.closing import (
    BUDGET,
    ORDINARY,
    Assembly,
    AssemblyStatus,
    ClosingResult,
    LoopCloser,
)
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
    held = indices(robot.model, checked_names("fixed", fixed, robot.joints, "joint"))[1]
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
    """Close a posture: within the joint limits if it starts there and that can be, or without."""
    # On the side of its dead points where it is; or else on that of the first posture, for what a
    # rough drawing is far from closed has no side.
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
    closer = LoopCloser.of(scene, moving, chains.limits if within_limits else NO_LIMITS)
    return assembly_of(scene, closer, start, *best_end(chains, closer, start, branch, budget))


def assembly_of(
    scene: Scene,
    closer: LoopCloser,
    start: Array,
    end: ClosingResult,
    status: AssemblyStatus,
    flipped: tuple[str, ...],
) -> Assembly:
    """Return the assembly that belongs to the best end of `closer` from `start`."""
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
    closer: LoopCloser,
    start: Array,
    branch: Mapping[str, int] | None,
    budget: int = BUDGET,
) -> tuple[ClosingResult, AssemblyStatus, tuple[str, ...]]:
    """Return the first end that is closed on the right branch, or else the best one."""
    # With the iterations of all runs, a status, and the clusters on the wrong side of a dead point.
    on = chains.branch(closer.equations.jacobian(start)) if branch is None else branch
    best: ClosingResult | None = None
    iterations, stopped = 0, False
    for end in closer.ends(start):
        iterations += end.iterations
        if end.size <= tolerances.CLOSED and not _differing_clusters(on, chains.branch(end.J)):
            return replace(end, iterations=iterations), AssemblyStatus.CLOSED, ()
        if best is None or (best.size > tolerances.CLOSED and end.size <= best.size):
            best = end
        if stopped := iterations >= ORDINARY * budget:
            break
    assert best is not None
    best = replace(best, iterations=iterations)
    if best.size <= tolerances.CLOSED:
        return best, AssemblyStatus.BRANCH_CHANGED, _differing_clusters(on, chains.branch(best.J))
    status = AssemblyStatus.UNREACHABLE if best.stationary else AssemblyStatus.STALLED
    return best, AssemblyStatus.OUT_OF_BUDGET if stopped else status, ()


def _differing_clusters(one: Mapping[str, int], other: Mapping[str, int]) -> tuple[str, ...]:
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
    check_type("branch", branch, Mapping, "the branch of an Assembly is needed")
    for name, side in branch.items():
        if name not in known:
            raise unknown_name("cluster of loops", str(name), known)
        if side not in (-1, 0, 1):
            raise InvalidArgument(f"branch[{name!r}] = {side!r}: one of -1, 0 and 1 is needed")


# Many closed configurations of one mechanism, from the angles of its motors.


# Steps on the way from the nominal configuration to one that is not found at once.
_STEPS = 8


@one_blas_thread
def assemble_batch(
    scene: Scene,
    angles: ArrayLike,
    *,
    joints: Sequence[str] | None = None,
    within_limits: bool = True,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return closed configurations with the motors at given angles, and which of them are closed.

    Each starts from the nominal configuration, and if that fails approaches its angles in small
    steps, so that no row depends on another. All are on the branch of the first posture.

    Parameters
    ----------
    scene : Scene
    angles : (n, k) array_like
        Of the motors, one row per robot [rad, m].
    joints : sequence of str, optional
        The joints that the columns are of; those with motors by default.
    within_limits : bool
        Whether angles beyond the limits of their joints, and configurations beyond those of other
        joints, count as not closed.

    Returns
    -------
    Q : (n, nq) array
        A row that is not closed is where its gap was smallest.
    closed : (n,) bool array
        Which of them are open by 1e-10 [m, rad] at most.

    Raises
    ------
    InvalidArgument
        If a size does not fit, a number is not finite, or a joint has several coordinates.
    NotAssembled
        If the loops cannot be closed at the nominal configuration.

    Notes
    -----
    Takes as long as a call of `Scene.assemble` a row, without its report.
    """
    check_scene(scene)
    scene.robot.check_unedited()
    robot = scene.robot
    named = robot.actuated if joints is None else joints
    names = checked_names("joints", named, robot.joints, "joint")
    iq, iv = indices(robot.model, names)
    if not names or not len(names) == len(iq) == len(iv):
        raise InvalidArgument(
            f"joints = {list(names)}: joints with one coordinate are needed, one at least"
        )
    goals = finite_rows("angles", angles, len(names))
    if goals.ndim != 2:
        raise InvalidArgument(f"angles has shape {goals.shape}: a row for each robot is needed")
    if not scene.nominal.closed:
        scene.state()  # raises what is in the way
    home, chains = nominal_configuration(scene), chains_of(scene)
    limits = chains.limits if within_limits else NO_LIMITS
    moving = np.ones(robot.nv, dtype=bool)
    moving[iv] = False
    closer = LoopCloser.of(scene, moving, limits)

    def closed_at(start: Array, goal: Array) -> tuple[Array, bool]:
        """Configuration near a start with the motors at a goal, and whether it is closed."""
        guess = start.copy()
        guess[iq] = goal
        end, status, _ = best_end(chains, closer, guess, chains.assembly_mode)
        at_goal = np.array_equal(end.q[iq], goal)  # not at a limit before it
        return end.q, status.ok and at_goal and not limits.beyond(end.q)

    Q, closed = np.zeros((len(goals), len(home))), np.zeros(len(goals), dtype=bool)
    for i, goal in enumerate(goals):
        Q[i], closed[i] = closed_at(home, goal)
        if closed[i] or not np.array_equal(Q[i, iq], goal):  # beyond the limits of a motor
            continue
        q = home
        for share in np.arange(1, _STEPS + 1) / _STEPS:
            q, is_closed = closed_at(q, (1 - share) * home[iq] + share * goal)
            if not is_closed:
                break
        else:
            Q[i], closed[i] = q, True
    return Q, closed


# place_on_ground: a floating robot on the ground that its contacts may touch.
#
#     x <- x + h e,                    up, along e, out of what is lower than a link
#     x <- x - min gap / (n . e) e,    down: convex shapes do not meet before that
#     x <- x - gap n,                  out of walls, until it is in nothing


# Shifts until every plane is clear: one for each of those that form a wedge, and some.
_SHIFTS = 20

# Steps downwards: of a corner past the edge of a box each leaves a share of the way.
_DESCENTS = 200
# Steps down to a ground: on a slope of 60 degrees each halves the distance.
_DOWNS = 100

# What faces up by more than this, as the sine of its angle to the vertical, is ground; else a wall.
_FACES_UP = 0.1


def place_on_ground(scene: Scene, q: ArrayLike) -> Array:
    """Return a configuration with the floating base put down until the first contact touches.

    It is moved along the vertical, up out of what is lower than the longest link before, and then
    out of walls.

    Parameters
    ----------
    scene : Scene
        With contacts that may open.
    q : (nq,) array_like
        Only the base moves; the joints, and with them the loops, stay as they are.

    Returns
    -------
    q : (nq,) array
        q as given, if the robot has no floating base or no contact has ground below it: planes that
        face up, and other shapes. Onto a `Ground` it is lowered along gravity, from above all of
        it. A wall moves the robot only where it is in one, and not where that takes it into
        another.

    Raises
    ------
    InvalidArgument
        If q is no configuration, the contacts of the scene are constraints, which never open, or
        other constraints tie the base to a place.
    """
    check_scene(scene)
    model = scene.robot.unedited
    placed = normalised(model, "q", q)
    if not scene.contacts and any(each.presses for each in scene.constraints):
        raise InvalidArgument(
            "scene: its contacts are held where they are; one with contacts that may open is "
            "needed, Scene(robot, contacts=robot.frictional_contacts(friction=0.7))"
        )
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    if not candidates.cones or model.joints[1].shortname() != "JointModelFreeFlyer":
        return placed
    own = _of_the_base(scene)
    has_vertical = bool(upward(scene).any())
    if has_vertical and (own & candidates.on_ground).any():
        on_ground = _lowered(scene, candidates, own, placed)
    else:
        if has_vertical:
            down = _put_down(scene, candidates, own, placed)
        else:
            down = _shifted_base(scene, candidates, own, placed, walls=False)[0]
        clear, ends = _shifted_base(scene, candidates, own, down, walls=True)
        on_ground = clear if ends else down
    _check_ties(scene, placed, on_ground)
    return on_ground


def _lowered(scene: Scene, candidates: Candidates, own: NDArray[np.bool_], q: Array) -> Array:
    """Base lowered from above a `Ground` until the first shape touches; q if none is below it.

    A shape that is a distance from everything may go down by as much.
    """
    model, up, placed = scene.robot.unedited, upward(scene), q.copy()
    data = data_of(model)
    algorithms(data).forwardKinematics(model, data, q)
    pairs = [each for bound in scene.contact_bounds for each in bound.pairs if each.surface]
    low = min(
        float(up.dot((data.oMi[p.joint] * p.placement).translation)) - p.shape.reach for p in pairs
    )
    bounds = np.concatenate([each.surface.bounds for each in pairs if each.surface]).reshape(-1, 3)
    heights = bounds[np.isfinite(bounds).all(axis=1)].dot(up)
    placed[:3] += max(0.0, float(heights.max(initial=low)) - low) * up
    floor = float(heights.min(initial=low)) - 1.0
    for _ in range(_DOWNS):
        algorithms(data).forwardKinematics(model, data, placed)
        gap = float(candidates.gaps(data, placed)[: candidates.cones][own].min())
        if abs(gap) <= tolerances.CLOSED:
            return placed
        if not np.isfinite(gap) or low + float(up.dot(placed[:3] - q[:3])) - gap < floor - 1.0:
            break
        placed[:3] -= gap * up
    return placed if abs(gap) <= tolerances.NEARLY_CLOSED else q


def _put_down(scene: Scene, candidates: Candidates, own: NDArray[np.bool_], q: Array) -> Array:
    """Base on the first ground below it, by `own` contacts; as it is without any."""
    model, up = scene.robot.unedited, upward(scene)
    data, size = data_of(model), scene.robot.longest_link or 1.0
    pairs = [pair for bound in scene.contact_bounds for pair in bound.pairs]
    planes = np.ones(candidates.cones, dtype=bool)
    of_pairs = [pair.ground_shape.is_plane for pair in pairs for _ in range(pair.points)]
    planes[candidates.contact_points :] = of_pairs

    def at(lift: float) -> tuple[Array, Array, Array]:
        """Configuration lifted along the vertical, gaps, and how fast they grow with a lift."""
        moved = q.copy()
        moved[:3] += lift * up
        algorithms(data).forwardKinematics(model, data, moved)
        gaps = candidates.gaps(data, moved)[: candidates.cones]
        return moved, gaps, candidates.axes(data, moved)[:, :, 2] @ up

    _, gaps, rises = at(0.0)
    floors = own & planes & (rises > _FACES_UP)
    solids = own & ~planes
    out = float(np.where(floors, -gaps / np.where(floors, rises, 1.0), 0.0).max(initial=0.0))
    lift = start = max(out, 0.0)
    while np.where(solids, at(lift)[1], np.inf).min(initial=np.inf) < -tolerances.CLOSED:
        lift = start + max(2.0 * (lift - start), 0.01 * size)
        if lift - start > size:  # a wall, and no step
            lift = start
            break
    for _ in range(_DESCENTS):
        moved, gaps, rises = at(lift)
        met_from_above = (rises > 0.0) & (gaps >= -tolerances.CLOSED)
        below = np.isfinite(gaps) & (floors | (solids & met_from_above))
        if not below.any():
            return q
        nearest = np.flatnonzero(below)[(gaps[below] / rises[below]).argmin()]
        if abs(gaps[nearest]) <= tolerances.CLOSED:
            return moved
        lift -= gaps[nearest] / rises[nearest]
    return moved


def _shifted_base(
    scene: Scene, candidates: Candidates, own: NDArray[np.bool_], q: Array, *, walls: bool
) -> tuple[Array, bool]:
    """Base on the ground and out of `walls`, by `own` contacts; whether the shifts ended."""
    model, up = scene.robot.unedited, upward(scene)
    data, placed = data_of(model), q.copy()
    for _ in range(_SHIFTS):
        algorithms(data).forwardKinematics(model, data, placed)
        gaps = candidates.gaps(data, placed)[: candidates.cones]
        n = candidates.axes(data, placed)[:, :, 2]
        ground = (n @ up > _FACES_UP) if up.any() else np.full(len(gaps), True)
        near = own & np.isfinite(gaps)
        counts = near & (ground | (walls & (gaps < 0.0)))
        if not (near & ground).any():
            return placed, True
        lowest = int(np.where(counts, gaps, np.inf).argmin())
        if abs(gaps[lowest]) <= tolerances.CLOSED:
            return placed, True
        placed[:3] -= gaps[lowest] * n[lowest]
    return placed, False


def _of_the_base(scene: Scene) -> NDArray[np.bool_]:
    """Mask of the cones between the base, or a body on it, and something else."""
    hangs = [1 in list(path) for path in scene.robot.unedited.supports]
    touches = [each for bound in scene.contact_bounds for each in bound.touches]
    pairs = [each for bound in scene.contact_bounds for each in bound.pairs]
    sides = [(each.joint, each.ground) for each in touches]
    sides += [(each.joint, each.ground) for each in pairs for _ in range(each.points)]
    return np.array([hangs[one] and not hangs[other] for one, other in sides], dtype=bool)


def _check_ties(scene: Scene, before: Array, after: Array) -> None:
    """Refuse a shift that opens constraints."""
    if not scene.rows or np.array_equal(before, after):
        return
    equations = equations_of(scene)
    was, found = (np.abs(equations.violation(each)) for each in (before, after))
    for bound in scene.bounds:
        opened = found[bound.rows].max(initial=0.0)
        if opened > was[bound.rows].max(initial=0.0) + tolerances.NEARLY_CLOSED:
            raise InvalidArgument(
                f"scene: {bound.name} ties the base to a place, and a shift onto the ground opens "
                "it; leave it out, or move what it is tied to"
            )
