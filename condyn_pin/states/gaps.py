"""Gaps: how far each loop is open, in metres and radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array
from condyn_pin.rows.bound import Bound, Coupled

if TYPE_CHECKING:
    from condyn_pin.scene import Scene


class Gap(NamedTuple):
    """How far apart the two sides of a constraint are."""

    length: float  # [m], or [m/s] of a velocity
    angle: float  # [rad], or [rad/s]

    @property
    def size(self) -> float:
        """The larger of the two numbers."""
        return max(self.length, self.angle)

    def text(self, per: str = "") -> str:
        """Return it in mm and degrees, with what follows the units, such as "/s"."""
        parts = []
        if self.length or not self.angle:
            parts.append(f"{1e3 * self.length:.3g} mm{per}")
        if self.angle:
            parts.append(f"{math.degrees(self.angle):.3g} deg{per}")
        return " and ".join(parts)

    def __str__(self) -> str:
        return self.text()


def closed(gap: Mapping[str, Gap]) -> bool:
    """Whether every gap is within tolerance (1e-10)."""
    return all(each.size <= tolerances.CLOSED for each in gap.values())


def worst(gap: Mapping[str, Gap]) -> tuple[str, Gap]:
    """Return the name and the gap of what is open furthest."""
    return max(gap.items(), key=lambda item: item[1].size)


def gaps(scene: Scene, c: Array) -> dict[str, Gap]:
    """Return how far each constraint that has a position is open, from c (m,)."""
    return {b.name: _gap(scene, b, c[b.rows]) for b in scene.bounds if b.anchored}


def slips(scene: Scene, velocity: Array) -> dict[str, Gap]:
    """Return how fast the sides of each constraint move apart, from J v (m,)."""
    return {b.name: _gap(scene, b, velocity[b.rows]) for b in scene.bounds}


def _gap(scene: Scene, bound: Bound | Coupled, rows: Array) -> Gap:
    """Return the norms of the linear and of the angular rows of one constraint."""
    if isinstance(bound, Coupled):
        angular = np.array([not _slides(scene.robot.model, bound.velocity[0])])
    else:
        angular = np.array([row > 2 for row in bound.selection] or [False])
    return Gap(float(np.linalg.norm(rows[~angular])), float(np.linalg.norm(rows[angular])))


def _slides(model: Any, iv: int) -> bool:
    """Whether the joint at a velocity index is a slider."""
    kinds = [joint.shortname() for joint in model.joints if joint.idx_v == iv and joint.nv == 1]
    return str(kinds[0]).startswith(
        ("JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPr")
    )
