"""A foot that stands on two edges, which are nearly the same one."""

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, by_reference, extreme, moving, near, powers


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_edges(severity: float, rng: Rng) -> Case:
    """Angle between two edges through one point that Cassie's left foot stands on [rad].

    On two edges a foot stands as on a surface, however near they are; on one it can roll.
    """
    feet, edge = {"feet": "lines"}, "left-foot/edge"
    cassie = load_robot("cassie", variant=feet, precision=tolerances.ROUNDED_GEOMETRY)
    cassie = cassie.with_frame("turned", edge, np.zeros(3), pin.rpy.rpyToMatrix(0, 0, severity))
    others = [*cassie.loops, *(foot for foot in cassie.contacts if foot.name != edge)]
    flat = Scene(cassie, [*others, SurfaceContact(edge)])
    state = moving(flat, rng)
    held = by_reference(flat, *state)
    free = by_reference(Scene(cassie, [*others, LineContact(edge)]), *state)
    scene = Scene(cassie, [*others, LineContact(edge), LineContact("turned")])
    return Case(scene, *state, near(severity, held, free))
