"""Answers, derivatives and motions of many states by the compiled core: those of Python.

A table of scenes has rows of every kind, each verb goes through it. `test_native.py` has what both
promise to the bit, and the border of the core.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from overconstrained import machines, state_near
from shared import all_scenes, robot
from test_applied_forces import chain_on
from test_driven import floating_box
from test_spring_dampers import SPRINGS

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.constraints import (
    Coupling,
    Driven,
    HeldJoint,
    KnifeEdge,
    Polynomial,
    RollingBall,
    Sine,
    analytic,
)
from condyn_pin.dynamics import DenseKKT, NullSpace, Status
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.scene import motor_torque
from condyn_pin.dynamics.workspace import default_solver
from condyn_pin.model import SpringDamper
from condyn_pin.simulation import derivatives_batch

pytestmark = pytest.mark.native

# Motions carry rounding on, step by step.
MOVED = 1e-9
# Behind a step the core closes loops by all rows, Python by those that are kept: with redundant
# rows they differ by the square of the gap that the step has left, up to 1.5e-7 on Cassie.
CLOSED = 3e-7
AT = 0.37  # [s], of scenes that are driven
N = 6

# Scenes of rods, gears, sliders, planes, edges and of what rolls: by another method than Python's,
# so that answers agree to rounding. Of a sleigh the joint is refused.
DIRECT = (
    "rolling_ball contacts", "rolling_disc contacts", "unicycle contacts", "four_bar rod",
    "four_bar geared", "talos hands on a rod", "talos hands on a slider", "talos hand on a beam",
    "talos on edges and planes", "talos arms geared",
)  # fmt: skip


def near(found: np.ndarray, wanted: np.ndarray, share: float) -> bool:
    """Whether they differ by a share of the largest number, or of 1, at most."""
    size = max(1.0, float(np.abs(wanted).max(initial=0.0)))
    return float(np.abs(found - wanted).max(initial=0.0)) <= share * size


def both(verb: Callable, *about: object, threads: int = 2, **how: object) -> tuple:
    """The answer of the core, and that of Python."""
    return verb(*about, **how, executor=cp.Native(threads=threads)), verb(*about, **how)


def by_core(workspace: cp.Workspace, states: tuple) -> tuple[dict, np.ndarray]:
    """What the core answers, and the states that it does not."""
    count, nv, rows = len(states[0]), workspace.scene.robot.nv, workspace.scene.rows
    outputs = {
        "a": np.zeros((count, nv)), "lam": np.zeros((count, rows)),
        "residuals": np.zeros((count, 5)), "statuses": np.zeros(count, np.int8),
        "iterations": np.zeros(count, np.int32), "solve_times": np.zeros(count),
    }  # fmt: skip
    left = workspace.compiled.solve(states, outputs, accuracy=None, threads=1)
    return outputs, left


def left_to_python(scene: cp.Scene, states: tuple, solver: cp.dynamics.Solver | None = None):
    """The states that the core does not answer."""
    return by_core(cp.Workspace(scene, solver), states)[1]


def states_of(scene: cp.Scene, count: int = N, seed: int = 5) -> tuple[np.ndarray, ...]:
    """States that are closed and move, under torques."""
    rng = np.random.default_rng(seed)

    def torque() -> np.ndarray:
        return (
            rng.normal(size=scene.robot.nv) if scene.is_driven else motor_torque(scene.robot, rng)
        )

    states = [(*scene.sample(rng), torque()) for _ in range(count)]
    return tuple(map(np.array, zip(*states, strict=True)))


def moved_off(scene: cp.Scene, q: np.ndarray, size: float) -> np.ndarray:
    rng = np.random.default_rng(0)
    moves = size * rng.normal(size=(len(q), scene.robot.nv))
    return np.array(
        [pin.integrate(scene.robot.model, *each) for each in zip(q, moves, strict=True)]
    )


# Scenes: driven rows


def crank() -> cp.Scene:
    bar = cp.model.four_bar()
    home = bar.postures["open"][0]
    return cp.Scene(bar, [*bar.loops, Driven(HeldJoint("crank", home), Sine(0.3, 0.7))])


def cylinder() -> cp.Scene:
    rod = Driven(cp.Loop("tool", "world", "rod", length=0.4), Sine(0.05, 2.0, offset=-0.1))
    return cp.Scene(floating_box(), [rod])


def point() -> cp.Scene:
    path = Sine((0.2, 0.1, 0.3), (1.0, 2.0, 0.5), (0.0, 1.0, 2.0))
    return cp.Scene(floating_box(), [Driven(cp.Loop("tool", "world"), path)])


def hand_past_hand() -> cp.Scene:
    """A ball loop of two moving bodies, beside feet that stand."""
    talos = robot("talos")
    path = Polynomial(((0.3, 0.1, 0, 0.2), (0, -0.2, 0.3, 0), (0.1, 0, 0, 0)))
    hands = cp.Loop("gripper_left_base_link", "gripper_right_base_link")
    return cp.Scene(talos, [*talos.contacts, Driven(hands, path)])


def slide() -> cp.Scene:
    pinned = cp.Loop("tool", "world", "planar", axis="y", name="slide")
    path = Polynomial(((0.1, 0.2, 0, 0.3), (0.3, -0.1, 0, 0.2)))
    return cp.Scene(floating_box(), [Driven(pinned, path)])


def gear() -> cp.Scene:
    geared = Driven(Coupling("FL_KFE", "FR_KFE", 1.0), Sine(0.1, 1.5))
    held = Driven(HeldJoint("HL_KFE", 1.2), analytic(lambda t: 0.2 * np.exp(-t) * np.sin(3 * t)))
    return cp.Scene(robot("solo12"), [geared, held])


def belt() -> cp.Scene:
    floor = RollingBall("centre", 0.1, height=0.0)
    path = Polynomial(((0, 0, 0, 1), (0, 0.1, 0, 0), (0, 0, 0, 0)))
    return cp.Scene(cp.model.rolling_ball(), [Driven(floor, path)])


def disc_on_a_belt() -> cp.Scene:
    disc = cp.model.rolling_disc()
    path = Polynomial(((0, 0.2, 0.5, 0.4), (0, 0.1, 0, 0), (0, 0, 0, 0)))
    return cp.Scene(disc, [Driven(disc.contacts[0], path)])


def blade() -> cp.Scene:
    pushed = Driven(KnifeEdge("tool"), Polynomial((0.0, 0.3, 0.0, 0.4)))
    return cp.Scene(floating_box(), [pushed])


DRIVEN = {
    make.__name__: make
    for make in (crank, cylinder, point, hand_past_hand, slide, gear, belt, disc_on_a_belt, blade)
}


# Scenes: redundant rows, and springs


def redundant_with_a_rod() -> cp.Scene:
    talos = robot("talos")
    left, right = talos.contacts
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    again = cp.SurfaceContact("left_sole_link", name="again")
    return cp.Scene(talos, [left, again, right, cp.Loop(*hands, "rod", length=0.5, name="rod")])


def one_joint_held() -> cp.Scene:
    solo = robot("solo12")
    return cp.Scene(solo, [*solo.contacts[1:], HeldJoint("FL_KFE", -1.0)])


# Branch to branch, branch to body and branch to world; longer and shorter than at rest, and two
# that are a spring alone or a damper alone.
BETWEEN = {
    "four_bar": (
        SpringDamper("world", "coupler_tip", 400.0, 20.0, 0.2),
        SpringDamper("crank_tip", "rocker_tip", 1e3, 1e1),
    ),
    "solo12": (
        SpringDamper("FL_FOOT", "HR_FOOT", 300.0, 8.0, 0.1),
        SpringDamper("FR_LOWER_LEG", "base_link", 500.0, 0.0, 0.6),
        SpringDamper("world", "HL_UPPER_LEG", 0.0, 20.0),
    ),
    "cassie": (
        SpringDamper("left-foot", "right-foot", 800.0, 20.0, 0.05),
        SpringDamper("pelvis", "left-tarsus", 2e3, 30.0, 1.2),
    ),
}


def sprung(scene: cp.Scene) -> cp.Scene:
    """The scene of the same robot with springs between its frames."""
    name = next(name for name in BETWEEN if scene.robot.name.startswith(name))
    return with_springs(scene, *BETWEEN[name])


def with_springs(scene: cp.Scene, *springs: SpringDamper) -> cp.Scene:
    return replace(scene, robot=replace(scene.robot, spring_dampers=springs))


def chain() -> cp.Scene:
    return cp.Scene(replace(chain_on("spherical"), spring_dampers=SPRINGS))


def hands_on_a_cross() -> cp.Scene:
    """A universal joint between two moving bodies, and one to the world."""
    talos = robot("talos")
    left, _ = talos.contacts
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    knee = cp.Loop("world", "leg_right_3_link", "universal", axis="yz", name="knee")
    return cp.Scene(talos, [left, cp.Loop(*hands, "universal", axis="zx"), knee])


def hands_on_a_cylinder() -> cp.Scene:
    talos = robot("talos")
    left, right = talos.contacts
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    return cp.Scene(talos, [left, right, cp.Loop(*hands, "cylindrical", axis="x")])


def cardan() -> cp.Scene:
    """Two shafts of the world, on one cross."""
    model = pin.Model()
    for name, tilt in (("driving", 0.0), ("driven", 0.6)):
        at = pin.SE3(pin.rpy.rpyToMatrix(0.0, tilt, 0.0), np.zeros(3))
        joint = model.addJoint(0, pin.JointModelRX(), at, name)
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.3, 0.1, 0.2), pin.SE3.Identity())
        model.addFrame(
            pin.Frame(f"{name} shaft", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
        )
    return cp.Scene(
        cp.Robot("shafts", model),
        [cp.Loop("driving shaft", "driven shaft", "universal", axis="yz")],
    )


def three_gears() -> cp.Scene:
    """Couplings of many joints, which are answered in Python."""
    model = pin.Model()
    for name in "abc":
        i = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(i, pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3), pin.SE3.Identity())
    gear = Coupling({"a": 30.0, "b": 70.0, "c": -100.0}, name="gear")
    return cp.Scene(cp.Robot("gears", model, actuated=["a", "b"]), [gear])


MADE = {
    make.__name__: make
    for make in (
        redundant_with_a_rod, one_joint_held, chain, three_gears, hands_on_a_cross,
        hands_on_a_cylinder, cardan,
    )
} | DRIVEN  # fmt: skip
FOUR_ROWS = ("hands_on_a_cross", "hands_on_a_cylinder", "cardan")


def scene_of(label: str) -> cp.Scene:
    """By its name; with springs if it ends in them."""
    plain = label.removesuffix(", sprung")
    scene = MADE[plain]() if plain in MADE else all_scenes()[plain]
    return sprung(scene) if label != plain else scene


# Answers and derivatives


def test_every_scene_with_rows_of_other_kinds_is_here():
    solvers = {label: default_solver(scene) for label, scene in all_scenes().items()}
    others = {label for label, solver in solvers.items() if not isinstance(solver, cp.Proximal)}
    assert set(DIRECT) | {"sleigh contacts"} == others


@pytest.mark.parametrize("label", [*DIRECT, *DRIVEN, "one_joint_held", *FOUR_ROWS])
def test_rows_of_every_kind(label):
    """On the constraints, and off them where gains pull; driven rows at a time."""
    scene = scene_of(label)
    of_a, of_lam, of_slopes, of_gaps = 1e-10, 1e-9, 1e-8, 1e-12
    if label == "one_joint_held":
        of_slopes = 1e-9
    if label in DRIVEN:
        scene, (of_a, of_lam, of_slopes, of_gaps) = scene.at(AT), (1e-12, 1e-12, 1e-12, 1e-14)
    q, v, tau = states_of(scene)
    assert not left_to_python(scene, (q, v, tau)).size
    beside = v + 1e-3 * np.random.default_rng(1).normal(size=v.shape)
    off = moved_off(scene, q, 1e-3), beside, tau
    for state, drift in (((q, v, tau), None), (off, cp.Baumgarte(3.0, 20.0))):
        found, wanted = both(cp.solve_batch, scene, *state, drift=drift)
        assert_array_equal(found.statuses, wanted.statuses)
        assert found.ok
        assert near(found.a, wanted.a, of_a)
        assert near(found.lam, wanted.lam, of_lam)
        assert near(found.violation, wanted.violation, of_gaps)
        assert near(found.velocity_violation, wanted.velocity_violation, of_gaps)
        found, wanted = both(derivatives_batch, scene, *state, drift=drift)
        for name in BLOCKS:
            assert near(getattr(found, name), getattr(wanted, name), of_slopes), name


@pytest.mark.parametrize(
    ("label", "solver"),
    [
        ("solo12 contacts", DenseKKT()), ("talos contacts", NullSpace()),
        ("solo12 alone", DenseKKT()), ("solo12 alone", NullSpace()),
        ("redundant_with_a_rod", NullSpace()), ("cassie loops", NullSpace()),
    ],
)  # fmt: skip
def test_direct_solvers(label, solver):
    """Redundant rows get the smallest lam."""
    scene = scene_of(label)
    states = states_of(scene)
    found, wanted = both(cp.solve_batch, scene, *states, solver=solver)
    assert_array_equal(found.statuses, wanted.statuses)
    redundant = bool(scene.nominal.redundant)
    assert near(found.a, wanted.a, 1e-9 if redundant else 1e-10)
    assert near(found.lam, wanted.lam, 1e-8 if redundant else 1e-9)
    assert not left_to_python(scene, states, solver).size
    if redundant:
        found, wanted = both(cp.solve_batch, scene, *states, solver=DenseKKT())
        assert_array_equal(found.statuses, wanted.statuses)
        assert found.statuses.any()


@pytest.mark.parametrize(
    ("label", "frame", "axes"),
    [
        ("solo12 contacts", "FL_FOOT", ("world", "body")),
        ("talos hands on a rod", "gripper_left_base_link", ("body", "world")),
    ],
)
def test_forces_from_outside(label, frame, axes):
    scene, rng = scene_of(label), np.random.default_rng(7)
    states = states_of(scene)
    forces = [
        cp.AppliedForce(frame, rng.normal(size=6) * 20.0, axes[0]),
        cp.AppliedForce("base_link", rng.normal(size=(N, 3)) * 30.0, axes[1]),
    ]
    found, wanted = both(cp.solve_batch, scene, *states, forces=forces, chunk=5)
    assert not near(wanted.a, cp.solve_batch(scene, *states).a, 1e-3)
    assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)
    assert near(found.error_bound, wanted.error_bound, 1e-11)
    found, wanted = both(derivatives_batch, scene, *states, forces=forces)
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-9), name


@pytest.mark.parametrize("label", ["cassie loops", "four_bar rod", "solo12 alone"])
def test_springs_between_frames_count_by_their_torques_alone(label):
    bare, scene = scene_of(label), scene_of(f"{label}, sprung")
    q, v, tau = states_of(scene)
    native = {"executor": cp.Native(threads=1)}
    alone = cp.solve_batch(bare, q, v, tau, **native)
    assert near(cp.solve_batch(scene, q, v, tau, **native).a, alone.a, 1e-10)
    pulled = tau + np.array([scene.robot.passive_torque(*x) for x in zip(q, v, strict=True)])
    found, wanted = both(cp.solve_batch, scene, q, v, pulled)
    assert not near(found.a, alone.a, 1e-3)
    assert near(found.a, wanted.a, 1e-9)


# States off their constraints: which rows count


def assert_rows_near(found: np.ndarray, wanted: np.ndarray, share: float, what: str) -> None:
    """As near as a share of the largest number of each row, or of 1."""
    size = np.maximum(1.0, np.abs(wanted).max(axis=1, initial=0.0))[:, None]
    assert_allclose(found / size, wanted / size, rtol=0, atol=share, err_msg=what)


def assert_answered_alike(scene: cp.Scene, states: tuple, **how: object) -> tuple:
    found, wanted = both(cp.solve_batch, scene, *states, **how)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_rows_near(found.a, wanted.a, 1e-10, "a")
    assert_rows_near(found.lam, wanted.lam, 1e-9, "lam")
    return found, wanted


def batch_near(scene: cp.Scene, noise_q: float, noise_v: float, count: int) -> tuple:
    states = [state_near(scene, noise_q, noise_v, seed) for seed in range(count)]
    return tuple(map(np.array, zip(*states, strict=True)))


@pytest.mark.parametrize("name", machines())
def test_open_states(name):
    """By both kinds of solver, at every size of noise, and in float32."""
    scene = machines()[name]
    small = [batch_near(scene, noise, noise, 3) for noise in (1e-9, 1e-7)]
    large = [batch_near(scene, noise, noise, 3) for noise in (1e-4, 1e-2)]
    rough = [[x.astype(np.float32).astype(float) for x in batch_near(scene, 0.0, 0.0, 2)]]
    states = tuple(np.concatenate(each) for each in zip(*small, *large, *rough, strict=True))
    for solver in (None, NullSpace()):
        _, wanted = assert_answered_alike(scene, states, solver=solver)
        # where noise is larger, what closing changes may have to be computed
        left = left_to_python(scene, states, solver)
        assert not (wanted.statuses[left[left < 6]] == tuple(Status).index(Status.OK)).any()


@pytest.mark.parametrize("name", ["talos on eight points", "cart with a door", "four_bar, ball"])
def test_rows_that_contradict_each_other_carry_the_smallest_forces(name):
    """|J v| of 0.1, where no acceleration satisfies all rows."""
    scene = machines()[name]
    states = batch_near(scene, 0.0, 0.1, 3)
    found, _ = assert_answered_alike(scene, states)
    assert found.velocity_violation.max() > 1e-2
    for state, lam in zip(zip(*states, strict=True), found.lam, strict=True):
        answer = cp.solve(scene, *state)
        assert np.abs(answer._kept.N.T @ lam).max(initial=0.0) <= 1e-9 * np.abs(lam).max()


@pytest.mark.parametrize("name", ["cassie", "bennett", "stewart, hinges", "four_bar, hinge"])
def test_derivatives_of_open_states(name):
    found, wanted = both(
        derivatives_batch, machines()[name], *batch_near(machines()[name], 1e-6, 1e-6, 3)
    )
    for block in BLOCKS:
        assert_rows_near(*(getattr(x, block).reshape(3, -1) for x in (found, wanted)), 1e-8, block)


def test_rows_at_their_word():
    """With a precision of 0 every row counts, in the core as in Python."""
    scene = machines()["cassie"]
    exact = replace(scene, robot=replace(scene.robot, precision=0.0))
    found, wanted = both(cp.solve_batch, exact, *batch_near(scene, 1e-5, 0.0, 3))
    assert_array_equal(found.statuses, wanted.statuses)
    assert_rows_near(found.a, wanted.a, 1e-10, "a")


def test_loops_that_are_open_by_more_and_more():
    scene = scene_of("cassie loops")
    q, v, tau = states_of(scene, 40)
    rng = np.random.default_rng(2)
    for i, scale in enumerate(10.0 ** rng.uniform(-12, -2, len(q))):
        q[i] = pin.integrate(scene.robot.model, q[i], scale * rng.normal(size=v.shape[1]))
    found, wanted = both(cp.solve_batch, scene, q, v, tau)
    assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)


# Motions


STEPS = {
    "semi-implicit": cp.SemiImplicitEuler(),
    "semi-implicit, explicit forces": cp.SemiImplicitEuler(implicit=False),
    "linearly implicit midpoint": cp.simulation.LinearlyImplicitMidpoint(),
    "implicit midpoint": cp.simulation.ImplicitMidpoint(),
    "Runge-Kutta 4": cp.RungeKutta4(),
}
DRIFTS = {
    "none": cp.simulation.NoDrift(),
    "Baumgarte": cp.Baumgarte.critical(60.0),
    "post": cp.simulation.PostStabilization(),
    "post, every third": cp.simulation.PostStabilization(every=3),
}


def starts(scene: cp.Scene, count: int = 3) -> tuple[np.ndarray, ...]:
    """States at which a motion begins, with torques that move it; driven rows move as paths do."""
    now = scene.at(0.0) if scene.is_driven else scene
    q, v, tau = states_of(now, count)
    v = 0.3 * v
    if scene.is_driven:
        v = [cp.mechanism.project_velocity(now, *each) for each in zip(q, v, strict=True)]
    return q, np.array(v), 0.1 * tau


def assert_moved_alike(
    scene: cp.Scene, q: np.ndarray, v: np.ndarray, tau: object = 0.0, *, within: float = MOVED,
    **how: object,
) -> tuple[cp.simulation.BatchTrajectory, cp.simulation.BatchTrajectory]:  # fmt: skip
    """How motions end, their samples, and what is measured along them."""
    found, wanted = both(cp.simulate_batch, scene, q, v, tau, **how)
    assert_array_equal(found.statuses, wanted.statuses)
    assert list(found.reasons) == list(wanted.reasons)
    assert_array_equal(found.t, wanted.t)
    arrays = {"q at the end": (found.q, wanted.q), "v at the end": (found.v, wanted.v)}
    if how.get("record"):
        of = found.samples.arrays
        arrays |= {name: (of[name], its) for name, its in wanted.samples.arrays.items()}
    for name, (one, two) in arrays.items():
        size = max(1.0, float(np.nanmax(np.abs(two), initial=0.0)))
        assert_allclose(one, two, rtol=0, atol=within * size, err_msg=name)
    for name in ("violation", "constraint_velocity", "energy_error"):
        least = 1e-9 if within == MOVED else within * max(1.0, float(np.abs(wanted.v).max()))
        one, two = getattr(found, name), getattr(wanted, name)
        assert_allclose(one, two, rtol=1e-6, atol=least, err_msg=name)
    return found, wanted


def within_of(label: str, drift: str) -> float:
    """Steps leave loops a little open, and redundant rows then are left out by other sums."""
    return CLOSED if label.startswith("cassie") and "post" in drift else MOVED


# Every scene moves by each kind of step; drift goes round, so that each meets every scene and step.
MOVING = (
    "cassie loops", "solo12 contacts", "four_bar rod", "rolling_disc contacts", "crank",
    "four_bar loops, sprung",
)  # fmt: skip
ROUND = [
    (label, steps, list(DRIFTS)[(i + k) % 4])
    for i, label in enumerate(MOVING)
    for k, steps in enumerate(STEPS)
]
OTHERS = [
    ("four_bar loops", "Runge-Kutta 4", "post"),  # by others: test_native.py
    ("unicycle contacts", "implicit midpoint", "Baumgarte"),
    ("unicycle contacts", "semi-implicit", "post"),
    ("talos on edges and planes", "semi-implicit", "Baumgarte"),  # anchored where they begin
    ("talos on edges and planes", "semi-implicit", "post"),
    ("talos arms geared", "semi-implicit", "post, every third"),
    ("redundant_with_a_rod", "semi-implicit", "post"),
    ("gear", "linearly implicit midpoint", "Baumgarte"),
    ("cassie loops, sprung", "implicit midpoint", "post"),
    ("cassie loops, sprung", "semi-implicit", "post, every third"),
    ("cassie loops, sprung", "Runge-Kutta 4", "Baumgarte"),
    ("four_bar rod, sprung", "semi-implicit", "post"),
    ("four_bar rod, sprung", "linearly implicit midpoint", "post, every third"),
    ("four_bar rod, sprung", "implicit midpoint", "Baumgarte"),
    ("solo12 alone, sprung", "linearly implicit midpoint", "none"),
    ("solo12 alone, sprung", "semi-implicit, explicit forces", "none"),
    ("chain", "implicit midpoint", "none"),
    ("chain", "semi-implicit", "none"),
    ("chain", "Runge-Kutta 4", "none"),
    *((label, "Runge-Kutta 4", "post") for label in DRIVEN if label != "crank"),
]


@pytest.mark.parametrize(("label", "steps", "drift"), [*ROUND, *OTHERS])
def test_motions(label, steps, drift):
    scene = scene_of(label)
    how = {"duration": 0.02, "dt": 2e-4, "integrator": STEPS[steps], "drift": DRIFTS[drift]}
    q, v, tau = starts(scene)
    v, tau = (0.3 * v, 0.0 * tau) if label == "redundant_with_a_rod" else (v, tau)
    assert_moved_alike(scene, q, v, tau, **how, record=7, within=within_of(label, drift))


def test_motions_by_a_direct_solver():
    scene = scene_of("solo12 contacts, sprung")
    for steps in STEPS.values():
        how = {"duration": 0.01, "dt": 2e-4, "integrator": steps, "drift": DRIFTS["post"]}
        assert_moved_alike(scene, *starts(scene, 2), **how, solver=DenseKKT())


@pytest.mark.parametrize("name", ["cassie", "bennett", "trammel"])
def test_motions_by_stages_off_the_constraints(name):
    """Runge-Kutta's are open by the square of the step."""
    scene = machines()[name]
    q, v, tau = batch_near(scene, 0.0, 0.0, 2)
    how = {
        "dt": 1e-3, "duration": 0.05, "integrator": cp.RungeKutta4(), "record": 10,
        "solver": None if name == "cassie" else NullSpace(),
        "limits": cp.simulation.MotionLimits(energy=np.inf),
    }  # fmt: skip
    for drift in ("none", "post"):
        how["drift"] = DRIFTS[drift]
        found, wanted = both(cp.simulate_batch, scene, q, 0.05 * v, tau, **how)
        assert_array_equal(found.statuses, wanted.statuses)
        assert wanted.ok
        assert_rows_near(found.q, wanted.q, 1e-9, "q")
        assert_rows_near(found.v, wanted.v, 1e-9, "v")


