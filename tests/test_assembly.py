"""Closed configurations: how they are reached, on which branch, and what is said otherwise."""

from __future__ import annotations

import dataclasses
import functools
import math
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shared import CLOSED, all_scenes, each_row, each_scene, robot

import condyn_pin as cp
from condyn_pin.mechanism.closed_chains import chains_of
from lab.extremes.base import with_inertias

CLOSED_CHAINS = [
    n for n in ("cassie", "four_bar", "stewart", "delta") if n in cp.io.available_robots()
]
GROUND, CRANK, COUPLER, ROCKER = 0.7, 0.3, 0.8, 0.6  # of four_bar() [m]


@functools.cache
def loops_of(name: str) -> cp.Scene:
    return cp.Scene(robot(name), robot(name).loops)


def bar_scene(**changes) -> cp.Scene:
    bar = dataclasses.replace(cp.model.four_bar(), **changes)
    return cp.Scene(bar, bar.loops)


def with_limits(scene: cp.Scene, **limits: tuple[float, float]) -> cp.Scene:
    model = pin.Model(scene.robot.model)
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    for joint, (low, high) in limits.items():
        iq = model.joints[model.getJointId(joint)].idx_q
        lower[iq], upper[iq] = low, high
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    return cp.Scene(dataclasses.replace(scene.robot, model=model), scene.constraints)


def gap(scene: cp.Scene, q: np.ndarray) -> float:
    return float(np.abs(cp.Workspace(scene).violation(q)).max(initial=0.0))


def elbow(q: np.ndarray) -> float:
    """Sine of the angle between coupler and rocker: zero where they are in line."""
    return math.sin(q[2] - q[0] - q[1])


# --- how far it reaches


@pytest.mark.parametrize("name", CLOSED_CHAINS)
def test_it_closes_from_random_starts_and_on_the_branch_or_says_that_it_did_not(name):
    """From normally distributed perturbations of 0.2 rad in every joint."""
    scene, model = loops_of(name), robot(name).model
    q, _ = scene.state()
    branch = scene.assemble(q).branch
    assert all(branch.values())
    rng = np.random.default_rng(0)
    found = [
        scene.assemble(
            pin.integrate(model, q, 0.2 * rng.normal(size=model.nv)), branch=branch, throw=False
        )
        for _ in range(100)
    ]
    closed = [assembly for assembly in found if assembly.status.ok]
    assert len(closed) >= 95
    assert np.median([assembly.iterations for assembly in found]) <= 8
    for assembly in closed:
        assert gap(scene, assembly.q) <= CLOSED
        assert assembly.branch == branch
        assert assembly.rank == scene.nominal.rank
    for assembly in found:
        if not assembly.status.ok:
            assert (
                assembly.status is cp.mechanism.AssemblyStatus.BRANCH_CHANGED or not assembly.closed
            )


@pytest.mark.parametrize("name", [name for name in CLOSED_CHAINS if name != "cassie"])
def test_the_same_branch_can_be_driven_to(name):
    """The motors alone, in small strides, lead from the posture to every configuration found."""
    scene, model = loops_of(name), robot(name).model
    q, _ = scene.state()
    motors = [robot(name).index_q(motor) for motor in robot(name).actuated]
    rng = np.random.default_rng(1)
    for _ in range(20):
        start = pin.integrate(model, q, 0.2 * rng.normal(size=model.nv))
        end = scene.assemble(start, branch=chains_of(scene).assembly_mode).q
        driven = cp.mechanism.complete_state(scene, end[motors], near=q).q
        data = [model.createData(), model.createData()]
        for each, where in zip(data, (end, driven), strict=True):
            pin.forwardKinematics(model, each, where)
        for one, other in zip(data[0].oMi, data[1].oMi, strict=True):
            assert np.abs(one.homogeneous - other.homogeneous).max() < 1e-8


@pytest.mark.long
@each_scene
def test_every_scene_is_closed_within_its_limits_or_is_not_called_ok(label):
    scene = all_scenes()[label]
    model = scene.robot.model
    rng = np.random.default_rng(3)
    for spread in (0.2, 0.2, 0.2, 0.6, 1.0):
        start = np.array(pin.integrate(model, scene.nominal.q, spread * rng.normal(size=model.nv)))
        assembly = scene.assemble(start, throw=False)
        assert np.isfinite(assembly.q).all()
        assert assembly.closed == (gap(scene, assembly.q) <= CLOSED)
        assert pin.isNormalized(model, assembly.q, 1e-9)
        if assembly.status.ok:
            assert assembly.closed
            assert not assembly.beyond_limits
            again = scene.assemble(assembly.q)
            assert np.abs(again.q - assembly.q).max() < 1e-9


