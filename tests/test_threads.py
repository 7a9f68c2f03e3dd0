"""Threads of the BLAS: one inside the library, the user's number everywhere else.

In interpreters of their own: the number is chosen before numpy is imported.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from condyn_pin._core.threads import VARIABLES

# numpy and SciPy have loaded that library; Pinocchio has none.
pytestmark = pytest.mark.once

SCRIPT = """
import json
import numpy as np
import condyn_pin as cp
from condyn_pin._core import threads
from condyn_pin._core.threads import blas_controllers, one_blas_thread
from condyn_pin.dynamics.derivatives import METHODS

def threads():
    return [library.get_num_threads() for library in libraries]

libraries = blas_controllers()
robot = cp.load_robot("cassie")
scene = cp.Scene(robot, robot.loops)
state = (*scene.sample(np.random.default_rng(0)), np.ones(robot.nv))
"""


def run(code: str, **variables: str) -> object:
    """Return what a script prints as JSON, with no number of threads set but those given."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT + textwrap.dedent(code)],
        env=environment | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("variables", "inside"), [({}, 1), ({"OMP_NUM_THREADS": ""}, 1), ({"OMP_NUM_THREADS": "3"}, 3)]
)
def test_threads_inside_and_outside(variables, inside):
    """Three before and after, on a machine of any number of cores."""
    before, seen, after = run(
        """
        for library in libraries:
            library.set_num_threads(3)
        before, seen = threads(), []

        def watched(*given, real=METHODS["kkt"]):
            found = real(*given)
            form = found._form
            found._form = lambda: seen.append(threads()) or form()
            seen.append(threads())
            return found

        METHODS["kkt"] = watched
        cp.derivatives(scene, *state).da_dq
        dense = cp.DenseKKT(mu=1e-6), cp.dynamics.NullSpace(), cp.dynamics.Soft()
        for solver in (*dense, cp.dynamics.GaussPrinciple()):
            workspace = cp.Workspace(scene, solver)
            real = type(workspace.equations).terms
            workspace.equations.terms = lambda q, v, real=real, of=workspace.equations: (
                seen.append(threads()) or real(of, q, v)
            )
            workspace.acceleration(*state)
        cp.simulate(scene, *state[:2], lambda *_: seen.append(threads()) or state[2], duration=2e-3)
        print(json.dumps([before, seen, threads()]))
        """,
        **variables,
    )
    assert len(seen) >= 6
    assert {n for each in seen for n in each} == {inside}
    assert set(before) == {3}
    assert after == before


@pytest.mark.long
def test_the_number_is_put_back_after_errors_and_from_many_threads():
    before, after = run(
        """
        from concurrent.futures import ThreadPoolExecutor

        for library in libraries:
            library.set_num_threads(3)
        before = threads()

        def work(k):
            with one_blas_thread:
                try:
                    cp.derivatives(scene, *state[:2], state[2] * (np.nan if k % 3 == 0 else k))
                except cp.CondynError:
                    return 0

        with ThreadPoolExecutor(4) as pool:
            list(pool.map(work, range(40)))
        print(json.dumps([before, threads()]))
        """
    )
    assert before == after


def test_workers_keep_to_one():
    found = run(
        """
        with cp.Processes(1) as pool:
            inside = pool.submit(eval, "[x.get_num_threads() for x in __import__("
                                 "'condyn_pin._core.threads')._core.threads.blas_controllers()]")
            print(json.dumps(inside.result()))
        """
    )
    assert set(found) == {1}


@pytest.mark.long
def test_answers_do_not_hang_on_the_number():
    """To the bit where nothing was set; else to rounding, and with the same statuses."""
    code = """
    answers, statuses, counts = [], [], []
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v = scene.sample(rng)
        tau = rng.normal(size=robot.nv)
        solvers = cp.Proximal(), cp.dynamics.NullSpace(), cp.dynamics.GaussPrinciple()
        for solver in (*solvers, cp.dynamics.Reference()):
            found = cp.Workspace(scene, solver).solve(q, v, tau, throw=False)
            answers += found.a.tolist()
            statuses.append(str(found.status))
            counts.append(found.iterations)
        answers += cp.derivatives(scene, q, v, tau).da_dq.ravel().tolist()
    print(json.dumps([answers, statuses, counts]))
    """
    unset, one, four = run(code), run(code, OMP_NUM_THREADS="1"), run(code, OMP_NUM_THREADS="4")
    assert unset == one
    assert one[1:] == four[1:]
    size = np.abs(one[0]).max()
    assert np.abs(np.subtract(one[0], four[0])).max() < 1e-10 * size


@pytest.mark.long
def test_doctor_says_what_is_set():
    unset = {name: value for name, value in os.environ.items() if name not in VARIABLES}

    def told(**variables):
        line = [sys.executable, "-m", "condyn_pin", "doctor", "--json"]
        done = subprocess.run(
            line, env=unset | variables, capture_output=True, text=True, check=False
        )
        return json.loads(done.stdout)["features"]

    assert told(OMP_NUM_THREADS="2")["BLAS threads"] == "as you set it, OMP_NUM_THREADS=2"
    assert told()["BLAS threads"] == "one inside condyn_pin, one for each core elsewhere"
    assert "openblas" in told()["BLAS"]
