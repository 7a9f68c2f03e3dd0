"""One body of a machine without its mass."""

from dataclasses import replace

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, with_inertias


@extreme(1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0)
def massless_body(severity: float, rng: Rng, scene: Scene) -> Case:
    """Mass and inertia of one body, any of them, times its own.

    Nothing is wrong with a body without mass where it cannot move without others.
    """
    robot = scene.robot
    inertias = list(robot.model.inertias)
    body = int(rng.integers(1, len(inertias)))
    whole = inertias[body]
    inertias[body] = pin.Inertia(severity * whole.mass, whole.lever, severity * whole.inertia)
    light = Scene(
        replace(robot, model=with_inertias(robot.model, inertias)),
        scene.constraints,
        scene.contacts,
    )
    return Case(light, *moving(light, rng))