@pytest.mark.long
def test_bars_in_line_are_left_sideways():
    """All the gap is along the bars, where no joint moves anything at first."""
    scene = bar_scene(postures={})
    start = np.zeros(3)
    J, c = cp.Workspace(scene).jacobian(start), cp.Workspace(scene).violation(start)
    assert np.abs(c).max() > 0.1
    assert np.abs(J.T @ c).max() < 1e-12
    assert scene.assemble(start).closed


# --- fixed joints


@each_row("rocker", [0.2, 0.3, 0.45])
def test_what_cannot_be_reached_ends_at_the_smallest_gap(rocker):
    """The rocker held where crank and coupler together are too short: they end in line."""
    scene = bar_scene()
    tip = np.array([GROUND + ROCKER * math.cos(rocker), ROCKER * math.sin(rocker)])
    short = float(np.hypot(*tip)) - (CRANK + COUPLER)
    assert short > 0
    start = robot("four_bar").postures["open"].copy()
    start[2] = rocker
    with pytest.raises(cp.errors.NotAssembled, match=r"coupler_rocker is open by .* mm") as error:
        scene.assemble(start, fixed=["rocker"])
    assembly = error.value.assembly
    assert assembly.status is cp.mechanism.AssemblyStatus.UNREACHABLE
    assert not assembly.closed
    assert assembly.q[2] == rocker
    assert assembly.violation["coupler_rocker"].length == pytest.approx(short, rel=1e-6)
    assert math.sin(assembly.q[1]) == pytest.approx(0.0, abs=1e-5)
    assert "unreachable" in str(assembly)
    copy = pickle.loads(pickle.dumps(error.value))
    assert str(copy) == str(error.value)
    assert np.array_equal(copy.assembly.q, assembly.q)


def test_random_four_bars_reach_what_trigonometry_says():
    """With the crank held, coupler and rocker meet, or end in line with the smallest gap."""
    rng = np.random.default_rng(7)
    reached = 0
    for _ in range(60):
        ground, crank, coupler, rocker = rng.uniform(0.3, 1.0, 4)
        bar = cp.model.four_bar(ground=ground, crank=crank, coupler=coupler, rocker=rocker)
        scene = cp.Scene(bar, bar.loops)
        start = rng.uniform(-np.pi, np.pi, 3)
        across = math.hypot(ground - crank * math.cos(start[0]), crank * math.sin(start[0]))
        gap_there = max(across - coupler - rocker, abs(coupler - rocker) - across)
        assembly = scene.assemble(start, fixed=["crank"], throw=False)
        assert assembly.closed == (gap_there <= 0)
        reached += assembly.closed
        if gap_there > 0:
            assert assembly.violation["coupler_rocker"].length == pytest.approx(gap_there, abs=1e-5)
            assert assembly.status is cp.mechanism.AssemblyStatus.UNREACHABLE
    assert 20 < reached < 55


# --- dead points and branches


def at_dead_point() -> np.ndarray:
    """Crank and coupler in line: the rocker can drive no further."""
    reach = CRANK + COUPLER
    alpha = math.acos((GROUND**2 + reach**2 - ROCKER**2) / (2 * GROUND * reach))
    tip = reach * np.array([math.cos(alpha), math.sin(alpha)])
    return np.array([alpha, 0.0, math.atan2(tip[1], tip[0] - GROUND)])


def test_a_dead_point_is_told_by_its_singular_value():
    scene, q = bar_scene(actuated=("rocker",)), at_dead_point()
    assembly = scene.assemble(q)
    assert assembly.closed
    assert assembly.smallest_singular_value < 1e-9
    assert assembly.branch == {"coupler_rocker": 0}
    assert assembly.rank == 2  # the linkage itself is not singular: the crank can still drive it
    driven_by_crank = bar_scene().assemble(q)
    assert driven_by_crank.smallest_singular_value > 0.1
    assert abs(driven_by_crank.branch["coupler_rocker"]) == 1


def test_the_sign_changes_across_a_dead_point_and_nowhere_else():
    scene = bar_scene(actuated=("rocker",))
    state = cp.mechanism.complete_state(scene, [at_dead_point()[2] + 0.02])
    signs, angles = [], []
    for crank in at_dead_point()[0] + np.linspace(-0.8, 0.8, 33):
        start = state.q.copy()
        start[0] = crank
        assembly = bar_scene(actuated=("rocker",)).assemble(start, fixed=["crank"], throw=False)
        assert assembly.closed
        signs.append(assembly.branch["coupler_rocker"])
        angles.append(math.sin(assembly.q[1]))
    assert {-1, 1} <= set(signs) <= {-1, 0, 1}
    sides = {sign * np.sign(s) for sign, s in zip(signs, angles, strict=True) if abs(s) > 1e-3}
    assert len(sides) == 1


