"""Two anchors that ask for two places, and drift control that pulls at both."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, extreme, powers, torques


@extreme(severities=(0.0, *powers(-15, 0)))
def contradictory(severity: float, rng: np.random.Generator) -> Case:
    """Distance of two anchors of one point, both with drift control [m].

    The rows ask for accelerations that differ by beta^2 times the distance: no answer exists.
    """
    talos = load_robot("talos")
    foot = "left_sole_link"
    q, v = Scene(talos, [PointContact(foot)]).state()
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, q)
    here = np.array(data.oMf[talos.model.getFrameId(foot)].translation)
    there = here + np.array([severity, 0.0, 0.0])
    scene = Scene(
        talos,
        [
            PointContact(foot, anchor=tuple(here), name="here"),
            PointContact(foot, anchor=tuple(there), name="there"),
        ],
    )
    return Case(scene, q, v, torques(scene, rng), drift=Baumgarte(20.0, 20.0))
