"""From what an MJCF file says to a Pinocchio tree and its loops.

MuJoCo moves a body b from where it is drawn by its joints one after the other. With p the point and
s the axis of a joint, q its coordinate and q0 the one where the file draws the model,

    parentMb(q) = parentMb · Π T(p) · E(q - q0) · T(-p),      E(q - q0) = E(-q0) · E(q),

E(q) the turn about s by q, or the shift along it. Pinocchio's joint stands after T(p) · E(-q0) and
what follows it at T(-p), so that a coordinate means the same in both, and limits, springs and
keyframes hold as they are written. A free joint is the pose in the world in both; only quaternions
are in another order, w x y z in the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.names import few
from condyn_pin.constraints.base import WORLD
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.violation import ConstraintViolation
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.mjcf_posture import DRAWN, hidden, postures
from condyn_pin.io.mjcf_types import (
    COORDINATES,
    Body,
    Closure,
    Description,
    End,
    Gear,
    Joint,
    MjcfRobot,
)
from condyn_pin.io.tree import NO_LIMIT, one_coordinate, orthonormal
from condyn_pin.model.spring import Spring


def build(said: Description) -> MjcfRobot:
    """Return the model, the loops and the rest of a description."""
    grown = _Tree(said)
    loops: list[Loop | Coupling] = []
    unused = [*said.unused, *grown.renamed, *_unused_settings(grown.joints.values())]
    for equality in said.equalities:
        if equality.name in (loop.name for loop in loops):
            raise InvalidModel(f"two equalities are named {equality.name!r}; rename one")
        loop, gap = grown.couple(equality) if isinstance(equality, Gear) else grown.close(equality)
        loops.append(loop)
        if gap.size > tolerances.DRAWN:
            unused.append(
                f"loop {loop.name!r} is open by {gap} where the file draws the model: "
                "Scene.state closes it"
            )
    for name in said.actuated:
        grown.joint(name, "an actuator")
    named = postures(grown.joints.values(), said.keyframes, grown.drawn_pose())
    if other := hidden(named, grown.joints.values(), said.keyframes.get(DRAWN)):
        unused.append(other)
    return MjcfRobot(
        model=grown.model,
        loops=tuple(loops),
        actuated=tuple(dict.fromkeys(said.actuated)),
        springs=tuple(
            Spring(joint.name, joint.stiffness, joint.rest)
            for joint in grown.joints.values()
            if joint.stiffness and joint.kind in ("slide", "hinge")
        ),
        postures=named,
        unused=tuple(unused),
    )


class _Tree:
    """A Pinocchio model while it grows: what carries each body, and where each is drawn."""

    def __init__(self, said: Description) -> None:
        self.model = pin.Model()
        self.model.name = said.name
        self.model.gravity.linear = said.gravity
        self.joints: dict[str, Joint] = {}
        self.drawn: dict[str, Any] = {}  # oMb
        self.renamed: list[str] = []
        self._carried: list[tuple[int, Any]] = []  # by body: Pinocchio joint i, and iMb
        self._on: dict[str, tuple[int, Any]] = {}  # the same by name
        self._site_frames: dict[str, str] = {}
        self._taken: set[str] = set()
        names = [body.name for body in said.bodies]
        for body in said.bodies:
            self._add_body(body, said.bodies, names)
        for body in said.bodies:
            self._add_sites(body, names)

    def _add_body(self, body: Body, bodies: tuple[Body, ...], names: list[str]) -> None:
        if not self._carried:  # the world
            self.drawn[body.name] = pin.SE3.Identity()
            self._carried.append((0, pin.SE3.Identity()))
            self._on[body.name] = self._carried[0]
            return
        _check_names((body.name, *(joint.name for joint in body.joints)))
        self.drawn[body.name] = self.drawn[bodies[body.parent].name] * body.pose
        i, iMparent = self._carried[body.parent]
        iMb = iMparent * body.pose
        for joint in body.joints:
            if joint.kind == "free" and (body.parent != 0 or len(body.joints) > 1):
                raise InvalidModel(
                    f"joint {joint.name!r}: a free joint has to be the only one of a body that "
                    "stands in <worldbody>"
                )
            i, iMb = self._add_joint(joint, i, iMb)
            if joint.name not in names:
                self.model.addJointFrame(i)
        self._carried.append((i, iMb))
        self._on[body.name] = (i, iMb)
        # What is fixed to the world moves nothing.
        inertia = body.inertia if i and body.inertia is not None else pin.Inertia.Zero()
        self._frame(body.name, i, iMb, pin.FrameType.BODY, inertia)

    def _add_joint(self, joint: Joint, carrier: int, iMb: Any) -> tuple[int, Any]:
        """Return Pinocchio's joint, and what follows it in its axes."""
        if joint.name in self.joints:
            raise InvalidModel(f"two joints are named {joint.name!r}; rename one")
        self.joints[joint.name] = joint
        to_point = pin.SE3(np.eye(3), joint.point)
        limits: list[Array] = []
        if joint.kind == "free":
            made, carrier, iMj, jMb = (
                pin.JointModelFreeFlyer(),
                0,
                pin.SE3.Identity(),
                pin.SE3.Identity(),
            )
        elif joint.kind == "ball":
            made, iMj, jMb = pin.JointModelSpherical(), iMb * to_point, to_point.inverse()
        else:
            hinge = joint.kind == "hinge"
            back = -joint.reference * joint.axis
            E = pin.SE3(pin.exp3(back), np.zeros(3)) if hinge else pin.SE3(np.eye(3), back)
            made, iMj, jMb = (
                one_coordinate(joint.axis, hinge=hinge),
                iMb * to_point * E,
                to_point.inverse(),
            )
            limits = [*np.clip([[inf], [inf], [joint.lower], [joint.upper]], -NO_LIMIT, NO_LIMIT)]
        i = self.model.addJoint(carrier, made, orthonormal(iMj), joint.name, *limits)
        rows = slice(self.model.joints[i].idx_v, self.model.nv)
        for key in ("armature", "damping"):
            values = getattr(self.model, key).copy()
            values[rows] = getattr(joint, key)
            setattr(self.model, key, values)
        return int(i), jMb

    def _add_sites(self, body: Body, names: list[str]) -> None:
        for site, bMs in body.sites.items():
            _check_names((site,))
            name = site
            if site in names:
                name = f"{site}_site"
                self.renamed.append(f"the name of site {site!r}: a body has it; {name!r} here")
            self._site_frames[site] = name
            self._mark(name, body.name, bMs)

    def _mark(self, name: str, body: str, bMx: Any) -> None:
        i, iMb = self._on[body]
        self._frame(name, i, iMb * bMx, pin.FrameType.OP_FRAME, pin.Inertia.Zero())

    def _frame(self, name: str, i: int, iMf: Any, kind: Any, inertia: Any) -> None:
        # Pinocchio would return the older frame of the same name and type without a word.
        if name in self._taken:
            raise InvalidModel(f"two frames would be named {name!r}; rename one")
        self._taken.add(name)
        self.model.addFrame(pin.Frame(name, i, 0, orthonormal(iMf), kind, inertia))

    def close(self, closure: Closure) -> tuple[Loop, ConstraintViolation]:
        """Return the loop of a closure, and how far it is open as drawn."""
        ends = closure.ends
        given = [self._pose(closure, end) for end in ends]
        oMa, oMb = (given[1 - k] if given[k] is None else given[k] for k in range(2))
        frames = []
        for end, oMx, suffix in zip(ends, (oMa, oMb), "ab", strict=True):
            frames.append(self._site_frames.get(end.site) or f"{closure.name}_{suffix}")
            if not end.site:
                bMx = self.drawn[end.body].actInv(oMx)
                if closure.kind == "ball":  # a point has the axes of its body
                    bMx.rotation = np.eye(3)
                self._mark(frames[-1], end.body, bMx)
        aMb = oMa.actInv(oMb)
        turn = np.zeros(3) if closure.kind == "ball" else pin.log3(aMb.rotation)
        apart, turned = (float(np.linalg.norm(part)) for part in (aMb.translation, turn))
        loop = Loop(frames[0], frames[1], closure.kind, name=closure.name)  # type: ignore[arg-type]
        return loop, ConstraintViolation(apart, turned)

    def _pose(self, closure: Closure, end: End) -> Any:
        """Return oMend as drawn; None if it is where the other end is."""
        if end.body not in self.drawn:
            known = unknown_name("body", end.body, self.drawn)
            raise InvalidModel(f"equality {closure.name!r}: {known}")
        return None if end.pose is None else self.drawn[end.body] * end.pose

    def couple(self, gear: Gear) -> tuple[Coupling, ConstraintViolation]:
        """Return a coupling, and how far it is open as drawn."""
        a, b = (self.joint(n, f"equality {gear.name!r}") for n in (gear.joint_a, gear.joint_b))
        for joint in (a, b):
            if COORDINATES[joint.kind] != 1:
                raise InvalidModel(
                    f"equality {gear.name!r}: joint {joint.name!r} is {joint.kind}; "
                    "a hinge or a slide is needed"
                )
        offset = a.reference + gear.shift - gear.ratio * b.reference
        shift = abs(gear.shift)
        gap = (
            ConstraintViolation(shift, 0.0)
            if a.kind == "slide"
            else ConstraintViolation(0.0, shift)
        )
        return Coupling(a.name, b.name, gear.ratio, offset, name=gear.name), gap

    def joint(self, name: str, who: str) -> Joint:
        """Return the joint that somebody names."""
        if name not in self.joints:
            raise InvalidModel(f"{who}: {unknown_name('joint', name, self.joints)}")
        return self.joints[name]

    def drawn_pose(self) -> Array:
        """Return the configuration in which the file draws the model."""
        q = np.array(pin.neutral(self.model))
        for name, joint in self.joints.items():
            i = self.model.getJointId(name)
            start = self.model.joints[i].idx_q
            if joint.kind == "free":
                body = next(b for b, (k, _) in self._on.items() if k == i)
                q[start : start + 7] = pin.SE3ToXYZQUAT(self.drawn[body])
            elif joint.kind != "ball":
                q[start] = joint.reference
        return q


def _check_names(names: Iterable[str]) -> None:
    for name in names:
        if name in WORLD:
            raise InvalidModel(f"the name {name!r} is the world's; rename it")


def _unused_settings(joints: Iterable[Joint]) -> Iterator[str]:
    """Say which settings of the joints the dynamics do not use."""
    joints = list(joints)
    damped = [joint.name for joint in joints if joint.damping]
    if damped:
        yield f"joint damping ({few(damped)}): add Robot.passive_torque to tau"
    limited = [joint for joint in joints if joint.lower > -inf or joint.upper < inf]
    if limited:
        yield f"limits of position ({len(limited)} joints)"
    sprung = [j.name for j in joints if j.stiffness and COORDINATES[j.kind] != 1]
    if sprung:
        yield f"springs of joints with several coordinates ({few(sprung)})"
