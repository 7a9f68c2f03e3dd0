"""Joints that close loops as joints of the tree: a body is cut in their place.

A `Loop` is a joint that was cut. Its rows are all that is left of it: no coordinate, and nothing
that acts along one. Here the body b behind the joint is cut instead. The joint carries a piece of
b, and a weld holds the rest,

    a --joint-- piece of b ==weld== rest of b,        I_piece + I_rest = I_b,

which move as the one body that they are. So the motion is that of the machine, and so is the wrench
in the joint, from the body a on all of b; the weld's own is inside b, and has no other meaning.

The coordinate of the joint is a number of q, its rate one of v. Limits, springs, dampers, friction,
motors, armatures and drives find the joint by its name, as they find every other. An angle counts
its turns, as that of any hinge does: it is integrated and never read off a rotation.

    loop          joints                      coordinate
    hinge         NAME                        turn of frame b about the axis of frame a [rad]
    slider        NAME                        shift of b along it [m]
    cylindrical   NAME_slide, NAME_turn       both
    universal     NAME_axis, NAME_axis2       turn about the axis of a, then about that of b [rad]
    ball          NAME                        quaternion x y z w of the axes of b in those of a
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import dry_friction, pin, set_dry_friction
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import UNLIMITED
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.loop import Loop
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import depth_first
from condyn_pin.model.springs import Spring
from condyn_pin.model.tree import one_coordinate

WHOLE: Final = ("hinge", "slider", "cylindrical", "universal", "ball")


@dataclass(frozen=True)
class Settings:
    """What a file says of a joint that closes a loop; of one without an axis, the damping alone."""

    lower: float = -inf  # [rad or m]
    upper: float = inf
    effort: float = inf  # [N m or N]
    velocity: float = inf  # [rad/s or m/s]
    damping: float = 0.0  # [N m s/rad or N s/m]
    friction: float = 0.0  # [N m or N]
    stiffness: float = 0.0  # [N m/rad or N/m]
    reference: float = 0.0  # where the spring rests [rad or m]


@dataclass(frozen=True)
class _Step:
    """One joint of a chain that stands for a loop: a turn about e, a shift along it, or a ball."""

    name: str
    e: Array | None  # unit vector in the axes of both frames; None for a ball
    turns: bool = True
    f: Array | None = None  # the angle is that of this direction across e

    def joint(self, sign: float) -> Any:
        """Pinocchio's joint; with sign -1 that from b to a, of the same coordinate."""
        if self.e is None:
            return pin.JointModelSpherical()
        return one_coordinate(sign * self.e, hinge=self.turns)

    def value(self, M: Any) -> float:
        """Coordinate of a turn or a shift by which frame b is placed in frame a."""
        if not self.turns:
            return float(self.e @ M.translation)
        Rf = M.rotation @ self.f
        return float(np.arctan2(self.e @ np.cross(self.f, Rf), self.f @ Rf))


def _steps(loop: Loop) -> tuple[_Step, ...]:
    """Joints from frame a to frame b."""
    if loop.kind == "ball":
        return (_Step(loop.name, None),)
    e, last = (np.eye(3)["xyz".index(axis)] for axis in (loop.axis[0], loop.axis[-1]))
    if loop.kind == "universal":
        return (
            _Step(f"{loop.name}_axis", e, f=last),
            _Step(f"{loop.name}_axis2", last, f=e),
        )
    turn, slide = _Step(loop.name, e, f=np.roll(e, 1)), _Step(loop.name, e, turns=False)
    if loop.kind == "cylindrical":
        return replace(slide, name=f"{loop.name}_slide"), replace(turn, name=f"{loop.name}_turn")
    return (slide if loop.kind == "slider" else turn,)


def with_whole_joints(
    robot: Robot,
    loops: Sequence[str | Loop],
    settings: Mapping[str, Settings] = MappingProxyType({}),
) -> Robot:
    """Return a robot whose tree has the joints of some loops; see `Robot.with_whole_joints`."""
    chosen = [_loop_of(robot, each) for each in loops]
    cuts = [_Cut(robot, loop, settings.get(loop.name, Settings())) for loop in chosen]
    pieces = Counter(cut.body for cut in cuts)
    model = pin.Model(robot.model)
    for body, n in pieces.items():
        model.inertias[body] = _share(robot.model.inertias[body], n + 1)
    for cut in cuts:
        cut.add_to(model, pieces[cut.body] + 1)
    ordered, index_q, _ = depth_first(model)

    def with_coordinates(q: Array) -> Array:
        data = whole_data(robot.model)
        pin.forwardKinematics(robot.model, data, q)
        return np.concatenate([q, *(cut.coordinates(data) for cut in cuts)])[index_q]

    ends = {frozenset(loop.frames) for loop in chosen}
    return replace(
        robot,
        model=ordered,
        postures={name: with_coordinates(q) for name, q in robot.postures.items()},
        loops=(
            *(each for each in robot.loops if frozenset(each.frames) not in ends),
            *(cut.weld for cut in cuts),
        ),
        springs=(*robot.springs, *(spring for cut in cuts for spring in cut.springs)),
    )


