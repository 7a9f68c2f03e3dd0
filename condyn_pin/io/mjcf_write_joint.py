"""Joints, inertias and numbers as MJCF writes them; `mjcf_write` has the conventions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf import DRAWN
from condyn_pin.model.robot import Robot
from condyn_pin.model.spring import Spring

_FAR = 1e10  # [rad or m] the side of a limit that does not exist: MuJoCo needs both
_FLAT = 1e-12  # rounding of A + B = C in the principal moments of a flat body, relative to C
_LEAST = 2e-15  # [kg, kg m^2] MuJoCo refuses a body that moves with less than 1e-15


def chains_of(model: Any) -> Sequence[Sequence[int]]:
    """Return the joints by the body they move: one that carries nothing goes with its child."""
    children: Mapping[int, list[int]] = defaultdict(list)
    for i in range(1, model.njoints):
        children[model.parents[i]].append(i)
    marked = {frame.parentJoint for frame in model.frames if frame.type != pin.FrameType.JOINT}
    chains: list[list[int]] = []
    for i in range(1, model.njoints):
        parent = model.parents[i]
        empty = parent and parent not in marked and not np.any(model.inertias[parent].matrix())
        if empty and len(children[parent]) == 1:
            chains[-1].append(i)  # depth-first: the parent was the joint before
        else:
            chains.append([i])
    return chains


def write_inertia(model: Any, i: int) -> dict[str, str]:
    """Return principal moments and axes: left to itself, MuJoCo finds them to 1e-7 only.

    What has no mass, or no extent, gets as little as MuJoCo allows.
    """
    inertia = model.inertias[i]
    moments, axes = np.linalg.eigh(inertia.inertia)
    if inertia.mass < 0 or moments[0] < -tolerances.MOMENT * moments[2]:
        raise InvalidModel(
            f"joint {model.names[i]!r} carries {inertia.mass:g} kg with the principal moments "
            f"{', '.join(f'{m:g}' for m in moments)} kg m^2; none may be negative"
        )
    moments = np.maximum(moments, _LEAST)
    A, B, C = moments  # in ascending order
    if A + B < C * (1 - _FLAT):
        raise InvalidModel(
            f"joint {model.names[i]!r} carries a body with the principal moments {A:g}, {B:g} and "
            f"{C:g} kg m^2; MuJoCo needs that two of them add up to the third or more"
        )
    moments[2] = min(C, A + B)  # MuJoCo compares without a tolerance
    right_handed = axes * np.sign(np.linalg.det(axes))
    placed = pin.SE3(right_handed, inertia.lever)
    return {
        "mass": numbers(max(inertia.mass, _LEAST)),
        "diaginertia": numbers(moments),
    } | write_pose(placed)


def write_joint(robot: Robot, i: int, B: Any, drawn: Array) -> dict[str, str]:
    """Return the attributes of joint i; B is the pose of its body in it, at the q that is drawn."""
    model = robot.model
    name, joint = model.names[i], model.joints[i]
    kind, here = joint.shortname(), B.isIdentity(0.0)
    if joint.nv == 1:
        said = _scalar(model, i, B, drawn)
    elif kind == "JointModelSpherical" and here:
        said = {"type": "ball"}
    elif kind == "JointModelFreeFlyer" and here and model.parents[i] == 0:
        said = {"type": "free"}
    else:
        raise InvalidModel(
            f"joint {name!r} is a {kind}, which MuJoCo does not have there; "
            "a hinge, a slider, a ball, or a free-flyer on the world is needed"
        )
    for key in ("armature", "damping"):
        values = np.array(getattr(model, key)[joint.idx_v : joint.idx_v + joint.nv])
        # on a free joint MuJoCo's armature is along the axes of the world: another bias
        if np.ptp(values) > 0 or (key == "armature" and joint.nv == 6 and values.any()):
            raise InvalidModel(
                f"joint {name!r}: {key} {values.tolist()}; MuJoCo has one number for a joint, and "
                "no armature for a free one"
            )
        if values[0]:
            said[key] = numbers(values[0])
    return {"name": str(name)} | said | _spring([s for s in robot.springs if s.joint == name])


def scalar_axis(model: Any, i: int) -> tuple[str, Array]:
    """Return "slide" or "hinge", and the axis in the joint, from S = (slide axis, hinge axis).

    The kind is empty if a joint of one coordinate is neither, such as a screw.
    """
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    slide, hinge = np.array(data.S).reshape(2, 3)
    if slide.any() and hinge.any():
        return "", hinge
    return ("slide", slide) if slide.any() else ("hinge", hinge)


def reference(model: Any, i: int, q: Array) -> float:
    """Return the coordinate of joint i of one coordinate, as MuJoCo counts it [rad or m]."""
    joint = model.joints[i]
    x = q[joint.idx_q : joint.idx_q + joint.nq]
    return float(np.arctan2(x[1], x[0]) if joint.nq == 2 else x[0])


def _scalar(model: Any, i: int, B: Any, drawn: Array) -> dict[str, str]:
    """Return the attributes of a joint of one coordinate."""
    joint = model.joints[i]
    kind, axis = scalar_axis(model, i)
    if not kind:
        raise InvalidModel(f"joint {model.names[i]!r}: MuJoCo has no {joint.shortname()}")
    said = {"type": kind, "axis": numbers(B.rotation.T @ axis)}
    if not B.isIdentity(0.0):
        said["pos"] = numbers(B.inverse().translation)
    if ref := reference(model, i, drawn):
        said["ref"] = numbers(ref)
    limits = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
    # MuJoCo refuses a range without width
    if joint.nq == 1 and limits[0] < limits[1] and (limits[0] > -_FAR or limits[1] < _FAR):
        said["range"] = numbers(np.clip(limits, -_FAR, _FAR))
    return said


def _spring(springs: Sequence[Spring]) -> dict[str, str]:
    """Return several springs on a joint as one: k = sum k_i, k q0 = sum k_i q0_i."""
    stiffness = sum(spring.stiffness for spring in springs)
    if not stiffness:
        return {}
    rest = sum(spring.stiffness * spring.reference for spring in springs) / stiffness
    return {"stiffness": numbers(stiffness), "springref": numbers(rest)}


def write_configuration(model: Any, q: Array) -> str:
    """Return q as MuJoCo counts it."""
    positions: list[ArrayLike] = []
    for i in range(1, model.njoints):
        joint = model.joints[i]
        x = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nq == 7:
            pose = model.jointPlacements[i] * pin.XYZQUATToSE3(x)
            positions += [pose.translation, _wxyz(pose.rotation)]
        elif joint.nq == 4:
            positions.append(np.roll(x, 1))
        else:
            positions.append([reference(model, i, q)])
    return numbers(np.concatenate(positions))


def write_pose(placement: Any) -> dict[str, str]:
    """Return the attributes of a pose."""
    said = {"pos": numbers(placement.translation)}
    if not np.array_equal(placement.rotation, np.eye(3)):
        said["quat"] = numbers(_wxyz(placement.rotation))
    return said


def numbers(values: ArrayLike) -> str:
    """Return numbers with as few digits as give them back to the last bit."""
    return " ".join(repr(float(x)).removesuffix(".0") for x in np.atleast_1d(values))


def _wxyz(rotation: Array) -> Array:
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)


def drawn(robot: Robot) -> Array:
    """Return the configuration (nq,) in which an MJCF of the robot draws it.

    That of its posture ``qpos0``, which comes with every MJCF, else neutral. A ball has no `ref`:
    in MuJoCo it is drawn at 1 0 0 0.
    """
    neutral = np.array(pin.neutral(robot.model))
    q = np.array(robot.postures.get(DRAWN, neutral))
    for joint in robot.model.joints[1:]:
        if joint.nq == 4 and joint.nv == 3:
            turned = slice(joint.idx_q, joint.idx_q + 4)
            q[turned] = neutral[turned]
    return q
