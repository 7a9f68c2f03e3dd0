"""Compiled ticks of a `Hierarchy`: the answers of Python, which does what is in doubt.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.typing import NDArray
from test_native_control import BASES, CONES, IN_CORE, OCTAGON, assert_same, pair, scene_of

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled_tick
from condyn_pin.control import (
    Actuation,
    CenterOfMass,
    ContactForce,
    ControlLimits,
    ControlStatus,
    FrameTask,
    Hierarchy,
    JointTask,
    Orientation,
    Posture,
)
from condyn_pin.control.compiled import tick_arrays
from condyn_pin.lab.hierarchies import HIERARCHIES
from condyn_pin.mechanism import project_velocity, rods_as_distances

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [
    pytest.mark.native, pytest.mark.once,
    pytest.mark.skip("the core yields to the regularisation: its levels are refused by name"),
]  # fmt: skip
pytest.importorskip("proxsuite")
pytest.importorskip("daqp")

Array = NDArray[np.float64]

# Forces that the regularisation alone decides are off by 1e-16 of what the tasks above miss, over
# 1e-5: on Talos these are hundreds of rad/s^2 where limits are met.
SAME = {"solo12": 1e-8, "talos": 1e-7, "cassie": 1e-8}


@functools.cache
def made(name: str) -> tuple[cp.Scene, cp.contact.Cone]:
    """Return where a robot stands; Cassie with rods that are distances.

    A rod that spins has 1e-7 of the inertia of the robot, which is on the edge of what counts as
    a row of its own: those ticks are Python's.
    """
    if name != "cassie":
        return scene_of(name), CONES[name]
    ladder = HIERARCHIES[name]
    scene = ladder.top()
    for each in ladder.models[:2]:
        scene = each.make(scene)
    rods = [f"{side}-pitch-rod-joint" for side in ("left", "right")]
    return rods_as_distances(scene, rods), OCTAGON


def states_of(name: str, count: int, speed: float) -> list[tuple[Array, Array]]:
    scene, _ = made(name)
    q0, _ = scene.state()
    found, rng = [], np.random.default_rng(4)
    for _ in range(count):
        q, v = scene.sample(rng, spread=0.02, speed=speed)
        if name == "cassie":
            q, v = q0, project_velocity(scene, q0, v)
        found.append((q, v))
    return found


def foot_of(name: str) -> tuple[str, float]:
    """Return the name of a contact, and its share of the weight [N]."""
    scene, _ = made(name)
    feet = [contact.name for contact in scene.constraints if contact.presses]
    return feet[0], scene.robot.mass * 9.81 / len(feet)


def stand(name: str, **com) -> Hierarchy:
    return Hierarchy([CenterOfMass(kp=20, **com), Orientation(BASES[name])], [Posture(weight=0.1)])


def strict(name: str, **com) -> Hierarchy:
    return Hierarchy([CenterOfMass(kp=20, **com)], [Orientation(BASES[name])], [Posture()])


def forces(name: str, **com) -> Hierarchy:
    foot, weight = foot_of(name)
    force = ContactForce(foot, (0.0, 0.0, 0.8 * weight), weight=1e-2)
    return Hierarchy(*stand(name, **com).levels, [force])


def all_forces(name: str, **com) -> Hierarchy:
    """Two levels, of which the second is forces alone."""
    *motion, force = forces(name, **com).levels
    return Hierarchy([task for level in motion for task in level], force)


def compare(
    name: str, tasks: Hierarchy, states: list[tuple[Array, Array]], **options
) -> tuple[int, int]:
    """Return how many ticks the core has answered as Python, and how many miss the first task."""
    scene, cone = made(name)
    python, core = pair(scene, tasks, cone, **options)
    answered = limited = 0
    for q, v in states:
        mine, yours = python.solve(q, v), core.solve(q, v)
        if yours.path == IN_CORE:
            assert_same(mine, yours, SAME[name])
            answered += 1
            limited += np.abs(yours.errors["CenterOfMass"]).max() > 0.1
        else:
            assert yours.status is mine.status
    return answered, limited


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("levels", [stand, strict, all_forces, forces])
def test_random_states_are_answered_as_by_python(name, levels):
    answered, _ = compare(name, levels(name), states_of(name, 20, 0.05))
    assert answered > (4 if levels is all_forces else 15)


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("levels", [stand, strict, forces])
def test_limits_that_a_level_meets_hold_for_those_below(name, levels):
    """Thrown about until feet and motors give no more; in corners, as of soles, Python is asked."""
    answered, limited = compare(name, levels(name), states_of(name, 20, 0.5))
    assert answered >= limited >= {"solo12": 3, "talos": 0, "cassie": 0}[name]


def test_corners_in_which_others_could_be_active_are_left_to_python():
    """A foot without force: which faces of its cone stay equations hangs on which were found."""
    scene, cone = made("solo12")
    rng = np.random.default_rng(0)
    states = [scene.sample(rng, spread=0.05, speed=1.0) for _ in range(119)][-9:]
    push = CenterOfMass(a=(6.0, 0.0, -2.0))
    tasks = Hierarchy([push], [Orientation(BASES["solo12"]), Posture(weight=0.1)])
    python, core = pair(scene, tasks, cone)
    paths = set()
    for q, v in states:
        mine, yours = python.solve(q, v), core.solve(q, v)
        paths.add(yours.path == IN_CORE)
        if yours.path == IN_CORE:
            assert_same(mine, yours, SAME["solo12"])
    assert paths == {True, False}


def arm(*, levels: list[list], joints: int = 3, **options):
    made = cp.model.chain(joints)
    given = {"limits": ControlLimits(torque=False), "actuation": Actuation(made, made.joints)}
    return pair(cp.Scene(made), Hierarchy(*levels), {}, **(given | options))


def swayed(name: str, levels, ticks: int) -> int:
    """Return how many ticks of a motion the core answers; each of them is compared."""
    scene, cone = made(name)
    q, v = scene.state()
    com, dt = cp.control.balance(scene, q, v, v, np.zeros(scene.rows)).com, 1e-3

    def sway(t: float) -> tuple[Array, Array, Array]:
        way, omega = np.array([0.01, 0.015, -0.005]), 6.0
        turn = omega * t
        return (
            com + way * (1 - np.cos(turn)), way * omega * np.sin(turn),
            way * omega**2 * np.cos(turn),
        )  # fmt: skip

    python, core = pair(scene, levels(name, reference=sway), cone, drift=cp.Baumgarte.critical(50))
    answered = 0
    for k in range(ticks):
        mine, yours = python.solve(q, v, k * dt), core.solve(q, v, k * dt)
        assert yours.status is mine.status is ControlStatus.OK
        if yours.path == IN_CORE:
            assert_same(mine, yours, SAME[name])
            answered += 1
        v = v + dt * yours.a
        q = pin.integrate(scene.robot.model, q, dt * v)
    return answered


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("levels", [stand, strict, all_forces])
def test_a_motion_in_closed_loop_is_that_of_python(name, levels):
    """Which ticks are left to Python hangs on rounding; most are not."""
    assert swayed(name, levels, 200) > 150


def test_a_level_begins_from_its_own_active_set():
    scene, cone = made("solo12")
    (q, v), *_ = states_of("solo12", 1, 0.05)
    python, core = pair(scene, strict("solo12", a=(6.0, 0.0, -2.0)), cone)
    first, again = core.solve(q, v), core.solve(q, v)
    assert first.path == again.path == IN_CORE
    assert first.active == again.active == python.solve(q, v).active
    assert first.iterations > again.iterations == 0


@pytest.mark.parametrize(
    ("bend", "path"), [(0.3, True), (1e-3, True), (1e-6, False), (2e-7, False), (0.0, True)]
)
def test_ranks_at_their_edge_are_left_to_python(bend, path):
    """An arm that is nearly straight: its tip hardly moves along it."""
    tip, q = cp.model.chain(3).frames[-1], np.array([0.4, bend, 0.0])
    first = FrameTask(tip, a=(0.1, 0.2, 0.3))
    python, core = arm(levels=[[first], [Posture(q + 0.1, joints=("joint0", "joint2"))]])
    mine, yours = python.solve(q, np.zeros(3)), core.solve(q, np.zeros(3))
    assert (yours.path == IN_CORE) is path
    if path:
        assert_same(mine, yours, 1e-9)


@pytest.mark.parametrize(("beyond", "path"), [(30.0, True), (1.0, False), (0.1, True)])
def test_multipliers_at_their_edge_are_left_to_python(beyond, path):
    """Two joints that want more than they may: by 1000 rad/s^2, and by a share of that."""
    first, second, third = cp.model.chain(3).joints
    python, core = arm(
        levels=[
            [JointTask(first, a=1001.0), JointTask(second, a=1.0 + beyond)],
            [JointTask(third, a=0.3)],
        ],
        limits=ControlLimits(torque=False, acceleration=1.0),
    )
    q, v = np.array([0.3, 0.4, -0.5]), np.zeros(3)
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert (yours.path == IN_CORE) is path
    assert np.abs(mine.a - yours.a).max() < 1e-8
    assert yours.a == pytest.approx([1.0, 1.0, 0.3], abs=1e-4)


def test_levels_of_equations_and_levels_that_are_left_nothing():
    made = cp.model.chain(3)
    first, second, _ = made.joints
    hard = JointTask(first, a=1.0, weight=np.inf)
    every = Posture(joints=made.joints)
    again = JointTask(second, a=5.0)
    q, v = np.array([0.3, 0.4, -0.5]), np.array([0.1, -0.2, 0.3])
    for levels in (
        [[hard], [every]],  # a level without rows of its own
        [[every, hard], [again]],
        [[every], [again], [hard]],
        [[every]],
    ):
        python, core = arm(levels=levels)
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert_same(mine, yours)


def test_levels_that_contradict_themselves_are_told_as_by_python():
    scene, cone = made("solo12")
    (q, v), *_ = states_of("solo12", 1, 0.05)
    falls = CenterOfMass(a=(0.0, 0.0, -15.0), weight=np.inf)
    python, core = pair(scene, Hierarchy([falls], [Posture()]), cone)
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert mine.status is yours.status is ControlStatus.INFEASIBLE
    assert str(mine.infeasible) == str(yours.infeasible)


def test_levels_that_do_not_fit_are_refused_at_the_border():
    scene, cone = made("solo12")
    core = pair(scene, forces("solo12"), cone)[1]
    arrays = tick_arrays.of_program(core._program, 1e-5)
    assert arrays["levels"] == [6, 12, 3]
    for levels in ([], [6, 12, 4], [6, 12, -3], [6, 2]):
        with pytest.raises(ValueError, match="level"):
            compiled_tick().Tick(**(arrays | {"levels": levels}))
    q, v = scene.state()
    numbers, out = core._tick._references.at(0.0), np.zeros(core._tick._size)
    whole, sides = compiled_tick().Tick(**arrays), np.zeros(3 * len(core.rows), np.int8)
    whole.solve(q, v, 0 * v, numbers, sides, out)
    with pytest.raises(ValueError, match="sides"):
        whole.solve(q, v, 0 * v, numbers, sides[1:].copy(), out)
