"""Machines with redundant rows, closed by construction, for `noise.py`.

Chains of hinges whose last link meets the world where it is drawn: overconstrained ones (Bennett,
spherical, planar in a slanted plane, Sarrus, a guide and a crank on one rod, a bar on three cranks)
and generic ones; and machines that have several at once, in other units, or far from the origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

import condyn_pin as cp
from condyn_pin.constraints.loop import axis_of

Array = np.ndarray
Rng = np.random.Generator
Machine = tuple[cp.Scene, Array | None]  # a scene, and a closed q; None for any that it samples

OVERCONSTRAINED = ("bennett", "spherical", "planar", "sarrus", "guided", "cranks")


class Drawing:
    """A model while it is drawn; lengths in metres times `unit`, which gravity is told."""

    def __init__(self, unit: float = 1.0) -> None:
        self.model, self.unit = pin.Model(), unit
        self.model.gravity.linear = unit * self.model.gravity.linear
        self.loops: list[Any] = []
        self.q: list[Array] = []

    def joint(self, parent: int, place: Any, joint: Any, q: Any, size: float, mass: float) -> int:
        """Add a body, `size` long."""
        name = f"joint{self.model.njoints}"
        place = pin.SE3(place.rotation, self.unit * place.translation)
        index = int(self.model.addJoint(parent, joint, place, name))
        length = self.unit * size
        turns = mass * length**2 * np.diag([0.02, 0.15, 0.17])
        centre = length * np.array([0.5, 0.01, 0.02])
        self.model.appendBodyToJoint(index, pin.Inertia(mass, centre, turns), pin.SE3.Identity())
        self.q.append(np.atleast_1d(np.asarray(q, dtype=float)))
        return index

    def frame(self, joint: int, place: Any) -> str:
        """Add a frame on a body."""
        name = f"frame{self.model.nframes}"
        place = pin.SE3(place.rotation, self.unit * place.translation)
        self.model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))
        return name

    def close(self, joint: int, place: Any, base: int, kind: str, axis: str = "z") -> None:
        """Close a loop between a frame of one body and another body, where they are drawn."""
        end = self.frame(joint, place)
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, np.concatenate(self.q))
        place = data.oMi[base].actInv(data.oMf[self.model.getFrameId(end)])
        place.translation /= self.unit
        self.loops.append(cp.Loop(end, self.frame(base, place), kind, axis_of(kind, axis)))

    def scene(self, name: str, *more: Any) -> tuple[cp.Scene, Array]:
        """Return the machine, and the state that it is drawn in."""
        q = np.concatenate(self.q)
        return cp.Scene(cp.Robot(name, self.model, postures={"drawn": q}), [*self.loops, *more]), q


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    """Return a placement without a rotation."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def turned(roll: float, x: float = 0.0, z: float = 0.0) -> Any:
    """Return Denavit's and Hartenberg's step: x along the link, its twist about x, z an offset."""
    return pin.SE3(pin.rpy.rpyToMatrix(roll, 0.0, 0.0), np.array([x, 0.0, z]))


def somewhere(rng: Rng) -> Any:
    """Return a random placement."""
    x = rng.normal(size=4)
    return pin.SE3(pin.Quaternion(*(x / np.linalg.norm(x))).toRotationMatrix(), rng.normal(size=3))


def hinges(
    drawing: Drawing, steps: Sequence[Any], q: Sequence[float], base: Any, on: int = 0
) -> int:
    """Add a chain of hinges about z, each at the end of the step before."""
    place, joint = base, on
    for step, angle in zip(steps, q, strict=True):
        size = max(float(np.linalg.norm(step.translation)), 0.2)
        joint = drawing.joint(joint, place, pin.JointModelRZ(), angle, size, 2.0 * size)
        place = step
    return joint