def test_points_nearly_one_are_anchored_where_a_motion_begins():
    """Pinocchio has them further apart; no motion tells their forces along that line."""
    toes = [cp.PointContact("left_sole_link", (x, 0, 0), name=f"{x}") for x in (0.1, 0.1001)]
    scene = cp.Scene(robot("talos"), toes)
    q, v, _ = states_of(scene, 4, seed=2)
    assert_moved_alike(scene, q, 0.3 * v, duration=0.02, dt=2e-4, drift=DRIFTS["Baumgarte"])


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("steps", ["linearly implicit midpoint", "implicit midpoint"])
def test_a_correction_behind_a_step_with_damping_is_in_the_metric_of_mass_alone(steps, every):
    """In the middle of a step M has the damping ahead; an arm whose tip is on a rod."""
    model, joint = pin.Model(), 0
    for i in range(3):
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * (i > 0)]))
        joint = model.addJoint(joint, pin.JointModelRY(), below, f"hinge {i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.3), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    model.damping[1] = 5.0
    scene = cp.Scene(cp.Robot("arm", model), [cp.Loop("tip", "universe", "rod", length=1.2)])
    q = scene.assemble(np.array([0.3, 0.5, 0.4])).q
    v = cp.mechanism.project_velocity(scene, q, np.array([3.0, -2.0, 4.0]))
    how = {"duration": 0.2, "dt": 5e-3, "integrator": STEPS[steps]}
    how["drift"] = cp.simulation.PostStabilization(every=every)
    assert_moved_alike(scene, q[None], v[None], **how)


@pytest.mark.parametrize(
    "steps", ["semi-implicit", "linearly implicit midpoint", "implicit midpoint"]
)
@pytest.mark.parametrize("label", ["four_bar loops", "four_bar rod"])
def test_stiff_springs(label, steps):
    """A strut that is stretched by a tenth of a millimetre, with a rate of 1e5 / s, at 1 ms."""
    scene = scene_of(label)
    q, v, tau = starts(scene, 1)
    length = np.linalg.norm(scene.robot.frame_pose(q[0], "coupler_tip").translation)
    scene = with_springs(scene, SpringDamper("world", "coupler_tip", 4e7, 2e5, length - 1e-4))
    how = {"duration": 0.05, "dt": 1e-3, "integrator": STEPS[steps], "drift": DRIFTS["post"]}
    how["limits"] = cp.simulation.MotionLimits(energy=np.inf)  # steps damp what they do not follow
    found, wanted = both(cp.simulate_batch, scene, q, 0.01 * v, tau, **how)
    assert wanted.ok
    assert_allclose(found.q, wanted.q, rtol=0, atol=1e-9)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-7 * max(1.0, np.abs(wanted.v).max()))


