"""anchored: a scene whose contacts say where in the world they belong."""

from __future__ import annotations

from collections.abc import MutableMapping
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_scene


def anchored(scene: Scene, q: ArrayLike) -> Scene:
    """Return the scene with its contacts anchored: those without an anchor where they are at q.

    c(q) = 0,    and wherever else a contact is, c is its gap

    A contact without an anchor holds its frame wherever that is: a foot that has slid or come off
    has no gap, and `Baumgarte` does not draw it back. With an anchor it is drawn back to where it
    stood.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.

    Returns
    -------
    Scene
        The same where every contact has an anchor.

    Raises
    ------
    InvalidArgument
        If q is no configuration.
    """
    check_scene(scene)
    return with_anchors(scene, normalised(scene.robot.unedited, "q", q), {})


def with_anchors(scene: Scene, q: Array, places: MutableMapping[Constraint, Constraint]) -> Scene:
    """Return the scene anchored at q; contacts that `places` has get theirs, new ones are added."""
    if all(bound.anchored for bound in scene.bounds):
        return scene
    frames: list[Any] = equations_of(scene).placements(q)
    pairs = zip(scene.constraints, scene.bounds, frames, strict=True)
    for constraint, bound, frame in pairs:
        if constraint not in places:
            places[constraint] = constraint if bound.anchored else constraint.anchored_at(*frame)
    placed = replace(scene, constraints=tuple(places[c] for c in scene.constraints))
    # J, and all that was measured with it, is the same where the contacts touch
    vars(placed)["nominal"] = scene.nominal
    return placed
