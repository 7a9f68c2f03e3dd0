"""A real Dask cluster on this machine: two worker processes, one of them killed on the way."""

from __future__ import annotations

import os

import numpy as np
import pytest
from distributed import Client, LocalCluster
from lost import KillsOnce
from shared import BLOCKS, all_scenes, motor_torque

import condyn_pin as cp

pytestmark = pytest.mark.once


@pytest.fixture(scope="module")
def client():
    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=2,
            processes=True,
            dashboard_address=None,
            memory_limit=None,  # a share of the machine's is little where there are many cores
        ) as cluster,  # fmt: skip
        Client(cluster) as client,
    ):
        yield client


def batch_of(scene: cp.Scene, count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(20)]
    return tuple(
        np.resize(np.array(each), (count, len(each[0]))) for each in zip(*states, strict=True)
    )


def test_a_cluster_changes_no_bit(client):
    scene = all_scenes()["cassie loops"]
    states = batch_of(scene, 60)
    executor = client.get_executor()
    for solver in (None, cp.dynamics.NullSpace()):
        here = cp.solve_batch(scene, *states, solver=solver)
        there = cp.solve_batch(scene, *states, solver=solver, executor=executor, chunk=4)
        for name in ("a", "lam", "residuals", "statuses", "iterations"):
            np.testing.assert_array_equal(getattr(there, name), getattr(here, name), err_msg=name)
    of, there_of = (
        cp.simulation.derivatives_batch(scene, *states, executor=e) for e in (None, executor)
    )
    for name in BLOCKS:
        np.testing.assert_array_equal(getattr(there_of, name), getattr(of, name))


def test_errors_come_back(client):
    scene = all_scenes()["four_bar rod"]
    states = batch_of(scene, 20)
    with pytest.raises(cp.errors.UnsupportedConstraint, match="Proximal takes"):
        cp.solve_batch(scene, *states, solver=cp.Proximal(), executor=client.get_executor())


def test_a_killed_worker_loses_nothing(client, tmp_path):
    scene = all_scenes()["four_bar loops"]
    states = batch_of(scene, 4000)
    before = {*client.run(os.getpid).values()}
    assert len(before) == 2
    mark, executor, seen = tmp_path / "mark", client.get_executor(), []
    found = cp.solve_batch(
        scene, *states, solver=KillsOnce(mark=str(mark), at=float(states[0][5, 0])),
        executor=executor, chunk=50, progress=lambda *counts: seen.append(counts),
    )  # fmt: skip
    assert seen == [(50 * i, 4000) for i in range(1, 81)]
    np.testing.assert_array_equal(found.a, cp.solve_batch(scene, *states, solver=cp.Proximal()).a)
    client.wait_for_workers(2, timeout=300)
    victim = int(mark.read_text())
    assert {*client.run(os.getpid).values()} & before == before - {victim}
    assert cp.solve_batch(scene, *states, executor=executor).ok  # the new one serves too
