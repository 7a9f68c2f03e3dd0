"""Identities between the paths of the library: what does not matter changes no answer.

Scenes and states are drawn by hypothesis: free balls, capsules and boxes that fall on each other
and on planes (`benchmarks/contact_judge.py`), and robots with loops.
"""

from __future__ import annotations

from dataclasses import replace

import contact_judge as judge
import numpy as np
import pinocchio as pin
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import each_row

import condyn_pin as cp
from condyn_pin.constraints import FrictionalContact, HeldJoint, Plane
from condyn_pin.model import together
from condyn_pin.stepping import step_batch

EXACT = cp.StewartTrinkle(contact=cp.contact.SemismoothNewton())
DT = 1e-3

seeds = st.integers(0, 10_000)


def drawn(
    seed: int, deepest: float = 1e-3, slower: float = 1.0
) -> tuple[judge.World, np.ndarray, np.ndarray]:
    """A world and a state of it whose step has one answer, and contacts that are not deep."""
    rng = np.random.default_rng(seed)
    while True:
        world = judge.draw(rng)
        for _ in range(5):
            q, v = judge.place(world, rng)
            v *= slower
            gaps = [meeting.gap for meeting in world.meetings(judge.poses_of(q))]
            if min(gaps) < -deepest:
                continue
            if cp.step(world.scene, q, v, dt=DT, integrator=EXACT).contact.lam.size == 0:
                continue
            if is_determined(world.scene, q, v):
                return world, q, v


def is_determined(scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> bool:
    """Whether rounding decides nothing of a step: it has one answer, in modes that last."""
    found = cp.step(scene, q, v, dt=DT, integrator=EXACT)
    if not found.status.ok or any("not determined" in notice for notice in found.notices):
        return False
    near = q + 1e-10 * np.sin(np.arange(len(q)))
    near = pin.normalize(scene.robot.model, near)
    other = cp.step(scene, near, v, dt=DT, integrator=EXACT)
    return bool(np.abs(other.v - found.v).max() < 1e-6 * max(1.0, np.abs(found.v).max()))


def same(one: np.ndarray, two: np.ndarray, within: float = 1e-7) -> None:
    np.testing.assert_allclose(one, two, rtol=0, atol=within * max(1.0, np.abs(two).max()))


@given(seeds)
@settings(max_examples=25)
def test_a_step_is_a_row_of_a_batch_and_the_first_of_a_motion(seed):
    world, q, v = drawn(seed)
    alone = cp.step(world.scene, q, v, dt=DT, integrator=EXACT)
    batch = step_batch(world.scene, np.array([q, q]), np.array([v, 0 * v]), dt=DT, integrator=EXACT)
    motion = cp.simulate(world.scene, q, v, duration=DT, dt=DT, integrator=EXACT, close_start=False)
    for q1, v1 in ((batch.q[0], batch.v[0]), (motion.q[1], motion.v[1])):
        same(q1, alone.q, 1e-12)
        same(v1, alone.v, 1e-12)


@given(seeds)
@settings(max_examples=25)
def test_the_order_of_contacts_does_not_matter(seed):
    world, q, v = drawn(seed)
    contacts = list(world.scene.contacts)
    np.random.default_rng(seed).shuffle(contacts)
    other = cp.Scene(world.scene.robot, contacts=contacts)
    one, two = (cp.step(scene, q, v, dt=DT, integrator=EXACT) for scene in (world.scene, other))
    same(one.v, two.v)
    assert one.modes == two.modes


@given(seeds)
@settings(max_examples=25)
def test_the_axes_of_the_world_do_not_matter(seed):
    """Everything turned and shifted, gravity too: velocities in the axes of bodies stay."""
    world, q, v = drawn(seed)
    rng = np.random.default_rng(seed)
    moved = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-3, 3, size=3)), 0.3 * rng.normal(size=3))
    model = pin.Model(world.scene.robot.model)
    model.gravity.linear = moved.rotation @ model.gravity.linear
    contacts = []
    for contact in world.scene.contacts:
        if isinstance(contact.on, Plane):
            normal = moved.rotation @ contact.on.normal
            height = contact.on.height + float(normal @ moved.translation)
            contact = replace(contact, on=Plane(normal=tuple(normal), height=height))
        contacts.append(contact)
    other = cp.Scene(cp.Robot("moved", model), contacts=contacts)
    Q = np.concatenate([pin.SE3ToXYZQUAT(moved * pose) for pose in judge.poses_of(q)])
    one = cp.step(world.scene, q, v, dt=DT, integrator=EXACT)
    two = cp.step(other, Q, v, dt=DT, integrator=EXACT)
    same(one.v, two.v)