def add(drawing: Drawing, family: str, rng: Rng, size: float = 1.0, on: int = 0) -> None:
    """Add a random machine of a family to a drawing, `size` times as large as usual."""
    base, q = somewhere(rng), rng.uniform(-1.5, 1.5, size=6)
    far = lambda low, high: size * rng.uniform(low, high)  # noqa: E731
    kind = "hinge"
    if family == "bennett":
        alpha, a = rng.uniform(0.2, 0.9), far(0.3, 1.0)
        b = a * rng.uniform(1.1, min(2.0, 0.97 / np.sin(alpha)))
        beta, theta = np.arcsin(b * np.sin(alpha) / a), rng.uniform(0.4, 2.6)
        K = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
        steps = [turned(alpha, a), turned(beta, b), turned(alpha, a)]
        q = np.array([theta, 2 * np.arctan(K / np.tan(theta / 2)), -theta])
    elif family == "spherical":  # all axes meet; the cut is away from where they do
        steps = [turned(rng.uniform(0.4, 1.2)) for _ in range(3)]
        steps[2] = steps[2] * shifted(z=far(0.2, 1.0))
    elif family == "planar":
        steps = [turned(0.0, far(0.3, 1.0)) for _ in range(3)]
        kind = str(rng.choice(["ball", "hinge", "planar"]))
    elif family == "sarrus":  # two groups of parallel hinges
        steps = [turned(0.0, far(0.3, 1.0)) for _ in range(5)]
        to_other = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.7), np.zeros(3))
        steps[2] = steps[2] * to_other * turned(rng.uniform(0.5, 1.5))
    elif family == "generic":
        n = int(rng.integers(4, 7))
        steps = [turned(rng.uniform(-1.5, 1.5), far(0.2, 0.8), far(-0.3, 0.3)) for _ in range(n)]
        kind = "ball" if n < 6 else "hinge"
    elif family == "guided":
        return _guided(drawing, far(0.3, 2.0), rng.uniform(0.2, 1.4), on)
    elif family == "cranks":
        return _cranks(drawing, far(0.3, 1.0), [far(0.3, 1.0), far(0.3, 1.0)], q[0] + 1.6, on)
    else:
        raise ValueError(family)
    last = hinges(drawing, steps, q[: len(steps)], base, on)
    return drawing.close(last, steps[-1], on, kind)


def _guided(drawing: Drawing, length: float, angle: float, on: int) -> None:
    """A slider on x, a rod from it to a guide along z, and a crank to the rod's middle."""
    y = pin.JointModelRY
    x = length * np.cos(angle)
    slider = drawing.joint(
        on, pin.SE3.Identity(), pin.JointModelPX(), drawing.unit * x, 0.2 * length, 0.5
    )
    rod = drawing.joint(slider, pin.SE3.Identity(), y(), np.pi + angle, length, 1.0)
    crank = drawing.joint(on, pin.SE3.Identity(), y(), -angle, length / 2, 0.7)
    tip = drawing.frame(rod, shifted(length))
    drawing.loops.append(cp.constraints.PlanarContact(tip, normal=(1, 0, 0), height=0.0))
    ends = drawing.frame(rod, shifted(length / 2)), drawing.frame(crank, shifted(length / 2))
    drawing.loops.append(cp.Loop(*ends, "planar", axis="y"))


def _cranks(drawing: Drawing, length: float, apart: Sequence[float], angle: float, on: int) -> None:
    """A bar on three parallel cranks of one length."""
    at = np.cumsum([0.0, *apart])
    y = pin.JointModelRY
    cranks = [drawing.joint(on, shifted(x), y(), angle, length, 2 * length) for x in at[:1]]
    bar = drawing.joint(cranks[0], shifted(length), y(), -angle, at[-1], 1.0)
    for x in at[1:]:
        crank = drawing.joint(on, shifted(x), y(), angle, length, 2 * length)
        ends = drawing.frame(bar, shifted(x)), drawing.frame(crank, shifted(length))
        drawing.loops.append(cp.Loop(*ends, "planar", axis="y"))


def of_family(family: str) -> Callable[[Rng], Machine]:
    """Return what draws a machine of a family."""

    def draw(rng: Rng) -> Machine:
        drawing = Drawing()
        add(drawing, family, rng)
        return drawing.scene(family)

    return draw


def in_other_units(rng: Rng) -> Machine:
    """Draw a machine whose lengths are numbers of 1e-3 to 1e3 times the usual size."""
    drawing = Drawing(10.0 ** rng.uniform(-3, 3))
    add(drawing, str(rng.choice([*OVERCONSTRAINED, "generic"])), rng)
    return drawing.scene("other units")


