"""Pressure in the middle of each contact, and little friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.distribution.force_distribution import ForceDistribution
from condyn_pin.dynamics.solution import Sites, upward


@dataclass(frozen=True)
class CentredPressure(ForceDistribution):
    """Forces along the normals, with their centres of pressure in the middle of the contacts.

    It minimises the tangential forces of each contact, and its tipping moments divided by the
    larger half of its size. Points have no moments.

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.

    References
    ----------
    Righetti, Buchli, Mistry, Kalakrishnan, Schaal. Optimal distribution of contact forces with
    inverse-dynamics control. International Journal of Robotics Research, 2013.
    """

    title: ClassVar[str] = "centred pressure"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of tangential forces, and of moments over lengths."""
        scene, up, rows = at.scene, upward(at.scene), []
        forces = at.forces(np.zeros(scene.rows))
        for contact, bound in zip(scene.constraints, scene.bounds, strict=True):
            if contact.support is None:
                continue
            R = forces[bound.name].own.rotation
            normal = R[:, 2] if contact.has_normal else up
            flat = np.eye(3) - np.outer(normal, normal)
            whole = np.array([bound.whole(row) for row in np.eye(bound.size)])
            block = np.zeros((whole.shape[1], motors + scene.rows))
            columns = slice(motors + bound.rows.start, motors + bound.rows.stop)
            block[:3, columns] = flat @ R @ whole[:, :3].T
            size = max(contact.support.half_length or 0.0, contact.support.half_width or 0.0)
            if size:
                block[3:, columns] = flat @ R @ whole[:, 3:].T / size
            rows.append(block)
        return np.vstack([np.zeros((0, motors + scene.rows)), *rows])