@pytest.mark.parametrize("label", ["four_bar loops, sprung", "chain"])
def test_energies_of_springs_and_dampers(label):
    scene = scene_of(label)
    q, v, tau = starts(scene, 2)
    found, wanted = both(cp.simulate_batch, scene, q, v, tau, duration=0.2, dt=5e-4, record=1)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-5, atol=1e-10)
    for one, two in zip(found, wanted, strict=True):
        assert np.ptp(two.energy.springs) > 0.1
        assert two.energy.damping[-1] < -1e-3
        assert found.energy_error.max() < 1e-5 * two.energy.scale
        for part in ("springs", "damping"):
            mine, its = getattr(one.energy, part), getattr(two.energy, part)
            assert_allclose(mine, its, rtol=0, atol=1e-8)


@pytest.mark.parametrize("record", [None, 3])
def test_energies_of_drives(record):
    scene = scene_of("crank")
    q, v = (x[None].repeat(3, axis=0) for x in scene.state())
    found, wanted = both(cp.simulate_batch, scene, q, v, duration=0.5, dt=2e-3, record=record)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-6, atol=1e-12)
    if record:
        energy = found[1].energy
        assert np.ptp(energy.driven) > 0.1
        assert np.abs(energy.error).max() == pytest.approx(found.energy_error[1], abs=1e-12)
        assert_allclose(energy.driven, wanted[1].energy.driven, rtol=0, atol=1e-9)


