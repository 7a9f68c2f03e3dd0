"""Scenes of a study: their labels, and other ways to model the same machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.scene import Scene, standard_scenes
from condyn_pin.errors import InvalidArgument
from condyn_pin.io.load import load_robot
from condyn_pin.model.robot import Robot

Scenes = Scene | str | Mapping[str, Scene] | Iterable[Scene | str]


def labelled(
    scenes: Scenes, scenes_of: Callable[[Robot], Mapping[str, Scene]] = standard_scenes
) -> dict[str, Scene]:
    """Return scenes by label; the name of a robot stands for those that `scenes_of` makes."""
    if isinstance(scenes, Mapping):
        pairs = list(scenes.items())
    else:
        if not isinstance(scenes, Scene | Iterable):
            raise InvalidArgument(
                f"scenes = {scenes!r}: a Scene, or the name of a robot, is needed"
            )
        several = [scenes] if isinstance(scenes, Scene | str) else list(scenes)
        pairs = [pair for one in several for pair in _pairs(one, scenes_of)]
    found = dict(pairs)
    if not pairs or not all(isinstance(scene, Scene) for scene in found.values()):
        raise InvalidArgument(
            f"scenes = {scenes!r}: scenes, or names of robots, and at least one are needed"
        )
    if len(found) < len(pairs):
        twice = Counter(label for label, _ in pairs).most_common(1)[0][0]
        raise InvalidArgument(
            f"scenes: two of them are called {twice!r}; a dict {{label: scene}} gives them names"
        )
    return found


def modellings(scene: Scene) -> dict[str, Scene]:
    """Return a scene as it is, and the same machine with other constraints that hold the same.

    A surface is its four corners, 12 rows for 6; an edge its two ends, 6 rows for 5; a hinge two
    points of its axis, 6 rows for 5; and a weld three points, 9 rows for 6. All are exact, the
    points at the price of redundant rows.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of str to Scene
        "as it is", and one for each of the four that the scene has.
    """
    made = {"as it is": scene}
    for label in sorted({constraint.by_points_called for constraint in scene.constraints} - {""}):
        robot, constraints = scene.robot, list[Constraint]()
        for constraint in scene.constraints:
            robot, points = (
                constraint.by_points(robot)
                if constraint.by_points_called == label
                else (robot, (constraint,))
            )
            constraints += points
        if tuple(constraints) != scene.constraints:
            made[label] = Scene(robot, constraints, scene.contacts)
    return made


def _pairs(
    one: Scene | str, scenes_of: Callable[[Robot], Mapping[str, Scene]]
) -> list[tuple[str, Scene]]:
    if isinstance(one, str):
        return list(scenes_of(load_robot(one)).items())
    if not isinstance(one, Scene):
        raise InvalidArgument(f"scenes: {one!r} is neither a scene nor the name of a robot")
    return [(f"{one.robot.name}, {one.rows} rows", one)]
