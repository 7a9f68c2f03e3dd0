"""Which wrenches contacts can give: the contact wrench cone.

    { G lam :  A lam <= 0 },        G the grasp map, A the cones

with wrenches about the origin of the world, in its axes, force first.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.contact.cones import Cones
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import InvalidArgument


def grasp(at: Sites, cones: ContactCones) -> Array:
    """Return G (6, m_c) of contacts with cones: G lam is their wrench about the world's origin."""
    scene, forces = at.scene, at.forces(np.zeros(at.scene.rows))
    columns = []
    for bound in scene.bounds:
        if bound.rows.start not in cones.touching:
            continue
        force = forces[bound.name]
        whole = np.array([bound.whole(row) for row in np.eye(bound.size)])
        f = force.rotation @ whole[:, :3].T
        moment = force.rotation @ whole[:, 3:].T if whole.shape[1] == 6 else 0.0
        columns.append(np.vstack((f, np.cross(force.at, f, axisb=0, axisc=0) + moment)))
    if not columns:
        raise InvalidArgument("cones: empty; contacts without one exert nothing that is known")
    return np.hstack(columns)


def placements(at: Sites) -> Any:
    """Return the placements of the joints in the world."""
    model = at.scene.robot.unedited
    data = whole_data(model)
    pin.forwardKinematics(model, data, at.q)
    return data.oMi


def wrench_margin(at: Sites, cones: Cones, f: Array, n: Array) -> float:
    """Return max t with A lam + t <= 0 over all lam of this wrench [N]."""
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    bound = ContactCones(at.scene, cones)
    A, G = bound.rows(placements(at)), grasp(at, bound)
    size = max(float(np.linalg.norm(f)), np.finfo(float).tiny)  # forces over this
    found = linprog(
        np.concatenate((np.zeros(G.shape[1]), [-1.0])),
        np.hstack((A, np.ones((len(A), 1)))),
        np.zeros(len(A)),
        np.hstack((G, np.zeros((6, 1)))),
        np.concatenate((f, n)) / size,
        bounds=(None, None),
        method="highs",
    )
    return size * float(found.x[-1]) if found.status == 0 else -np.inf
