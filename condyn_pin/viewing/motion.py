"""Motion: keyframe tracks of the poses and colours of parts, for meshcat's viewer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.solution import Sites
from condyn_pin.simulation.trajectory import Trajectory, balances
from condyn_pin.viewing import part as three
from condyn_pin.viewing.instant import Instant, PlottedForce, instant
from condyn_pin.viewing.marks import LargestForce
from condyn_pin.viewing.part import Part


def tracks(
    parts: Sequence[Part], instants: Sequence[Instant], frames: Array
) -> dict[str, list[dict[str, Any]]]:
    """Keyframe tracks of moving or recoloured parts, by path; `frames` (k,) in pictures."""
    found: dict[str, list[dict[str, Any]]] = {}
    for part in parts:
        T = np.array([part.place(at) for at in instants])
        if not (T[:1] == T).all():
            found[part.path] = _moving(T, frames)
        if part.tint is not None:
            colours = np.array([part.tint(at) for at in instants])
            if not (colours[:1] == colours).all():
                for i in range(len(part.meshes)):
                    path = f"{part.path}/{i}/<object>"
                    found[path] = [three.track("material.color", "color", colours, frames)]
    return found


def _moving(T: Array, frames: Array) -> list[dict[str, Any]]:
    """Tracks of position, rotation and, if it varies, scale of matrices (k, 4, 4)."""
    scale = np.linalg.norm(T[:, :3, :3], axis=1)
    rotations = T[:, :3, :3] / scale[:, None, :]
    quaternions = np.array([pin.Quaternion(R).coeffs() for R in rotations])  # x y z w
    for before, following in pairwise(quaternions):
        if before @ following < 0.0:  # the other sign is the same rotation, and nearer
            following *= -1.0
    moving = [
        three.track("position", "vector3", T[:, :3, 3], frames),
        three.track("quaternion", "quaternion", quaternions, frames),
    ]
    if not np.allclose(scale, scale[0], rtol=1e-6):
        moving.append(three.track("scale", "vector3", scale, frames))
    return moving


def drawn_samples(trajectory: Trajectory, fps: float) -> NDArray[np.intp]:
    """Return the indices of the samples to draw, the nearest to each of `fps` times a second."""
    # Samples are not interpolated: a configuration halfway between two closed ones is open. Each is
    # drawn at its own time, the last one among them.
    t = trajectory.t
    times = np.minimum(t[0] + np.arange(round((t[-1] - t[0]) * fps) + 1) / fps, t[-1])
    after = np.searchsorted(t, times, side="right").clip(max=len(t) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(times - t[before] <= t[after] - times, before, after)
    return np.unique(np.append(nearest, len(t) - 1))


def instants_of(
    trajectory: Trajectory, samples: Sequence[int], *, forces: bool, balance: bool = False
) -> list[Instant]:
    """Return the instants of samples, each with its constraints, their forces, and its balance."""
    balanced = dict(zip(samples, balances(trajectory, samples), strict=True)) if balance else {}
    found, felt, modes = [], trajectory.forces if forces else {}, trajectory.modes
    for k in samples:
        phase = next(p for p in trajectory.phases if p.samples.start <= k < p.samples.stop)
        q = trajectory.q[k]
        lam = trajectory.lam[k, list(phase.columns)]
        acting = Sites(phase.scene, q).forces(lam) if forces else {}
        contact = PlottedForce(
            {name: force[k] for name, force in felt.items()},
            {name: str(mode[k]) for name, mode in modes.items()},
        )
        found.append(instant(phase.scene.at(trajectory.t[k]), q, acting, contact, balanced.get(k)))
    return found


def gaps_of(trajectory: Trajectory) -> Iterator[dict[str, ConstraintViolation]]:
    """Yield the gaps of all constraints at each sample, drawn or not."""
    for phase in trajectory.phases:
        equations = Equations(phase.scene.robot.model, phase.scene.bounds)
        samples = zip(trajectory.t[phase.samples], trajectory.q[phase.samples], strict=True)
        for t, q in samples:
            equations.at(t)
            yield gaps(phase.scene, equations.violation(q))


def peaks_of(trajectory: Trajectory) -> dict[str, LargestForce]:
    """Return the largest forces and moments of all samples by name, drawn or not."""
    return {
        name: LargestForce(
            *(float(np.linalg.norm(part, axis=1).max()) for part in (f[:, :3], f[:, 3:]))
        )
        for name, f in trajectory.forces.items()
    }


# Where the camera is at first: all parts are in the picture, seen along the normal of a linkage.


FROM = np.array([0.78, 0.55, 0.3])  # the direction from the middle to the camera
_FLAT = 0.9  # of the normal's z: above this a plane is seen as a floor is
_TILT = 0.2  # of a linkage in a plane: how far above its normal, and beside it, the camera is
FIELD = 35.0  # [deg] of the camera, from bottom to top
ASPECT = 4.0 / 3.0  # of a window; in a narrower one the page moves the camera back
_FILLED = 0.82  # of the picture: the rest is for labels
_AROUND = ("floor", "sheet", "grounds", "inertia")  # parts that may reach out of the picture
_LOOKS = 12  # instants of a motion that are looked at


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose of the camera.

    at, target (3,): its position, and the point that it looks at [m]
    """

    at: Array  # [m]
    target: Array  # [m]

    @property
    def axes(self) -> Array:
        """Axes right, up and backward in the world, the rows of (3, 3)."""
        back = (self.at - self.target) / np.linalg.norm(self.at - self.target)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])


