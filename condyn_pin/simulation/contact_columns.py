"""Rows of lam that belong to constraints and contacts, by name, and the gaps of contacts."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms, data_of
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene


def row_names(scene: Scene) -> tuple[str, ...]:
    """Return the names of the rows of lam: those of constraints, then those of contacts."""
    return scene.row_names + candidates_of(scene).row_names


def candidates_of(scene: Scene) -> Candidates:
    """Return the contacts of a scene, in memory of their own."""
    return Candidates(scene.robot.unedited, scene.contact_bounds)


def contact_rows(candidates: Candidates) -> dict[str, slice]:
    """Return the rows of each candidate: three of a cone, one of the others."""
    sizes = [3 if i < candidates.cones else 1 for i in range(len(candidates.names))]
    ends = accumulate(sizes)
    pairs = zip(candidates.names, ends, sizes, strict=True)
    return {name: slice(end - size, end) for name, end, size in pairs}


def gaps_along(scene: Scene, Q: Array) -> tuple[tuple[str, ...], Array]:
    """Return the names of what has a gap, and the gaps at Q (k, nq) [m, rad]."""
    model = scene.robot.unedited
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    data = data_of(model)
    count = candidates.cones + candidates.half_lines
    gaps = np.empty((len(Q), count))
    for row, q in zip(gaps, Q, strict=True):
        algorithms(data).forwardKinematics(model, data, q)
        row[:] = candidates.gaps(data, q)
    return candidates.names[:count], gaps


def forces_of(scene: Scene, lam: Array) -> dict[str, Array]:
    """Return lam (m,) by name: on the first-named body of a constraint, on the robot of a contact.

    In the axes of each; a contact has (t1, t2, n).
    """
    forces = {
        bound.name: lam[bound.rows] if bound.is_scalar else np.asarray(bound.whole(lam[bound.rows]))
        for bound in scene.bounds
    }
    contacts = lam[scene.rows :]
    return forces | {
        name: contacts[rows] for name, rows in contact_rows(candidates_of(scene)).items()
    }
