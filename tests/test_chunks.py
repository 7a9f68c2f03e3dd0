"""Chunks over executors: here, threads, processes of every kind; lost workers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import crash
import pytest
from lost import kill_once
from shared import each_row

import condyn_pin as cp

pytestmark = pytest.mark.once


def square(x: int) -> int:
    return x * x


def refuse(x: int) -> int:
    if x == 3:
        raise cp.InvalidArgument("x = 3: another number is needed")
    return x


def die_once(mark: str, x: int) -> int:
    """Kill the worker at x = 3, the first time."""
    if x == 3:
        kill_once(mark)
    return square(x)


def die(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return square(x)


SQUARES = {i: i * i for i in range(10)}


def results(work, executor, **options) -> dict[int, int]:
    return dict(cp.map_chunks(work, range(10), executor=executor, **options))


@pytest.mark.long
def test_work_is_done_here_and_in_order_or_by_threads():
    assert list(cp.map_chunks(square, [3, 4])) == [(0, 9), (1, 16)]
    with ThreadPoolExecutor(2) as executor:
        assert results(square, executor) == SQUARES


def loses_nothing(start_method: str, mark: str) -> None:
    seen = []
    with cp.Processes(2, start_method=start_method) as executor:
        found = results(partial(die_once, mark), executor, progress=lambda *n: seen.append(n))
        assert os.path.exists(mark)
        assert results(square, executor) == SQUARES
    assert found == SQUARES
    assert seen == [(i + 1, 10) for i in range(10)]


@each_row("start_method", ["spawn", "forkserver", "fork"])
def test_a_killed_worker_loses_nothing(start_method, tmp_path):
    """In an interpreter of its own: a fork of this one would copy the locks of its threads."""
    call = f"test_chunks.loses_nothing({start_method!r}, {str(tmp_path / 'mark')!r})"
    assert crash.run(f"import test_chunks; {call}") == crash.Outcome("ok", "")


def ends_with_all_else_done() -> None:
    found = {}
    text = "3 pools of workers in a row"
    with (
        cp.Processes(2, start_method="fork") as executor,
        pytest.raises(cp.errors.WorkersLost, match=text),
    ):
        found.update(cp.map_chunks(die, range(10), executor=executor))  # pair by pair
    assert found.items() <= SQUARES.items()
    assert 3 not in found


@pytest.mark.long
def test_work_that_always_kills_ends_with_an_error_and_all_else_done():
    call = "import test_chunks; test_chunks.ends_with_all_else_done()"
    assert crash.run(call) == crash.Outcome("ok", "")


@pytest.mark.long
def test_a_function_of_a_notebook_is_refused_by_name():
    script = (
        "import condyn_pin as cp\n"
        "def one(seed): return seed\n"
        "with cp.Processes(1) as executor:\n"
        "    try: executor.submit(one, 1)\n"
        "    except cp.errors.InvalidArgument as error: print(error)\n"
        "    print(executor.submit(abs, -1).result())\n"
    )
    call = [sys.executable, "-c", script]
    refused, answer = subprocess.check_output(call, text=True).splitlines()
    assert refused.startswith("fn = one: a function of a notebook")
    assert answer == "1"


def dies_with_a_lock(mark: str) -> None:
    """Kill a worker where it first lets go of a lock that it shares with others."""

    def hook(_frame: object, event: str, called: Any) -> None:
        is_lock = type(getattr(called, "__self__", None)).__name__ == "SemLock"
        if event == "c_call" and is_lock and called.__name__ in ("release", "__exit__"):
            kill_once(mark)

    os.register_at_fork(after_in_child=partial(sys.setprofile, hook))
    with cp.Processes(2, start_method="fork") as executor:
        assert results(square, executor) == SQUARES
    assert os.path.exists(mark)


@pytest.mark.long
def test_a_worker_that_is_killed_while_it_begins_blocks_no_other(tmp_path):
    """A broken pool terminates its workers: a lock that one held would be taken for ever."""
    call = f"test_chunks.dies_with_a_lock({str(tmp_path / 'mark')!r})"
    assert crash.run(f"import test_chunks; {call}", timeout=60.0) == crash.Outcome("ok", "")


@pytest.mark.long
def test_a_plain_pool_says_that_it_is_of_no_use_any_more():
    text = r"of no use after that; \d+ of 10 .*\.Processes"
    pool = ProcessPoolExecutor(2, get_context("spawn"))
    with pool, pytest.raises(cp.errors.WorkersLost, match=text):
        results(die, pool)


@pytest.mark.parametrize("executor", [nullcontext, ThreadPoolExecutor, cp.Processes])
def test_what_the_work_raises_is_raised(executor):
    with executor(*([] if executor is nullcontext else [2])) as pool:
        with pytest.raises(cp.InvalidArgument, match="x = 3"):
            results(refuse, pool)
        assert results(square, pool) == SQUARES


class _Forgetful(Executor):
    """Loses every chunk a number of times, as a cluster does when it gives up on one."""

    def __init__(self, times: int) -> None:
        self._times, self._threads = times, ThreadPoolExecutor(1)

    def submit(self, fn, /, *args, **kwargs):
        if args[1] == 3 and self._times:
            self._times -= 1
            return self._threads.submit(_forget)
        return self._threads.submit(fn, *args, **kwargs)

    def shutdown(self, wait=True, *, cancel_futures=False):
        self._threads.shutdown(wait, cancel_futures=cancel_futures)


def _forget() -> None:
    raise TimeoutError("no answer")


def test_a_chunk_that_the_executor_lost_is_handed_out_again():
    with _Forgetful(2) as executor:
        assert results(square, executor) == SQUARES
    text = r"chunk 3 .* 3 times, .* TimeoutError: no answer"
    with _Forgetful(3) as executor, pytest.raises(cp.errors.WorkersLost, match=text):
        results(square, executor)


@pytest.mark.long
def test_stopping_early_cancels_what_nobody_has_begun():
    with ThreadPoolExecutor(1) as executor:
        chunks = cp.map_chunks(square, range(1000), executor=executor)
        next(chunks)
        chunks.close()
        assert executor._work_queue.qsize() <= 256
    assert results(square, None) == SQUARES


@each_row(
    ("call", "words"),
    [
        *(
            (partial(results, square, executor), r"executor = .* Processes\(2\)")
            for executor in (2, "processes", cp.Processes)
        ),
        *((partial(cp.Processes, n), "workers = ") for n in (0, -1, 1.5, True, "two")),
        (
            partial(cp.Processes, 2, start_method="thread"),
            "start_method = 'thread': one of fork, spawn",
        ),
    ],
)
def test_what_is_no_executor_is_refused(call, words):
    with pytest.raises(cp.InvalidArgument, match=words):
        call()


def test_processes_say_what_they_are():
    with cp.Processes() as executor:
        assert repr(executor) == f"Processes({executor.workers}, start_method='spawn')"
        assert executor.workers == len(os.sched_getaffinity(0))


def run_script(text: str, path: Path) -> subprocess.CompletedProcess[str]:
    path.write_text(text)
    # its output ends when the last process that has it open ends
    return subprocess.run(
        [sys.executable, str(path)], capture_output=True, text=True, check=False, timeout=300
    )


ORPHANS = """
import os, signal
import condyn_pin as cp

