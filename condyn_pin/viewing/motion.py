"""Motion: keyframe tracks of the poses and colours of parts, for meshcat's viewer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
from condyn_pin.viewing.marks import Camera, LargestForce
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


# Where the camera is at first: from the middle of what is seen, along the normal of a linkage.


_FAR = 1.15  # of the size of a scene, from its middle to the camera
FROM = np.array([0.78, 0.55, 0.3])  # the direction from there to the camera
_FLAT = 0.9  # of the normal's z: above this a plane is seen as a floor is
_TILT = 0.2  # of a linkage in a plane: how far above its normal, and beside it, the camera is


def eye_at(middle: Array, size: float, toward: Array) -> Camera:
    """Return the camera that sees a scene of this size [m] from a direction."""
    return Camera(middle + _FAR * size * toward, middle)


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
