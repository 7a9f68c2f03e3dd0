"""Mechanisms whose motion is known in closed form, or from the literature to many digits."""

from __future__ import annotations

import inspect

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, relative, robot

import condyn_pin as cp
from condyn_pin.model.mechanisms import MECHANISMS
from condyn_pin.model.mechanisms.machine import mechanism

GRAVITY = 9.81


def loops_of(loaded: cp.Robot) -> cp.Scene:
    return cp.Scene(loaded, loaded.loops)


def rank(scene: cp.Scene, q: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(cp.Workspace(scene).jacobian(q), tol=1e-9))


# The registry


def test_each_mechanism_is_a_public_function_and_a_robot_by_name():
    for name, build in MECHANISMS.items():
        assert getattr(cp.model, name) is build
        assert cp.load_robot(name) == build()
        assert build().source == "built in condyn_pin/model/mechanisms"
        assert all(
            (p.kind is p.KEYWORD_ONLY or p.name == "n") and p.default is not p.empty
            for p in inspect.signature(build).parameters.values()
        )


@pytest.mark.long
def test_two_mechanisms_of_one_name_are_refused():
    def chain() -> cp.Robot:
        raise AssertionError

    with pytest.raises(cp.InvalidArgument, match="a mechanism named chain exists"):
        mechanism(chain)
    assert MECHANISMS["chain"] is cp.model.chain


@pytest.mark.long
@each_row("value", [0, -1, 1.5, "two", None, True, np.nan])
def test_counts_are_whole_numbers(value):
    for make in (cp.model.chain, cp.model.n_four_bar):
        with pytest.raises(cp.InvalidArgument, match=r"^n = .*a whole number of at least 1"):
            make(n=value)


@pytest.mark.long
@each_row("value", [0, -1.0, np.nan, np.inf, "long", None, True])
def test_lengths_and_masses_are_positive_numbers(value):
    for make in (cp.model.chain, cp.model.n_four_bar, cp.model.pendulum):
        for argument in ("length", "mass"):
            with pytest.raises(cp.InvalidArgument, match=rf"^{argument} = .*a positive number"):
                make(**{argument: value})


# N-four-bar: ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta)


def parallel(n: int, theta: float) -> np.ndarray:
    """Cranks at theta, couplers level."""
    return np.array([theta, *([-theta, theta] * n)])


@pytest.mark.values
@pytest.mark.parametrize("n", [1, 2, 10, 40])
@pytest.mark.parametrize("theta", [1.5707963, 0.8, 2.9])
def test_n_four_bar_moves_as_its_equation_says(n, theta):
    length, speed = 0.7, -1.3
    scene = loops_of(cp.model.n_four_bar(n=n, length=length, mass=2.5))
    assert (scene.rows, scene.nominal.rank, scene.nominal.mobility) == (3 * n, 2 * n, 1)
    q, v = parallel(n, theta), parallel(n, speed)
    a = cp.solve(scene, q, v, np.zeros(2 * n + 1), solver=cp.dynamics.Reference()).a
    wanted = -((n + 1) / 2 + n) * GRAVITY / length * np.cos(theta) / ((n + 1) / 3 + n)
    assert relative(a, parallel(n, wanted)) < 1e-9 * n**2


@pytest.mark.long
def test_the_size_of_a_mechanism_may_stand_first():
    assert cp.model.n_four_bar(3) == cp.model.n_four_bar(n=3)
    assert cp.model.chain(5) == cp.model.chain(n=5)


@pytest.mark.long
def test_n_four_bar_starts_as_the_benchmark_does():
    """1.5 J at -1 rad/s."""
    bar = robot("n_four_bar")
    q, _ = loops_of(bar).state("square")
    v = parallel(2, -1.0)
    assert np.abs(cp.Workspace(loops_of(bar)).jacobian(q) @ v).max() < 1e-15
    energy = pin.computeKineticEnergy(bar.model, bar.model.createData(), q, v)
    assert energy == pytest.approx(1.5, rel=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 2, 5])
