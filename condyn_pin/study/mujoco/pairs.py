"""Joints of a robot and of a MuJoCo model, matched by name.

A coordinate means the same in both if the joint has the same type, hangs on the same joint, and
turns about, or slides along, the same axis. Whatever breaks that is refused by name: a state would
be taken over into another motion without a word.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import HIGH, LOW, checked, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.mjcf import KINDS
from condyn_pin.io.mjcf_file import joint_names
from condyn_pin.io.mjcf_write import scalar_axis
from condyn_pin.model.robot import Robot

_BALLS: Final = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}


@dataclass(frozen=True)
class Pair:
    """One joint in both engines."""

    name: str  # here
    here: int  # its index in Pinocchio's model
    there: int  # and in MuJoCo's
    kind: str  # free, ball, slide or hinge
    q: slice  # where it is in q
    v: slice  # and in v, a and tau
    qpos: slice  # where it is in MuJoCo's qpos
    dof: slice  # and in qvel, qacc and qfrc


def pairs_of(
    robot: Robot, mj: Any, names: Mapping[str, str], without: Sequence[str]
) -> tuple[Pair, ...]:
    """Return the joints of a robot with those of MuJoCo, in the robot's order.

    Refused is what is missing on either side, has another type or another parent.
    """
    known = joint_names(mj)
    there = _names_there(robot, known, names)
    left_out = checked("without", without, known, "joint of the MuJoCo model")
    spare = [n for n in known if n not in there.values() and n not in left_out]
    for name, other in there.items():
        if other not in known or other in left_out:
            raise InvalidModel(
                f"joint {name!r} of {robot.name} is not in the MuJoCo model, which has "
                f"{listed(spare) or 'no other joint'}; if it has another name there, say "
                f"names={{{name!r}: ...}}"
            )
    if spare:
        raise InvalidModel(
            f"the MuJoCo model has joints that {robot.name} lacks: {listed(spare)}; name them in "
            "without=[...], and they stay where they are"
        )
    paired = tuple(
        _pair(robot, mj, i, known.index(there[name])) for i, name in enumerate(robot.joints, 1)
    )
    _check_parents(robot, mj, paired, known)
    return paired


def _names_there(robot: Robot, known: list[str], names: Mapping[str, str]) -> dict[str, str]:
    """Return MuJoCo's names of the robot's joints."""
    if not isinstance(names, Mapping):
        raise InvalidArgument(f"names = {names!r}: a mapping of our names to MuJoCo's is needed")
    for name, other in names.items():
        if name not in robot.joints:
            raise unknown_name("joint", str(name), robot.joints)
        if other not in known:
            raise unknown_name("joint of the MuJoCo model", str(other), known)
    there = {name: names.get(name, name) for name in robot.joints}
    for name, other in there.items():
        if list(there.values()).count(other) > 1:
            raise InvalidArgument(f"names: {name!r} and another joint are both {other!r} in MuJoCo")
    return there


def _pair(robot: Robot, mj: Any, i: int, j: int) -> Pair:
    joint, kind = robot.model.joints[i], KINDS[int(mj.jnt_type[j])]
    short = joint.shortname()
    ours = scalar_axis(robot.model, i)[0] if joint.nv == 1 else _BALLS.get(short, "")
    if ours != kind:
        raise InvalidModel(
            f"joint {robot.model.names[i]!r} is a {short} here and a {kind} in MuJoCo: their "
            "coordinates do not mean the same"
        )
    if kind == "free" and robot.model.parents[i] != 0:
        raise InvalidModel(
            f"joint {robot.model.names[i]!r} is a free-flyer on another joint here, and free of "
            "all others in MuJoCo"
        )
    at, dof = int(mj.jnt_qposadr[j]), int(mj.jnt_dofadr[j])
    return Pair(
        name=str(robot.model.names[i]),
        here=i,
        there=j,
        kind=kind,
        q=slice(joint.idx_q, joint.idx_q + joint.nq),
        v=slice(joint.idx_v, joint.idx_v + joint.nv),
        qpos=slice(at, at + {"free": 7, "ball": 4}.get(kind, 1)),
        dof=slice(dof, dof + joint.nv),
    )


def _check_parents(robot: Robot, mj: Any, paired: Sequence[Pair], known: list[str]) -> None:
    here = {pair.there: pair.here for pair in paired}
    for pair in paired:
        parent = carrier(mj, pair.there, here)
        if robot.model.parents[pair.here] != here.get(parent, 0):
            raise InvalidModel(
                f"joint {pair.name!r} hangs on {robot.model.names[robot.model.parents[pair.here]]} "
                f"here and on {known[parent] if parent >= 0 else 'the world'} in MuJoCo"
            )


def carrier(mj: Any, joint: int, among: Mapping[int, int]) -> int:
    """Return the joint that carries one of MuJoCo's, -1 for the world; held ones are skipped."""
    body, j = int(mj.jnt_bodyid[joint]), joint - 1
    if j >= int(mj.body_jntadr[body]):
        return j if j in among else carrier(mj, j, among)
    return holder(mj, int(mj.body_parentid[body]), among)


def holder(mj: Any, body: int, among: Mapping[int, int]) -> int:
    """Return the last joint that moves a body of MuJoCo, -1 if none of those given does."""
    while body:
        first, count = int(mj.body_jntadr[body]), int(mj.body_jntnum[body])
        for j in reversed(range(first, first + count)):
            if j in among:
                return j
        body = int(mj.body_parentid[body])
    return -1


def check_axes(robot: Robot, data: Any, paired: Sequence[Pair], q: Array) -> None:
    """Refuse axes that are others; q is the configuration that MuJoCo's `data` is in."""
    placed = whole_data(robot.model)
    pin.forwardKinematics(robot.model, placed, q)
    for pair in paired:
        ours, theirs = axes(robot.model, placed, data, pair)
        if np.abs(ours - theirs).max() > tolerances.PARALLEL:
            what = "axis is" if pair.kind in ("hinge", "slide") else "frame has the axes"
            raise InvalidModel(
                f"joint {pair.name!r}: its {what} {_numbers(ours)} here and {_numbers(theirs)} in "
                "MuJoCo, in the world as the file draws the model: a coordinate does not mean the "
                "same motion"
            )


def axes(model: Any, placed: Any, data: Any, pair: Pair) -> tuple[Array, Array]:
    """Return the axis of a joint in the world in both engines; of a ball, three."""
    R = placed.oMi[pair.here].rotation
    if pair.kind in ("hinge", "slide"):
        return R @ scalar_axis(model, pair.here)[1], np.array(data.xaxis[pair.there])
    theirs = data.xmat[data.model.jnt_bodyid[pair.there]]
    return np.array(R), np.array(theirs).reshape(3, 3)


def _numbers(values: Array) -> str:
    columns = np.atleast_2d(np.round(values.T, 4) + 0.0)  # no minus zero
    return ", ".join(f"({', '.join(f'{x:g}' for x in column)})" for column in columns)


def check_units(name: str, x: Array, part: slice) -> None:
    """Refuse quaternions, or (cos, sin), that are not of norm 1."""
    squared = np.atleast_1d((x * x).sum(axis=-1))
    wrong = squared[~((squared > LOW) & (squared < HIGH))]
    if wrong.size:
        order = "(w x y z)" if name == "qpos" else "(x y z w) or (cos, sin)"
        raise InvalidArgument(
            f"{name}[{part.start}:{part.stop}] has norm {sqrt(wrong.flat[0]):.9g}: a unit "
            f"quaternion {order} is needed; "
            + ("mujoco.mj_normalizeQuat" if name == "qpos" else "pin.normalize")
            + " makes one"
        )
