"""Many states at once: the bits of `solve`, whoever did the work; nothing lost, nothing hidden."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from lost import KillsOnce
from shared import BLOCKS, all_scenes, motor_torque

import condyn_pin as cp
from condyn_pin._core import rows, work
from condyn_pin._core.work import Kind, SharedArrays
from condyn_pin.simulation.batch.inputs import PickledRecipe, Recipe

LABELS = ("talos contacts", "cassie loops", "four_bar loops", "solo12 alone")
N = 24

# Lost workers, chunks, signals and shared memory: Pinocchio has no part in them.
of_processes = pytest.mark.once


def batch_of(label: str, count: int = N) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    scene, rng = all_scenes()[label], np.random.default_rng(5)
    states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    return tuple(map(np.array, zip(*states, strict=True)))  # type: ignore[return-value]


@pytest.fixture(scope="module")
def executor():
    with cp.Processes(2) as processes:
        yield processes


def assert_same(found: cp.simulation.BatchSolution, wanted: cp.simulation.BatchSolution) -> None:
    for name in ("q", "a", "lam", "residuals", "statuses", "iterations"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)


@pytest.mark.parametrize("label", LABELS)
def test_a_batch_has_the_bits_of_single_solves(label):
    scene, (q, v, tau) = all_scenes()[label], batch_of(label)
    batch = cp.solve_batch(scene, q, v, tau)
    assert batch.ok
    assert batch.counts == {"ok": N}
    assert len(batch) == N
    for i, solution in enumerate(batch):
        wanted = cp.solve(scene, q[i], v[i], tau[i])
        np.testing.assert_array_equal(solution.a, wanted.a)
        np.testing.assert_array_equal(solution.lam, wanted.lam)
        assert solution.residuals == wanted.residuals
        assert (solution.status, solution.iterations) == (wanted.status, wanted.iterations)
        for name, force in wanted.forces.items():
            np.testing.assert_array_equal(batch.forces[name][i], force)
            np.testing.assert_array_equal(solution.world_forces[name], wanted.world_forces[name])
    assert batch.error_bound.max() <= 1e-8
    assert batch.dynamics_error[3] == batch[3].dynamics_error
    assert batch.constraint_error[3] == batch[3].constraint_error
    assert (batch.violation[3], batch.velocity_violation[3]) == batch[3].state_error


@pytest.mark.parametrize("label", LABELS)
def test_processes_change_no_bit(label, executor):
    scene, states = all_scenes()[label], batch_of(label)
    assert_same(
        cp.solve_batch(scene, *states, executor=executor, chunk=5), cp.solve_batch(scene, *states)
    )


@pytest.mark.long
@pytest.mark.parametrize("label", LABELS)
def test_derivatives(label, executor):
    scene, (q, v, tau) = all_scenes()[label], batch_of(label, 6)
    here = cp.simulation.derivatives_batch(scene, q, v, tau)
    there = cp.simulation.derivatives_batch(scene, q, v, tau, executor=executor, chunk=2)
    assert len(here) == 6
    assert_same(there.solution, here.solution)
    wanted = cp.derivatives(scene, q[4], v[4], tau[4])
    for name in BLOCKS:
        np.testing.assert_array_equal(getattr(here, name)[4], getattr(wanted, name))
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    np.testing.assert_array_equal(here.matrix[4], wanted.matrix)


@pytest.mark.parametrize("without", ["shared memory", "so much memory"])
def test_where_memory_cannot_be_shared_it_is_copied(without, executor, monkeypatch):
    if without == "shared memory":
        monkeypatch.setattr(rows, "CAN_SHARE", False)
    else:
        monkeypatch.setattr(work.os, "ftruncate", _no_memory)
    scene, states = all_scenes()["talos contacts"], batch_of("talos contacts")
    found = cp.solve_batch(scene, *states, executor=executor, chunk=7)
    assert_same(found, cp.solve_batch(scene, *states))
    assert _shared_memory() == 0


def _no_memory(*_: int) -> None:
    raise OSError(28, "No space left on device")


def test_threads_give_the_same():
    scene, states = all_scenes()["cassie loops"], batch_of("cassie loops")
    with ThreadPoolExecutor(3) as threads:
        found = cp.solve_batch(scene, *states, executor=threads, chunk=2)
    assert_same(found, cp.solve_batch(scene, *states))


@pytest.mark.long
@pytest.mark.parametrize(
    ("same", "torque"),
    [(list, 1.0), (np.array, 1.0), (lambda _: 0, 0.0), (lambda _: 0.0, 0.0)],
    ids=["list", "array", "0", "0.0"],
)
def test_one_torque_for_all(same, torque, executor):
    scene, (q, v, tau) = all_scenes()["talos contacts"], batch_of("talos contacts")
    wanted = cp.solve_batch(scene, q, v, np.tile(torque * tau[0], (N, 1)))
    for where in (None, executor):
        assert_same(cp.solve_batch(scene, q, v, same(tau[0]), executor=where), wanted)


def test_some_rows_are_a_batch_and_one_is_an_answer():
    scene, (q, v, tau) = all_scenes()["cassie loops"], batch_of("cassie loops", 6)
    v[3] *= 1e170
    of = cp.simulation.derivatives_batch(scene, q, v, tau)
    batch = of.solution
    for some in (slice(2, 4), slice(None, None, -2), batch.statuses == 0, batch.failed, [5, 0], []):
        part, part_of = batch[some], of[some]
        assert_same(part_of.solution, part)
        np.testing.assert_array_equal(part.solve_times, batch.solve_times[some])
        np.testing.assert_array_equal(part.a, batch.a[some])
        np.testing.assert_array_equal(part_of.dlam_dq, of.dlam_dq[some])
        assert not part.a.flags.writeable
        assert not part_of.da_dq.flags.writeable
    assert (len(batch[2:4]), batch[2:4].counts) == (2, {"ok": 1, "not_finite": 1})
    assert batch[2:4][1].status is cp.Status.NOT_FINITE
    np.testing.assert_array_equal(batch[-1].a, batch.a[5])
    assert of[3].solution.status is cp.Status.NOT_FINITE
    assert np.isnan(of[3].da_dq).all()
    with pytest.raises(IndexError):
        batch[6]
    with pytest.raises(IndexError):
        of[6]


@pytest.mark.long
def test_the_derivatives_of_one_row_are_those_of_the_state():
    scene, (q, v, tau) = all_scenes()["cassie loops"], batch_of("cassie loops", 2)
    found = cp.simulation.derivatives_batch(scene, q, v, tau)[1]
    wanted = cp.derivatives(scene, q[1], v[1], tau[1])
    for name in BLOCKS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    n, m = scene.robot.nv, scene.rows
    rng = np.random.default_rng(1)
    steps, gradients = rng.normal(size=(3, n)), (rng.normal(size=n), rng.normal(size=m))
    mine = *found.jvp(*steps), *found.vjp(*gradients)
    theirs = *wanted.jvp(*steps), *wanted.vjp(*gradients)
    for one, other in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


@of_processes
@pytest.mark.parametrize("kind", [cp.Processes, ThreadPoolExecutor])
def test_an_executor_that_was_shut_down(kind):
    scene, states = all_scenes()["four_bar loops"], batch_of("four_bar loops")
    executor = kind(1)
    executor.shutdown()
    text = r"executor = .* takes no work \(.*after shutdown\); 4 of 4 chunks are left"
    with pytest.raises(cp.errors.WorkersLost, match=text) as lost:
        cp.solve_batch(scene, *states, executor=executor, chunk=6)
    assert lost.value.done.counts == {"missing": N}
    assert str(lost.value.done).endswith(", ... (missing: no worker got to it)")


@pytest.mark.long
@of_processes
def test_places_of_shared_memory_are_used_again(executor):
    """Far more chunks than places, and the last ones smaller: every row is where it belongs."""
    scene, (q, v, tau) = all_scenes()["four_bar loops"], batch_of("four_bar loops", 500)
    q[17], v[17] = scene.state()
    assert_same(
        cp.solve_batch(scene, q, v, tau, executor=executor, chunk=7),
        cp.solve_batch(scene, q, v, tau),
    )
    assert _shared_memory() == 0


@pytest.mark.long
def test_drift_solver_and_accuracy_reach_the_workers(executor):
    scene, (q, v, tau) = all_scenes()["cassie loops"], batch_of("cassie loops")
    options = {"solver": cp.Proximal(mu=1e-3, max_iterations=1), "accuracy": 1e-1}
    options["drift"] = cp.Baumgarte(10.0, 10.0)
    found = cp.solve_batch(scene, q, 2 * v, tau, executor=executor, **options)
    assert_same(found, cp.solve_batch(scene, q, 2 * v, tau, **options))
    wanted = cp.solve(scene, q[3], 2 * v[3], tau[3], throw=False, **options)
    np.testing.assert_array_equal(found.a[3], wanted.a)
    exact = cp.solve_batch(scene, q, 2 * v, tau, executor=executor)
    assert np.abs(exact.a - found.a).max() > 1e-6


@pytest.mark.long
def test_what_is_not_ok_is_counted_and_named(executor):
    scene, (q, v, tau) = all_scenes()["talos contacts"], batch_of("talos contacts")
    v[[2, 17]] *= 1e170  # finite, and its square is not
    here = cp.solve_batch(scene, q, v, tau)
    assert here.failed.tolist() == [2, 17]
    assert not here.ok
    assert here.counts == {"ok": N - 2, "not_finite": 2}
    assert here[2].status is cp.Status.NOT_FINITE
    assert str(here).endswith(f"\nnot ok: 2, 17 ({cp.Status.NOT_FINITE})")
    assert "22 ok, 2 not_finite" in repr(here)
    assert np.isfinite(here.a[here.statuses == 0]).all()
    assert_same(cp.solve_batch(scene, q, v, tau, executor=executor, chunk=4), here)

    of = cp.simulation.derivatives_batch(scene, q, v, tau, executor=executor, chunk=4)
    for name in ("q", "a", "lam", "statuses", "iterations"):
        np.testing.assert_array_equal(getattr(of.solution, name), getattr(here, name), err_msg=name)
    # Newton and Euler's recursion is that of the derivatives here, which adds in another order
    rounding = 1e-13 * 9.81 * scene.robot.mass
    np.testing.assert_allclose(of.solution.residuals, here.residuals, rtol=0, atol=rounding)
    for name in BLOCKS:
        bad = np.isnan(getattr(of, name)).reshape(N, -1)
        assert bad.all(axis=1).nonzero()[0].tolist() == [2, 17]
        assert bad.any(axis=1).nonzero()[0].tolist() == [2, 17]


@pytest.mark.long
def test_a_singular_matrix_in_every_row():
    scene, states = all_scenes()["cassie loops"], batch_of("cassie loops")
    batch = cp.solve_batch(scene, *states, solver=cp.DenseKKT())
    assert batch.counts == {"singular": N}
    assert np.isnan(batch.a).all()
    assert np.isinf(batch.error_bound).all()
    assert f"not ok: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, ... ({cp.Status.SINGULAR})" in str(batch)


@pytest.mark.long
def test_no_states(executor):
    scene = all_scenes()["talos contacts"]
    nothing = np.zeros((0, scene.robot.nv))
    for where in (None, executor):
        batch = cp.solve_batch(
            scene, np.zeros((0, scene.robot.nq)), nothing, nothing, executor=where
        )
        assert (len(batch), batch.ok, batch.counts, batch.lam.shape) == (0, True, {}, (0, 12))
        assert repr(batch) == "BatchSolution(talos, 0 states: none)"


@pytest.mark.long
def test_answers_are_frozen_pickle_and_do_not_follow_their_arguments(executor):
    scene, (q, v, tau) = all_scenes()["four_bar loops"], batch_of("four_bar loops")
    batch = cp.solve_batch(scene, q, v, tau, executor=executor)
    kept = batch.q.copy()
    q += 1.0
    np.testing.assert_array_equal(batch.q, kept)
    assert not batch.a.flags.writeable
    assert_same(pickle.loads(pickle.dumps(batch)), batch)


@pytest.mark.parametrize("verb", [cp.solve_batch, cp.simulation.derivatives_batch])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_number_that_is_not_finite_is_named_with_its_row(which, verb):
    scene, states = all_scenes()["talos contacts"], batch_of("talos contacts")
    states[which][13, 9] = np.nan
    with pytest.raises(
        cp.InvalidArgument, match=rf"{('Q', 'V', 'TAU')[which]}\[13, 9\] = nan: finite"
    ):
        verb(scene, *states)


def test_shapes_and_quaternions_are_named():
    scene, (q, v, tau) = all_scenes()["talos contacts"], batch_of("talos contacts")
    loose = q.copy()
    loose[5, 3:7] *= 1.1
    for states, text in (
        ((q[0], v, tau), r"Q has shape \(39,\): .* shape \(N, 39\) is needed, one row per state"),
        ((q[:, 1:], v, tau), r"Q has shape \(24, 38\): an array of shape \(24, 39\)"),
        ((q, v[1:], tau), r"V has shape \(23, 38\): an array of shape \(24, 38\)"),
        ((q, v, tau[:, :5]), r"TAU has shape \(24, 5\): an array of shape \(24, 38\)"),
        ((q, v, tau[0, :5]), r"TAU has shape \(5,\): an array of shape \(38,\)"),
        ((q, v, 1.0), r"TAU has shape \(\): an array of shape \(24, 38\)"),
        (([[0.0], [0.0, 1.0]], v, tau), r"Q: an array of shape \(N, 39\) is needed"),
        (("states", v, tau), r"Q has shape \(\)"),
        ((loose, v, tau), r"Q\[5, 3:7\] = .* has norm 1\.1: .* Q\[5\]"),
    ):
        with pytest.raises(cp.InvalidArgument, match=text):
            cp.solve_batch(scene, *states)


@pytest.mark.values
@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"chunk": 0}, "chunk = 0: a whole number"),
        ({"chunk": 2.5}, "chunk = 2.5: a whole number"),
        ({"chunk": True}, "chunk = True: a whole number"),
        ({"accuracy": 0.0}, "accuracy = 0.0"),
        ({"executor": 2}, "executor = 2: a concurrent.futures.Executor"),
        ({"solver": "proximal"}, "solver = 'proximal': a solver object"),
        ({"solver": lambda: None}, "solver = <function"),
        ({"drift": 3.0}, "drift = 3.0"),
    ],
)
@pytest.mark.parametrize("processes", [False, True])
def test_options_are_checked(options, text, processes, executor):
    scene, states = all_scenes()["four_bar loops"], batch_of("four_bar loops")
    if processes:
        options = {"executor": executor} | options
    with pytest.raises(cp.InvalidArgument, match=text):
        cp.solve_batch(scene, *states, **options)


def test_other_refusals(executor):
    scene, states = all_scenes()["four_bar rod"], batch_of("four_bar loops")
    with pytest.raises(cp.errors.UnsupportedConstraint, match="Proximal takes"):
        cp.solve_batch(scene, *states, solver=cp.Proximal(), executor=executor)
    with pytest.raises(cp.InvalidArgument, match="scene = str"):
        cp.solve_batch("four_bar", *states)
    with pytest.raises(cp.errors.UnknownName, match="no method named 'kkd'; did you mean 'kkt'"):
        cp.simulation.derivatives_batch(scene, *states, method="kkd")


@pytest.mark.long
@of_processes
@pytest.mark.parametrize("count", [0, 1, 15, 1000, 100_000])
def test_chunks_cover_all_rows_and_become_smaller(count):
    chunks = rows.chunks_of(count, None, 1000)
    assert [i for rows in chunks for i in range(rows.start, rows.stop)] == list(range(count))
    sizes = [rows.stop - rows.start for rows in chunks]
    assert sizes == sorted(sizes, reverse=True)
    assert max(sizes, default=0) <= 1000
    assert len(chunks) <= count / 1000 + 40


@pytest.mark.long
def test_unpickled_states_take_the_hot_path(monkeypatch):
    """An unpickled array has a dtype object of its own: a study in a worker solved all twice."""
    scene, states = all_scenes()["talos contacts"], batch_of("talos contacts", 1)
    here = [np.array(x[0]) for x in states]
    there = pickle.loads(pickle.dumps(here))
    assert there[0].dtype is not here[0].dtype
    workspace = cp.Workspace(scene)
    wanted = workspace.acceleration(*here)
    swapped = [here[0], here[1].astype(">f8"), here[2]]
    np.testing.assert_array_equal(workspace.acceleration(*swapped), wanted)
    monkeypatch.setattr(workspace, "careful_acceleration", None)
    monkeypatch.setattr(workspace._arguments, "check", None)
    np.testing.assert_array_equal(workspace.acceleration(*there), wanted)
    np.testing.assert_array_equal(workspace.solve(*there).a, wanted)
    with pytest.raises(TypeError):
        workspace.acceleration(*swapped)


@pytest.mark.long
def test_a_workspace_is_made_once(executor):
    recipes = [Recipe(all_scenes()[label]).pickled() for label in LABELS]
    for recipe in recipes:
        found = dict(cp.map_chunks(_whose, [recipe] * 12, executor=executor))
        again = dict(cp.map_chunks(_whose, [recipe] * 12, executor=executor))
        made = {*found.values(), *again.values()}
        assert len(made) == len({process for process, _ in made}) <= 2


def _whose(recipe: PickledRecipe) -> tuple[int, int]:
    return os.getpid(), id(recipe.workspace())


@pytest.mark.long
@of_processes
def test_a_killed_worker_loses_nothing(tmp_path):
    scene, states = all_scenes()["four_bar loops"], batch_of("four_bar loops", 200)
    solver = KillsOnce(mark=str(tmp_path / "mark"), at=float(states[0][100, 0]))
    seen = []
    with cp.Processes(2) as processes:
        first = processes._pool
        found = cp.solve_batch(
            scene, *states, solver=solver, executor=processes, chunk=5,
            progress=lambda *counts: seen.append(counts),
        )  # fmt: skip
        assert processes._pool is not first
    assert_same(found, cp.solve_batch(scene, *states, solver=cp.Proximal()))
    assert seen == [(5 * i, 200) for i in range(1, 41)]


@pytest.mark.long
@of_processes
@pytest.mark.parametrize(
    ("verb", "shared"), [(cp.solve_batch, True), (cp.simulation.derivatives_batch, False)]
)
def test_a_plain_pool_that_breaks_hands_over_what_is_done(verb, shared, monkeypatch, tmp_path):
    if not shared:
        monkeypatch.setattr(rows, "CAN_SHARE", False)
    scene, states = all_scenes()["four_bar loops"], batch_of("four_bar loops", 400)
    solver = KillsOnce(mark=str(tmp_path / "mark"), at=float(states[0][200, 0]))
    with (
        ProcessPoolExecutor(2, get_context("spawn")) as pool,
        pytest.raises(cp.errors.WorkersLost, match="is of no use after that") as lost,
    ):
        verb(scene, *states, solver=solver, executor=pool, chunk=10)
    here, done = verb(scene, *states, solver=cp.Proximal()), lost.value.done
    if verb is cp.simulation.derivatives_batch:
        of, here, done = (here, done), here.solution, done.solution
        assert np.isnan(of[1].da_dq[done.missing]).all()
        solved = np.flatnonzero(done.statuses == 0)
        np.testing.assert_array_equal(of[1].dlam_dq[solved], of[0].dlam_dq[solved])
    assert 100 <= done.counts["ok"] < 400
    assert done.counts["missing"] == 400 - done.counts["ok"] == len(done.missing)
    assert not done.ok
    assert np.isnan(done.a[done.missing]).all()
    solved = np.flatnonzero(done.statuses == 0)
    np.testing.assert_array_equal(done.a[solved], here.a[solved])
    with pytest.raises(cp.errors.WorkersLost, match="no worker got to state"):
        done[int(done.missing[0])]


def _meet(folder: str) -> int:
    """Come back when two processes have come."""
    Path(folder, str(os.getpid())).touch()
    while len(os.listdir(folder)) < 2:
        sleep(0.01)
    return os.getpid()


@of_processes
def test_an_interrupt_ends_a_batch_and_not_the_workers(executor, tmp_path):
    scene, states = all_scenes()["four_bar loops"], batch_of("four_bar loops", 400)
    seen = []

    def interrupt(*_: int) -> None:
        seen.append(executor.pids)
        if len(seen) == 3:
            raise KeyboardInterrupt

    ready = dict(cp.map_chunks(_meet, [str(tmp_path)] * 2, executor=executor))
    assert {*ready.values()} == {*executor.pids}  # one that still imports would end
    for pid in executor.pids:
        os.kill(pid, signal.SIGINT)  # as a terminal does
    with pytest.raises(KeyboardInterrupt):
        cp.solve_batch(scene, *states, executor=executor, chunk=2, progress=interrupt)
    assert len(seen) == 3
    assert cp.solve_batch(scene, *states, executor=executor).ok
    assert executor.pids == seen[0]
    assert _shared_memory() == 0


@of_processes
def test_memory_that_is_gone_is_not_taken_for_what_came_after():
    """The next arrays may have the same number of a file; late work may not write there."""
    kinds = {"x": Kind((3,))}
    with closing(SharedArrays(kinds)) as before, closing(SharedArrays(kinds)) as after:
        late = replace(before.address, path=after.address.path)
        with pytest.raises(FileNotFoundError, match="another file"):
            late.open()
        assert np.array_equal(after.address.open()["x"], np.zeros(3))


@pytest.mark.long
@of_processes
def test_shared_arrays():
    kinds = {"x": Kind((3, 2)), "none": Kind((0, 4)), "n": Kind((5,), "i1"), "end": Kind((2, 0))}
    with closing(SharedArrays(kinds)) as shared:
        assert _shared_memory() == 2  # ours, and that of the map
        other = shared.address.open()
        other["x"][:], other["n"][:] = 2.5, 7
        for name, kind in kinds.items():
            assert shared.arrays[name].shape == other[name].shape == kind.shape
            assert not other[name].size or other[name].ctypes.data % 64 == 0
        assert (shared.arrays["x"] == 2.5).all()
        assert (shared.arrays["n"] == 7).all()
    assert shared.arrays["x"].sum() == 15.0  # still there
    with pytest.raises(FileNotFoundError):
        shared.address.open()
    del shared, other
    assert _shared_memory() == 0
    with pytest.raises(OSError, match=r"memory|space|large"):
        SharedArrays({"x": Kind((2**59,))})
    assert _shared_memory() == 0


def _shared_memory() -> int:
    """Return how many files of this process are shared memory of a batch."""
    gc.collect()  # an exception and its frames keep each other, and arrays with them
    links = (os.readlink(path) for path in Path("/proc/self/fd").iterdir() if path.is_symlink())
    return sum("memfd:condyn_pin" in link for link in links)


SCRIPT = """
import numpy as np
import condyn_pin as cp

