"""A study on a Dask cluster of two processes, of which one is killed in the middle."""

from __future__ import annotations

import os

import pytest
from lost import KillsOnce

import condyn_pin as cp

pytestmark = pytest.mark.once


@pytest.mark.long
def test_a_killed_worker_of_a_cluster_loses_nothing(tmp_path):
    from distributed import Client, LocalCluster

    mark, solvers = tmp_path / "mark", cp.study.sweep(cp.Proximal())
    half = len(solvers) // 2
    solvers = [*solvers[:half], KillsOnce(mark=str(mark)), *solvers[half:]]
    study = cp.Study("four_bar", solvers, states=3)
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=None
        ) as cluster,
        Client(cluster) as client,
    ):
        workers = {*client.run(os.getpid).values()}
        table = study.run(timed=False, executor=client.get_executor())
    assert len(workers) == 2
    assert int(mark.read_text()) in workers
    assert table.rows == study.run(timed=False).rows
