"""Baumgarte's terms: the same answer by every method, and gaps that close as they should."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from shared import SOLVERS, all_scenes, relative, robot, states, takes

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA, pin

PULLED = cp.Baumgarte(4.0, 6.0)
LABELS = [
    "talos contacts",
    "cassie loops",
    "four_bar loops",
    "talos foot to foot, welded",
    "talos hands to the world and together",
    "talos hands hinged",
    "cassie on lines",
]


@pytest.mark.parametrize("label", LABELS)
def test_every_method_is_pulled_the_same_way(label):
    """A little off the constraints, where equivalents of a hinge differ by squares of the gap."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    rng = np.random.default_rng(0)
    q = pin.integrate(scene.robot.model, q, 1e-7 * rng.normal(size=scene.robot.nv))
    v = v + 1e-7 * rng.normal(size=scene.robot.nv)
    exact = cp.solve(
        scene,
        q,
        v,
        tau,
        solver=cp.dynamics.Reference(rank_tolerance=1e-6),
        drift=PULLED,
        throw=False,
    )
    plain = cp.solve(scene, q, v, tau, solver=cp.Proximal(), drift=PULLED, throw=False)
    if not scene.nominal.redundant:  # open loops with redundant rows contradict each other
        for solver in (
            kind() for kind in SOLVERS.values() if kind not in (cp.LCABA, cp.dynamics.Soft)
        ):
            if takes(solver, scene):
                pulled = cp.solve(scene, q, v, tau, solver=solver, drift=PULLED, throw=False)
                assert relative(pulled.a, exact.a) < 1e-8, solver
    free = cp.solve(scene, q, v, tau, solver=cp.Proximal(), throw=False)
    gap = max(plain.state_error)
    assert gap > 1e-8
    assert relative(plain.a, free.a, 1.0) > 1e-10


def test_rows_are_the_damped_spring():
    """J a + gamma = -2 alpha J v - beta^2 c, row by row, far from closed."""
    bar = robot("four_bar")
    scene = cp.Scene(bar, [cp.Loop("coupler_tip", "rocker_tip", "planar", axis="y")])
    rng = np.random.default_rng(1)
    q, v, tau = rng.normal(size=(3, 3))
    workspace = cp.Workspace(scene, drift=PULLED)
    solution = workspace.solve(q, v, tau)
    t = workspace.terms(q, v)
    wanted = -8.0 * t.J @ v - 36.0 * workspace.violation(q)
    assert np.allclose(t.a_ref, wanted, rtol=1e-12)
    assert np.allclose(t.J @ solution.a + t.gamma, wanted, rtol=1e-9)


def test_a_contact_without_anchor_is_only_damped():
    scene = all_scenes()["solo12 contacts"]
    rng = np.random.default_rng(2)
    q, _, tau = states("solo12 contacts")[0]
    v = rng.normal(size=scene.robot.nv)
    for solver in (cp.Proximal(), cp.DenseKKT(), cp.dynamics.Reference()):
        damped = cp.solve(scene, q, v, tau, solver=solver, drift=cp.Baumgarte(4.0, 0.0))
        sprung = cp.solve(scene, q, v, tau, solver=solver, drift=cp.Baumgarte(4.0, 1e3))
        assert np.array_equal(damped.a, sprung.a)


def test_a_gap_closes_as_it_should():
    """c'' + 2 alpha c' + beta^2 c = 0: a four-bar, 1 mm open, integrated with small steps."""
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    q = q + np.array([1e-3, 0.0, 0.0])
    workspace = cp.Workspace(scene, drift=cp.Baumgarte(10.0, 10.0))
    gap, dt, tau = workspace.violation(q), 1e-4, np.zeros(3)
    for _ in range(2000):
        v = v + dt * workspace.acceleration(q, v, tau)
        q = pin.integrate(bar.model, q, dt * v)
    t = 0.2
    wanted = gap * (1 + 10.0 * t) * np.exp(-10.0 * t)
    assert np.abs(workspace.violation(q) - wanted).max() < 0.02 * np.abs(gap).max()


def test_it_is_a_value_and_goes_along():
    workspace = cp.Workspace(all_scenes()["four_bar loops"], drift=PULLED)
    assert pickle.loads(pickle.dumps(workspace)).drift == PULLED
    assert (PULLED.Kd, PULLED.Kp) == (8.0, 36.0)


@pytest.mark.parametrize(("alpha", "beta"), [(-1.0, 1.0), (1.0, -1e-9), (np.nan, 1.0), ("a", 1.0),
                                           (1.0, 1e155), (1e300, 1.0)])  # fmt: skip
def test_gains_are_refused(alpha, beta):
    with pytest.raises(cp.InvalidArgument, match=r"alpha|beta"):
        cp.Baumgarte(alpha, beta)


def test_refuses():
    scene, state = all_scenes()["four_bar loops"], states("four_bar loops")[0]
    with pytest.raises(cp.InvalidArgument, match="drift = 10"):
        cp.solve(scene, *state, drift=10.0)
    with pytest.raises(cp.InvalidArgument, match="use it without drift"):
        cp.solve(scene, *state, solver=cp.dynamics.Soft(), drift=PULLED)
    if HAS_LCABA:
        with pytest.raises(cp.errors.UnsupportedConstraint, match="ignores drift control"):
            cp.solve(scene, *state, solver=cp.LCABA(), drift=PULLED)
