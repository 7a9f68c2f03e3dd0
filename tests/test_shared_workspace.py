"""Threads: a workspace belongs to one at a time, and everything else may be shared."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from shared import all_scenes, each_row, robot, states

import condyn_pin as cp
from condyn_pin.dynamics import BoundSolver
from condyn_pin.dynamics.nominal import pinocchio_constraints_of

WAIT = 60.0  # [s], far more than anything here takes


class Held:
    """A solve that stays inside until it is let go, in another thread."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.inside, self.go = threading.Event(), threading.Event()
        start = cp.dynamics.Reference.start

        def held(solver: cp.dynamics.Reference, workspace: cp.Workspace) -> BoundSolver:
            method = start(solver, workspace)

            def acceleration(q, v, tau):
                self.inside.set()
                assert self.go.wait(WAIT)
                return method.acceleration(q, v, tau)

            return BoundSolver(acceleration, method.lam, method.iterations)

        monkeypatch.setattr(cp.dynamics.Reference, "start", held)

    def call(self, pool: ThreadPoolExecutor, function, *arguments):
        future = pool.submit(function, *arguments)
        assert self.inside.wait(WAIT)
        return future


LABEL = "talos foot held twice"

CALLS = {
    "solve": lambda w, q, v, tau: w.solve(q, v, tau),
    "acceleration": lambda w, q, v, tau: w.acceleration(q, v, tau),
    "acceleration with forces": lambda w, q, v, tau: w.acceleration(
        q, v, tau, forces=[cp.AppliedForce("left_sole_link", (1.0, 2.0, 3.0))]
    ),
    "derivatives": lambda w, q, v, tau: w.derivatives(q, v, tau),
    "terms": lambda w, q, v, tau: w.terms(q, v),
    "jacobian": lambda w, q, v, tau: w.jacobian(q),
    "violation": lambda w, q, v, tau: w.violation(q),
    "use": lambda w, q, v, tau: w.use(w.scene),
    "data": lambda w, q, v, tau: w.data,
    "constraint_models": lambda w, q, v, tau: w.constraint_models,
    "constraint_datas": lambda w, q, v, tau: w.constraint_datas,
}


@each_row("holding", ["solve", "acceleration", "derivatives"])
def test_another_thread_is_refused_while_one_is_at_work(monkeypatch, holding):
    held, scene = Held(monkeypatch), all_scenes()[LABEL]
    q, v, tau = states(LABEL)[0]
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    with ThreadPoolExecutor(1) as pool:
        future = held.call(pool, CALLS[holding], workspace, q, v, tau)
        for name, call in CALLS.items():
            with pytest.raises(cp.errors.SharedWorkspace, match="one Workspace"):
                pytest.fail(f"{name}: {call(workspace, q, v, tau)}")
        held.go.set()
        future.result(WAIT)
    for call in CALLS.values():  # and when it is done, nobody is refused
        call(workspace, q, v, tau)


