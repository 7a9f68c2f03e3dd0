"""Two anchors that ask for two places, and drift control that pulls at both."""

from condyn_pin._core import tolerances
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, extreme, frame_at, powers, torques


@extreme(0.0, *powers(-15, 0))
def contradictory(severity: float, rng: Rng) -> Case:
    """Distance of two anchors of one point, both with drift control [m].

    The rows ask for accelerations that differ by beta^2 times the distance: no answer exists.
    """
    talos, foot = load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), "left_sole_link"
    q, v = Scene(talos, [PointContact(foot)]).state()
    x, y, z = frame_at(talos, q, foot).translation
    here = PointContact(foot, anchor=(x, y, z), name="here")
    there = PointContact(foot, anchor=(x + severity, y, z), name="there")
    scene = Scene(talos, [here, there])
    return Case(scene, q, v, torques(scene, rng), drift=Baumgarte(20.0, 20.0))
