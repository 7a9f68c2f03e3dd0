"""Driven rows by the compiled core: answers, derivatives and motions are those of Python.

c(q) = s(t),    J v = s'(t),    J a + gamma = s''(t)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shared import robot
from test_driven import floating_box
from test_native import DRIFTS, STEPS, assert_moved_like_python, left_to_python, near

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints import (
    Coupling,
    Driven,
    HeldJoint,
    KnifeEdge,
    Polynomial,
    RollingBall,
    RollingWheel,
    Sine,
    analytic,
)
from condyn_pin.dynamics import compiled as arrays
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.simulation.batch.inputs import DrivenPath
from condyn_pin.simulation.batch.motions import MEASURED

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]

N = 8
AT = 0.37  # [s]


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
    solo = robot("solo12")
    geared = Driven(Coupling("FL_KFE", "FR_KFE", 1.0), Sine(0.1, 1.5))
    held = Driven(HeldJoint("HL_KFE", 1.2), analytic(lambda t: 0.2 * np.exp(-t) * np.sin(3 * t)))
    return cp.Scene(solo, [geared, held])


def belt() -> cp.Scene:
    floor = RollingBall("centre", 0.1, height=0.0)
    path = Polynomial(((0, 0, 0, 1), (0, 0.1, 0, 0), (0, 0, 0, 0)))
    return cp.Scene(cp.model.rolling_ball(), [Driven(floor, path)])


def disc_on_a_belt() -> cp.Scene:
    disc = cp.model.rolling_disc()
    (wheel,) = disc.contacts
    assert isinstance(wheel, RollingWheel)
    path = Polynomial(((0, 0.2, 0.5, 0.4), (0, 0.1, 0, 0), (0, 0, 0, 0)))
    return cp.Scene(disc, [Driven(wheel, path)])


def blade() -> cp.Scene:
    pushed = Driven(KnifeEdge("tool"), Polynomial((0.0, 0.3, 0.0, 0.4)))
    return cp.Scene(floating_box(), [pushed])


SCENES = {
    make.__name__: make
    for make in (
        *(crank, cylinder, point, hand_past_hand, slide, gear, belt, disc_on_a_belt, blade),
    )
}


def states_of(scene: cp.Scene, count: int = N) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    found = [(*scene.sample(rng), rng.normal(size=scene.robot.nv)) for _ in range(count)]
    q, v, tau = map(np.array, zip(*found, strict=True))
    return q, v, tau


@pytest.mark.parametrize("gains", [None, cp.Baumgarte(3.0, 20.0)])
@pytest.mark.parametrize("label", SCENES)
def test_answers_and_derivatives_at_a_time_are_those_of_python(label, gains):
    """Also off the paths, where gains pull."""
    scene = SCENES[label]().at(AT)
    q, v, tau = states_of(scene)
    if gains is not None:
        rng = np.random.default_rng(0)
        q = np.array([
            pin.integrate(scene.robot.model, x, 1e-3 * rng.normal(size=v.shape[1])) for x in q
        ])  # fmt: skip
        v = v + 1e-3 * rng.normal(size=v.shape)
    native = cp.Native(threads=2)
    wanted = cp.solve_batch(scene, q, v, tau, drift=gains)
    found = cp.solve_batch(scene, q, v, tau, drift=gains, executor=native)
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert found.ok
    assert near(found.a, wanted.a, 1e-12)
    assert near(found.lam, wanted.lam, 1e-12)
    for name in ("violation", "velocity_violation"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-14)
    if gains is None:
        assert not left_to_python(scene, (q, v, tau)).size
    batch = cp.simulation.derivatives_batch
    wanted = batch(scene, q, v, tau, drift=gains)
    found = batch(scene, q, v, tau, drift=gains, executor=native)
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-12), name


@pytest.mark.parametrize("label", SCENES)
def test_a_workspace_of_the_core_is_that_of_a_time(label):
    scene = SCENES[label]()
    # at another time the state is off its paths: the rows at their word
    scene = replace(scene, robot=replace(scene.robot, precision=0.0))
    q, v, tau = states_of(scene.at(AT), 1)
    state, other = (q[0], v[0], tau[0]), scene.at(0.1)
    native = cp.Workspace(scene.at(AT), native=True)
    for there in (scene.at(AT), other):
        native.use(there)
        found, wanted = native.solve(*state), cp.solve(there, *state)
        assert near(found.a, wanted.a, 1e-12)
        assert near(found.lam, wanted.lam, 1e-12)
        assert found.residuals.violation == pytest.approx(wanted.residuals.violation, abs=1e-14)
        one, two = native.derivatives(*state), cp.derivatives(there, *state)
        for name in BLOCKS:
            assert near(getattr(one, name), getattr(two, name), 1e-12), name
    assert not near(cp.solve(scene.at(AT), *state).lam, cp.solve(other, *state).lam, 1e-3)


def test_the_memory_of_a_workspace_may_have_moved_on():
    """A motion takes its rows along their paths: the core begins at the time of the scene."""
    scene = crank().at(AT)
    q, v, tau = states_of(scene, 1)
    workspace = cp.Workspace(scene)
    workspace.equations.at(3.0)
    answer = {"a": np.zeros((1, 3)), "lam": np.zeros((1, scene.rows))}
    rest = {
        "residuals": np.zeros((1, 5)), "statuses": np.zeros(1, np.int8),
        "iterations": np.zeros(1, np.int32), "solve_times": np.zeros(1),
    }  # fmt: skip
    workspace.compiled.solve((q, v, tau), answer | rest, accuracy=None, threads=1)
    assert near(answer["a"][0], cp.solve(scene, q[0], v[0], tau[0]).a, 1e-12)


@pytest.mark.pairs
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("label", ["crank", "cylinder", "gear"])
def test_motions_follow_the_path(label, steps, drift):
    scene = SCENES[label]()
    assert_moved_like_python(scene, *starts(scene), steps, drift)


@pytest.mark.parametrize("label", SCENES)
def test_motions_of_every_kind_of_driven_rows(label):
    scene = SCENES[label]()
    assert_moved_like_python(scene, *starts(scene), "Runge-Kutta 4", "post")


def starts(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States at which a motion begins, moving as the paths do."""
    now = scene.at(0.0)
    q, v, tau = states_of(now, 3)
    slower = [cp.mechanism.project_velocity(now, *each) for each in zip(q, 0.3 * v, strict=True)]
    return q, np.array(slower), 0.1 * tau


