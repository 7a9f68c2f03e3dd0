"""Random problems for the campaign: trees of every joint type, constraints of every kind.

A problem is a robot, a scene, a state on its constraints, torques and external forces; all follow
from one seed. Loops are closed by construction: their second frame is put where the first one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import condyn_pin as cp
from condyn_pin.constraints.loop import axis_of
from judges.oracle import Array, Oracle, rows, solve

Random = np.random.Generator

# Kinds of loops of the problems of a campaign, in the order in which seeds draw them, and others.
KINDS = ("ball", "weld", "hinge", "slider", "planar", "rod")
FOUR_ROWS = ("universal", "cylindrical")

# How far masses spread over one tree: decades below and above 1 kg.
SPREADS = (0.3, 0.3, 1.0, 1.0, 2.0, 4.0)


@dataclass(frozen=True)
class Problem:
    """One scene with a state on its constraints.

    Attributes
    ----------
    forces : sequence of (frame, force, of_body)
        External forces: (3,) or (6,), in the axes of the frame or in those of the world.
    """

    scene: cp.Scene
    q: Array
    v: Array
    tau: Array
    forces: tuple[tuple[str, Array, bool], ...]


def problem(seed: int, kinds: Sequence[str] = KINDS) -> Problem:
    """Return the problem of a seed, with loops of some kinds."""
    rng = np.random.default_rng([20260, seed])
    model = tree(rng)
    q = configuration(model, rng)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    constraints = _constraints(model, data, q, rng, kinds)
    robot = cp.Robot("random", model, postures={"here": q})
    scene = cp.Scene(robot, constraints)
    q = scene.robot.postures["here"]
    v = _velocity(scene, q, rng)
    return Problem(scene, q, v, _torque(scene, q, v, rng), _forces(model, rng))


# --- trees


def _axis(rng: Random) -> Array:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _simple(rng: Random) -> Any:
    """Return a joint with one degree of freedom."""
    kinds = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX,
             pin.JointModelPY, pin.JointModelPZ]  # fmt: skip
    unaligned = [pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned]
    helical = [pin.JointModelHX, pin.JointModelHY, pin.JointModelHZ]
    pick = int(rng.integers(10))
    if pick < 6:
        return kinds[pick]()
    if pick < 8:
        return unaligned[pick - 6](_axis(rng))
    if pick < 9:
        return helical[int(rng.integers(3))](float(rng.normal(scale=0.2)))
    return pin.JointModelHelicalUnaligned(_axis(rng), float(rng.normal(scale=0.2)))


def _continuous(axis: Array) -> Any:
    """Return a joint without bounds about any axis, which Python gets from a file only."""
    numbers = " ".join(repr(float(x)) for x in axis)
    text = (
        '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia '
        'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" '
        f'type="continuous"><parent link="a"/><child link="b"/><axis xyz="{numbers}"/></joint>'
        "</robot>"
    )
    return pin.buildModelFromXML(text).joints[1]


def _joint(rng: Random, root: bool) -> Any:
    """Return a joint of any type."""
    pick = int(rng.integers(14 if root else 13))
    unbounded = [pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ]
    if pick == 0:
        return unbounded[int(rng.integers(3))]()
    if pick == 1:
        return _continuous(_axis(rng))
    if pick == 2:
        return pin.JointModelSpherical()
    if pick == 3:
        return pin.JointModelSphericalZYX()
    if pick == 4:
        one = _axis(rng)
        two = np.cross(one, _axis(rng))
        return pin.JointModelUniversal(one, two / np.linalg.norm(two))
    if pick == 5:
        return pin.JointModelPlanar()
    if pick == 6:
        return pin.JointModelTranslation()
    if pick == 7:
        return pin.JointModelEllipsoid(*rng.uniform(0.05, 0.5, size=3))
    if pick == 8:
        made = pin.JointModelComposite(_simple(rng), placement(rng))
        for _ in range(int(rng.integers(1, 3))):
            made.addJoint(_simple(rng), placement(rng))
        return made
    if pick == 13 or (root and pick == 12):
        return pin.JointModelFreeFlyer()
    return _simple(rng)


def placement(rng: Random) -> Any:
    """Return a place, turned more often than not."""
    turn = pin.exp3(rng.normal(size=3)) if rng.random() < 0.7 else np.eye(3)
    return pin.SE3(turn, rng.normal(scale=0.3, size=3))


def _inertia(rng: Random, spread: float) -> Any:
    mass = 10.0 ** rng.uniform(-spread, spread)
    size = rng.uniform(0.05, 0.4, size=3)
    moments = mass * (size.sum() * np.ones(3) - size) ** 2 / 12.0
    moments = np.array([moments[1] + moments[2], moments[0] + moments[2], moments[0] + moments[1]])
    turn = pin.exp3(rng.normal(size=3))
    return pin.Inertia(mass, rng.normal(scale=0.15, size=3), turn @ np.diag(moments) @ turn.T)


def tree(rng: Random) -> Any:
    """Return a tree whose joints come depth-first, with a frame on each body."""
    model = pin.Model()
    spread = float(rng.choice(SPREADS))
    count, path = int(rng.integers(2, 11)), [0]
    for i in range(count):
        while len(path) > 1 and rng.random() < 0.25:
            path.pop()
        joint = model.addJoint(path[-1], _joint(rng, len(path) == 1), placement(rng), f"joint{i}")
        model.appendBodyToJoint(joint, _inertia(rng, spread), pin.SE3.Identity())
        path.append(joint)
        model.addFrame(pin.Frame(f"body{i}", joint, 0, placement(rng), pin.FrameType.OP_FRAME))
    if rng.random() < 0.3:
        model.armature = rng.uniform(0.0, 0.3, size=model.nv)
    pick = rng.random()
    if pick < 0.1:
        model.gravity = pin.Motion.Zero()
    elif pick < 0.3:
        model.gravity = pin.Motion(9.81 * _axis(rng), np.zeros(3))
    return model


def configuration(model: Any, rng: Random) -> Array:
    """Return a configuration, now and then one near the neutral."""
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    if rng.random() < 0.1:
        q = pin.integrate(model, pin.neutral(model), 1e-3 * rng.normal(size=model.nv))
    return np.asarray(q)


# --- constraints


class _Frames:
    """Frames that are added to a model where the state needs them."""

    def __init__(self, model: Any, data: Any, rng: Random) -> None:
        self.model, self.data, self.rng, self.count = model, data, rng, 0

    def any(self, world: bool = True) -> int:
        """Return a joint; the world now and then."""
        if world and self.rng.random() < 0.25:
            return 0
        return int(self.rng.integers(1, self.model.njoints))

    def add(self, joint: int, place: Any) -> str:
        """Add a frame to a body, at a place of the world, and return its name."""
        name = f"frame{self.count}"
        self.count += 1
        here = self.data.oMi[joint].actInv(place)
        self.model.addFrame(pin.Frame(name, joint, 0, here, pin.FrameType.OP_FRAME))
        return name


def _constraints(
    model: Any, data: Any, q: Array, rng: Random, kinds: Sequence[str]
) -> list[cp.constraints.Constraint]:
    """Return constraints that hold at q; now and then one twice, or a ball beside a weld."""
    frames = _Frames(model, data, rng)
    made: list[cp.constraints.Constraint] = []
    for _ in range(int(rng.integers(0, 5))):
        k = len(made)
        pick = int(rng.integers(len(kinds) + 5)) - len(kinds)
        if pick < 0:
            made += _loops(frames, kinds[pick], f"c{k}", rng)
        elif pick < 3:
            made.append(_contact(frames, f"c{k}", rng))
        elif pick == 3:
            made += _coupling(model, q, f"c{k}", rng)
        else:
            made.append(_rolling(frames, f"c{k}", rng))
    return made


def _loops(frames: _Frames, kind: Any, name: str, rng: Random) -> list[cp.constraints.Constraint]:
    one, two = frames.any(), frames.any()
    if one == two:
        return []
    i = int(rng.integers(3))
    e, across, axis = np.eye(3)[i], np.eye(3)[i - 1], "xyz"[i]
    place = frames.data.oMi[frames.any(False)] * placement(rng)
    if kind in FOUR_ROWS:
        turn, shift, swing = rng.normal(size=3)
        alike = {
            "universal": pin.SE3(pin.exp3(turn * e) @ pin.exp3(swing * across), np.zeros(3)),
            "cylindrical": pin.SE3(pin.exp3(turn * e), 0.3 * shift * e),
        }[kind]
        pins = axis + "xyz"[i - 1] if kind == "universal" else axis
        a, b = frames.add(one, place), frames.add(two, place * alike)
        return [cp.Loop(a, b, kind, axis=pins, name=name)]  # type: ignore[arg-type]
    other = {
        "ball": pin.SE3(pin.exp3(rng.normal(size=3)), np.zeros(3)),
        "weld": pin.SE3.Identity(),
        "hinge": pin.SE3(pin.exp3(rng.normal() * e), np.zeros(3)),
        "slider": pin.SE3(np.eye(3), rng.normal(scale=0.3) * e),
        "planar": pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.3) * e),
        "rod": placement(rng),
    }[kind]
    a, b = frames.add(one, place), frames.add(two, place * other)
    length = None
    if kind == "rod":
        ends = [
            frames.data.oMi[f.parentJoint] * f.placement for f in frames.model.frames.tolist()[-2:]
        ]
        length = float(np.linalg.norm(ends[1].translation - ends[0].translation))
    made = [cp.Loop(a, b, kind, axis=axis_of(kind, axis), length=length, name=name)]
    pick = rng.random()
    if pick < 0.15:
        made.append(
            cp.Loop(a, b, kind, axis=axis_of(kind, axis), length=length, name=f"{name}_twice")
        )
    elif pick < 0.25 and kind in ("ball", "weld", "hinge"):
        made.append(cp.Loop(b, a, "ball", name=f"{name}_ball"))
    return list(made)


def _contact(frames: _Frames, name: str, rng: Random) -> cp.constraints.Constraint:
    joint = frames.any(False)
    place = frames.data.oMi[joint] * placement(rng)
    frame, axis = frames.add(joint, place), "xyz"[int(rng.integers(3))]
    anchored = rng.random() < 0.5
    seven = tuple(pin.SE3ToXYZQUAT(place)) if anchored else None
    pick = int(rng.integers(4))
    if pick == 0:
        anchor = tuple(place.translation) if anchored else None
        return cp.PointContact(frame, anchor=anchor, name=name)
    if pick == 1:
        return cp.SurfaceContact(frame, anchor=seven, name=name)
    if pick == 2:
        return cp.constraints.LineContact(frame, axis, anchor=seven, name=name)  # type: ignore[arg-type]
    normal = _axis(rng)
    height = float(normal @ place.translation) if anchored else None
    return cp.constraints.PlanarContact(frame, normal=tuple(normal), height=height, name=name)


def _rolling(frames: _Frames, name: str, rng: Random) -> cp.constraints.Constraint:
    joint = frames.any(False)
    frame = frames.add(joint, frames.data.oMi[joint] * placement(rng))
    normal, radius = tuple(_axis(rng)), float(rng.uniform(0.05, 0.5))
    axis: Any = "xyz"[int(rng.integers(3))]
    pick = int(rng.integers(3))
    if pick == 0:
        return cp.constraints.RollingBall(frame, radius, normal=normal, name=name)
    if pick == 1:
        every: Any = ("rolling", "lateral", "normal")
        holds = every[: int(rng.integers(1, 4))]
        return cp.constraints.RollingWheel(frame, radius, axis, holds, normal, name=name)
    return cp.constraints.KnifeEdge(frame, axis, tuple(rng.normal(scale=0.2, size=3)), name=name)


def _coupling(model: Any, q: Array, name: str, rng: Random) -> list[cp.constraints.Constraint]:
    able = [i for i in range(1, model.njoints) if model.joints[i].nq == model.joints[i].nv == 1]
    if len(able) < 2:
        return []
    a, b = (int(i) for i in rng.choice(able, size=2, replace=False))
    ratio = float(rng.normal()) or 1.0
    offset = float(q[model.joints[a].idx_q] - ratio * q[model.joints[b].idx_q])
    return [cp.constraints.Coupling(model.names[a], model.names[b], ratio, offset, name=name)]


# --- states and forces


def _velocity(scene: cp.Scene, q: Array, rng: Random) -> Array:
    """Return a velocity along the constraints, by the oracle's rows; rest now and then."""
    nv = scene.robot.nv
    speed = float(rng.choice([0.0, 1.0, 1.0, 10.0]))
    oracle = Oracle(scene.robot.model, q, np.zeros(nv))
    J, _ = rows(oracle, scene)
    free = solve(oracle.M, oracle.h, J, np.zeros(len(J))).free
    coordinates = rng.normal(size=free.shape[1])
    moved = free @ coordinates
    size = float(np.abs(moved).max(initial=0.0))
    return np.asarray(speed * moved / size if size else moved, dtype=float)


def _torque(scene: cp.Scene, q: Array, v: Array, rng: Random) -> Array:
    """Return no torque, one that balances, or one that moves every joint by about 1 rad/s^2."""
    nv, pick = scene.robot.nv, rng.random()
    if pick < 0.15:
        return np.zeros(nv)
    oracle = Oracle(scene.robot.model, q, np.zeros(nv))
    if pick < 0.3:
        return np.asarray(oracle.h, dtype=float)
    push = np.sqrt(np.diag(np.asarray(oracle.M, dtype=float)))
    return np.asarray(10.0 ** rng.uniform(-1, 2) * push * rng.normal(size=nv))


def _forces(model: Any, rng: Random) -> tuple[tuple[str, Array, bool], ...]:
    made = []
    if rng.random() < 0.4:
        for _ in range(int(rng.integers(1, 3))):
            frame = f"body{int(rng.integers(model.njoints - 1))}"
            size = int(rng.choice([3, 6]))
            force = 10.0 ** rng.uniform(-1, 2) * rng.normal(size=size)
            made.append((frame, force, bool(rng.random() < 0.5)))
    return tuple(made)