def test_motions_without_samples_are_measured():
    scene = scene_of("cassie loops")
    how = {"duration": 0.1, "dt": 1e-3, "integrator": cp.simulation.LinearlyImplicitMidpoint()}
    found, _ = assert_moved_alike(scene, *starts(scene, 5), **how, within=CLOSED)
    assert found.samples is None
    assert found.run_times.min() > 0


def test_motions_that_break_down_or_cannot_begin_say_what_python_says():
    scene = scene_of("cassie loops")
    q, v, tau = starts(scene, 4)
    v[1] *= 1e4  # it turns too far in a step, or is lost
    q[2] = pin.integrate(scene.robot.model, q[2], np.full(v.shape[1], 0.05))  # open loops
    how = {"duration": 0.05, "dt": 1e-3}  # the damping of its rods is too stiff for Runge-Kutta 4
    found, wanted = both(cp.simulate_batch, scene, q, v, tau, **how, record=5)
    assert wanted.counts.get("failed", 0) + wanted.counts.get("diverged", 0) > 1
    assert_array_equal(found.statuses, wanted.statuses)
    assert list(found.reasons) == list(wanted.reasons)
    assert_array_equal(np.isfinite(found.samples.t), np.isfinite(wanted.samples.t))


def four_bar_along(joint: str, at: float, path: object) -> cp.Scene:
    bar = cp.model.four_bar()
    return cp.Scene(bar, [*bar.loops, Driven(HeldJoint(joint, at), path)])