def _loop_of(robot: Robot, given: str | Loop) -> Loop:
    """A loop of the robot by its name, or one that is given; InvalidArgument if it is no joint."""
    loop: Constraint | None = given if isinstance(given, Loop) else None
    if isinstance(given, str):
        loop = next((each for each in robot.loops if each.name == given), None)
        if loop is None:
            raise unknown_name("loop", given, [each.name for each in robot.loops])
    if not isinstance(loop, Loop):
        raise InvalidArgument(f"loops: {given!r}: the name of a loop, or a Loop, is needed")
    if loop.kind not in WHOLE:
        raise InvalidArgument(
            f"loops: {loop.name!r} is a {loop.kind}, which has no coordinate; one of "
            f"{', '.join(WHOLE)} is needed: cp.Loop({loop.frame_a!r}, {loop.frame_b!r}, ...)"
        )
    return loop


class _Cut:
    """A loop whose joint joins the tree: between one of its bodies and a piece of the other.

    The piece is of body b; of body a where b is the world's, or too light to be cut there.
    """

    def __init__(self, robot: Robot, loop: Loop, settings: Settings) -> None:
        self._steps, self._settings, self._loop = _steps(loop), settings, loop
        (self._a, self._aMc1), (self._b, self._bMc2) = (robot.frame(f) for f in loop.frames)
        if self._a == self._b:
            raise InvalidModel(f"loop {loop.name!r}: both of its frames are on one body")
        inertias = robot.model.inertias
        if self._moves(self._b, self._bMc2, inertias):
            self.forward = True
        elif self._moves(self._a, self._aMc1, inertias):
            self.forward = False
        else:
            raise InvalidModel(
                f"loop {loop.name!r}: neither of its bodies has an inertia that its joint would "
                "move, and a piece of one is needed; make another joint of the loop the cut"
            )
        for name in (step.name for step in self._steps):
            if name in robot.joints or name in robot.frames:
                raise InvalidModel(
                    f"loop {loop.name!r}: its joint would be named {name!r}, as a joint or a frame "
                    "of the robot is; give the loop another name"
                )

    @property
    def body(self) -> int:
        """Joint that carries the body that is cut."""
        return self._b if self.forward else self._a

    @property
    def weld(self) -> Loop:
        """Weld that holds the piece to the rest of its body."""
        ends = self._steps[-1 if self.forward else 0].name, self._loop.frames[self.forward]
        return Loop(*ends, "weld", name=f"{self._loop.name}_weld", drift=self._loop.drift)

    @property
    def springs(self) -> tuple[Spring, ...]:
        """Spring of a joint with one coordinate."""
        its = self._settings
        return (Spring(self._loop.name, its.stiffness, its.reference),) if its.stiffness else ()

    def add_to(self, model: Any, n: int) -> None:
        """Add the joints, at the end, and a piece of one n-th."""
        joint, placement = (self._a, self._aMc1) if self.forward else (self._b, self._bMc2)
        for step in self._steps if self.forward else reversed(self._steps):
            joint = _add(model, joint, placement, step, 1.0 if self.forward else -1.0, self._settings)
            placement = pin.SE3.Identity()
        at = self._bMc2 if self.forward else self._aMc1
        piece = _share(model.inertias[self.body], 1)
        model.appendBodyToJoint(joint, piece, at.inverse())

    def coordinates(self, data: Any) -> Array:
        """Coordinates of the joints; reads data.oMi."""
        M = (data.oMi[self._a] * self._aMc1).actInv(data.oMi[self._b] * self._bMc2)
        if self._loop.kind == "ball":
            M = M if self.forward else M.inverse()
            return np.array(pin.Quaternion(M.rotation).coeffs())
        values = [step.value(M) for step in self._steps]
        middle = 0.5 * (self._settings.lower + self._settings.upper)
        if np.isfinite(middle) and self._steps[0].turns:  # the turn that its limits mean
            values[0] -= 2 * np.pi * np.round((values[0] - middle) / (2 * np.pi))
        return np.array(values if self.forward else values[::-1])

    def _moves(self, body: int, placement: Any, inertias: Any) -> bool:
        """True if the inertia of a body resists every motion of the joint."""
        if not body or not inertias[body].mass > 0.0:
            return False
        I = placement.actInv(inertias[body]).matrix()  # noqa: E741
        S = np.zeros((6, 3))
        for k, step in enumerate(self._steps):
            if step.e is None:
                S[3:] = np.eye(3)
            else:
                S[3 * step.turns : 3 * step.turns + 3, k] = step.e
        S = S[:, : 3 if self._steps[0].e is None else len(self._steps)]
        return bool(np.linalg.eigvalsh(S.T @ I @ S)[0] > tolerances.MOMENT * np.abs(I).max())


def _add(model: Any, carrier: int, placement: Any, step: _Step, sign: float, its: Settings) -> int:
    """Add one joint with its frame, limits, damping and friction; return its number."""
    made, limits = step.joint(sign), ()
    if step.e is not None:
        ends = its.effort, its.velocity, its.lower, its.upper
        limits = tuple(np.array([x]) for x in np.clip(ends, -UNLIMITED, UNLIMITED))
    i = int(model.addJoint(carrier, made, placement, step.name, *limits))
    model.addJointFrame(i)
    damping, friction = np.array(model.damping), dry_friction(model)
    damping[model.joints[i].idx_v :], friction[model.joints[i].idx_v :] = its.damping, its.friction
    model.damping = damping
    set_dry_friction(model, friction)
    return i


def _share(inertia: Any, n: int) -> Any:
    """Inertia of one n-th of a body."""
    return pin.Inertia(inertia.mass / n, inertia.lever, inertia.inertia / n)
