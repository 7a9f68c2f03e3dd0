"""Joints that close loops as joints of the tree: a body is cut in their place.

A `Loop` is a joint that was cut, and rows are all that is left of it: it has no coordinate, and
nothing acts along one. Here the body b behind the joint is cut instead. The joint carries a piece
of b, and a weld holds the rest,

    a --joint(q)-- piece of b ==weld== rest of b,        I_piece + I_rest = I_b,

which move as the one body that they are. The motion is that of the machine whatever the pieces
weigh, and the wrench in the joint is that of a on the whole of b. The weld's own is inside b.

The coordinate of the joint is a number of q, and its rate one of v. Stops, springs, dampers, dry
friction, motors, rotors and drives find the joint by its name, as they find every other. An angle
counts its turns as that of any hinge does: it is integrated, and never read off a rotation.

    loop          joints                      coordinates
    hinge         NAME                        turn of frame b about the axis of frame a [rad]
    slider        NAME                        shift of frame b along it [m]
    cylindrical   NAME_slide, NAME_turn       both
    universal     NAME_axis, NAME_axis2       turns about the axis of a and that of b [rad]
    ball          NAME                        quaternion x y z w of the axes of b in those of a

Where b is the world, or has no inertia that the joint would move, a is cut, and the joint leads
from b to a: about the opposite axis, so that coordinates stay; the quaternion is the inverse.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, pi
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import dry_friction, pin, set_dry_friction
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import UNLIMITED, whole_data
from condyn_pin.constraints.loop import CutJoint, Loop
from condyn_pin.constraints.places import with_joint_names
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import depth_first
from condyn_pin.model.springs import Spring
from condyn_pin.model.tree import one_coordinate


@dataclass(frozen=True)
class Settings:
    """Settings in a file of a joint that closes a loop; balls have damping and friction alone."""

    lower: float = -inf  # [rad or m]
    upper: float = inf
    effort: float = inf  # [N m or N]
    velocity: float = inf  # [rad/s or m/s]
    damping: float = 0.0  # [N m s/rad or N s/m]
    friction: float = 0.0  # [N m or N]
    stiffness: float = 0.0  # [N m/rad or N/m]
    reference: float = 0.0  # where the spring rests [rad or m]

    @property
    def act(self) -> bool:
        """True if they limit the joint, or act in it."""
        stops = self.lower > -UNLIMITED or self.upper < UNLIMITED
        return stops or any((self.damping, self.friction, self.stiffness))


_NONE: Final = Settings()


def with_whole_joints(
    robot: Robot,
    loops: Sequence[str | Loop],
    settings: Mapping[str, Settings] = MappingProxyType({}),
) -> Robot:
    """Robot whose tree has the joints of loops, with settings by name; `Robot.with_whole_joints`.

    Raises
    ------
    InvalidModel
        If neither body of a joint has an inertia that it would move, both are one, or its name is
        taken.
    """
    chosen = [_loop_of(robot, each) for each in loops]
    cuts = [_Cut(robot, loop, settings.get(loop.name, _NONE)) for loop in chosen]
    pieces = Counter(cut.body for cut in cuts)
    model = pin.Model(robot.model)
    for body, n in pieces.items():
        model.inertias[body] = _part(robot.model.inertias[body], n + 1)
    for cut in cuts:
        cut.add_to(model)
    data = whole_data(robot.model)

    def longer(q: Array) -> Array:
        """Configuration with the coordinates of the joints at its end."""
        pin.forwardKinematics(robot.model, data, q)
        return np.concatenate([q, *(cut.coordinates(data) for cut in cuts)])

    for entry in robot.model.referenceConfigurations:
        model.referenceConfigurations[entry.key()] = longer(np.array(entry.data()))
    ordered, index_q, _ = depth_first(model)

    ends = [{*loop.frames} for loop in chosen]
    return replace(
        robot,
        model=ordered,
        postures={name: longer(q)[index_q] for name, q in robot.postures.items()},
        loops=(
            *(each for each in robot.loops if {*each.frames} not in ends),
            *(cut.weld for cut in cuts),
        ),
        springs=(*robot.springs, *(spring for cut in cuts for spring in cut.springs)),
    )


def _loop_of(robot: Robot, given: str | Loop) -> Loop:
    """Loop of the robot by its name, or one that is given; InvalidArgument if it is no joint."""
    known = {each.name: each for each in robot.loops}
    if isinstance(given, str) and given not in known:
        raise unknown_name("loop", given, known)
    loop = known[given] if isinstance(given, str) else given
    if not getattr(loop, "cut_joints", ()):
        raise InvalidArgument(
            f"loops: {given!r} has no coordinate of its own: a Loop that is a hinge, slider, "
            "cylindrical, universal or ball is needed, or the name of one"
        )
    return with_joint_names(loop, robot)  # type: ignore[return-value]  # cuts of joints are loops


class _Cut:
    """Joint of a loop, between one of its bodies and a piece of the other."""

    def __init__(self, robot: Robot, loop: Loop, settings: Settings) -> None:
        self._loop, self._settings, self._steps = loop, settings, loop.cut_joints
        ends = [robot.frame(frame) for frame in loop.frames]
        if ends[0][0] == ends[1][0]:
            raise InvalidModel(f"loop {loop.name!r}: both of its frames are on one body")
        for name in (step.name for step in self._steps):
            if name in robot.joints or name in robot.frames:
                raise InvalidModel(
                    f"loop {loop.name!r}: its joint would be named {name!r}, which {robot.name} "
                    "has already; give the loop another name"
                )
        moved = [self._is_moved(robot.model.inertias[i], M) if i else False for i, M in ends]
        if not any(moved):
            raise InvalidModel(
                f"loop {loop.name!r}: neither of its bodies has an inertia that this joint would "
                "move; give one of them some, or cut the loop at another joint"
            )
        self._ends, self._forward = ends, moved[1]

    @property
    def body(self) -> int:
        """Joint that carries the body that is cut."""
        return int(self._ends[self._forward][0])

    @property
    def weld(self) -> Loop:
        """Weld of the piece and the rest of its body."""
        last = self._steps[-1 if self._forward else 0].name
        rest = self._loop.frames[self._forward]
        return Loop(last, rest, "weld", name=f"{self._loop.name}_weld", drift=self._loop.drift)

    @property
    def springs(self) -> tuple[Spring, ...]:
        """Spring of a joint with one coordinate."""
        its = self._settings
        return (Spring(self._loop.name, its.stiffness, its.reference),) if its.stiffness else ()

    def add_to(self, model: Any) -> None:
        """Add the joints at the end of a model, and a piece as heavy as what is left there."""
        carrier, placement = self._ends[not self._forward]
        for step in self._steps if self._forward else self._steps[::-1]:
            joint = _joint(step, 1.0 if self._forward else -1.0)
            carrier = _add(model, carrier, placement, joint, step.name, self._settings)
            placement = pin.SE3.Identity()
        model.appendBodyToJoint(
            carrier, model.inertias[self.body], self._ends[self._forward][1].inverse()
        )

    def coordinates(self, data: Any) -> Array:
        """Coordinates of the joints in the order of the tree; reads data.oMi."""
        c1, c2 = (data.oMi[i] * M for i, M in self._ends)
        M, values = c1.actInv(c2), list[float]()
        if self._steps[0].is_ball:
            R = M.rotation if self._forward else M.rotation.T
            return np.array(pin.Quaternion(R).coeffs())
        for step in self._steps:
            values.append(step.value(M))
            M = step.placed(values[-1]).actInv(M)
        middle = 0.5 * (self._settings.lower + self._settings.upper)
        is_hinge = len(values) == 1 and self._steps[0].turns
        if is_hinge and abs(middle) < UNLIMITED:  # the turn between its stops
            values[0] -= 2 * pi * round((values[0] - middle) / (2 * pi))
        return np.array(values if self._forward else values[::-1])

    def _is_moved(self, inertia: Any, placement: Any) -> bool:
        """True if the inertia of a body, at the loop, resists every motion of the joint."""
        I = placement.actInv(inertia).matrix()  # noqa: E741
        S = np.hstack([step.axes for step in self._steps])
        least = np.linalg.eigvalsh(S.T @ I @ S)[0]
        return bool(least > tolerances.MOMENT * np.abs(I).max())


def _joint(step: CutJoint, sign: float) -> Any:
    """Pinocchio's joint; with sign -1 the one from b to a with the same coordinate."""
    if step.is_ball:
        return pin.JointModelSpherical()
    return one_coordinate(sign * step.e + 0.0, hinge=step.turns)


def _add(model: Any, carrier: int, placement: Any, joint: Any, name: str, its: Settings) -> int:
    """Add a joint with its frame, limits, damping and friction; return its number."""
    limits: tuple[Array, ...] = ()
    if joint.nq == joint.nv:
        ends = its.effort, its.velocity, its.lower, its.upper
        limits = tuple(np.array([x]) for x in np.clip(ends, -UNLIMITED, UNLIMITED))
    i = int(model.addJoint(carrier, joint, placement, name, *limits))
    model.addJointFrame(i)
    rows = slice(model.joints[i].idx_v, None)
    damping, friction = np.array(model.damping), dry_friction(model)
    damping[rows], friction[rows] = its.damping, its.friction
    model.damping = damping
    set_dry_friction(model, friction)
    return i


def _part(inertia: Any, n: int) -> Any:
    """Inertia of one n-th of a body."""
    return pin.Inertia(inertia.mass / n, inertia.lever, inertia.inertia / n)