@given(seeds, st.sampled_from([0.125, 8.0]), st.sampled_from([1e-2, 1e2]))
@settings(max_examples=25)
def test_units_do_not_matter(seed, length, mass):
    """All lengths times `length`, all masses times `mass`, in the same time.

    But for the speed at which what is deep is pushed out, 0.2 m/s at most, and for how far paths
    that bend may miss, 0.1 mm: bodies are slow.
    """
    world, q, v = drawn(seed, 1.1e-4, 0.1)
    model = pin.Model(world.scene.robot.model)
    model.gravity.linear = length * model.gravity.linear
    for i, inertia in enumerate(world.scene.robot.model.inertias):
        model.inertias[i] = pin.Inertia(
            mass * inertia.mass, length * inertia.lever, mass * length**2 * inertia.inertia
        )
    solids = [
        replace(s, radius=length * s.radius, half_length=length * s.half_length,
                half=length * s.half)
        for s in world.solids
    ]  # fmt: skip
    contacts = []
    for (one, two, _), contact in zip(world.pairs, world.scene.contacts, strict=True):
        contact = replace(contact, shape=solids[one].shape)
        if two < 0:
            contact = replace(contact, on=replace(contact.on, height=length * contact.on.height))
        else:
            contact = replace(contact, on_shape=solids[two].shape)
        contacts.append(contact)
    other = cp.Scene(cp.Robot("other units", model), contacts=contacts)
    Q, V = q.reshape(-1, 7).copy(), v.reshape(-1, 6).copy()
    Q[:, :3] *= length
    V[:, :3] *= length
    one = cp.step(world.scene, q, v, dt=DT, integrator=EXACT)
    two = cp.step(other, Q.ravel(), V.ravel(), dt=DT, integrator=EXACT)
    back = two.v.reshape(-1, 6) / np.array(3 * [length] + 3 * [1.0])
    same(back.ravel(), one.v)


@given(seeds, seeds)
@settings(max_examples=15)
def test_a_scene_is_its_islands_apart(seed, other):
    """Two worlds in one scene, each in the order that it has by itself."""
    parts = {"one": drawn(seed), "two": drawn(other)}
    robot = together({name: world.scene.robot for name, (world, _, _) in parts.items()})
    contacts = []
    for name, (world, _, _) in parts.items():
        for contact in world.scene.contacts:
            on = contact.on if isinstance(contact.on, Plane) else f"{name}/{contact.on}"
            contacts.append(
                replace(contact, frame=f"{name}/{contact.frame}", on=on,
                        name=f"{name} {contact.name}")
            )  # fmt: skip
    both = cp.step(
        cp.Scene(robot, contacts=contacts),
        np.concatenate([q for _, q, _ in parts.values()]),
        np.concatenate([v for _, _, v in parts.values()]),
        dt=DT, integrator=EXACT,
    )  # fmt: skip
    each = [cp.step(w.scene, q, v, dt=DT, integrator=EXACT).v for w, q, v in parts.values()]
    same(both.v, np.concatenate(each))


@given(st.sampled_from(["solo12", "go2", "panda"]), seeds)
@settings(max_examples=20)
def test_a_joint_that_is_held_is_a_joint_that_is_locked(name, seed):
    """In accelerations, and in a step with feet on the floor."""
    robot, rng = cp.load_robot(name), np.random.default_rng(seed)
    joint = str(rng.choice(robot.joints[1:]))
    q = np.array(next(iter(robot.postures.values())))
    held = cp.Scene(robot, [HeldJoint(joint, float(q[robot.index_q(joint)]))])
    small = cp.Scene(robot).lock([joint], q)
    v = rng.normal(scale=0.5, size=robot.nv)
    v[robot.index_v(joint)] = 0.0
    tau = rng.normal(size=robot.nv)
    free = np.delete(np.arange(robot.nv), robot.index_v(joint))
    one = cp.solve(held, q, v, tau)
    two = cp.solve(small, *small.reduce_state(q, v), tau[free])
    same(one.a[free], two.a, 1e-9)


REFUSED = {
    "not finite": (lambda q, v: (q, v * np.nan), DT),
    "a quaternion of no length": (lambda q, v: (q * np.r_[1, 1, 1, 0, 0, 0, 0], v), DT),
    "a size": (lambda q, v: (q, v[:-1]), DT),
    "more than half a turn": (lambda q, v: (q, v + np.r_[0, 0, 0, 0, 4000.0, 0]), DT),
    "no time": (lambda q, v: (q, v), 0.0),
    "time backwards": (lambda q, v: (q, v), -DT),
}


@each_row("what", REFUSED)
def test_what_one_verb_refuses_all_refuse(what):
    box = cp.model.free_box(size=(0.2, 0.2, 0.1))
    ball = FrictionalContact("box", cp.constraints.Ball(0.1), friction=0.5)
    scene = cp.Scene(box, contacts=[ball])
    spoil, dt = REFUSED[what]
    q, v = spoil(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]), np.zeros(6))
    about = {"duration": 2 * DT, "dt": dt, "integrator": EXACT}
    verbs = {
        "step": lambda: cp.step(scene, q, v, dt=dt).status.ok,
        "step_batch": lambda: step_batch(scene, np.array([q]), np.array([v]), dt=dt).ok,
        "simulate": lambda: cp.simulate(scene, q, v, **about).status.ok,
        "simulate_batch": lambda: cp.simulate_batch(
            scene, np.array([q]), np.array([v]), **about
        ).ok,
    }  # fmt: skip
    for name, verb in verbs.items():
        try:
            is_ok = verb()
        except cp.errors.CondynError:
            continue
        assert not is_ok, name