def test_n_four_bar_gains_n_degrees_of_freedom_when_flat(n):
    scene = loops_of(cp.model.n_four_bar(n=n))
    assert rank(scene, scene.state("square")[0]) == 2 * n
    assert rank(scene, scene.state("flat")[0]) == n


# Chain


@pytest.mark.parametrize("n", [10, 30, 100])
def test_condition_of_a_chain(n):
    assert cp.Scene(cp.model.chain(n=n)).nominal.condition == pytest.approx(4.1 * n**4, rel=0.1)


@pytest.mark.parametrize("posture", ["hanging", "straight"])
def test_a_chain_of_one_is_a_rod(posture):
    """theta'' = -(3 g / 2 L) cos(theta)."""
    scene = cp.Scene(cp.model.chain(n=1, length=0.4, mass=3.0))
    q, v = scene.state(posture)
    a = cp.solve(scene, q, v, [0.0]).a
    assert a[0] == pytest.approx(-1.5 * GRAVITY / 0.4 * np.cos(q[0]), abs=1e-12)


@pytest.mark.long
def test_a_chain_that_hangs_stays():
    scene = cp.Scene(robot("chain"))
    q, v = scene.state("hanging")
    assert np.abs(cp.solve(scene, q, v, 0 * v).a).max() < 1e-9


# Parallelogram and five-bar


def test_parallelogram_moves_as_a_pendulum():
    """The coupler shifts only: (2 I + m L^2) theta'' = -(2 m_crank / 2 + m) g L cos(theta)."""
    scene = loops_of(robot("parallelogram"))
    L, crank, coupler, radius = 0.3, 0.6, 1.0, 0.01
    inertia = crank * (3 * radius**2 + L**2) / 12 + crank * L**2 / 4
    q, v = scene.state("home")
    a = cp.solve(scene, q, v, 0 * v).a
    wanted = -(crank + coupler) * GRAVITY * L * np.cos(np.pi / 3)
    wanted /= 2 * inertia + coupler * L**2
    assert relative(a, wanted * np.array([1, -1, 1])) < 1e-12


@pytest.mark.long
def test_parallelogram_is_singular_when_flat():
    scene = loops_of(robot("parallelogram"))
    assert rank(scene, scene.state("home")[0]) == 2
    assert rank(scene, scene.state("flat")[0]) == 1


@pytest.mark.long
def test_five_bar_reaches_where_its_readme_says():
    bar = robot("five_bar")
    data = bar.model.createData()
    joint, placement = bar.frame("tip_a")
    for posture, height in (("home", 0.3968119), ("upright", 0.4828427)):
        pin.forwardKinematics(bar.model, data, loops_of(bar).state(posture)[0])
        tip = (data.oMi[joint] * placement).translation
        assert np.allclose(tip, [0, 0, height], atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "axis"), [("five_bar", "y"), ("parallelogram", "y"), ("andrews", "z")]
)
def test_planar_pins_close_the_same_loops_without_redundant_rows(name, axis):
    loaded = robot(name)
    balls = loops_of(loaded)
    pins = cp.Scene(
        loaded, [cp.Loop(loop.frame_a, loop.frame_b, "planar", axis=axis) for loop in loaded.loops]
    )
    assert (pins.rows, pins.nominal.rank) == (2 * len(loaded.loops), balls.nominal.rank)
    assert not pins.nominal.redundant
    for seed in range(3):
        q, v = balls.sample(np.random.default_rng(seed))
        one, two = (
            cp.solve(s, q, v, 0 * v, solver=cp.dynamics.Reference()).a for s in (balls, pins)
        )
        assert relative(one, two) < 1e-11


# Stewart and Delta: the platform keeps level, as drawn


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "posture", "height"),
    [("stewart", "home", 0.6), ("stewart", "lifted", 0.7), ("delta", "home", -0.3128898)],
)
def test_platforms_are_level(name, posture, height):
    loaded = robot(name)
    q, _ = loops_of(loaded).state(posture)
    assert np.abs(q - loaded.postures[posture]).max() < 1e-14
    data = loaded.model.createData()
    pin.forwardKinematics(loaded.model, data, q)
    joint, placement = loaded.frame("platform")
    platform = data.oMi[joint] * placement
    assert np.allclose(platform.rotation, np.eye(3), atol=1e-12)
    assert platform.translation[2] == pytest.approx(height, abs=1e-7)