def of_two_sizes(rng: Rng) -> Machine:
    """Draw two machines in one scene, one 10 to 1000 times the size of the other."""
    drawing = Drawing()
    for size in (1.0, 10.0 ** -rng.uniform(1, 3)):
        add(drawing, str(rng.choice(OVERCONSTRAINED)), rng, size)
    return drawing.scene("two sizes")


def floating(rng: Rng) -> Machine:
    """Draw a machine on a body that floats 1 m to 10 km from the origin."""
    drawing = Drawing()
    at = 10.0 ** rng.uniform(0, 4) * rng.normal(size=3)
    turn = pin.Quaternion(somewhere(rng).rotation).coeffs()
    body = drawing.joint(
        0, pin.SE3.Identity(), pin.JointModelFreeFlyer(), np.concatenate([at, turn]), 1.0, 5.0
    )
    add(drawing, str(rng.choice([*OVERCONSTRAINED[:4], "generic"])), rng, on=body)
    return drawing.scene("floating")


def mixed(rng: Rng) -> Machine:
    """Draw an overconstrained machine beside a rod, a coupling, a driven joint or a wheel."""
    drawing = Drawing()
    add(drawing, str(rng.choice(OVERCONSTRAINED)), rng)
    first = drawing.model.njoints
    q = rng.uniform(-1.0, 1.0, size=3)
    steps = [turned(0.3, 0.5), turned(-0.4, 0.7), turned(0.2, 0.4)]
    last = hinges(drawing, steps, q, somewhere(rng))
    names = [f"joint{first + k}" for k in range(3)]
    tip = drawing.frame(last, steps[-1])
    which = str(rng.choice(["rod", "coupling", "driven", "wheel"]))
    if which == "rod":
        data = drawing.model.createData()
        pin.framesForwardKinematics(drawing.model, data, np.concatenate(drawing.q))
        anchor = data.oMf[drawing.model.getFrameId(tip)] * shifted(0.3, 0.2, 0.1)
        length = float(np.linalg.norm([0.3, 0.2, 0.1]))
        more: Any = cp.Loop(tip, drawing.frame(0, anchor), "rod", length=length)
    elif which == "coupling":
        more = cp.constraints.Coupling(names[0], names[1], 2.0, float(q[0] - 2.0 * q[1]))
    elif which == "driven":
        held = cp.constraints.HeldJoint(names[0], float(q[0]))
        more = cp.constraints.Driven(held, cp.constraints.Sine(0.3, 1.0), time=0.0)
    else:
        more = cp.constraints.KnifeEdge(tip, "x")
    return drawing.scene(f"mixed {which}", more)


def flat(rng: Rng) -> Machine:
    """Draw a parallelogram 1e-6 to 0.1 rad from flat."""
    angle = 10.0 ** rng.uniform(-6, -1)
    drawing, y = Drawing(), pin.JointModelRY
    a, b = rng.uniform(0.3, 1.0, size=2)
    crank = drawing.joint(0, pin.SE3.Identity(), y(), 0.5, a, 1.0)
    bar = drawing.joint(crank, shifted(a), y(), -0.5, b, 1.0)
    other = drawing.joint(0, shifted(b), y(), 0.5, a, 1.0)
    ends = drawing.frame(bar, shifted(b)), drawing.frame(other, shifted(a))
    kind = str(rng.choice(["ball", "planar", "hinge"]))
    drawing.loops.append(cp.Loop(*ends, kind, axis=axis_of(kind, "y")))
    return drawing.scene("flat")[0], np.array([angle, -angle, angle])


def flat_posture(rng: Rng) -> Machine:
    """Draw a parallelogram that is flat in its posture, and 1e-3 to 1 rad from it at the state."""
    scene, q = flat(rng)
    robot = cp.Robot("flat posture", scene.robot.model, postures={"flat": 0 * q})
    angle = 10.0 ** rng.uniform(-3, 0)
    return cp.Scene(robot, scene.constraints), np.array([angle, -angle, angle])


def with_kind(robot: cp.Robot, kind: str) -> cp.Scene:
    """Return the loops of a robot as loops of another kind."""
    loops = [
        cp.Loop(x.frame_a, x.frame_b, kind, axis_of(kind, "z"), name=x.name) for x in robot.loops
    ]
    return cp.Scene(robot, loops)