def mirrored(q: np.ndarray) -> np.ndarray:
    """The other way to close a four-bar with this angle of the crank."""
    crank = CRANK * np.array([math.cos(q[0]), math.sin(q[0])])
    pivot = np.array([GROUND, 0.0])
    tip = pivot + ROCKER * np.array([math.cos(q[2]), math.sin(q[2])])
    axis = (pivot - crank) / np.linalg.norm(pivot - crank)
    across = (tip - crank) - ((tip - crank) @ axis) * axis
    other = tip - 2 * across
    coupler, rocker = (math.atan2(*(other - end)[::-1]) for end in (crank, pivot))
    return np.array([q[0], coupler - q[0], rocker])


def test_the_mirror_image_is_another_branch_and_a_flip_is_not_silent():
    scene = bar_scene()
    q, _ = scene.state()
    home, other = scene.assemble(q).branch, mirrored(q)
    assert gap(scene, other) < 1e-12
    assert home == {"coupler_rocker": 1}
    assert scene.assemble(other).branch == {"coupler_rocker": -1}
    with pytest.raises(cp.errors.BranchChanged, match=r"coupler_rocker: .*dead point") as error:
        scene.assemble(other, fixed=["crank", "coupler", "rocker"], branch=home)
    assembly = error.value.assembly
    assert assembly.closed
    assert assembly.flipped == ("coupler_rocker",)
    copy = pickle.loads(pickle.dumps(error.value))
    assert type(copy) is cp.errors.BranchChanged
    assert np.array_equal(copy.assembly.q, assembly.q)
    assert isinstance(error.value, cp.errors.NotAssembled)  # what callers catch catches this too


@pytest.mark.long
@pytest.mark.parametrize("fixed", [(), ("crank",)])
def test_what_is_called_closed_is_on_the_side_of_the_start(fixed):
    """The angle between coupler and rocker, by trigonometry, keeps its sign; or it is said."""
    scene, statuses, flips = bar_scene(), [], 0
    rng = np.random.default_rng(5)
    for _ in range(200):
        start = rng.uniform(-np.pi, np.pi, 3)
        side = chains_of(scene).branch(cp.Workspace(scene).jacobian(start))
        assembly = scene.assemble(start, fixed=fixed, throw=False)
        statuses.append(assembly.status)
        if assembly.status.ok:
            assert assembly.branch == side
            if abs(elbow(start)) > 1e-3:
                assert elbow(start) * elbow(assembly.q) > 0
        flips += scene.assemble(start, fixed=fixed, branch={}, throw=False).branch != side
    assert statuses.count(cp.mechanism.AssemblyStatus.CLOSED) > 130
    assert fixed or flips > 10
    changed = cp.mechanism.AssemblyStatus.BRANCH_CHANGED
    assert fixed or set(statuses) <= {cp.mechanism.AssemblyStatus.CLOSED, changed}


@pytest.mark.long
def test_loops_that_have_no_side_have_no_branch():
    """What Bricard's loop can move turns with it: no sign tells where its dead points are."""
    scene = loops_of("bricard")
    q, _ = scene.state()
    assert chains_of(scene).clusters
    assert scene.assemble(q).branch == chains_of(scene).assembly_mode == {}
    v = np.random.default_rng(4).normal(size=scene.robot.nv)
    for _ in range(400):
        v = cp.mechanism.project_velocity(scene, q, v, metric="euclidean")
        v /= np.abs(v).max()
        moved = pin.integrate(scene.robot.model, q, 0.01 * v)
        q = scene.assemble(moved, within_limits=False).q
    assert gap(scene, q) < CLOSED
    for name in ("stewart", "delta", "cassie", "four_bar", "parallelogram", "five_bar"):
        assert all(cluster.sided for cluster in chains_of(loops_of(name)).clusters)


