"""put_down: a floating robot on the ground that its contacts may touch.

x <- x - gap n,    of the ground with the least gap, until it touches
x <- x - gap n,    of what a contact is in, until it is in nothing
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms, data_of
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import upward
from condyn_pin.errors import InvalidArgument

# Shifts until every plane is clear: one for each of those that form a wedge, and some.
_SHIFTS = 20

# What faces up by more than this, as the sine of its angle to the vertical, is ground; else a wall.
_FACES_UP = 0.1


def put_down(scene: Scene, q: ArrayLike) -> Array:
    """Return a configuration with the floating base shifted until the lowest contact just touches.

    x <- x - gap n,  with gap and n of the ground that is nearest below, and out of walls

    Parameters
    ----------
    scene : Scene
        With contacts that may let go.
    q : (nq,) array_like
        Only the base moves; the joints, and with them the loops, stay as they are.

    Returns
    -------
    q : (nq,) array
        q as given, if the robot has no floating base or no contact has ground below it: planes and
        boxes that face up. A wall moves the robot only where it is in one, and not where that takes
        it into another.

    Raises
    ------
    InvalidArgument
        If q is no configuration, the contacts of the scene are constraints, which never let go, or
        other constraints tie the base to a place.
    """
    check_scene(scene)
    model = scene.robot.unedited
    placed = normalised(model, "q", q)
    if not scene.contacts and any(each.presses for each in scene.constraints):
        raise InvalidArgument(
            "scene: its contacts are held where they are; one with contacts that may let go is "
            "needed, Scene(robot, contacts=robot.frictional_contacts(friction=0.7))"
        )
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    if not candidates.cones or model.joints[1].shortname() != "JointModelFreeFlyer":
        return placed
    own = _of_the_base(scene)
    down = _shifted(scene, candidates, own, placed, walls=False)[0]
    clear, ends = _shifted(scene, candidates, own, down, walls=True)
    found = clear if ends else down
    _check_ties(scene, placed, found)
    return found


def _shifted(
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
    """Whether each cone is one of the base, or of what hangs on it, with something else."""
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