@pytest.mark.long
def test_delta_only_shifts_its_platform():
    delta = robot("delta")
    scene = loops_of(delta)
    joint, _ = delta.frame("platform")
    data = delta.model.createData()
    for seed in range(3):
        q, v = scene.sample(np.random.default_rng(seed))
        pin.forwardKinematics(delta.model, data, q, v)
        turning = pin.getVelocity(delta.model, data, joint, pin.LOCAL).angular
        assert np.abs(turning).max() < 1e-9


# Bricard, IFToMM A04: sin b = -sin a / (1 + sin a)


@pytest.mark.long
@pytest.mark.parametrize(("a", "inertia"), [(0.0, 5.01), (np.pi / 2, 1.8379166666666667)])
def test_bricard_has_the_inertia_of_the_benchmark(a, inertia):
    bricard = robot("bricard")
    workspace = cp.Workspace(loops_of(bricard))
    b = np.arcsin(-np.sin(a) / (1 + np.sin(a)))
    db = -np.cos(a) / ((1 + np.sin(a)) ** 2 * np.cos(b))
    q, along = np.array([a, b, a, b, a]), np.array([1, db, 1, db, 1])
    assert np.abs(workspace.violation(q)).max() < 1e-15
    assert np.abs(workspace.jacobian(q) @ along).max() < 1e-15
    assert along @ workspace.terms(q, 0 * q).M @ along == pytest.approx(inertia, rel=1e-14)
    if a == 0:
        energy = pin.computePotentialEnergy(bricard.model, bricard.model.createData(), q)
        assert energy == pytest.approx(-29.43, rel=1e-14)


@pytest.mark.long
@each_row("a", [0.0, 0.5, 1.2, 2.0, 3.1])
def test_bricard_is_redundant_everywhere(a):
    b = np.arcsin(-np.sin(a) / (1 + np.sin(a)))
    assert rank(loops_of(robot("bricard")), np.array([a, b, a, b, a])) == 4


@pytest.mark.long
def test_bricard_with_a_hinge_moves_as_with_two_points():
    """5 rows of rank 4, the same rows as the 6 of two points."""
    bricard = robot("bricard")
    two_points = loops_of(bricard)
    joint, _ = bricard.frame("rod5")
    data = bricard.model.createData()
    pin.forwardKinematics(bricard.model, data, bricard.postures["home"])
    end = data.oMi[joint] * pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    hinged = bricard.with_frame("end", "rod5", [1.0, 0.0, 0.0])
    hinged = hinged.with_frame("ground", "base", end.translation, end.rotation)
    hinge = cp.Scene(hinged, [cp.Loop("end", "ground", "hinge", axis="z")])
    assert (hinge.rows, hinge.nominal.rank, hinge.nominal.mobility) == (5, 4, 1)
    for seed in range(3):
        q, v = two_points.sample(np.random.default_rng(seed))
        tau = np.array([3.0, 0, 0, 0, 0])
        wanted = cp.solve(two_points, q, v, tau, solver=cp.dynamics.Reference()).a
        assert (
            relative(cp.solve(hinge, q, v, tau, solver=cp.dynamics.Reference()).a, wanted) < 1e-10
        )


# Andrews' mechanism, IFToMM A03: order beta, theta, gamma, phi, delta, omega, epsilon

ANDREWS = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
# At 0.03 s: q, v and a of an integration in extended precision, right to 15 digits
Q_003 = (
    1.581077119515370628e01, -1.575637105841183845e01, 4.082224011964579699e-02,
    -5.347301163420796078e-01, 5.24409965879954069e-01, 5.347301163420796077e-01,
    1.048080741041937873e00,
)  # fmt: skip
V_003 = (
    1.139920302259105845e03, -1.424379295177539814e03, 1.103291191061835987e01,
    1.929337410503163186e01, 5.735699148294903731e-01, -1.929337410503163186e01,
    3.231791492491237849e-01,
)  # fmt: skip
A_003 = (
    -2.463176312287382132e04, 5.185031963646296957e04, 3.241026007075785143e05,
    5.667494220009951673e05, 1.674363541834544661e04, -5.667494220009951674e05,
    9.826507801544138879e03,
)  # fmt: skip


