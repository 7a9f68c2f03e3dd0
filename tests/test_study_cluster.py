"""A study on a Dask cluster of two processes, of which one is killed in the middle."""

from __future__ import annotations

import os
import signal

import condyn_pin as cp


def test_a_killed_worker_of_a_cluster_loses_nothing():
    from distributed import Client, LocalCluster

    study = cp.Study("four_bar", cp.sweep(cp.Proximal()), states=3)
    killed: list[int] = []
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        workers = list(client.run(os.getpid).values())

        def kill_one(what: str, done: int, total: int) -> None:
            if what.endswith("errors") and done > 1 and not killed:
                killed.append(workers[0])
                os.kill(workers[0], signal.SIGKILL)

        table = study.run(timed=False, executor=client.get_executor(), progress=kill_one)
    assert len(set(workers)) == 2
    assert killed
    assert table.rows == study.run(timed=False).rows