@pytest.mark.long
def test_cassies_legs_have_signs_of_their_own():
    scene = loops_of("cassie")
    q, _ = scene.state()
    assembly = scene.assemble(q)
    assert set(assembly.branch) == set(scene.names)
    flipped = q.copy()
    free = ("left-tarsus-crank-joint", "left-crank-rod-joint")
    crank, rod = (robot("cassie").index_q(name) for name in free)
    # the plantar parallelogram of the left leg folded over: crank and rod mirrored
    flipped[crank], flipped[rod] = -q[crank] - 1.0, -q[rod]
    held = [name for name in robot("cassie").joints if name not in free]
    other = scene.assemble(flipped, fixed=held, within_limits=False, throw=False)
    assert other.closed
    changed = [name for name in scene.names if other.branch[name] != assembly.branch[name]]
    assert changed == ["left-plantar-foot-joint"]


@pytest.mark.long
def test_without_motors_there_is_no_branch():
    scene = bar_scene(actuated=())
    assembly = scene.assemble(cp.dynamics.described_posture(scene))
    assert assembly.branch == {}
    assert assembly.smallest_singular_value == pytest.approx(
        np.sort(np.linalg.svd(cp.Workspace(scene).jacobian(assembly.q), compute_uv=False))[1]
    )


# --- the flat parallelogram


def parallelogram() -> cp.Scene:
    bar = cp.model.four_bar(ground=0.6, crank=0.3, coupler=0.6, rocker=0.3)
    bar = dataclasses.replace(bar, postures={"flat": np.zeros(3)})
    return cp.Scene(bar, bar.loops)


@pytest.mark.long
def test_a_flat_parallelogram_is_in_a_dead_point_where_two_branches_start():
    scene = parallelogram()
    assembly = scene.assemble(np.zeros(3))
    assert assembly.status.ok
    assert assembly.rank == 1
    assert assembly.smallest_singular_value < 1e-12
    assert assembly.branch == {"coupler_rocker": 0}
    ends = [scene.assemble([0.3, -0.3 + fold, 0.3 - fold], fixed=["crank"]) for fold in (0.01, 0.7)]
    signs = [end.branch["coupler_rocker"] for end in ends]
    assert signs[0] * signs[1] == -1
    assert np.abs(ends[0].q - [0.3, -0.3, 0.3]).max() < 1e-9
    assert elbow(ends[1].q) * elbow(ends[0].q) < 0


# --- limits


@pytest.mark.long
def test_joints_stay_within_their_limits():
    free = bar_scene()
    q, _ = free.state()
    scene = with_limits(free, crank=(q[0], 3.0), rocker=(-3.0, q[2] + 0.1))
    start = q + np.array([-0.4, 0.0, 0.5])  # both outside
    out = scene.assemble(start, within_limits=False)
    assert out.closed
    assert out.beyond_limits
    assembly = scene.assemble(start)
    assert assembly.closed
    assert q[0] <= assembly.q[0] <= 3.0
    assert assembly.q[2] <= q[2] + 0.1
    assert not assembly.beyond_limits


@pytest.mark.long
def test_a_closure_beyond_the_limits_is_named():
    free = bar_scene()
    q, _ = free.state()
    both = (q, mirrored(q))
    most = max(solution[2] for solution in both)
    scene = with_limits(free, rocker=(most + 0.1, most + 0.5), coupler=(-2.0, 2.0))
    start = q.copy()
    start[2] = most + 0.2
    with pytest.raises(
        cp.errors.NotAssembled, match=r"rocker is .* deg beyond its limits"
    ) as error:
        scene.assemble(start, fixed=["crank"])
    assembly = error.value.assembly
    assert assembly.status is cp.mechanism.AssemblyStatus.BEYOND_LIMITS
    assert most + 0.1 <= assembly.q[2] <= most + 0.5
    assert not assembly.closed
    beyond = [most + 0.1 - solution[2] for solution in both]
    assert min(abs(assembly.beyond_limits["rocker"].angle - by) for by in beyond) < 1e-6
    assert scene.assemble(start, fixed=["crank"], within_limits=False).closed


@pytest.mark.long
def test_a_joint_held_beyond_its_limits_is_refused():
    scene = with_limits(bar_scene(), crank=(0.0, 1.0))
    with pytest.raises(
        cp.InvalidArgument, match=r"fixed: 'crank' is 28\.6 deg .*within_limits=False"
    ):
        scene.assemble([1.5, -0.9, 1.4], fixed=["crank"])
    assert scene.assemble([1.5, -0.9, 1.4], fixed=["crank"], within_limits=False).closed


@pytest.mark.long
def test_infinite_limits_are_none():
    assert chains_of(bar_scene()).limits.joints == ()
    one_sided = with_limits(bar_scene(), crank=(-np.inf, 1.0))
    assert one_sided.check([1.5, 0, 0]).beyond_limits == {"crank": (0.0, 0.5)}
    assert one_sided.check([-1e9, 0, 0]).beyond_limits == {}


