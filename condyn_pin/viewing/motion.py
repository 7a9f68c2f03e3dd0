"""Motion: how the pose of each part goes through the moments, as meshcat's viewer plays it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.force import Sites
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing import three
from condyn_pin.viewing.moment import Moment, moment
from condyn_pin.viewing.part import Part


def tracks(parts: Sequence[Part], moments: Sequence[Moment]) -> dict[str, list[dict[str, Any]]]:
    """Return what changes of each part, by path; what rests has no track."""
    found: dict[str, list[dict[str, Any]]] = {}
    for part in parts:
        T = np.array([part.place(at) for at in moments])
        if not (T[:1] == T).all():
            found[part.path] = _moving(T)
        if part.tint is not None:
            colours = np.array([part.tint(at) for at in moments])
            if not (colours[:1] == colours).all():
                for i in range(len(part.meshes)):
                    path = f"{part.path}/{i}/<object>"
                    found[path] = [three.track("material.color", "color", colours)]
    return found


def _moving(T: Array) -> list[dict[str, Any]]:
    """Return position, rotation and scale of matrices (k, 4, 4)."""
    scale = np.linalg.norm(T[:, :3, :3], axis=1)
    rotations = T[:, :3, :3] / scale[:, None, :]
    quaternions = np.array([pin.Quaternion(R).coeffs() for R in rotations])  # x y z w
    for one, following in pairwise(quaternions):
        if one @ following < 0.0:  # the other sign is the same rotation, and nearer
            following *= -1.0
    moving = [
        three.track("position", "vector3", T[:, :3, 3]),
        three.track("quaternion", "quaternion", quaternions),
    ]
    if not np.allclose(scale, scale[0], rtol=1e-6):
        moving.append(three.track("scale", "vector3", scale))
    return moving


def moments_of(trajectory: Trajectory, fps: float, *, forces: bool) -> list[Moment]:
    """Return moments of a trajectory, `fps` of them for each second of the motion.

    Between two samples q is interpolated along the group; constraints and forces are those of the
    sample before.
    """
    t = trajectory.t
    model = trajectory.scene.robot.model
    times = t[0] + np.arange(round((t[-1] - t[0]) * fps) + 1) / fps
    found = []
    for time in np.minimum(times, t[-1]):
        k = min(int(np.searchsorted(t, time, side="right")) - 1, len(t) - 2) if len(t) > 1 else 0
        q = trajectory.q[k]
        if len(t) > 1 and t[k + 1] > t[k]:
            q = pin.interpolate(model, q, trajectory.q[k + 1], (time - t[k]) / (t[k + 1] - t[k]))
        phase = next(p for p in trajectory.phases if p.samples.start <= k < p.samples.stop)
        lam = trajectory.lam[k, list(phase.columns)]
        acting = Sites(phase.scene, q).forces(lam) if forces else {}
        found.append(moment(phase.scene, q, acting))
    return found
