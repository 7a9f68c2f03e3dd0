"""Many motions at once: the bits of `simulate`, whoever did the work; nothing lost or hidden."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.simulation.run import HybridPhase

N, DURATION = 5, 0.05


def scene_of(label: str) -> cp.Scene:
    if label == "talos feet":
        return cp.Scene(robot("talos"), robot("talos").contacts)
    return cp.Scene(robot(label), robot(label).loops)


def states(scene: cp.Scene, count: int = N) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    some = [scene.sample(rng) for _ in range(count)]
    return np.array([q for q, _ in some]), 0.2 * np.array([v for _, v in some])


def pull(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A torque that workers find in this module."""
    return -0.1 * v


@dataclass(frozen=True)
class Policy:
    """A torque with numbers of its own, whose == is that of arrays."""

    gains: np.ndarray

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -self.gains @ v


@pytest.fixture(scope="module")
def executor():
    with cp.Processes(2) as processes:
        yield processes


CHOICES = [
    (
        "four_bar",
        {"integrator": cp.SemiImplicitEuler(), "drift": cp.simulation.PostStabilization()},
    ),
    ("four_bar", {"integrator": cp.simulation.Rattle()}),
    ("cassie", {"integrator": cp.SemiImplicitEuler(), "drift": cp.simulation.Projection(every=3)}),
    ("talos feet", {"integrator": cp.SemiImplicitEuler()}),
]


def assert_same(one: cp.simulation.BatchTrajectory, other: cp.simulation.BatchTrajectory) -> None:
    for name in ("t", "q", "v", "violation", "constraint_velocity", "energy_error", "statuses"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.samples is None) == (other.samples is None)
    if one.samples and other.samples:
        for name, array in vars(one.samples).items():
            np.testing.assert_array_equal(array, getattr(other.samples, name), err_msg=name)


@pytest.mark.parametrize(("label", "choices"), CHOICES)
def test_motions_have_the_bits_of_single_ones(label, choices, executor):
    """Those that are recorded are looked at whole in test_motion_files."""
    scene = scene_of(label)
    Q, V = states(scene)
    TAU = np.random.default_rng(1).normal(size=(N, scene.robot.nv))
    here = cp.simulate_batch(scene, Q, V, TAU, duration=DURATION, **choices)
    assert here.ok, here.counts
    over = {"executor": executor, "chunk": 2}
    assert_same(cp.simulate_batch(scene, Q, V, TAU, duration=DURATION, **over, **choices), here)
    for i in (0, N - 1):
        wanted = cp.simulate(scene, Q[i], V[i], TAU[i], duration=DURATION, **choices)
        np.testing.assert_array_equal(here.q[i], wanted.q[-1])
        np.testing.assert_array_equal(here.v[i], wanted.v[-1])
        assert here.violation[i] <= wanted.violation.max()


ONE = np.array([0.3, 0.0, 0.1])


@pytest.mark.parametrize(
    ("torques", "of_one"),
    [
        ((0.0, np.zeros(3)), np.zeros(3)),
        ((ONE, np.tile(ONE, (N, 1))), ONE),
        ((pull, Policy(0.1 * np.eye(3))), pull),
        ((Policy(np.eye(3)),), Policy(np.eye(3))),
    ],
    ids=["none", "the same", "function", "object with arrays"],
)
def test_torques_for_all_and_functions(torques, of_one, executor):
    scene = scene_of("four_bar")
    Q, V = states(scene)
    wanted = cp.simulate(scene, Q[4], V[4], of_one, duration=DURATION).q[-1]
    runs = [
        cp.simulate_batch(scene, Q, V, torque, duration=DURATION, chunk=2, executor=where)
        for torque in torques
        for where in (None, executor)
    ]
    np.testing.assert_array_equal(runs[0].q[4], wanted)
    for other in runs[1:]:
        assert_same(other, runs[0])


def test_a_torque_that_cannot_travel_is_named(executor):
    scene = scene_of("four_bar")
    Q, V = states(scene)
    with pytest.raises(cp.InvalidArgument, match=r"executor = Processes\(2.*lambda.*<lambda>"):
        cp.simulate_batch(scene, Q, V, lambda *_: 0 * V[0], duration=0.01, executor=executor)
    with ThreadPoolExecutor(2) as threads:  # where nothing is pickled
        found = cp.simulate_batch(
            scene, Q, V, lambda *_: 0 * V[0], duration=0.01, executor=threads, chunk=2
        )
    assert_same(found, cp.simulate_batch(scene, Q, V, duration=0.01))


@pytest.mark.long
def test_float32_is_taken_in_double_precision():
    scene = scene_of("four_bar")
    Q, V = (each.astype(np.float32) for each in states(scene))
    found = cp.simulate_batch(scene, Q, V, duration=0.01)
    assert found.q.dtype == np.float64
    wanted = cp.simulate_batch(scene, Q.astype(np.float64), V.astype(np.float64), duration=0.01)
    assert_same(found, wanted)


@pytest.mark.long
def test_what_motions_share_is_made_once(monkeypatch):
    made = []
    start = HybridPhase.__init__
    monkeypatch.setattr(HybridPhase, "__init__", lambda *given: made.append(1) or start(*given))
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    Q, V = states(scene)
    options = {"duration": DURATION, "integrator": cp.SemiImplicitEuler()}
    found = cp.simulate_batch(scene, Q, V, np.ones((N, 3)), chunk=2, **options)
    assert len(made) == 1
    again = cp.simulate_batch(scene, Q, V, 2.0 * np.ones((N, 3)), chunk=2, **options)
    assert len(made) == 1
    assert np.abs(again.q - found.q).max() > 1e-6
    assert_same(cp.simulate_batch(scene, Q, V, np.ones(3), chunk=1, **options), found)