@pytest.mark.long
@pytest.mark.parametrize("name", CLOSED_CHAINS)
def test_samples_are_within_limits_and_on_the_branch_of_the_posture(name):
    scene = loops_of(name)
    home = scene.assemble(scene.state()[0]).branch
    rng = np.random.default_rng(2)
    for _ in range(10):
        q, v = scene.sample(rng)
        assert scene.assemble(q).branch == home
        assert scene.check(q, v).ok
        assert not scene.check(q, v).beyond_limits


# --- properties

angles = st.floats(-4.0, 4.0)


@given(st.tuples(angles, angles, angles), st.sampled_from([(), ("crank",), ("rocker",)]))
def test_the_result_is_closed_or_it_raises_and_closing_again_changes_nothing(start, fixed):
    scene = loops_of("four_bar")
    assembly = scene.assemble(start, fixed=fixed, throw=False)
    assert np.isfinite(assembly.q).all()
    held = [scene.robot.index_q(name) for name in fixed]
    assert np.array_equal(assembly.q[held], np.array(start)[held])
    if not assembly.status.ok:
        with pytest.raises((cp.errors.NotAssembled, cp.errors.BranchChanged)) as error:
            scene.assemble(start, fixed=fixed)
        assert np.array_equal(error.value.assembly.q, assembly.q)
        assert error.value.assembly.status is assembly.status
        return
    assert gap(scene, assembly.q) <= CLOSED
    again = scene.assemble(assembly.q, fixed=fixed)
    assert np.abs(again.q - assembly.q).max() <= 1e-9
    assert again.iterations <= 1


# --- projections


@pytest.mark.values
@each_scene
@pytest.mark.parametrize("metric", ["mass", "euclidean"])
def test_projections_are_on_the_constraints_and_nearest(label, metric):
    scene = all_scenes()[label]
    rng = np.random.default_rng(4)
    q, v = scene.sample(rng)
    nv = scene.robot.nv
    terms = cp.Workspace(scene).terms(q, v)
    W = terms.M if metric == "mass" else np.eye(nv)
    tangents = [cp.mechanism.project_velocity(scene, q, rng.normal(size=nv)) for _ in range(3)]
    x = rng.normal(size=nv)
    nearest = cp.mechanism.project_velocity(scene, q, x, metric=metric)
    a = cp.mechanism.project_acceleration(scene, q, v, x, metric=metric)
    assert np.abs(terms.J @ nearest).max(initial=0.0) < 1e-9
    residual = terms.J @ a + terms.gamma
    scale = max(1.0, np.abs(a).max(), np.abs(terms.gamma).max(initial=0.0))
    assert np.abs(residual).max(initial=0.0) < 1e-9 * scale
    for tangent in tangents:
        size = np.linalg.norm(W @ tangent)
        assert abs(tangent @ W @ (x - nearest)) < 1e-9 * size * np.linalg.norm(x)
        assert abs(tangent @ W @ (x - a)) < 1e-9 * size * max(1.0, np.linalg.norm(a))


@pytest.mark.values
@pytest.mark.parametrize("angle", [1e-1, 1e-4, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8])
@pytest.mark.parametrize(("lightest", "heaviest"), [(0, 0), (-1, 1), (-6, 2), (-12, 0), (-6, 6)])
def test_closed_states_near_a_singular_one_are_projected(angle, lightest, heaviest):
    """What has less than 1e-7 of the largest singular value was left out, and then refused."""
    rng = np.random.default_rng(0)
    for cells in (1, 2, 3):
        linkage = cp.model.n_four_bar(cells)
        shares = 10.0 ** rng.uniform(lightest, heaviest, size=linkage.model.njoints)
        bodies = [
            pin.Inertia(share * bar.mass, bar.lever, share * bar.inertia)
            for share, bar in zip(shares, linkage.model.inertias, strict=True)
        ]
        linkage = dataclasses.replace(linkage, model=with_inertias(linkage.model, bodies))
        scene, nv = cp.Scene(linkage, linkage.loops), linkage.nv
        along = np.ones(nv)
        along[1::2] = -1.0
        q, x = angle * along, rng.normal(size=nv)
        for metric in ("mass", "euclidean"):
            v = cp.mechanism.project_velocity(scene, q, x, metric=metric)
            assert scene.check(q, v).consistent
            again = cp.mechanism.project_velocity(scene, q, v, metric=metric)
            np.testing.assert_allclose(again, v, atol=1e-8 * np.abs(v).max())
            a = cp.mechanism.project_acceleration(scene, q, v, x, metric=metric)
            terms = cp.Workspace(scene).terms(q, v)
            left = np.abs(terms.J @ a + terms.gamma).max()
            assert left <= 1e-10 * max(1.0, np.abs(a).max(), np.abs(terms.gamma).max())