if __name__ == "__main__":
    with cp.Processes(2, start_method={start_method!r}) as executor:
        dict(cp.map_chunks(abs, range(4), executor=executor))
        print(*executor.pids, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("start_method", ["spawn", "forkserver", "fork"])
def test_workers_end_with_their_parent(start_method, tmp_path):
    done = run_script(ORPHANS.format(start_method=start_method), tmp_path / "script.py")
    assert done.returncode == -signal.SIGKILL
    assert done.stdout.split()


UNGUARDED = """
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import condyn_pin as cp

print("imported", flush=True)
with {pool} as executor:
    dict(cp.map_chunks(abs, range(4), executor=executor))
"""


@each_row("pool", [
        "cp.Processes(2)", "cp.Processes(1, start_method='forkserver')",
        "ProcessPoolExecutor(2, get_context('spawn'))",
    ])  # fmt: skip
def test_a_script_without_a_guard_is_told_so_at_once(pool, tmp_path):
    """No worker is started a second time: each would do the work of the script again."""
    done = run_script(UNGUARDED.format(pool=pool), tmp_path / "script.py")
    assert done.returncode == 1
    # behind it the tracker of another process may tell what that one left
    lost = "condyn_pin.errors.WorkersLost: "
    last = [line for line in done.stderr.splitlines() if line.startswith(lost)][-1]
    assert 'inside `if __name__ == "__main__":`' in last
    assert "kills them" not in last
    assert done.stdout.count("imported") <= 3  # the script itself, and each worker


@pytest.mark.long
def test_a_script_that_workers_cannot_import_does_not_blame_the_work(tmp_path):
    done = run_script(
        "import condyn_pin as cp\nif __name__ == '__main__':\n"
        "    dict(cp.map_chunks(abs, range(4), executor=cp.Processes(1)))\n"
        "else:\n    raise SystemExit('no licence')\n",
        tmp_path / "script.py",
    )
    assert "no licence" in done.stderr
    assert "could begin, and printed why" in done.stderr.splitlines()[-1]
