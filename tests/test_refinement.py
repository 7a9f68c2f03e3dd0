"""Corrections by residuals of our own: what they gain, on every scene."""

from __future__ import annotations

import numpy as np
import pytest
from shared import all_scenes, each_scene, relative, states, takes, truth

import condyn_pin as cp


@each_scene
def test_a_correction_is_one_more_iteration(label):
    """With residuals from elsewhere: what Pinocchio iterates is what the equations ask for."""
    scene = all_scenes()[label]
    mu = 1e-4 * scene.nominal.delassus_norm
    iterated = cp.Proximal(mu=mu, max_iterations=3, relative_accuracy=0.0)
    corrected = cp.Proximal(mu=mu, max_iterations=1, refinements=2)
    if not scene.rows or not takes(iterated, scene):
        return
    for state in states(label):
        one = cp.solve(scene, *state, solver=iterated, throw=False)
        other = cp.solve(scene, *state, solver=corrected, throw=False)
        assert relative(other.a, one.a) < 1e-9
        assert other.iterations == 3


@each_scene
def test_two_corrections_of_a_damped_solve_reach_rounding(label):
    """Also with redundant rows, where the matrix is singular without mu."""
    scene = all_scenes()[label]
    if not scene.rows:
        return
    mu = 1e-8 * scene.nominal.delassus_norm
    solver = cp.DenseKKT(mu=mu, refinements=2)
    for state, exact in zip(states(label), truth(label), strict=True):
        solution = cp.solve(scene, *state, solver=solver, throw=False)
        assert relative(solution.a, exact.a) < 1e-9
        assert solution.status.ok


@pytest.mark.long
def test_forces_are_those_of_the_refined_answer():
    scene = all_scenes()["cassie on lines"]  # edges, which Pinocchio imitates
    rough = cp.Proximal(mu=1e-5 * scene.nominal.delassus_norm, max_iterations=1)
    fine = cp.Proximal(mu=rough.mu, max_iterations=1, refinements=10)
    for state in states("cassie on lines"):
        assert not cp.solve(scene, *state, solver=rough, throw=False).status.ok
        solution = cp.solve(scene, *state, solver=fine, throw=False)
        assert solution.status.ok
        assert solution.dynamics_error < 1e-9


def test_auto_is_the_default():
    assert cp.Proximal(mu="auto") == cp.Proximal()
    assert "auto" not in repr(cp.Proximal(mu="auto", refinements=1))


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("kind", [cp.Proximal, cp.DenseKKT])
@pytest.mark.parametrize("refinements", [-1, 1.5, True, 101, np.nan, "two"])
def test_a_number_of_corrections_that_is_none_is_refused(kind, refinements):
    with pytest.raises(cp.InvalidArgument, match="refinements = "):
        kind(refinements=refinements)


@pytest.mark.long
def test_a_word_that_is_no_weight_is_refused():
    with pytest.raises(cp.InvalidArgument, match="mu"):
        cp.Proximal(mu="best")
