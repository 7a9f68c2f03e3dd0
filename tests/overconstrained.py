"""Machines with redundant rows, and states of them, closed and slightly open.

Bennett's loop moves against Gruebler's count, so that rows are redundant on the constraints only.
The trammel and three cranks are planar ones of this kind. The cart with a door has rows that are
redundant everywhere, and contradict each other as soon as the door is open.
"""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
from shared import axis_of

import condyn_pin as cp

# Lengths a and b, twist of a and turn of the first hinge: b sin(twist a) = a sin(twist b).
BENNETTS = {
    "bennett": (0.5, 0.8, 0.5, 1.2),
    "bennett, twisted": (0.4, 0.5, 0.9, 0.8),
    "bennett, flat": (1.0, 1.3, 0.3, 2.0),
    "bennett, slender": (0.3, 0.55, 0.5, 1.0),
}


def moved(x: float, turned: float = 0.0) -> pin.SE3:
    """A place x [m] along an axis, turned about it [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(turned, 0.0, 0.0), np.array([x, 0.0, 0.0]))


def bar(length: float) -> pin.Inertia:
    """A rod of 2 kg/m along x whose mass is a little off its axis."""
    mass = 2 * length
    turns = np.diag([0.02, 1 / 6, 1 / 6]) * mass * length**2
    return pin.Inertia(mass, np.array([length / 2, 0.01, 0.02]), turns)


def frame(model: pin.Model, name: str, joint: int, place: pin.SE3) -> None:
    model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))


def bennett(a: float, b: float, twist: float, turn: float) -> cp.Scene:
    """Bennett's loop in a slanted frame: a hinge whose five rows have rank 2."""
    other = np.arcsin(b * np.sin(twist) / a)
    base = moved(0.0, 1.0)
    model, parent, place = pin.Model(), 0, base
    for k, then in enumerate((moved(a, twist), moved(b, other), moved(a, twist))):
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"hinge{k}")
        model.appendBodyToJoint(parent, bar(then.translation[0]), pin.SE3.Identity())
        place = then
    frame(model, "end", parent, place)
    frame(model, "bearing", 0, base * moved(b, other).inverse())
    ratio = np.sin((other + twist) / 2) / np.sin((other - twist) / 2)
    q = np.array([turn, 2 * np.arctan(ratio / np.tan(turn / 2)), -turn])
    robot = cp.Robot("bennett", model, postures={"closed": q})
    return cp.Scene(robot, [cp.Loop("end", "bearing", "hinge", axis="z")])


def trammel(length: float = 1.0, leans: float = 0.7) -> cp.Scene:
    """A rod between two slides at right angles, and a crank to its middle: three rows of rank 2."""
    model, origin = pin.Model(), pin.SE3.Identity()
    slider = model.addJoint(0, pin.JointModelPX(), origin, "slider")
    model.appendBodyToJoint(slider, pin.Inertia(0.5, np.zeros(3), 0.01 * np.eye(3)), origin)
    rod = model.addJoint(slider, pin.JointModelRY(), origin, "rod")
    model.appendBodyToJoint(rod, bar(length), origin)
    crank = model.addJoint(0, pin.JointModelRY(), origin, "crank")
    model.appendBodyToJoint(crank, bar(length / 2), origin)
    frame(model, "tip", rod, moved(length))
    frame(model, "middle", rod, moved(length / 2))
    frame(model, "crank_tip", crank, moved(length / 2))
    q = np.array([length * np.cos(leans), np.pi + leans, -leans])
    guide = cp.constraints.PlanarContact("tip", normal=(1, 0, 0), height=0.0)
    pinned = cp.Loop("middle", "crank_tip", "planar", axis="y")
    return cp.Scene(cp.Robot("trammel", model, postures={"closed": q}), [guide, pinned])