@pytest.mark.long
def test_contacts_are_anchored_anew_in_the_same_memory(monkeypatch):
    made = []
    build = cp.Workspace.__init__
    monkeypatch.setattr(
        cp.Workspace, "__init__", lambda *given, **more: made.append(1) or build(*given, **more)
    )
    scene = scene_of("talos feet")
    Q, V = states(scene)
    options = {"duration": 0.01, "integrator": cp.SemiImplicitEuler()}
    cp.simulate_batch(scene, Q[:1], V[:1], **options)
    few = len(made)
    found = cp.simulate_batch(scene, Q, V, **options)
    assert len(made) == few
    for q, end in zip(Q[1:], found.q[1:], strict=True):  # no foot goes where another one began
        assert np.abs(end - q).max() < 0.1 * np.abs(end - Q[0]).max()
    assert found.violation.max() < 1e-6


def test_what_breaks_down_is_counted_and_stops_nobody():
    scene = scene_of("four_bar")
    Q, V = states(scene)
    Q[1, 0] += 0.3  # open
    V[3] *= 1e6  # faster than any step can follow
    found = cp.simulate_batch(scene, Q, V, duration=DURATION, record=10)
    assert found.statuses[[0, 2, 4]].tolist() == [0, 0, 0]
    assert set(found.failed) == {1, 3}
    assert found.t[1] == 0.0
    assert np.isnan(found.violation[1])
    assert np.isnan(found.samples.q[1]).all()
    assert sum(found.counts.values()) == N
    assert not found.ok
    assert "finished" in repr(found)
    *numbers, first, second = str(found).splitlines()
    assert "steps/s" in numbers[0]
    assert first == f"not ok: 1 after 0 s ({cp.simulation.RunStatus.FAILED})"
    wanted = cp.simulate(scene, Q[3], V[3], duration=DURATION, record=10)
    assert second == f"not ok: 3 after {wanted.t[-1]:.4g} s ({wanted.status})"
    assert "not ok" not in str(cp.simulate_batch(scene, Q[:1], V[:1], duration=DURATION))
    lost = replace(found, statuses=np.full(N, -1, np.int8), t=np.full(N, np.nan))
    assert str(lost).endswith("not ok: 0, 1, 2, 3, 4 (missing: no worker got to it)")


@pytest.mark.parametrize("processes", [False, True])
def test_an_interrupt_keeps_the_motions_that_are_done(processes, executor, monkeypatch):
    scene = scene_of("four_bar")
    Q, V = states(scene)
    V[0] *= 1e6  # and its words
    options = {"duration": DURATION, "chunk": 2}
    wanted = cp.simulate_batch(scene, Q, V, **options)

    def interrupt(done: int, total: int) -> None:
        if done >= 2:
            raise KeyboardInterrupt

    options |= {"executor": executor, "chunk": 2} if processes else {}
    with pytest.raises(cp.errors.Interrupted) as stopped:
        cp.simulate_batch(scene, Q, V, **options, progress=interrupt)
    done = stopped.value.table
    assert 2 <= N - len(done.missing) < N
    ended = np.flatnonzero(done.statuses != -1)
    np.testing.assert_array_equal(done.q[ended], wanted.q[ended])
    assert done.reasons[ended].tolist() == wanted.reasons[ended].tolist()
    assert np.isnan(done.q[done.missing]).all()


def test_an_interrupt_in_a_motion_stops_all_of_them():
    scene = scene_of("four_bar")
    Q, V = states(scene)
    calls = []

    def impatient(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        calls.append(t)
        if len(calls) == 300:  # in the second motion
            raise KeyboardInterrupt
        return np.zeros(3)

    with pytest.raises(cp.errors.Interrupted) as stopped:
        cp.simulate_batch(scene, Q, V, impatient, duration=DURATION, chunk=1)
    assert len(calls) == 300
    assert stopped.value.table.counts == {"missing": N - 1, "finished": 1}


def test_bad_input_is_refused_before_anything_is_done():
    scene = scene_of("four_bar")
    Q, V = states(scene)
    for wrong in (
        {"duration": -1.0},
        {"duration": 1.0, "record": 0},
        {"duration": 1.0, "chunk": 0},
        {"duration": 1.0, "integrator": "rk4"},
        {"duration": 1.0, "integrator": cp.simulation.Rattle(), "drift": cp.Baumgarte(1, 1)},
    ):
        with pytest.raises(cp.InvalidArgument):
            cp.simulate_batch(scene, Q, V, **wrong)
    Q[2, 1] = np.nan
    with pytest.raises(cp.InvalidArgument, match=r"Q0\[2, 1\] = nan"):
        cp.simulate_batch(scene, Q, V, duration=1.0)


@pytest.mark.long
@pytest.mark.parametrize("size", [1e200, 1e308])
def test_a_velocity_whose_square_is_no_number_cannot_begin(size):
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    batch = cp.simulate_batch(scene, [q, q], [v, v + size], duration=1e-3)
    assert batch.counts == {"finished": 1, "failed": 1}