@pytest.mark.long
def test_rounding_is_relative_to_the_velocities_that_a_slip_is_the_difference_of():
    """A gear of a million: 1e-10 m/s is less than one rounding of its two sides."""
    model = pin.Model()
    for name in ("fast", "slow"):
        joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    scene = cp.Scene(cp.Robot("gears", model), [cp.constraints.Coupling("fast", "slow", 1.3e7)])
    rng = np.random.default_rng(0)
    for _ in range(20):
        v = cp.mechanism.project_velocity(scene, np.zeros(2), rng.normal(size=2) * [1.3e7, 1.0])
        assert scene.check(np.zeros(2), v).consistent
    assert not scene.check(np.zeros(2), [1.3e7, 1.0 + 1e-9]).consistent


def test_gauss_principle():
    """The constrained acceleration is the free one, projected in the metric of M."""
    scene = loops_of("cassie")
    q, v = scene.sample(np.random.default_rng(6))
    tau = robot("cassie").passive_torque(q, v)
    free = cp.solve(cp.Scene(robot("cassie")), q, v, tau, solver=cp.dynamics.Reference()).a
    right = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a
    error = np.abs(cp.mechanism.project_acceleration(scene, q, v, free) - right).max()
    assert error < 1e-8 * np.abs(right).max()


# --- the state from the motors


@pytest.mark.parametrize("name", CLOSED_CHAINS)
def test_the_motors_give_the_state_and_its_derivative(name):
    scene, model = loops_of(name), robot(name).model
    near, _ = scene.sample(np.random.default_rng(8))
    motors = [robot(name).index_q(motor) for motor in robot(name).actuated]
    rng = np.random.default_rng(9)
    q_act = near[motors] + 0.1 * rng.normal(size=len(motors))
    v_act = rng.normal(size=len(motors))
    state = cp.mechanism.complete_state(scene, q_act, v_act, near=near, within_limits=False)
    assert np.array_equal(state.q[motors], q_act)
    assert gap(scene, state.q) <= CLOSED
    assert state.residual <= CLOSED
    J = cp.Workspace(scene).jacobian(state.q)
    assert np.abs(J @ state.v).max() < 1e-10
    assert np.abs(J @ state.G).max() < 1e-12
    assert state.conflicting == 0
    assert state.undetermined == scene.nominal.mobility - len(motors)
    step = 1e-6
    for column, move in zip(state.G.T, step * np.eye(len(motors)), strict=True):
        ends = [
            cp.mechanism.complete_state(
                scene, q_act + s * move, near=state.q, within_limits=False
            ).q
            for s in (-1, 1)
        ]
        assert np.abs(pin.difference(model, *ends) / (2 * step) - column).max() < 1e-7


@pytest.mark.long
def test_springs_and_base_stay_where_near_has_them():
    scene, cassie = loops_of("cassie"), robot("cassie")
    near, _ = scene.sample(np.random.default_rng(10))
    motors = [cassie.index_q(name) for name in cassie.actuated]
    state = cp.mechanism.complete_state(scene, near[motors] + 0.05, near=near)
    kept = [cassie.index_q(spring.joint) for spring in cassie.springs]
    assert np.array_equal(state.q[kept], near[kept])
    assert np.abs(state.q[:7] - near[:7]).max() < 1e-15  # but for normalising
    assert state.undetermined == 12  # the base, and in each leg two springs and the spin of a rod


@pytest.mark.long
def test_the_motors_do_not_jump_across_a_dead_point():
    with pytest.raises((cp.errors.NotAssembled, cp.errors.BranchChanged)):
        cp.mechanism.complete_state(bar_scene(actuated=("rocker",)), [at_dead_point()[2] - 0.05])


@pytest.mark.long
@pytest.mark.parametrize("past", [0.01, 0.05, 0.25, 0.7])
def test_a_flat_parallelogram_is_not_left_for_the_other_linkage(past):
    """It goes flat at -60 deg. The antiparallelogram beyond has the sign of the one before."""
    scene, flat = loops_of("parallelogram"), -math.pi / 3
    before = cp.mechanism.complete_state(scene, [flat + 0.01])
    assert np.abs(before.q - before.q[0] * np.array([1, -1, 1])).max() < 1e-9
    with pytest.raises(cp.errors.BranchChanged, match=r"followed for .*%.* dead point") as error:
        cp.mechanism.complete_state(scene, [flat - past])
    assembly = error.value.assembly
    assert assembly.status is cp.mechanism.AssemblyStatus.BRANCH_CHANGED
    assert assembly.flipped == ("coupler_rocker",)
    with pytest.raises(cp.errors.BranchChanged, match=r"followed for 0\.0% of the way"):
        cp.mechanism.complete_state(scene, [flat], near=[flat, -flat, flat])