@pytest.mark.parametrize("record", [None, 3])
def test_what_drives_do_is_in_the_balance(record):
    scene = crank()
    q, v = (x[None].repeat(3, axis=0) for x in scene.state())
    how = {"duration": 0.5, "dt": 2e-3, "record": record}
    wanted = cp.simulate_batch(scene, q, v, **how)
    found = cp.simulate_batch(scene, q, v, **how, executor=cp.Native(threads=2))
    np.testing.assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-6, atol=1e-12)
    if record:
        energy = found[1].energy
        assert np.ptp(energy.driven) > 0.1
        assert np.abs(energy.error).max() == pytest.approx(found.energy_error[1], abs=1e-12)
        np.testing.assert_allclose(energy.driven, wanted[1].energy.driven, atol=1e-9)


def test_a_path_that_is_a_function_is_evaluated_on_the_grid_alone():
    """Once at each half step, however many motions and chunks of them there are."""
    asked: list[float] = []

    def along(t):
        asked.append(t)
        return 0.3 * np.sin(t), 0.3 * np.cos(t), -0.3 * np.sin(t)

    bar = cp.model.four_bar()
    motor = Driven(HeldJoint("crank", bar.postures["open"][0]), along)
    scene = cp.Scene(bar, [*bar.loops, motor])
    q, v = (x[None].repeat(9, axis=0) for x in scene.state())
    how = {"duration": 0.02, "dt": 1e-3}
    asked.clear()
    found = cp.simulate_batch(scene, q, v, **how, executor=cp.Native(threads=1), chunk=2)
    late = [t for t in asked if t > 0.01]  # what checks a scene looks at its beginning
    assert np.array(sorted(late)) == pytest.approx(0.01 + 5e-4 * np.arange(1, 21), abs=1e-12)
    wanted = cp.simulate_batch(scene, q, v, **how)
    assert near(found.q, wanted.q, 1e-12)


def test_a_path_out_of_reach_ends_the_run_as_in_python():
    bar = cp.model.four_bar()
    far = Driven(HeldJoint("rocker", bar.postures["open"][2]), Sine(2.0, 0.5))
    scene = cp.Scene(bar, [*bar.loops, far])
    q, v = (x[None] for x in scene.state())
    wanted = cp.simulate_batch(scene, q, v, duration=1.0)
    found = cp.simulate_batch(scene, q, v, duration=1.0, executor=cp.Native(threads=1))
    assert "cannot follow" in wanted.reasons[0]
    assert list(found.reasons) == list(wanted.reasons)
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.t, wanted.t, 1e-12)


