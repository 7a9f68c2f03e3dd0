"""Many states at once: over two processes, over a Dask cluster, with a worker killed on the way.

OMP_NUM_THREADS=1 python examples/12_many_states.py
"""

import os
import signal
import sys

import numpy as np

import condyn_pin as cp


def main() -> None:
    """Solve and differentiate many states of Cassie's closed legs."""
    count = 500 if "--quick" in sys.argv else 2000
    cassie = cp.load_robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    rng = np.random.default_rng(0)
    some = [legs.sample(rng) for _ in range(20)]
    Q = np.resize([q for q, _ in some], (count, cassie.nq))
    V = np.resize([v for _, v in some], (count, cassie.nv))
    TAU = np.array([cassie.passive_torque(q, v) for q, v in zip(Q, V, strict=True)])

    here = cp.solve_batch(legs, Q, V, TAU)
    print(here)

    # The same over two processes of this machine. One is killed after the third chunk: what it
    # worked on is done again by another.
    with cp.Processes(2) as executor:
        done = []

        def kill_one(*counts: int) -> None:
            done.append(counts)
            if len(done) == 3:
                os.kill(executor.pids[0], signal.SIGKILL)

        there = cp.solve_batch(legs, Q, V, TAU, executor=executor, progress=kill_one)
        d = cp.simulation.derivatives_batch(legs, Q[:50], V[:50], TAU[:50], executor=executor)
    print("after the loss of a process:", there)
    print("derivatives:", d.da_dq.shape, d.dlam_dtau.shape)

    # Where rows are redundant, a method that needs independent ones fails, and it shows.
    dense = cp.solve_batch(legs, Q[:100], V[:100], TAU[:100], solver=cp.DenseKKT())
    print("DenseKKT:", dense.counts)

    # And over a cluster: here two processes of this machine, elsewhere any number of computers.
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print('no cluster: pip install "condyn_pin[cluster]"')
    else:
        with LocalCluster(n_workers=2, dashboard_address=None) as cluster, Client(cluster) as dask:
            far = cp.solve_batch(legs, Q, V, TAU, executor=dask.get_executor())
        print("Dask:", far)
        assert np.array_equal(far.a, here.a)

    exact = cp.solve_batch(legs, Q[:20], V[:20], TAU[:20], solver=cp.dynamics.Reference())
    error = np.abs(there.a[:20] - exact.a).max() / np.abs(exact.a).max()
    assert np.array_equal(there.a, here.a)  # to the last bit
    print(f"error of the batch against Reference: {error:.0e} of max |a|")


if __name__ == "__main__":
    main()