def framed(parts: Sequence[Part], instants: Sequence[Instant], toward: Array) -> Camera:
    """Return the nearest camera in a direction (3,) that has all parts in the picture.

    In the axes right x, up y and backward z of a camera at the distance d from its target, a point
    is seen if |x| <= (d - z) tan_x and |y| <= (d - z) tan_y.
    """
    points = _corners(parts, instants)
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    axes = Camera(target + toward, target).axes
    tan = _FILLED * np.tan(np.deg2rad(0.5 * FIELD)) * np.array([ASPECT, 1.0])
    for _ in range(5):  # each moves the middle of the picture to that of the points
        x = (points - target) @ axes.T
        distance = float((x[:, 2] + (np.abs(x[:, :2]) / tan).max(axis=1)).max())
        seen = x[:, :2] / (distance - x[:, 2:])
        target = target + 0.5 * distance * (seen.min(axis=0) + seen.max(axis=0)) @ axes[:2]
    return Camera(target + max(distance, _NEAREST) * axes[2], target)


_NEAREST = 0.05  # [m] from the camera to a scene that is a point


def _corners(parts: Sequence[Part], instants: Sequence[Instant]) -> Array:
    """Corners (k, 3) of the boxes around all parts, at some instants [m]."""
    found = [at.com for at in instants]
    for part in parts:
        if part.path.split("/")[0] in _AROUND or not part.meshes:
            continue
        vertices = np.concatenate([mesh.vertices for mesh, _ in part.meshes])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        box = np.array([np.where(bits, low, high) for bits in np.ndindex(2, 2, 2)])
        for at in instants[:: max(1, len(instants) // _LOOKS)]:
            if (T := part.pose(at)) is not None:
                found += list(box @ T[:3, :3].T + T[:3, 3])
    return np.array(found)


def toward_of(normal: Array | None) -> Array:
    """Return the direction to the camera (3,): nearly along the normal of a linkage's plane."""
    if normal is None:
        return FROM
    if abs(normal[2]) > _FLAT:  # from above, y going up
        toward = np.sign(normal[2]) * normal - [0.0, _TILT, 0.0]
    else:
        right = np.cross([0.0, 0.0, 1.0], normal)
        sign = 1.0 if right.sum() >= 0.0 else -1.0  # x, or y, goes to the right
        toward = sign * (normal + _TILT * right) + [0.0, 0.0, _TILT]
    found: Array = toward / np.linalg.norm(toward)
    return found