@pytest.mark.parametrize(
    ("late", "said"),
    [
        (lambda t: (np.nan, 0.0, 0.0), "is not finite"),
        (lambda t: (0.0, 0.0), "three arrays are needed"),
    ],
)
def test_a_path_that_ends_on_the_way_ends_the_motion_as_in_python(late, said):
    """What it does after the end of a motion is nobody's affair."""
    path = Sine(0.3, 0.7)

    def along(t):
        return path(t) if t < 0.01 else late(t)

    bar = cp.model.four_bar()
    scene = cp.Scene(bar, [*bar.loops, Driven(HeldJoint("crank", bar.postures["open"][0]), along)])
    q, v = (x[None] for x in scene.state())
    wanted = cp.simulate_batch(scene, q, v, duration=0.02)
    found = cp.simulate_batch(scene, q, v, duration=0.02, executor=cp.Native(threads=1))
    assert said in wanted.reasons[0]
    assert list(found.reasons) == list(wanted.reasons)
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    np.testing.assert_array_equal(found.t, wanted.t)
    found = cp.simulate_batch(scene, q, v, duration=8e-3, executor=cp.Native(threads=1))
    assert found.ok


def test_an_error_of_a_path_is_raised_as_in_python():
    def along(t):
        return (0.0, 0.0, 0.0) if t < 0.01 else 1 / 0

    scene = cp.Scene(floating_box(), [Driven(KnifeEdge("tool"), along)])
    q, v = (x[None] for x in scene.state())
    for executor in (None, cp.Native(threads=1)):
        with pytest.raises(ZeroDivisionError):
            cp.simulate_batch(scene, q, v, duration=0.02, executor=executor)


def test_paths_that_do_not_fit_are_refused_at_the_border():
    scene = crank().at(0.0)
    workspace = cp.Workspace(scene)
    core, path = workspace.compiled.core, DrivenPath(workspace, 1e-3, 4)
    q, v = (x[None] for x in scene.state())

    def simulate(rows, wanted, of=core):
        found = {
            "t": np.zeros((1, 2)), "q": np.zeros((1, 2, 3)), "v": np.zeros((1, 2, 3)),
            "a": np.zeros((1, 2, 3)), "lam": np.zeros((1, 2, scene.rows)),
            "measures": np.zeros((1, 2, MEASURED)),
        }  # fmt: skip
        done = np.zeros(1, np.int32)
        of.simulate(
            q, v, 0 * v, integrator=4, dt=1e-3, steps=4, every=4, correct_every=0,
            with_answers=True, limits=np.array([1e-7, 1e100, 1e50, 1.0, 3, 1e-2]), driven=rows,
            path=wanted, **found, done=done, times=np.zeros(1), threads=1,
        )  # fmt: skip
        return bool(done[0])

    assert simulate(path.rows, path.wanted)
    for rows, wanted in (
        (path.rows, path.wanted[:-1].copy()), (path.rows, path.wanted[:, :2].copy()),
        (path.rows, path.wanted[:, :, :0].copy()), (path.rows + 99, path.wanted),
        (path.rows - 99, path.wanted), (path.rows[:0], path.wanted[:, :, :0].copy()),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="does not fit the scene"):
            simulate(rows, wanted)
    bare = cp.Workspace(cp.Scene(scene.robot, scene.constraints[:1])).compiled.core
    with pytest.raises(ValueError, match="number of driven rows"):
        simulate(path.rows, path.wanted, bare)
    for place in range(path.wanted.size):  # wherever it is, no answer of the core has seen it
        broken = path.wanted.copy()
        broken.flat[place] = np.nan
        assert not simulate(path.rows, broken)


@pytest.mark.parametrize("shape", [(3, 1), (2, 3), (1, 3)])
def test_where_driven_rows_are_has_a_number_for_each_row(shape):
    workspace = cp.Workspace(crank().at(0.0))
    parts = {
        **arrays.of_model(workspace.model), **arrays.of_springs(workspace.scene.robot),
        **arrays.of_constraints(workspace), **arrays.of_solver(workspace),
        **arrays.of_precision(workspace.scene),
    }  # fmt: skip
    compiled().Core(**parts)
    with pytest.raises(ValueError, match="wanted does not fit"):
        compiled().Core(**(parts | {"wanted": np.zeros(shape)}))


def test_what_stays_in_python_is_refused_by_name():
    scene = crank()
    q, v = (x[None] for x in scene.state())
    with pytest.raises(UnsupportedBackend, match="StormerVerlet"):
        cp.simulate_batch(
            scene, q, v, duration=0.01, integrator=cp.simulation.StormerVerlet(),
            executor=cp.Native(),
        )  # fmt: skip