def main():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    many = np.tile(q, (50, 1)), np.tile(v, (50, 1)), np.zeros(3)
    with cp.Processes(2, start_method={start_method!r}) as executor:
        batch = cp.solve_batch(scene, *many, executor=executor)
        of = cp.simulation.derivatives_batch(scene, *many, executor=executor)
    assert np.array_equal(batch.a, cp.solve_batch(scene, *many).a)
    assert np.array_equal(of.da_dq, cp.simulation.derivatives_batch(scene, *many).da_dq)
    print(batch.counts)

if __name__ == "__main__":
    main()
"""


@pytest.mark.long
@of_processes
@pytest.mark.parametrize("start_method", ["spawn", "forkserver", "fork"])
def test_a_script_ends_without_a_word(start_method, tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(start_method=start_method))
    result = subprocess.run(
        [sys.executable, "-W", "error", str(path)], capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "{'ok': 50}\n", "")


# --- samples


@pytest.mark.parametrize("label", ["cassie loops", "four_bar loops", "talos contacts"])
def test_many_samples_are_one_after_the_other_whoever_draws_them(label, executor):
    scene, n = all_scenes()[label], 70  # two chunks
    Q, V = cp.simulation.sample_batch(scene, n, np.random.default_rng(7), spread=0.1, speed=0.5)
    children = np.random.default_rng(7).spawn(n)
    single = [scene.sample(child, spread=0.1, speed=0.5) for child in children]
    assert np.array_equal(Q, [q for q, _ in single])
    assert np.array_equal(V, [v for _, v in single])
    with ThreadPoolExecutor(2) as threads:
        for by in (executor, threads):
            rng = np.random.default_rng(7)
            found = cp.simulation.sample_batch(scene, n, rng, spread=0.1, speed=0.5, executor=by)
            assert np.array_equal(found[0], Q)
            assert np.array_equal(found[1], V)


@pytest.mark.long
def test_samples_of_a_second_call_are_others():
    scene, rng = all_scenes()["four_bar loops"], np.random.default_rng(7)
    first, second = (cp.simulation.sample_batch(scene, 3, rng)[0] for _ in range(2))
    assert not np.isin(first, second).any()
    assert [x.shape for x in cp.simulation.sample_batch(scene, 0, rng)] == [(0, 3), (0, 3)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((-1, np.random.default_rng(0)), "n = -1: a whole number"),
        ((3, 0), "rng = 0: numpy.random.default_rng"),
    ],
)
def test_bad_arguments_of_many_samples_are_refused(arguments, text):
    with pytest.raises(cp.InvalidArgument, match=text):
        cp.simulation.sample_batch(all_scenes()["four_bar loops"], *arguments)
