"""Judge random contact steps by the laws alone, with geometry and balances of their own.

    python benchmarks/contact_judge.py [--steps 20000] [--derivatives 5000] [--seed 0]

Free balls, capsules and boxes, on planes that lean and on each other, are put near each other at
random, deep ones among them, and take one step. Of the answer only q+, v+ and its status are read.
From them, by formulas of this file,

    gaps             no contact closes further than it was, and none that was open ends closed
    momentum         m (V+ - V) = m g dt + sum P,    L+ - L = sum r x P
    Coulomb's law    P in the cones of what touches at the end; along -slip where that slides

have to be met: impulses that do so are sought by nonnegative least squares. A step is wrong that is
ok and for which there are none, within what a step of order 1 leaves, (turn + travel / size) of the
momenta, and what the lever of deep contacts leaves open, depth / size. What is neither ok nor has a
notice is counted too.

Derivatives of steps, along random directions of q, v and tau, are held against differences of
steps, where no contact is about to change its mode. Prints the worst of each.
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import script
from scipy.optimize import nnls
from script import Printed

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Capsule, FrictionalContact, Plane

GRAVITY = np.array([0.0, 0.0, -9.81])
SIDES = 48
FAN = np.linspace(-1.0, 1.0, 5)  # directions beside -slip, in units of what a step turns it by

# What a step may miss: paths that bend are followed to 0.1 mm, as documented [m]; and a share of
# all momenta, in units of how far bodies turn and travel within it [1].
MISSES = 1e-4
ORDER_1 = 4.0

# Steps on both sides of a state that are differenced [rad, m, rad/s, m/s, N, N m], what differences
# are off by, relative, and margins of modes from which on no contact changes its own between them.
SPAN = 3e-8
DIFFERENCED = 1e-4
MARGIN = 1e-3
OFF_KINKS = 3e-5  # [m, rad]

# Depth from which two bodies have no one place where they meet [m], and how often bodies are put
# elsewhere for it. Steps [s].
TOO_DEEP, TRIES = 0.02, 20
STEPS = (5e-4, 1e-3, 2e-3)


@dataclass(frozen=True)
class Solid:
    """A free body: a segment of balls, or a box."""

    mass: float  # [kg]
    radius: float  # [m], 0 of a box
    half_length: float  # [m], along z, 0 of a ball
    half: np.ndarray  # (3,) of a box [m]

    @property
    def inertia(self) -> pin.Inertia:
        """About its centre."""
        if self.radius == 0.0:
            return pin.Inertia.FromBox(self.mass, *(2 * self.half))
        if self.half_length:
            return pin.Inertia.FromCapsule(self.mass, self.radius, 2 * self.half_length)
        return pin.Inertia.FromSphere(self.mass, self.radius)

    @property
    def shape(self) -> Any:
        """As contacts have it."""
        if self.radius == 0.0:
            return Box(*self.half)
        return Capsule(self.radius, self.half_length) if self.half_length else Ball(self.radius)

    @property
    def size(self) -> float:
        """From its centre to what is furthest away [m]."""
        return float(self.radius + self.half_length or np.linalg.norm(self.half))

    def points(self) -> list[tuple[np.ndarray, float]]:
        """Points with radii whose distances to a plane are those of the solid."""
        if self.radius == 0.0:
            signs = np.array(np.meshgrid(*3 * [[-1, 1]])).reshape(3, -1).T
            return [(x, 0.0) for x in signs * self.half]
        ends = {0.0} if not self.half_length else {-self.half_length, self.half_length}
        return [(np.array([0.0, 0.0, z]), self.radius) for z in sorted(ends)]


@dataclass(frozen=True)
class Meeting:
    """Where two bodies are nearest: one is pushed along n, the other, -1 the world, against it."""

    pair: int
    one: int
    two: int
    gap: float
    at: np.ndarray
    n: np.ndarray


@dataclass(frozen=True)
class World:
    """Solids and the pairs that may touch: (body, plane) or (ball, body)."""

    solids: list[Solid]
    planes: list[tuple[np.ndarray, float]]
    pairs: list[tuple[int, int, float]]  # (body, plane as -1 - index or body, friction)
    scene: cp.Scene

    def meetings(self, poses: list[pin.SE3]) -> Iterator[Meeting]:
        """Yield where the pairs meet, in one order."""
        for k, (one, two, _) in enumerate(self.pairs):
            if two < 0:
                n, height = self.planes[-1 - two]
                for x, radius in self.solids[one].points():
                    c = poses[one].act(x)
                    gap = float(n @ c) - height - radius
                    yield Meeting(k, one, -1, gap, c - (radius + gap / 2) * n, n)
                continue
            centre, radius = poses[one].translation, self.solids[one].radius
            distance, foot, n = nearest(self.solids[two], poses[two], centre)
            gap = distance - radius
            yield Meeting(k, one, two, gap, foot + gap / 2 * n, n)


def nearest(solid: Solid, pose: pin.SE3, point: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Signed distance of a point to a solid, the foot on its surface, and the normal there."""
    x = pose.actInv(point)
    if solid.radius:
        axis = np.array([0.0, 0.0, np.clip(x[2], -solid.half_length, solid.half_length)])
        length = float(np.linalg.norm(x - axis))
        n = (x - axis) / length
        foot, distance = axis + solid.radius * n, length - solid.radius
    elif (np.abs(x) <= solid.half).all():
        i = int((solid.half - np.abs(x)).argmin())
        n = np.zeros(3)
        n[i] = np.copysign(1.0, x[i])
        foot, distance = x.copy(), float(np.abs(x[i]) - solid.half[i])
        foot[i] = n[i] * solid.half[i]
    else:
        foot = np.clip(x, -solid.half, solid.half)
        distance = float(np.linalg.norm(x - foot))
        n = (x - foot) / distance
    return distance, pose.act(foot), pose.rotation @ n


