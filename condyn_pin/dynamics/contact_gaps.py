"""How far the contacts of a scene are from touching."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene, check_scene


def contact_gaps(scene: Scene, q: ArrayLike) -> dict[str, float]:
    """Return the signed distances of contacts and stops at q, by the names of candidates [m, rad].

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like

    Returns
    -------
    dict of str to float
        Negative where a body is in another, or a joint beyond its stop.
    """
    check_scene(scene)
    q_ = normalised(scene.robot.model, "q", q)
    candidates, gaps = gaps_at(scene, q_)
    return dict(zip(candidates.names, gaps.tolist(), strict=False))  # intervals have none


def gaps_at(scene: Scene, q: Array) -> tuple[Candidates, Array]:
    """Return the candidates of a scene and their gaps at a configuration that was checked."""
    scene.robot.check_unedited()
    model = scene.robot.model
    candidates, data = Candidates(model, scene.contact_bounds), model.createData()
    pin.forwardKinematics(model, data, q)
    return candidates, np.array(candidates.gaps(data, q))
