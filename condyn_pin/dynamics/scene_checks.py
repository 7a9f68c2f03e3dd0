"""What a verb refuses in a scene, before it begins: each check says what would do."""

from __future__ import annotations

from condyn_pin._core.arguments import counted
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.model.robot import Robot


def check_scene(scene: object, argument: str = "scene") -> None:
    """Refuse what is no scene."""
    if not isinstance(scene, Scene):
        cure = ""
        if isinstance(scene, Robot):
            of = "Scene(robot, robot.loops)" if scene.loops else "Scene(robot, robot.contacts)"
            cure = f", the robot with the constraints that count: {of}"
        raise InvalidArgument(f"{argument} = {type(scene).__name__}: a Scene is needed{cure}")


def check_bilateral(scene: Scene) -> None:
    """Refuse contacts that may let go where forces are solved for that never do."""
    if scene.contacts:
        count = sum(len(bound.candidates) for bound in scene.contact_bounds)
        raise UnsupportedConstraint(
            f"{counted(count, 'contact')} may open: step, its derivatives and simulate take "
            "them; scene.closed() is the scene that holds them"
        )


def check_time(scene: Scene) -> None:
    """Refuse driven constraints where nothing says at which time they are looked at."""
    if moving := [b.name for b in scene.bounds if b.drive and b.drive.time is None]:
        raise UnsupportedConstraint(
            f"{', '.join(moving)} follow{'s' * (len(moving) == 1)} a path of time: "
            "scene.at(t) is the scene at one; simulate takes it through all"
        )


def time_of(scene: Scene) -> float:
    """Return the time at which a scene is looked at [s]; 0 where nothing is driven."""
    check_time(scene)
    times = {b.drive.time or 0.0 for b in scene.bounds if b.drive} or {0.0}
    if len(times) > 1:
        raise UnsupportedConstraint(
            f"driven rows are at {', '.join(f'{t:g}' for t in sorted(times))} s: one time is "
            "needed, and scene.at(t) gives all of them the same"
        )
    return times.pop()


def check_at_all_times(scene: Scene, why: str) -> None:
    """Refuse driven constraints that stay at one time, where time goes on; `why` says what for."""
    if placed := [b.name for b in scene.bounds if b.drive and b.drive.time is not None]:
        raise InvalidArgument(
            f"scene: {', '.join(placed)} stays at one time, as scene.at(t) has it; {why}: pass the "
            "scene without at(t)"
        )


def check_not_driven(scene: Scene, what: str) -> None:
    """Refuse driven constraints for `what` asks for J v = 0."""
    if moving := [b.name for b in scene.bounds if b.drive]:
        raise UnsupportedConstraint(
            f"{', '.join(moving)}: driven along a path, J v = s'(t), and {what} takes J v = 0; "
            "leave it out, or take its constraint without Driven"
        )