def three_cranks(length: float = 0.5, apart: float = 0.4, turn: float = 0.6) -> cp.Scene:
    """A bar on three equal cranks that stay parallel: four rows of rank 3."""
    model, cranks = pin.Model(), []
    for k in range(3):
        crank = model.addJoint(0, pin.JointModelRY(), moved(k * apart), f"crank{k}")
        model.appendBodyToJoint(crank, bar(length), pin.SE3.Identity())
        cranks.append(crank)
        if not k:
            coupler = model.addJoint(crank, pin.JointModelRY(), moved(length), "bar")
            model.appendBodyToJoint(coupler, bar(2 * apart), pin.SE3.Identity())
    loops = []
    for k in (1, 2):
        frame(model, f"on_bar{k}", coupler, moved(k * apart))
        frame(model, f"on_crank{k}", cranks[k], moved(length))
        loops.append(cp.Loop(f"on_bar{k}", f"on_crank{k}", "planar", axis="y"))
    q = np.array([turn, -turn, turn, turn])
    return cp.Scene(cp.Robot("three_cranks", model, postures={"closed": q}), loops)


def cart_with_a_door(open_by: float = 0.0, precision: float | None = None) -> cp.Scene:
    """A door nailed to its cart at its edge: three rows, of which one counts at every opening."""
    model, origin = pin.Model(), pin.SE3.Identity()
    cart = model.addJoint(0, pin.JointModelPX(), origin, "cart")
    model.appendBodyToJoint(cart, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), origin)
    door = model.addJoint(cart, pin.JointModelRZ(), origin, "door")
    middle = np.array([0.3, 0.0, 0.0])
    model.appendBodyToJoint(door, pin.Inertia(1.0, middle, 0.1 * np.eye(3)), origin)
    frame(model, "post", cart, moved(0.5))
    frame(model, "edge", door, moved(0.5))
    more = {} if precision is None else {"precision": precision}
    robot = cp.Robot("cart", model, postures={"closed": np.array([0.0, open_by])}, **more)
    return cp.Scene(robot, [cp.Loop("post", "edge")])


def with_kind(robot: cp.Robot, kind: str) -> cp.Scene:
    """A robot whose loops are all of one kind."""
    return cp.Scene(
        robot,
        [cp.Loop(x.frame_a, x.frame_b, kind, axis=axis_of(kind), name=x.name) for x in robot.loops],
    )


def on_feet(robot: cp.Robot) -> cp.Scene:
    """Cassie with loops and two points under each foot."""
    feet = ("left-foot", "right-foot")
    points = [
        cp.PointContact(foot, offset=(x, 0.0, 0.0), name=f"{foot}{x:+}")
        for foot in feet
        for x in (-0.05, 0.05)
    ]
    return cp.Scene(robot, [*robot.loops, *points])


def on_eight_points(robot: cp.Robot) -> cp.Scene:
    """Talos on the four corners of either sole: 24 rows of rank 12."""
    return cp.Scene(robot, [point for sole in robot.contacts[:2] for point in sole.corners()])


@functools.cache
def machines() -> dict[str, cp.Scene]:
    """Every machine, by name."""
    four_bar, load = cp.load_robot("four_bar"), cp.load_robot
    ends = ("coupler_tip", "rocker_tip")
    cassie, bricard = load("cassie"), load("bricard")
    return {
        **{name: bennett(*shape) for name, shape in BENNETTS.items()},
        "trammel": trammel(),
        "three cranks": three_cranks(),
        "bricard": cp.Scene(bricard, bricard.loops),
        "cassie": cp.Scene(cassie, cassie.loops),
        "cassie on its feet": on_feet(cassie),
        "delta, hinges": with_kind(load("delta"), "hinge"),
        "stewart, hinges": with_kind(load("stewart"), "hinge"),
        "talos on eight points": on_eight_points(load("talos")),
        **{
            f"four_bar, {kind}": cp.Scene(four_bar, [cp.Loop(*ends, kind, axis=axis_of(kind, "y"))])
            for kind in ("ball", "hinge", "planar")
        },
        "cart with a door": cart_with_a_door(),
    }


def state_near(
    scene: cp.Scene, noise_q: float, noise_v: float, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Configuration, velocity and torques, off the constraints by some noise [rad, m; and per s].

    The posture of a machine with one freedom is closed by construction; others are sampled.
    """
    rng = np.random.default_rng(seed)
    robot, nv = scene.robot, scene.robot.nv
    q, v = scene.state() if nv <= 4 else scene.sample(rng)
    v = cp.mechanism.project_velocity(scene, q, rng.normal(size=nv))
    q = pin.integrate(robot.model, q, noise_q * rng.normal(size=nv))
    return q, v + noise_v * rng.normal(size=nv), rng.normal(size=nv)
