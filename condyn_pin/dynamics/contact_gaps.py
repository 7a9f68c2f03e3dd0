"""How far the contacts of a scene are from touching."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms, data_of
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.scene_checks import check_scene


def contact_gaps(scene: Scene, q: ArrayLike) -> dict[str, float]:
    """Return the signed distances of contacts and stops at q, by the names of candidates [m, rad].

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.

    Returns
    -------
    dict of str to float
        Negative where a body is in another, or a joint beyond its stop.

    Raises
    ------
    InvalidArgument
        If q has a wrong size, is not finite, or has an unnormalised quaternion.
    """
    check_scene(scene)
    q_ = scene.robot.arguments.configuration("q", q)
    candidates, gaps = gaps_at(scene, q_)
    return dict(zip(candidates.names, gaps.tolist(), strict=False))  # intervals have none


def penetration(scene: Scene, q: ArrayLike) -> dict[str, ConstraintViolation]:
    """Return the contacts and stops that are passed at q, and how far."""
    if not scene.contacts:
        return {}
    candidates, gaps = gaps_at(scene, scene.robot.arguments.configuration("q", q))
    return {
        candidates.names[i]: gap_of_kind(-gaps[i], is_length=candidates.is_length[i])
        for i in np.flatnonzero(gaps < -tolerances.CLOSED)
    }


def gap_of_kind(gap: float, *, is_length: bool) -> ConstraintViolation:
    """Return the size of a gap as a length or as an angle."""
    size = abs(float(gap))
    return ConstraintViolation(size, 0.0) if is_length else ConstraintViolation(0.0, size)


def gap_text(gap: float, *, is_length: bool) -> str:
    """Return what a gap is, in mm or degrees: open by, closed, or penetrates by."""
    if abs(gap) <= tolerances.CLOSED:
        return "closed"
    size = gap_of_kind(gap, is_length=is_length)
    return f"open by {size}" if gap > 0.0 else f"penetrates by {size}"


def gaps_at(scene: Scene, q: Array) -> tuple[Candidates, Array]:
    """Return the candidates of a scene and their gaps at a configuration that was checked."""
    scene.robot.check_unedited()
    model = scene.robot.model
    candidates, data = Candidates(model, scene.contact_bounds, exact=True), data_of(model)
    algorithms(data).forwardKinematics(model, data, q)
    return candidates, np.array(candidates.gaps(data, q))