@each_row("n", [1, 2, 3])
def test_bars_in_a_row_are_not_folded_in_passing(n):
    """With n loops flat at once the sign changes n times."""
    bars = cp.model.n_four_bar(n=n)
    scene = cp.Scene(bars, bars.loops)
    angle = cp.mechanism.complete_state(scene, [0.02]).q
    assert np.abs(np.abs(angle) - 0.02).max() < 1e-9
    for crank in (-0.01, -0.1, -0.5):
        with pytest.raises(cp.errors.BranchChanged):
            cp.mechanism.complete_state(scene, [crank])


@pytest.mark.long
def test_far_motors_are_followed_all_the_way():
    """The crank of a crank-rocker turns three times and comes back."""
    scene = bar_scene()
    q, _ = scene.state()
    turned = cp.mechanism.complete_state(scene, q[:1] + 6 * np.pi).q
    assert np.abs(np.sin((turned - q) / 2)).max() < 1e-9


def test_motors_within_limits():
    scene = with_limits(bar_scene(), crank=(0.0, 1.5), rocker=(-3.0, 2.0))
    with pytest.raises(cp.InvalidArgument, match=r"q_actuated: 'crank' is 5\.73 deg beyond"):
        cp.mechanism.complete_state(scene, [1.6])
    free = cp.mechanism.complete_state(scene, [0.0], within_limits=False).q
    assert gap(scene, free) <= CLOSED
    tight = with_limits(bar_scene(), rocker=(free[2] + 0.1, 3.0))
    with pytest.raises(
        cp.errors.NotAssembled, match=r"rocker is 5\.73 deg beyond its limits"
    ) as error:
        cp.mechanism.complete_state(tight, [0.0])
    assert error.value.assembly.status is cp.mechanism.AssemblyStatus.BEYOND_LIMITS
    assert np.array_equal(cp.mechanism.complete_state(tight, [0.0], within_limits=False).q, free)


@pytest.mark.long
def test_the_legs_of_the_stewart_platform_end():
    scene = loops_of("stewart")
    with pytest.raises(cp.InvalidArgument, match=r"q_actuated: 'leg1' is 100 mm beyond its limits"):
        cp.mechanism.complete_state(scene, np.full(6, 0.3))
    assert cp.mechanism.complete_state(scene, np.full(6, 0.2)).residual <= CLOSED


@pytest.mark.long
def test_more_motors_than_freedoms_are_in_conflict():
    scene = bar_scene(actuated=("crank", "rocker"))
    q, _ = scene.state()
    state = cp.mechanism.complete_state(scene, q[[0, 2]])
    assert (state.conflicting, state.undetermined) == (1, 0)
    with pytest.raises(cp.errors.NotAssembled):
        cp.mechanism.complete_state(scene, q[[0, 2]] + [0.1, 0.0])


# --- bad input


def case(text, call):
    return call, text


@each_row(
    ("call", "text"),
    [
        case("branch = 'open'", lambda s: s.assemble(np.ones(3), branch="open")),
        case("no cluster of loops named", lambda s: s.assemble(np.ones(3), branch={"a": 1})),
        case(
            r"branch\['coupler_rocker'\] = 2",
            lambda s: s.assemble(np.ones(3), branch={"coupler_rocker": 2}),
        ),
        case(
            "metric = 'mas'",
            lambda s: cp.mechanism.project_velocity(s, np.ones(3), np.ones(3), metric="mas"),
        ),
        case("v has shape", lambda s: cp.mechanism.project_velocity(s, np.ones(3), np.ones(4))),
        case(
            r"v\[0\] = nan", lambda s: cp.mechanism.project_velocity(s, np.ones(3), [np.nan, 0, 0])
        ),
        case(
            "a has shape",
            lambda s: cp.mechanism.project_acceleration(s, np.ones(3), np.ones(3), np.ones(2)),
        ),
        case(
            "q has shape",
            lambda s: cp.mechanism.project_acceleration(s, np.ones(2), np.ones(3), np.ones(3)),
        ),
        case("q_actuated has shape", lambda s: cp.mechanism.complete_state(s, [1.0, 2.0])),
        case(r"q_actuated\[0\] = inf", lambda s: cp.mechanism.complete_state(s, [np.inf])),
        case("999 rad or m from where it is", lambda s: cp.mechanism.complete_state(s, [1000.0])),
        case("v_actuated has shape", lambda s: cp.mechanism.complete_state(s, [1.0], [1.0, 2.0])),
        case("near has shape", lambda s: cp.mechanism.complete_state(s, [1.0], near=[1.0])),
        case(
            "no actuated joints", lambda s: cp.mechanism.complete_state(bar_scene(actuated=()), [])
        ),
        case(r"q\[1\] = nan", lambda s: s.check([0, np.nan, 0])),
        case("v has shape", lambda s: s.check(np.ones(3), np.ones(2))),
        case("q has shape", lambda s: s.rank(np.ones(2))),
        case("q has shape", lambda s: s.summary(np.ones(2))),
    ],
)
def test_bad_input_is_named(call, text):
    with pytest.raises(cp.CondynError, match=text):
        call(loops_of("four_bar"))


