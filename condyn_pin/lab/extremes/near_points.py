"""Two points of one foot that are held, nearer and nearer to each other."""

from condyn_pin._core import tolerances
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, powers


@extreme(*powers(-1, -16, -1), 0.0)
def near_points(severity: float, rng: Rng) -> Case:
    """Distance of two points of a foot that are both held [m].

    Together they leave the foot one turn less than a single point, however near they are. Below
    1e-11 no arithmetic in double precision can tell them from one.
    """
    foot = "left_sole_link"
    here = PointContact(foot, name="here")
    there = PointContact(foot, (severity, 0.0, 0.0), name="there")
    scene = Scene(load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), [here, there])
    return Case(scene, *moving(scene, rng))
