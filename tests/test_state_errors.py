"""Answers at states that are only nearly on the constraints.

Noise of an estimator, float32, encoders. The judge is the closed machine beside the state: it is
found by Gauss-Newton's steps of the rank that the closed machine has, and solved by dense algebra.
"""

from __future__ import annotations

import copy
import functools
import pickle
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from overconstrained import machines
from shared import axis_of, each_row, robot, takes

import condyn_pin as cp

NAMES = tuple(name for name in machines() if name != "cart with a door")
SOLVERS = [
    kind()
    for kind in (
        cp.Proximal, cp.LCABA, cp.dynamics.NullSpace, cp.dynamics.GaussPrinciple,
        cp.dynamics.Reference, cp.dynamics.ConjugateGradient, cp.dynamics.MinimumResidual,
    )
    if not kind.missing()  # of this Pinocchio
]  # fmt: skip


class Closed(NamedTuple):
    """A closed state, its torques, and the rank of the rows there."""

    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    rank: int


class Equations(NamedTuple):
    """M, h, J and gamma by the primitives of the library, none of its solvers."""

    M: np.ndarray
    h: np.ndarray
    J: np.ndarray
    gamma: np.ndarray

    @classmethod
    def at(cls, scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> Equations:
        terms = cp.Workspace(scene).terms(q, v)
        return cls(terms.M, terms.h, terms.J, terms.gamma)

    def answer(self, tau: np.ndarray, rank: int) -> tuple[np.ndarray, np.ndarray]:
        """a and the smallest lam with the `rank` largest singular values of J L^-T."""
        L = np.linalg.cholesky(self.M)
        U, S, Vt = np.linalg.svd(np.linalg.solve(L, self.J.T).T, full_matrices=False)
        U, S, Vt = U[:, :rank], S[:rank], Vt[:rank]
        free = np.linalg.solve(L, tau - self.h)
        x = free + Vt.T @ (-(U.T @ self.gamma) / S - Vt @ free)
        return np.linalg.solve(L.T, x), U @ ((Vt @ (x - free)) / S)


def close(scene: cp.Scene, q: np.ndarray, v: np.ndarray, rank: int):
    """The closed state beside (q, v), by Gauss-Newton's steps of that rank in the metric of M."""
    workspace = cp.Workspace(scene)

    def back(q: np.ndarray, c: np.ndarray | None = None) -> np.ndarray:
        terms = workspace.terms(q, 0 * v)
        s = terms.J @ v if c is None else c
        L = np.linalg.cholesky(terms.M)
        U, S, Vt = np.linalg.svd(np.linalg.solve(L, terms.J.T).T, full_matrices=False)
        x = Vt[:rank].T @ ((U[:, :rank].T @ s) / S[:rank])
        return np.linalg.solve(L.T, x)

    for _ in range(8):
        q = pin.integrate(scene.robot.model, q, -back(q, workspace.violation(q)))
    return q, v - back(q)


@functools.cache
def closed(name: str, seed: int = 0) -> Closed:
    scene, rng = machines()[name], np.random.default_rng(seed)
    q, v = scene.sample(rng, spread=0.1, speed=0.5)
    rank = scene.rank(q).rank
    q, v = close(scene, q, v, rank)
    return Closed(q, v, cp.Workspace(scene).terms(q, v).M @ rng.normal(size=len(v)), rank)


def noisy(name: str, noise: float, of_v: float, seed: int = 0):
    """A noisy state, and a and lam of the closed machine beside it."""
    scene, state, rng = machines()[name], closed(name, seed), np.random.default_rng(seed + 1)
    q = pin.integrate(scene.robot.model, state.q, noise * rng.normal(size=len(state.v)))
    v = state.v + of_v * rng.normal(size=len(state.v))
    beside = close(scene, q, v, state.rank)
    a, lam = Equations.at(scene, *beside).answer(state.tau, state.rank)
    return q, v, a, lam


def off(x: np.ndarray, right: np.ndarray, least: float = 9.81) -> float:
    return float(np.abs(x - right).max() / max(least, np.abs(right).max()))


@pytest.mark.values
@pytest.mark.parametrize("noise", [1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("name", NAMES)
def test_the_answer_is_that_of_the_closed_machine(name, noise):
    """The error is as large as the noise, times what a singular posture is away."""
    scene, state = machines()[name], closed(name)
    q, v, a, lam = noisy(name, noise, noise)
    solution = cp.solve(scene, q, v, state.tau)
    assert solution.rank == state.rank
    assert off(solution.a, a) < 1e2 * noise + 1e-9
    force = 1e-2 * scene.nominal.weight  # the joints feel no less than that
    assert off(solution.lam, lam, force) < 1e4 * noise + 1e-7
    hot = cp.Workspace(scene)
    assert off(hot.acceleration(q, v, state.tau), a) < 1e2 * noise + 1e-9
    assert off(hot.lam(), lam, force) < 1e4 * noise + 1e-7


@pytest.mark.values
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("name", ["bennett", "trammel", "cassie", "bricard", "stewart, hinges"])
def test_every_method_gives_the_one_answer(name, solver):
    scene, state = machines()[name], closed(name)
    if not takes(solver, scene):
        pytest.skip(f"{type(solver).__name__} does not take the scene")
    q, v, _, _ = noisy(name, 1e-5, 1e-2)
    right = cp.solve(scene, q, v, state.tau, solver=cp.dynamics.Reference())
    found = cp.solve(scene, q, v, state.tau, solver=solver, throw=False)
    assert off(found.a, right.a) < 1e-8
    assert off(found.lam, right.lam, 1e-6) < 1e-6


@pytest.mark.values
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("name", ["talos on eight points", "bricard", "bennett", "cassie"])
def test_forces_are_the_smallest_at_any_velocity(name, solver):
    """Where J v is not 0 rows contradict each other: no force comes of that."""
    scene, state = machines()[name], closed(name)
    if not takes(solver, scene):
        pytest.skip(f"{type(solver).__name__} does not take the scene")
    v = state.v + 0.1 * np.random.default_rng(2).normal(size=len(state.v))
    J = cp.Workspace(scene).jacobian(state.q)
    null = np.linalg.svd(J)[0][:, state.rank :]
    found = cp.solve(scene, state.q, v, state.tau, solver=solver, throw=False)
    hot = cp.Workspace(scene, solver)
    hot.acceleration(state.q, v, state.tau)
    batch = cp.solve_batch(scene, [state.q], [v], [state.tau], solver=solver)
    for lam in (found.lam, hot.lam(), batch.lam[0]):
        assert np.abs(null.T @ lam).max() < 1e-9 * np.abs(lam).max()


@pytest.mark.long
def test_rows_that_are_always_zero_carry_no_force():
    """A door that turns although it is nailed misses gamma along its radius."""
    model = pin.Model()
    door = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    inertia = pin.Inertia(1.0, np.array([0.5, 0.0, 0.0]), 0.1 * np.eye(3))
    model.appendBodyToJoint(door, inertia, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    for name, joint in (("nail", 0), ("edge", door)):
        model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("door", model), [cp.Loop("nail", "edge", "ball")])
    for solver in SOLVERS[:3]:
        if takes(solver, scene):
            found = cp.solve(scene, [0.0], [1.0], [0.0], solver=solver, throw=False)
            assert np.abs(found.lam).max() < 1e-9


@pytest.mark.long
def test_recorded_forces_of_a_motion_with_gains_are_the_smallest():
    """With Baumgarte's gains alone J v is never 0."""
    scene, state = machines()["talos on eight points"], closed("talos on eight points")
    gains = cp.Baumgarte.critical(50.0)
    run = cp.simulate(
        scene, state.q, state.v, lambda t, q, v: state.tau * np.sin(30 * t),
        duration=0.05, dt=1e-3, integrator=cp.SemiImplicitEuler(), drift=gains,
    )  # fmt: skip
    workspace = cp.Workspace(scene)
    for k in range(5, len(run.t), 15):
        J = workspace.jacobian(run.q[k])
        null = np.linalg.svd(J)[0][:, state.rank :]
        assert np.abs(null.T @ run.lam[k]).max() < 1e-9 * np.abs(run.lam[k]).max()


@each_row("seed", range(5))
def test_a_state_in_float32_is_ok(seed):
    scene, state = machines()["cassie"], closed("cassie", seed)
    q, v = (x.astype(np.float32).astype(float) for x in (state.q, state.v))
    unit = pin.normalize(scene.robot.model, q)
    right, _ = Equations.at(scene, *close(scene, unit, v, state.rank)).answer(state.tau, state.rank)
    found = cp.solve(scene, q, v, state.tau)
    assert found.status.ok
    assert off(found.a, right) < 1e-5
    assert found.doubt < 1e-5


@pytest.mark.long
@each_row("name", ["bennett", "cassie", "delta, hinges", "bricard"])
def test_the_answer_says_how_far_it_is_from_closed(name):
    scene, state = machines()[name], closed(name)
    q, v, a, _ = noisy(name, 1e-5, 1e-5)
    found = cp.solve(scene, q, v, state.tau)
    assert found.rank == state.rank
    assert len(found.left_out) == scene.rows - state.rank
    assert set(found.rest) <= set(scene.row_names)
    gap = cp.Workspace(scene).violation(q)
    moved = pin.integrate(scene.robot.model, q, -found.state_error.q)
    assert np.abs(cp.Workspace(scene).violation(moved)).max() < 1e-3 * np.abs(gap).max()
    again = found.closed()
    assert off(again.a, a) < 1e-2 * off(found.a, a) + 1e-10  # off by the square
    assert 0.2 < off(again.a, found.a) / off(found.a, a) < 5.0


@pytest.mark.long
def test_closed_states_are_in_no_doubt():
    scene, state = machines()["cassie"], closed("cassie")
    found = cp.solve(scene, state.q, state.v, state.tau)
    assert found.doubt < 1e-12
    assert found.rest == {}
    assert (found.rank, len(found.left_out)) == (10, 2)
    assert np.abs(found.state_error.q).max() < 1e-12
    assert found.notices == ()


@pytest.mark.long
def test_a_state_that_is_far_from_closed_is_inaccurate():
    """Where closing leads to a singular posture, no acceleration belongs to the state."""
    scene, state = machines()["cassie"], closed("cassie")
    rng = np.random.default_rng(0)
    q = pin.integrate(scene.robot.model, state.q, 0.05 * rng.normal(size=len(state.v)))
    found = cp.solve(scene, q, state.v, state.tau, throw=False)
    assert found.status is cp.Status.INACCURATE
    assert found.doubt > 0.1
    assert any("Scene.assemble" in notice for notice in found.notices)
    word = cp.Scene(replace(scene.robot, precision=0.0), scene.constraints)
    taken = cp.solve(word, q, state.v, state.tau, solver=cp.dynamics.Reference())
    assert taken.status.ok  # every row at its word: that is a question of its own


@pytest.mark.long
def test_a_contact_that_slides_to_its_anchor_is_in_no_doubt():
    """J does not change with the place of a floating base, however long the way is."""
    solo = robot("solo12")
    q, v = solo.postures["standing"], np.zeros(solo.nv)
    free = cp.Scene(solo, [cp.PointContact("FL_FOOT")])
    at = cp.Workspace(free).equations.placements(q)[0][0].translation
    held = cp.Scene(solo, [cp.PointContact("FL_FOOT", anchor=np.add(at, [0.0, 0.0, 0.03]))])
    found = cp.solve(held, q, v, v)
    assert 0.0 < found.doubt < 0.1
    assert off(found.a, cp.solve(free, q, v, v).a) < 1e-9


def test_velocities_that_contradict_each_other_are_named():
    scene, state = machines()["bricard"], closed("bricard")
    v = state.v + 0.1 * np.random.default_rng(1).normal(size=len(state.v))
    found = cp.solve(scene, state.q, v, state.tau)
    assert found.rest
    assert any("project_velocity" in notice for notice in found.notices)
    cured = cp.mechanism.project_velocity(scene, state.q, v)
    assert np.allclose(v - found.state_error.v, cured, atol=1e-9)
    assert cp.solve(scene, state.q, cured, state.tau).rest == {}


def test_a_row_of_a_batch_is_the_answer_of_its_state():
    scene, state = machines()["cassie"], closed("cassie")
    states = [noisy("cassie", noise, noise)[:2] for noise in (0.0, 1e-7, 1e-4, 5e-2)]
    q, v = (np.array(each) for each in zip(*states, strict=True))
    batch = cp.solve_batch(scene, q, v, state.tau)
    for i in range(len(q)):
        alone = cp.solve(scene, q[i], v[i], state.tau, throw=False)
        assert batch[i].status is alone.status
        assert np.array_equal(batch.a[i], alone.a)
        assert batch[i].doubt == alone.doubt
        assert batch[i].rank == alone.rank
        assert np.array_equal(batch[i].state_error.q, alone.state_error.q)


@pytest.mark.long
def test_answers_survive_copies():
    scene, state = machines()["bennett"], closed("bennett")
    q, v, _, _ = noisy("bennett", 1e-4, 1e-4)
    found = cp.solve(scene, q, v, state.tau)
    for same in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert same.doubt == found.doubt
        assert same.rest == found.rest
        assert np.array_equal(same.state_error.q, found.state_error.q)
        assert np.array_equal(same.closed().a, found.closed().a)


@pytest.mark.long
def test_hot_loops_keep_their_method_where_loops_are_open():
    """Hinges and planar pins that are open by a nanometre are not solved by another method."""
    four_bar = cp.load_robot("four_bar")
    for kind in ("hinge", "planar"):
        scene = cp.Scene(
            four_bar, [cp.Loop("coupler_tip", "rocker_tip", kind, axis=axis_of(kind, "y"))]
        )
        q, v = scene.sample(np.random.default_rng(0))
        workspace, tau = cp.Workspace(scene), np.zeros(3)
        right = workspace.acceleration(q, v, tau)
        for gap in (1e-9, 1e-4):
            a = workspace.acceleration(q + np.array([gap, 0.0, 0.0]), v, tau)
            assert "equations" not in vars(workspace)  # nothing but Pinocchio's own terms
            assert off(a, right) < 1e2 * gap


def test_a_velocity_that_decides_a_beside_a_dead_point_is_named():
    """Beside a flat parallelogram the error of J v is divided by the last pivot."""
    linkage = cp.load_robot("parallelogram")
    scene = cp.Scene(linkage, linkage.loops)
    lean = 1e-3 * np.array([1.0, -1.0, 1.0])
    q = linkage.postures["flat"] + lean  # the sides stay parallel: closed
    assert np.abs(cp.Workspace(scene).violation(q)).max() < 1e-12
    v = cp.mechanism.project_velocity(scene, q, np.array([1.0, -1.0, 1.0]))
    found = cp.solve(scene, q, v + np.array([0.0, 0.1, 0.0]), np.zeros(3), throw=False)
    assert found.status is cp.Status.INACCURATE
    assert found.doubt < 1e-6  # the loops are closed
    assert any("project_velocity" in notice for notice in found.notices)
    with pytest.raises(cp.SolveFailed, match="none belongs to this state"):
        cp.solve(scene, q, v + np.array([0.0, 0.1, 0.0]), np.zeros(3))