def squeezer_torque(andrews: cp.Robot, q: np.ndarray) -> np.ndarray:
    """0.033 N m on beta, and the spring of 4530 N/m, 77.85 mm long at rest."""
    model, data = andrews.model, andrews.model.createData()
    end, anchor = (model.getFrameId(name) for name in ("spring_end", "spring_anchor"))
    axes = pin.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(model, data, q, end, axes)[:3]
    pin.framesForwardKinematics(model, data, q)
    stretch = data.oMf[end].translation - data.oMf[anchor].translation
    length = np.linalg.norm(stretch)
    tau = -4530 * (length - 0.07785) / length * (J.T @ stretch)
    tau[model.joints[model.getJointId("beta")].idx_v] += 0.033
    return tau


def in_tree(andrews: cp.Robot, values: tuple[float, ...]) -> np.ndarray:
    """Numbers in the order of the literature, put in the order of the tree."""
    return np.array([values[ANDREWS.index(name)] for name in andrews.joints])


@pytest.mark.long
def test_andrews_starts_as_in_the_literature():
    andrews = robot("andrews")
    q, v = loops_of(andrews).state("start")
    assert q[andrews.joints.index("beta")] == pytest.approx(-0.0617138900142764496, rel=1e-15)
    solution = cp.solve(loops_of(andrews), q, v, squeezer_torque(andrews, q))
    wanted = in_tree(andrews, (14222.4439199541, -10666.8329399655, 0, 0, 0, 0, 0))
    assert relative(solution.a, wanted) < 1e-11
    force = solution.world_forces["K2_K3"]
    assert np.allclose(force, [-98.5668703962410896, 6.12268834425566265, 0], atol=1e-9)
    for name in ("K2_K4", "K2_K6"):
        assert np.abs(solution.forces[name]).max() < 1e-9


def test_andrews_accelerates_as_in_the_literature():
    andrews = robot("andrews")
    scene = loops_of(andrews)
    q, v = in_tree(andrews, Q_003), in_tree(andrews, V_003)
    assert np.abs(cp.Workspace(scene).violation(q)).max() < 1e-15
    a = cp.solve(scene, q, v, squeezer_torque(andrews, q)).a
    assert relative(a, in_tree(andrews, A_003)) < 1e-11


# Bodies that fly and hit


@pytest.mark.long
def test_a_ball_and_a_box_are_solid():
    ball, box = cp.model.free_ball(mass=2.0, radius=0.3), cp.model.free_box(mass=3.0)
    np.testing.assert_allclose(ball.model.inertias[1].inertia, 0.4 * 2.0 * 0.09 * np.eye(3))
    np.testing.assert_allclose(box.model.inertias[1].inertia, 3.0 * 0.08 / 12 * np.eye(3))
    long = cp.model.free_box(mass=12.0, size=(1.0, 2.0, 3.0)).model.inertias[1].inertia
    np.testing.assert_allclose(np.diag(long), [13.0, 10.0, 5.0])
    assert ball.postures["resting"][2] == 0.3
    assert box.postures["resting"][2] == 0.1
    for size in ((1.0, 1.0), (1.0, 0.0, 1.0), "box"):
        with pytest.raises(cp.InvalidArgument, match="size"):
            cp.model.free_box(size=size)