def draw(rng: np.random.Generator) -> World:
    """Return one to four solids, of 0.1 to 10 kg, and what they may touch."""
    solids = []
    for _ in range(rng.integers(1, 5)):
        mass, kind = float(10 ** rng.uniform(-1, 1)), rng.integers(3)
        sizes = rng.uniform(0.05, 0.2, size=3)
        solids.append(
            Solid(mass, 0.0, 0.0, sizes)
            if kind == 0
            else Solid(mass, float(sizes[0]), float(sizes[1]) if kind == 1 else 0.0, sizes)
        )
    lean = rng.normal(scale=0.3, size=2) * (rng.random() < 0.5)
    floor = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
    planes = [(floor, 0.0)]
    if rng.random() < 0.3:
        wall = np.array([1.0, *rng.normal(scale=0.3, size=2)])
        planes.append((wall / np.linalg.norm(wall), -0.5))
    pairs = []

    def friction() -> float:
        return float(rng.choice([0.0, 0.3, 0.8, rng.uniform(0, 1.2)]))

    for i, solid in enumerate(solids):
        pairs += [(i, -1 - j, friction()) for j in range(len(planes))]
        if solid.radius == 0.0 or solid.half_length:
            continue
        for j, other in enumerate(solids):
            if j != i and not (j > i and other.radius and not other.half_length):
                pairs.append((i, j, friction()))
    return made(solids, planes, pairs)