def feet() -> cp.Scene:
    """Return Cassie with its loops, and two points under each foot."""
    cassie = cp.load_robot("cassie")
    names = [frame.name for frame in cassie.model.frames]
    toes = [
        [name for name in names if side in name and ("toe" in name or "foot" in name)][-1]
        for side in ("left", "right")
    ]
    points = [
        cp.PointContact(toe, offset=(x, 0, 0), name=f"{toe}{x}")
        for toe in toes
        for x in (-0.05, 0.05)
    ]
    return cp.Scene(cassie, [*cassie.loops, *points])


def eight_points() -> cp.Scene:
    """Return Talos on the corners of its two feet."""
    corners = [(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.06, 0.06)]
    soles = ("left_sole_link", "right_sole_link")
    points = [
        cp.PointContact(sole, offset=corner, name=f"{sole.split('_')[0]}{k}")
        for sole in soles
        for k, corner in enumerate(corners)
    ]
    return cp.Scene(cp.load_robot("talos"), points)


def peaucellier(kind: str) -> Machine:
    """Return Peaucellier's straight-line linkage: seven hinges and three loops in a plane."""
    drawing, y = Drawing(), pin.JointModelRY
    th, L, k, e = 0.35, 1.0, 0.45, 0.35

    def links(parent: int, at: float, length: float, angle: float) -> int:
        return drawing.joint(parent, shifted(at), y(), angle, length, 2 * length)

    C = 2 * e * np.cos(th) * np.exp(1j * th)
    D = (L**2 - k**2) / abs(C) * np.exp(1j * th)
    half = np.arccos((L**2 + abs(C) ** 2 - k**2) / (2 * L * abs(C)))
    ends = []
    for sign in (1, -1):
        A = L * np.exp(1j * (th + sign * half))
        arm = links(0, 0.0, L, -np.angle(A))
        ends.append([links(arm, L, k, -np.angle((P - A) / A)) for P in (C, D)])
    crank = links(0, e, e, -np.angle(C - e))
    (a_c, a_d), (b_c, b_d) = ends
    for first, second, x in ((a_c, b_c, k), (a_d, b_d, k), (a_c, crank, e)):
        pair = drawing.frame(first, shifted(k)), drawing.frame(second, shifted(x))
        drawing.loops.append(cp.Loop(*pair, kind, axis=axis_of(kind, "y")))
    return drawing.scene(f"peaucellier {kind}")


def bar(kind: str) -> cp.Scene:
    """Return the four-bar linkage, closed by a loop of some kind."""
    return cp.Scene(
        cp.model.four_bar(),
        [cp.Loop("coupler_tip", "rocker_tip", kind, axis=axis_of(kind, "y"), name="tip")],
    )


SHIPPED: dict[str, Callable[[], cp.Scene]] = {
    "Cassie": lambda: cp.Scene(cp.load_robot("cassie"), cp.load_robot("cassie").loops),
    "Cassie on its feet": feet,
    "Bricard": lambda: cp.Scene(cp.model.bricard(), cp.model.bricard().loops),
    "Delta": lambda: with_kind(cp.model.delta(), "ball"),
    "Delta with hinges": lambda: with_kind(cp.model.delta(), "hinge"),
    "Stewart": lambda: with_kind(cp.model.stewart(), "ball"),
    "Stewart with hinges": lambda: with_kind(cp.model.stewart(), "hinge"),
    "four-bar, ball": lambda: bar("ball"),
    "four-bar, hinge": lambda: bar("hinge"),
    "four-bar, planar": lambda: bar("planar"),
    "Talos on eight points": eight_points,
}

DRAWN: dict[str, Callable[[Rng], Machine]] = {
    **{family: of_family(family) for family in (*OVERCONSTRAINED, "generic")},
    "other units": in_other_units,
    "two sizes": of_two_sizes,
    "floating": floating,
    "mixed": mixed,
    "flat": flat,
    "flat posture": flat_posture,
    "peaucellier": lambda rng: peaucellier(str(rng.choice(["planar", "ball", "hinge"]))),
}
