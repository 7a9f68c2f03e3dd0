"""Joints of a model by name, and rotations.

Joints: where q and v hold them, steps between q, which are lengths, and whose axes turn.

v_J = S(q) v
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

Indices = NDArray[np.int_]

# Pinocchio's own way to say that there is no limit; 3.9 cannot unpickle a model that has infinity.
UNLIMITED: Final = float(np.finfo(float).max)

# Names of Pinocchio's joints whose coordinates are all lengths begin so.
_SLIDERS = (
    "JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismatic", "JointModelTranslation",
)  # fmt: skip

# Those whose last coordinate is an angle that q holds as (cos, sin).
_PAIRS = ("JointModelPlanar", "JointModelRUB", "JointModelRevoluteUnbounded")

# Columns of S are unit axes, or lengths of levers: what changes them by less is rounding.
_SAME = 1e-9

# Configurations at which S is looked at: steps from the neutral one that repeat nowhere [rad, m].
_LOOKS = ((0.7, 1.3), (0.4, 2.9), (0.9, 4.1))


def indices(model: Any, joints: Sequence[str]) -> tuple[Indices, Indices]:
    """Indices of some joints in q and in v, in the order given."""
    chosen = [model.joints[model.getJointId(name)] for name in joints]
    index_q = [i for joint in chosen for i in range(joint.idx_q, joint.idx_q + joint.nq)]
    index_v = [i for joint in chosen for i in range(joint.idx_v, joint.idx_v + joint.nv)]
    return np.array(index_q, dtype=np.int_), np.array(index_v, dtype=np.int_)


def lengths(joint: Any) -> tuple[bool, ...]:
    """Flag of each coordinate of a joint with nq = nv: length [m], or else angle [rad]."""
    if joint.shortname() == "JointModelComposite":
        return tuple(length for part in joint.extract().joints for length in lengths(part))
    return (joint.shortname().startswith(_SLIDERS),) * int(joint.nv)


def difference(model: Any, q0: NDArray[np.float64], q1: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the tangent step (nv,) from q0 to q1, also where it is small."""
    # `pin.difference` takes a plane turn for none where rounding leaves its 2 cos above 2: of those
    # below 1e-8 rad some are lost, and of those between numbers off unit length larger ones.
    step = np.array(pin.difference(model, q0, q1))
    for joint in model.joints:
        if joint.shortname().startswith(_PAIRS):
            end = joint.idx_q + joint.nq
            (c0, s0), (c1, s1) = (q[end - 2 : end].tolist() for q in (q0, q1))
            angle = atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1)
            step[joint.idx_v + joint.nv - 1] = angle
    return step


def unbounded(model: Any) -> tuple[int, ...]:
    """Indices in v of the rates of angles that q has as (cos, sin)."""
    chosen = [joint for joint in model.joints if joint.shortname().startswith(_PAIRS)]
    return tuple(joint.idx_v + joint.nv - 1 for joint in chosen)


def joints_with_turning_axes(model: Any) -> tuple[int, ...]:
    """Joints whose axes turn with their own q: S(q) is not constant in the body's axes."""
    # Pinocchio's derivatives, and its Coriolis matrix, take S for one. S is looked at itself, at a
    # few configurations, so that no list of kinds has to be complete. A joint of one coordinate is
    # a screw, whose axis stays.
    still, numbers = pin.neutral(model), np.arange(model.nv)
    steps = (size * np.sin(start + 1.7 * numbers) for size, start in _LOOKS)
    looks = [pin.integrate(model, still, step) for step in steps]

    def turns(joint: Any) -> bool:
        first, *others = (axes(joint, q) for q in looks)
        return any(np.abs(S - first).max() > _SAME * np.abs(first).max() for S in others)

    return tuple(joint.id for joint in list(model.joints)[1:] if joint.nv > 1 and turns(joint))


def axes(joint: Any, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motion subspace S(q) (6, nv) of a joint of a model, in the axes of its body."""
    data = joint.createData()
    joint.calc(data, q)
    return np.array(data.S).reshape(6, joint.nv)


# Rotation matrices: whether nine numbers are one, and the least that turns z to a direction.


def rotation_fault(R: Array) -> str:
    """Fault of a rotation matrix; empty if it is one."""
    if not np.isfinite(R).all():
        return "it is not finite"
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > tolerances.ROTATION:
        return f"its axes are not orthonormal, R R^T - 1 has an entry of {error:.3g}"
    return "it is left-handed, det R = -1" if np.linalg.det(R) < 0 else ""


def frames_along(directions: Array) -> Array:
    """Rotations of `z_along` for unit vectors (k, 3), as (k, 3, 3)."""
    x, y, z = directions.T
    c = 1.0 + z
    up = c > 0.0
    c = np.where(up, c, 1.0)
    xy = -x * y / c
    down = np.where(up, 1.0, -1.0)  # about x where z turns over
    rows = (1.0 - x * x / c, xy, x, xy, down * (1.0 - y * y / c), y, -x, -y, z)
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)


def z_along(direction: Array) -> Array:
    """Smallest rotation (3, 3) that turns z to a direction (3,), of any length."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction)
    return np.array(turn.matrix())
