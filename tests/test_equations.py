"""M, h, J and gamma against differences on the manifold and against Pinocchio's own objects."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, each_scene, relative, states

import condyn_pin as cp
from condyn_pin._core import _pin
from condyn_pin.constraints.rows.bound import BoundBetweenFrames


def equations(label: str):
    scene = all_scenes()[label]
    return cp.Workspace(scene).equations


def central(f, model, q, h=1e-6):
    """Central differences of f on the manifold, a column a tangent direction."""
    columns = []
    for i in range(model.nv):
        step = np.zeros(model.nv)
        step[i] = h
        columns.append(
            (f(pin.integrate(model, q, step)) - f(pin.integrate(model, q, -step))) / (2 * h)
        )
    return np.column_stack(columns)


@each_scene
def test_jacobian_is_the_derivative_of_the_violation(label):
    """At a closed state, for every row that has a position error."""
    scene = all_scenes()[label]
    rows = [row for b in scene.bounds for row in b.positioned]
    if not rows:
        return
    eq, q = equations(label), states(label)[0][0]
    J, numeric = eq.jacobian(q), central(eq.violation, scene.robot.model, q)
    assert np.abs(J[rows] - numeric[rows]).max() < 1e-8


@each_scene
def test_jacobian_equals_pinocchios(label):
    scene = all_scenes()[label]
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    q = states(label)[0][0]
    if not all(isinstance(b, BoundBetweenFrames) and b.is_plain for b in scene.bounds):
        return  # rows that Pinocchio does not have
    if not scene.rows:
        assert workspace.jacobian(q).shape == (0, scene.robot.nv)
        return
    pinocchio = (
        workspace.model, workspace.data, workspace.constraint_models, workspace.constraint_datas
    )  # fmt: skip
    _pin.factorise_constraints(*pinocchio, q, 1.0)  # which computes what the next line reads
    theirs = pin.getConstraintsJacobian(*pinocchio)
    assert relative(workspace.equations.sign[:, None] * workspace.jacobian(q), theirs, 1.0) < 1e-14


@each_scene
def test_gamma_is_the_time_derivative_of_the_jacobian_times_v(label):
    """(d/dt J(q(t))) v along q(t) = q (+) t v, at a state with J v = 0."""
    scene = all_scenes()[label]
    if not scene.rows:
        return
    eq, (q, v, _) = equations(label), states(label)[0]
    model, h = scene.robot.model, 1e-6
    ahead, behind = (eq.jacobian(pin.integrate(model, q, s * h * v)) @ v for s in (1, -1))
    gamma = eq.terms(q, v).gamma
    assert relative((ahead - behind) / (2 * h), gamma, floor=np.abs(v).max() ** 2) < 1e-7


@each_scene
def test_velocity_rows_are_the_jacobian_times_v(label):
    """Off the constraints too."""
    scene = all_scenes()[label]
    if not scene.rows:
        return
    eq = equations(label)
    rng = np.random.default_rng(3)
    model = scene.robot.model
    q = pin.integrate(model, states(label)[0][0], 0.05 * rng.normal(size=model.nv))
    v, a = rng.normal(size=(2, model.nv))
    eq.motion(q, v, a)
    velocity, acceleration = eq._velocity.copy(), eq._acceleration.copy()
    t = eq.terms(q, v)
    assert relative(velocity, t.J @ v, 1.0) < 1e-13
    assert relative(acceleration, t.J @ a + t.gamma, 1.0) < 1e-13


@each_scene
def test_mass_matrix_is_symmetric_and_gives_the_inverse_dynamics(label):
    scene = all_scenes()[label]
    eq, (q, v, _) = equations(label), states(label)[0]
    t = eq.terms(q, v)
    a = np.random.default_rng(4).normal(size=scene.robot.nv)
    tau = pin.rnea(scene.robot.model, scene.robot.model.createData(), q, v, a)
    assert np.array_equal(t.M, t.M.T)
    assert relative(t.M @ a + t.h, tau, 1.0) < 1e-13


@pytest.mark.long
@each_scene
def test_errors_equal_the_assembled_residuals(label):
    """For any a and lam, not only for an answer."""
    scene = all_scenes()[label]
    eq, (q, v, tau) = equations(label), states(label)[0]
    rng = np.random.default_rng(5)
    a, lam = rng.normal(size=scene.robot.nv), rng.normal(size=scene.rows)
    t = eq.terms(q, v)
    dynamics, largest = eq.errors(q, v, tau, a, lam)
    expected = np.abs(t.M @ a + t.h - tau - t.J.T @ lam)
    assert relative(dynamics, expected, 1.0) < 1e-12
    sizes = [expected, a, eq.violation(q), t.J @ v, t.J @ a + t.gamma, lam]
    for found, wanted in zip(largest, sizes, strict=True):
        wanted = np.abs(wanted).max(initial=0.0)
        assert abs(found - wanted) <= 1e-12 * max(wanted, 1.0)


@pytest.mark.long
@each_scene
def test_terms_are_owned(label):
    eq = equations(label)
    first, second, *_ = states(label)
    t = eq.terms(*first[:2])
    kept = [x.copy() for x in (t.M, t.h, t.J, t.gamma)]
    eq.terms(*second[:2])
    assert all(np.array_equal(x, y) for x, y in zip((t.M, t.h, t.J, t.gamma), kept, strict=True))
