"""States off their constraints in the compiled core: the rows that count are those of Python."""

from __future__ import annotations

import numpy as np
import pytest
from overconstrained import machines, state_near
from test_native import left_to_python

import condyn_pin as cp
from condyn_pin.dynamics import Status
from condyn_pin.dynamics.derivatives.differences import BLOCKS

pytestmark = pytest.mark.native

STATES = 6
NULL_SPACE = cp.dynamics.NullSpace()


def batch_near(
    scene: cp.Scene, noise_q: float, noise_v: float, count: int = STATES
) -> tuple[np.ndarray, ...]:
    states = [state_near(scene, noise_q, noise_v, seed) for seed in range(count)]
    return tuple(map(np.array, zip(*states, strict=True)))


def assert_near(found: np.ndarray, wanted: np.ndarray, share: float, what: str) -> None:
    """As near as a share of the largest number of each row, or of 1."""
    for one, two in zip(found, wanted, strict=True):
        size = max(1.0, float(np.abs(two).max(initial=0.0)))
        np.testing.assert_allclose(one, two, rtol=0, atol=share * size, err_msg=what)


@pytest.mark.pairs
@pytest.mark.parametrize("noise", [1e-9, 1e-7, 1e-4, 1e-2])
@pytest.mark.parametrize("solver", [None, NULL_SPACE], ids=["default", "null space"])
@pytest.mark.parametrize("name", machines())
def test_answers_and_statuses_are_those_of_python(name, solver, noise):
    scene = machines()[name]
    states = batch_near(scene, noise, noise)
    wanted = cp.solve_batch(scene, *states, solver=solver)
    found = cp.solve_batch(scene, *states, solver=solver, executor=cp.Native(threads=2))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert_near(found.a, wanted.a, 1e-10, "a")
    assert_near(found.lam, wanted.lam, 1e-9, "lam")
    if noise <= 1e-7:  # where it is larger, what closing changes may have to be computed
        left = left_to_python(scene, states, solver)
        assert not (wanted.statuses[left] == tuple(Status).index(Status.OK)).any()


@pytest.mark.parametrize("name", ["cassie", "bennett", "four_bar, ball"])
def test_states_in_float32(name):
    scene = machines()[name]
    states = tuple(x.astype(np.float32).astype(float) for x in batch_near(scene, 0.0, 0.0))
    wanted = cp.solve_batch(scene, *states)
    found = cp.solve_batch(scene, *states, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert_near(found.a, wanted.a, 1e-10, "a")
    assert_near(found.lam, wanted.lam, 1e-9, "lam")


@pytest.mark.parametrize("name", ["talos on eight points", "cart with a door", "four_bar, ball"])
def test_rows_that_contradict_each_other_carry_the_smallest_forces(name):
    """|J v| of 0.1, where no acceleration satisfies all rows."""
    scene = machines()[name]
    states = batch_near(scene, 0.0, 0.1)
    wanted = cp.solve_batch(scene, *states)
    found = cp.solve_batch(scene, *states, executor=cp.Native(threads=1))
    assert found.velocity_violation.max() > 1e-2
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert_near(found.a, wanted.a, 1e-10, "a")
    assert_near(found.lam, wanted.lam, 1e-9, "lam")
    for state, lam in zip(zip(*states, strict=True), found.lam, strict=True):
        answer = cp.solve(scene, *state)
        assert np.abs(answer._kept.N.T @ lam).max(initial=0.0) <= 1e-9 * np.abs(lam).max()


@pytest.mark.parametrize("name", ["cassie", "bennett", "stewart, hinges", "four_bar, hinge"])
def test_derivatives_are_those_of_python(name):
    scene = machines()[name]
    states = batch_near(scene, 1e-6, 1e-6, 3)
    batch = cp.simulation.derivatives_batch
    wanted, found = batch(scene, *states), batch(scene, *states, executor=cp.Native(threads=1))
    for block in BLOCKS:
        assert_near(getattr(found, block), getattr(wanted, block), 1e-8, block)


@pytest.mark.parametrize("name", ["cassie", "bennett", "trammel"])
@pytest.mark.parametrize(
    "drift", [cp.simulation.NoDrift(), cp.simulation.PostStabilization()], ids=["none", "post"]
)
def test_stages_of_a_step_are_those_of_python(name, drift):
    """Runge-Kutta's are open by the square of the step."""
    scene = machines()[name]
    solver = None if name == "cassie" else NULL_SPACE
    q, v, tau = batch_near(scene, 0.0, 0.0, 2)
    how = {
        "dt": 1e-3, "duration": 0.05, "integrator": cp.RungeKutta4(), "drift": drift,
        "solver": solver, "record": 10, "limits": cp.simulation.MotionLimits(energy=np.inf),
    }  # fmt: skip
    wanted = cp.simulate_batch(scene, q, 0.05 * v, tau, **how)
    found = cp.simulate_batch(scene, q, 0.05 * v, tau, **how, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert wanted.ok
    assert_near(found.q, wanted.q, 1e-9, "q")
    assert_near(found.v, wanted.v, 1e-9, "v")


def test_rows_at_their_word():
    """With a precision of 0 every row counts, in the core as in Python."""
    robot = machines()["cassie"].robot
    scene = cp.Scene(cp.Robot(robot.name, robot.model, precision=0.0), robot.loops)
    q, v, tau = batch_near(machines()["cassie"], 1e-5, 0.0, 3)
    wanted = cp.solve_batch(scene, q, v, tau)
    found = cp.solve_batch(scene, q, v, tau, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert_near(found.a, wanted.a, 1e-10, "a")