@pytest.mark.long
@each_row("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_whatever_ends_a_call_leaves_the_workspace_free(monkeypatch, error):
    scene = all_scenes()[LABEL]
    q, v, tau = states(LABEL)[0]
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    bound = workspace.bound

    def fails(*_):
        raise error

    for name in ("solve", "acceleration", "derivatives"):
        workspace.bound = replace(bound, acceleration=fails)
        with pytest.raises(error):
            CALLS[name](workspace, q, v, tau)
        workspace.bound = bound
        with ThreadPoolExecutor(1) as pool:
            pool.submit(CALLS[name], workspace, q, v, tau).result(WAIT)


def test_lam_is_that_of_the_thread_that_asks():
    """Two threads in turn: no call overlaps, and lam would be that of the other's acceleration."""
    scene = all_scenes()[LABEL]
    q, v, tau = states(LABEL)[0]
    workspace = cp.Workspace(scene)
    workspace.acceleration(q, v, tau)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(workspace.acceleration, q, v, 2 * tau).result(WAIT)
        with pytest.raises(cp.errors.SharedWorkspace, match="another thread's"):
            workspace.lam()
        assert np.isfinite(pool.submit(workspace.lam).result(WAIT)).all()


@pytest.mark.parametrize("method", ["kkt", "differences"])
def test_what_derivatives_form_later_waits_for_no_other_thread(monkeypatch, method):
    """`dlam_dq` of redundant rows, and all of the differences, use the workspace when asked for."""
    held, scene = Held(monkeypatch), all_scenes()[LABEL]
    q, v, tau = states(LABEL)[0]
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    held.go.set()
    found = workspace.derivatives(q, v, tau, method=method)
    held.go.clear()
    held.inside.clear()
    with ThreadPoolExecutor(1) as pool:
        future = held.call(pool, workspace.solve, q, v, tau)
        with pytest.raises(cp.errors.SharedWorkspace):
            pytest.fail(str(found.dlam_dq))
        held.go.set()
        future.result(WAIT)
    assert np.isfinite(found.dlam_dq).all()


@pytest.mark.long
def test_the_verbs_keep_a_workspace_for_each_thread(monkeypatch):
    held, scene = Held(monkeypatch), all_scenes()[LABEL]
    (q, v, tau), (q2, v2, tau2) = states(LABEL)[:2]
    wanted = cp.solve(scene, q2, v2, tau2).a
    with ThreadPoolExecutor(1) as pool:
        future = held.call(pool, lambda: cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()))
        found = cp.solve(scene, q2, v2, tau2)
        cp.derivatives(scene, q2, v2, tau2)
        held.go.set()
        assert future.result(WAIT).status.ok
    assert np.array_equal(found.a, wanted)


@pytest.mark.long
def test_simulations_run_side_by_side():
    """A torque that waits for the other run: each run has memory of its own."""
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    q, v = scene.sample(np.random.default_rng(0))
    both = threading.Barrier(2, timeout=WAIT)

    def run(scale: float, meet: bool) -> cp.Trajectory:
        def tau(t, q, v):
            if meet:
                both.wait()
            return np.full(scene.robot.nv, scale)

        return cp.simulate(scene, q, v, tau, duration=0.02, dt=1e-3)

    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(run, (1.0, -2.0), (True, True)))
    for scale, found in zip((1.0, -2.0), together, strict=True):
        alone = run(scale, False)
        assert np.array_equal(found.q, alone.q)
        assert np.array_equal(found.lam, alone.lam)


@pytest.mark.long
def test_lazy_properties_of_a_scene_may_be_asked_for_at_once():
    scene = all_scenes()[LABEL]
    fresh = cp.Scene(scene.robot, scene.constraints)
    both = threading.Barrier(4, timeout=WAIT)

    def look(_):
        both.wait()
        return (
            fresh.nominal.weight,
            pinocchio_constraints_of(fresh).constraints,
            fresh.rank().rank,
        )

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(look, range(4)))
    assert {(weight, rank) for weight, _, rank in found} == {(scene.nominal.weight, found[0][2])}


@pytest.mark.long
def test_derivatives_stay_those_of_their_scene():
    """A derivative by a placement, asked for after the workspace has gone on to another scene."""
    talos = robot("talos")
    one, other = (
        cp.Scene(talos, [cp.SurfaceContact(f"{side}_sole_link", name="foot", anchor=anchor)])
        for side, anchor in (("left", (0, 0, 0, 0, 0, 0, 1)), ("right", (0, 0, 0.5, 0, 0, 0, 1)))
    )
    q, v, tau = states(LABEL)[0]
    workspace = cp.Workspace(one)
    found = workspace.derivatives(q, v, tau)
    wanted = found.by_placement("foot")
    workspace.use(other)
    for had, want in zip(found.by_placement("foot"), wanted, strict=True):
        assert np.array_equal(had, want)