def made(solids: list[Solid], planes: list[Any], pairs: list[tuple[int, int, float]]) -> World:
    """Return the world of solids and planes of which some pairs may touch."""
    model, contacts = pin.Model(), []
    for i, solid in enumerate(solids):
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"joint {i}")
        model.appendBodyToJoint(joint, solid.inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"body {i}", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    for one, two, friction in pairs:
        what: dict[str, Any]
        if two < 0:
            normal, height = planes[-1 - two]
            what = {"on": Plane(normal=tuple(normal), height=height)}
        else:
            what = {"on": f"body {two}", "on_shape": solids[two].shape}
        contacts.append(
            FrictionalContact(
                f"body {one}", solids[one].shape, **what, friction=friction, name=f"{one} on {two}"
            )
        )
    return World(solids, planes, pairs, cp.Scene(cp.Robot("world", model), contacts=contacts))


def poses_of(q: np.ndarray) -> list[pin.SE3]:
    """Return the poses of all bodies."""
    return [pin.XYZQUATToSE3(x) for x in q.reshape(-1, 7)]


def place(world: World, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Bodies near the floor, some near each other, some a little inside."""
    q = []
    for i, solid in enumerate(world.solids):
        R = pin.Quaternion(*(x / np.linalg.norm(x) for x in [rng.normal(size=4)])).matrix() \
            if rng.random() < 0.6 else np.eye(3)  # fmt: skip
        n = world.planes[0][0]
        if rng.random() < 0.4:  # flat
            R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), n).matrix()
        pose = pin.SE3(R, np.array([0.45 * (i % 2), 0.45 * (i // 2), 0.0]))
        low = min(float(n @ pose.act(x)) - r for x, r in solid.points())
        gap = float(rng.choice([0.0, 1e-4, -1e-4, rng.uniform(-5e-3, 2e-2)]))
        pose.translation += (gap - low) * n
        q.append(pose)
    for one, two, _ in world.pairs:
        if two >= 0 and rng.random() < 0.6:  # the ball goes to the other body
            away = rng.normal(size=3)
            away[2] = abs(away[2])
            x = q[two].translation + away / np.linalg.norm(away)
            for _ in range(40):
                distance, _, n = nearest(world.solids[two], q[two], x)
                x = x - (distance - world.solids[one].radius) * n
            _, _, n = nearest(world.solids[two], q[two], x)
            q[one].translation = x + float(rng.choice([0.0, 1e-4, -1e-3])) * n
    v = rng.normal(size=6 * len(q)) * rng.choice([0.0, 0.3, 1.0, 3.0])
    return np.concatenate([pin.SE3ToXYZQUAT(pose) for pose in q]), v


def velocities(poses: list[pin.SE3], v: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """V and omega of each body, in the world."""
    return [
        (pose.rotation @ x[:3], pose.rotation @ x[3:])
        for pose, x in zip(poses, v.reshape(-1, 6), strict=True)
    ]


def rate(meeting: Meeting, poses: list[pin.SE3], moving: list[Any]) -> np.ndarray:
    """Velocity of one body against the other where they meet."""
    s = np.zeros(3)
    for body, sign in ((meeting.one, 1.0), (meeting.two, -1.0)):
        if body >= 0:
            V, w = moving[body]
            s += sign * (V + np.cross(w, meeting.at - poses[body].translation))
    return s


def faults(world: World, q: np.ndarray, v: np.ndarray, q1: np.ndarray, v1: np.ndarray, dt: float):
    """What laws the step breaks: how far gaps close too much [m], and a share of the momenta."""
    start, end = poses_of(q), poses_of(q1)
    before, after = velocities(start, v), velocities(end, v1)
    turn = max(np.linalg.norm(w) * dt for _, w in (*before, *after))
    travel = max(
        np.linalg.norm(V) * dt / s.size
        for (V, _), s in zip((*before, *after), 2 * world.solids, strict=True)
    )
    ends, begins = list(world.meetings(end)), list(world.meetings(start))
    deepest = max((-each.gap for each in begins), default=0.0)
    lever = max(deepest, 0.0) / min(solid.size for solid in world.solids)
    loose = min(1.0, ORDER_1 * (turn + travel) + lever)
    fastest = turn / dt
    closed = max((min(b.gap, 0.0) - e.gap for b, e in zip(begins, ends, strict=True)), default=0.0)
    generators, n_bodies = [], len(world.solids)
    middle = [0.5 * (a.translation + b.translation) for a, b in zip(start, end, strict=True)]
    reach = MISSES + 0.2 * dt + loose * 1e-3
    for b, e in zip(begins, ends, strict=True):
        if e.gap > (reach if b.gap < 0 else MISSES + loose * 1e-4):
            continue
        mu, s = world.pairs[e.pair][2], rate(e, end, after)
        tangent = s - (s @ e.n) * e.n
        slip = float(np.linalg.norm(tangent))
        t1 = np.cross(e.n, [1.0, 0.0, 0.0] if abs(e.n[0]) < 0.9 else [0.0, 1.0, 0.0])
        t1 /= np.linalg.norm(t1)
        t2 = np.cross(e.n, t1)
        speed = max(
            float(np.linalg.norm(V) + world.solids[body].size * np.linalg.norm(w))
            for moving in (before, after)
            for body, (V, w) in enumerate(moving)
            if body in {e.one, e.two}
        )
        blurred = 1e-6 + 2.0 * fastest * abs(b.gap) + 0.5 * loose * speed
        if mu == 0.0:
            directions = [e.n]
        elif slip > 3 * blurred:
            t1, t2 = tangent / slip, np.cross(e.n, tangent / slip)
            angles = np.arcsin(min(1.0, blurred / slip)) * FAN
            directions = [e.n - mu * (np.cos(a) * t1 + np.sin(a) * t2) for a in angles]
        else:
            angles = 2 * np.pi * np.arange(SIDES) / SIDES
            wide = mu / np.cos(np.pi / SIDES)
            directions = [e.n + wide * (np.cos(a) * t1 + np.sin(a) * t2) for a in angles]
            directions.append(e.n)
        for d in directions:
            column = np.zeros((n_bodies, 6))
            for body, sign in ((e.one, 1.0), (e.two, -1.0)):
                if body >= 0:
                    column[body, :3] += sign * d
                    column[body, 3:] += sign * np.cross(e.at - middle[body], d)
            generators.append(column)
    change, weight = np.zeros((n_bodies, 6)), np.zeros((n_bodies, 6))
    for i, solid in enumerate(world.solids):
        (V0, w0), (V1, w1) = before[i], after[i]
        I0, I1 = (p.rotation @ solid.inertia.inertia @ p.rotation.T for p in (start[i], end[i]))
        change[i, :3] = solid.mass * (V1 - V0 - dt * GRAVITY)
        change[i, 3:] = I1 @ w1 - I0 @ w0
        weight[i, :3], weight[i, 3:] = 1.0, 1.0 / solid.size
    b = (weight * change).ravel()
    moved = sum(
        s.mass * (np.linalg.norm(V) + s.size * np.linalg.norm(w) + dt * 9.81)
        for s, (V, w) in zip(2 * world.solids, (*before, *after), strict=True)
    )
    if generators:
        A = np.array([(weight * column).ravel() for column in generators]).T
        left = nnls(A, b, maxiter=100 * A.shape[1])[1]
    else:
        left = float(np.linalg.norm(b))
    return closed, left / moved, loose


def states(seed: int, count: int, of_each: int) -> Iterator[tuple[str, World, Any, Any, float]]:
    """Yield worlds and states of them with a time step, none too deep, each with its name."""
    for k in range(-(-count // of_each)):
        rng = np.random.default_rng([seed, k])
        world = draw(rng)
        for j in range(min(of_each, count - k * of_each)):
            for _ in range(TRIES):
                q, v = place(world, rng)
                if min(each.gap for each in world.meetings(poses_of(q))) > -TOO_DEEP:
                    yield f"scene {k}, state {j}", world, q, v, float(rng.choice(STEPS))
                    break


def judge_steps(seed: int, count: int) -> int:
    """Judge steps; return how many are wrong."""
    counted, wrong, slowest, begun = Counter[str](), 0, 0.0, time.process_time()
    worst_gap = worst_law = 0.0
    for name, world, q, v, dt in states(seed, count, 20):
        before = time.process_time()
        try:
            step = cp.step(world.scene, q, v, dt=dt)
        except cp.errors.CondynError as error:
            counted[type(error).__name__] += 1
            continue
        finally:
            slowest = max(slowest, time.process_time() - before)
        counted[step.status.name.lower()] += 1
        if not step.status.ok:
            counted["without a word"] += not step.notices
            continue
        closed, law, loose = faults(world, q, v, step.q, step.v, dt)
        worst_gap, worst_law = max(worst_gap, closed), max(worst_law, law / (1e-6 + loose))
        told = bool(step.notices)
        counted["with a notice"] += told
        if closed > MISSES and not told:
            wrong += 1
            print(f"{name}: a gap closes by {closed:.2e} m more than it may")
        if law > 1e-6 + loose:
            wrong += 1
            print(f"{name}: no legal impulses, {law:.1e} of the momenta is left")
    print(", ".join(f"{n} {what}" for what, n in counted.items()))
    print(
        f"steps: worst gap {worst_gap:.1e} m, laws {worst_law:.2f} of what order 1 leaves; slowest "
        f"{1e3 * slowest:.0f} ms, mean {1e3 * (time.process_time() - begun) / count:.1f} ms with "
        f"the judgement; wrong: {wrong}"
    )
    return wrong + counted["without a word"]


def judge_derivatives(seed: int, count: int) -> int:
    """Hold derivatives against differences; return how many are wrong."""
    counted, wrong, worst = Counter[str](), 0, 0.0
    exact = cp.StewartTrinkle(contact=cp.contact.SemismoothNewton())
    for name, world, q, v, dt in states(seed, count, 20):
        rng, n, model = np.random.default_rng(seed), len(v), world.scene.robot.model
        # off gaps of 0, and of dt, from which on pushes are as fast as they may be: kinks
        q = pin.integrate(model, q, OFF_KINKS * rng.normal(size=n))

        def end(t: float) -> tuple[Any, np.ndarray]:
            moved = pin.integrate(model, q, t * along[:n])  # noqa: B023  used here
            step = cp.step(
                world.scene, moved, v + t * along[n : 2 * n], t * along[2 * n :],  # noqa: B023
                dt=dt, integrator=exact,  # noqa: B023
            )  # fmt: skip
            return step, step.v

        along = rng.normal(size=3 * n)
        (step, _), (before, v_before), (after, v_after) = end(0.0), end(-SPAN), end(SPAN)
        if not step.status.ok:
            counted["not ok"] += 1
            continue
        try:
            found = step.derivatives()
        except cp.errors.CondynError as error:
            counted[type(error).__name__] += 1
            continue
        if (
            found.one_sided
            or found.margin < MARGIN
            or not step.modes == before.modes == after.modes
        ):
            counted["near another mode"] += 1
            continue
        counted["compared"] += 1
        told = np.hstack([found.dv_dq, found.dv_dv, found.dv_dtau])
        difference = (v_after - v_before) / (2 * SPAN)
        size = float(np.abs(told * along).sum(axis=1).max())
        off = float(np.abs(told @ along - difference).max()) / size
        worst = max(worst, off)
        if off > DIFFERENCED:
            wrong += 1
            print(f"{name}: the derivative is off by {off:.1e} of itself")
    print(", ".join(f"{n} {what}" for what, n in counted.items()))
    print(f"derivatives: worst {worst:.1e} of themselves; wrong: {wrong}")
    return wrong


def judge(given: Namespace) -> int:
    """Judge, and print what is wrong; 1 if anything is."""
    wrong = judge_steps(given.seed, given.steps)
    wrong += judge_derivatives(given.seed, given.derivatives)
    return int(wrong > 0)


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--derivatives", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=0)


SUBJECTS = [Printed("contact_judge", "random steps judged by laws alone", judge, _options)]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