@pytest.mark.parametrize(("theta", "friction"), [(np.arctan(2.0), 1.5), (0.9, 0.4)])
def test_the_tip_of_the_rod_is_pushed_down_by_a_force_up(theta, friction):
    length, mass, speed = 2.0, 1.5, 0.7
    rod = cp.model.painleve_rod(length=length, mass=mass)
    q = np.array([0.0, length / 2 * np.sin(theta), theta])
    v = np.array([-1.0, length / 2 * np.cos(theta) * speed, speed])  # the tip slides on z = 0
    data = rod.model.createData()
    frame = rod.model.getFrameId("tip")
    pin.computeJointJacobians(rod.model, data, q)
    pin.updateFramePlacements(rod.model, data)
    J = pin.getFrameJacobian(rod.model, data, frame, pin.LOCAL_WORLD_ALIGNED)[[0, 2]]
    np.testing.assert_allclose((J @ v)[1], 0.0, atol=1e-15)
    np.testing.assert_allclose(data.oMf[frame].translation, [-np.cos(theta), 0, 0], atol=1e-15)
    N = 4.0
    a = pin.aba(rod.model, data, q, v, J.T @ [friction * N, N])
    pin.forwardKinematics(rod.model, data, q, v, a)
    ahead = pin.getFrameClassicalAcceleration(rod.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    cos, sin = np.cos(theta), np.sin(theta)
    A = 1 + 3 * cos**2 - 3 * friction * sin * cos
    b = GRAVITY - length / 2 * sin * speed**2
    assert mass * ahead.linear[2] == pytest.approx(A * N - mass * b, rel=1e-6)
    assert friction < 1.4 or pytest.approx(-0.2) == A


# Several robots as one


def test_robots_together_move_as_they_do_alone():
    parts = {"one": robot("four_bar"), "two": robot("solo12"), "three": robot("four_bar")}
    all_three = cp.model.together(parts)
    assert all_three.joints[:2] == tuple(f"one/{name}" for name in parts["one"].joints[:2])
    assert all_three.mass == pytest.approx(sum(part.mass for part in parts.values()))
    assert [loop.name for loop in all_three.loops] == [
        f"{name}/{loop.name}" for name, part in parts.items() for loop in part.loops
    ]
    assert all_three.actuated[0] == f"one/{parts['one'].actuated[0]}"
    scenes = [cp.Scene(part, part.loops) for part in parts.values()]
    whole = cp.Scene(all_three, all_three.loops)
    rng = np.random.default_rng(4)
    states = [scene.sample(rng) for scene in scenes]
    taus = [rng.normal(size=scene.robot.nv) for scene in scenes]
    q, v = (np.concatenate(each) for each in zip(*states, strict=True))
    a = cp.solve(whole, q, v, np.concatenate(taus), solver=cp.dynamics.Reference()).a
    alone = [
        cp.solve(scene, *state, tau, solver=cp.dynamics.Reference()).a
        for scene, state, tau in zip(scenes, states, taus, strict=True)
    ]
    assert relative(a, np.concatenate(alone)) < 1e-12


def test_robots_together_keep_every_number():
    cassie = robot("cassie")
    both = cp.model.together({"a": cassie, "b": cassie})
    for name in ("armature", "damping", "lowerPositionLimit", "effortLimit", "rotorInertia"):
        numbers = getattr(cassie.model, name)
        np.testing.assert_array_equal(getattr(both.model, name), [*numbers, *numbers])
    np.testing.assert_array_equal(both.postures["standing"], [*cassie.postures["standing"]] * 2)
    assert both.springs[len(cassie.springs)].joint == f"b/{cassie.springs[0].joint}"
    assert {c.frames for c in both.contacts} == {
        (f"{side}/{frame}",) for side in "ab" for c in cassie.contacts for frame in c.frames
    }
    assert both.frame("b/left-foot")[0] == cassie.frame("left-foot")[0] + len(cassie.joints)


def test_what_are_no_robots_is_refused():
    other = pin.Model(robot("pendulum").model)
    other.gravity.linear = np.zeros(3)
    for robots, words in (
        ({}, "robots by their names"),
        ([robot("pendulum")], "robots by their names"),
        ({"a": "pendulum"}, r"robots\['a'\] = 'pendulum'"),
        ({"a": robot("pendulum"), "b": cp.Robot("b", other)}, r"robots\['b'\]: its gravity is"),
    ):
        with pytest.raises(cp.InvalidArgument, match=words):
            cp.model.together(robots)