# Many at once


@pytest.mark.parametrize("name", ["cassie", "delta", "five_bar"])
def test_many_are_closed_as_one_by_one(name):
    scene = loops_of(name)
    motors = scene.robot.actuated
    iq = [scene.robot.index_q(name) for name in motors]
    rng = np.random.default_rng(5)
    angles = scene.state()[0][iq] + 0.1 * rng.normal(size=(6, len(motors)))
    Q, closed = cp.mechanism.assemble_batch(scene, angles)
    assert closed.all()
    np.testing.assert_array_equal(Q[:, iq], angles)
    for q, goal in zip(Q, angles, strict=True):
        assert scene.check(q).closed
        guess = scene.state()[0]
        guess[iq] = goal
        one = scene.assemble(guess, fixed=motors)
        assert np.abs(np.asarray(pin.difference(scene.robot.model, q, one.q))).max() < 1e-6
    again, _ = cp.mechanism.assemble_batch(scene, angles[3:4])
    np.testing.assert_array_equal(again[0], Q[3])  # a row depends on no other


def test_what_cannot_be_closed_is_masked():
    scene = loops_of("delta")
    iq = [scene.robot.index_q(name) for name in scene.robot.actuated]
    start = scene.state()[0][iq]
    far = start + np.array([np.zeros(3), [np.pi, 0.0, 0.0]])
    Q, closed = cp.mechanism.assemble_batch(scene, far)
    assert closed.tolist() == [True, False]
    assert np.isfinite(Q).all()
    cassie = loops_of("cassie")
    beyond = np.full((1, 10), 50.0)
    assert not cp.mechanism.assemble_batch(cassie, beyond)[1].any()
    none, mask = cp.mechanism.assemble_batch(cassie, np.zeros((0, 10)))
    assert none.shape == (0, cassie.robot.nq)
    assert mask.shape == (0,)


@each_row(
    ("angles", "joints", "words"),
    [
        (np.zeros(2), None, "a row for each robot"),
        (np.zeros((3, 5)), None, "angles"),
        (np.full((1, 2), np.nan), None, "angles"),
        (np.zeros((1, 0)), (), "one coordinate are needed"),
    ],
)
def test_bad_angles_are_named(angles, joints, words):
    with pytest.raises(cp.InvalidArgument, match=words):
        cp.mechanism.assemble_batch(loops_of("five_bar"), angles, joints=joints)


@pytest.mark.long
def test_a_budget_ends_what_does_not_close():
    """The rocker held where crank and coupler are too short, one attempt after the other."""
    scene = bar_scene()
    start = robot("four_bar").postures["open"].copy()
    start[2] = 0.0
    few = scene.assemble(start, fixed=["rocker"], budget=1, throw=False)
    assert few.status is cp.mechanism.AssemblyStatus.OUT_OF_BUDGET
    assert "budget=1000" in str(few.error())
    all_of_them = scene.assemble(start, fixed=["rocker"], throw=False)
    assert all_of_them.status is cp.mechanism.AssemblyStatus.UNREACHABLE
    assert few.iterations < all_of_them.iterations
    with pytest.raises(cp.InvalidArgument, match="budget"):
        scene.assemble(start, budget=0)


@pytest.mark.long
def test_what_closes_needs_no_budget():
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    q = scene.state()[0] + 0.1
    np.testing.assert_array_equal(scene.assemble(q, budget=1).q, scene.assemble(q).q)