def path_until(t_end: float, then: Callable) -> Callable:
    path = Sine(0.3, 0.7)
    return lambda t: path(t) if t < t_end else then(t)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (path_until(0.01, lambda t: (np.nan, 0.0, 0.0)), "is not finite"),
        (path_until(0.01, lambda t: (0.0, 0.0)), "three arrays are needed"),
        (path_until(0.01, lambda t: 1 / 0), ZeroDivisionError),
        (Sine(2.0, 0.5), "cannot follow"),  # of the rocker, which does not get there
    ],
    ids=["no number", "another shape", "an error", "out of reach"],
)
def test_a_path_that_ends_on_the_way_ends_the_motion_as_in_python(path, said):
    """After the end of a motion its values do not count."""
    open_ = cp.model.four_bar().postures["open"]
    joint, at = ("rocker", open_[2]) if said == "cannot follow" else ("crank", open_[0])
    scene = four_bar_along(joint, at, path)
    q, v = (x[None] for x in scene.state())
    duration = 1.0 if said == "cannot follow" else 0.02
    if not isinstance(said, str):
        for executor in (None, cp.Native(threads=1)):
            with pytest.raises(said):
                cp.simulate_batch(scene, q, v, duration=duration, executor=executor)
    else:
        found, wanted = both(cp.simulate_batch, scene, q, v, duration=duration)
        assert said in wanted.reasons[0]
        assert list(found.reasons) == list(wanted.reasons)
        assert_array_equal(found.statuses, wanted.statuses)
        assert_array_equal(found.t, wanted.t)
    assert cp.simulate_batch(scene, q, v, duration=8e-3, executor=cp.Native(threads=1)).ok


def test_a_path_that_is_a_function_is_evaluated_on_the_grid_alone():
    """Once at each half step, however many motions and chunks of them there are."""
    times: list[float] = []

    def along(t):
        times.append(t)
        return 0.3 * np.sin(t), 0.3 * np.cos(t), -0.3 * np.sin(t)

    scene = four_bar_along("crank", cp.model.four_bar().postures["open"][0], along)
    q, v = (x[None].repeat(9, axis=0) for x in scene.state())
    how = {"duration": 0.02, "dt": 1e-3}
    times.clear()
    found = cp.simulate_batch(scene, q, v, **how, executor=cp.Native(threads=1), chunk=2)
    late = [t for t in times if t > 0.01]  # what checks a scene looks at its beginning
    assert np.array(sorted(late)) == pytest.approx(0.01 + 5e-4 * np.arange(1, 21), abs=1e-12)
    assert near(found.q, cp.simulate_batch(scene, q, v, **how).q, 1e-12)
