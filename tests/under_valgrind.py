"""Tests of the compiled core under valgrind: memory of others, numbers nobody has set, races.

    python tests/under_valgrind.py                           both tools, with tests that are short
    python tests/under_valgrind.py --tool helgrind -- ...    races alone, with tests of your choice

A report counts if a function of the core is in its stack: Python and numpy have reports of their
own. It takes 30 to 50 times as long as the tests do. A release has no names of functions:
`pip install ./native -C cmake.build-type=RelWithDebInfo` has them.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Every way into the core, by tests that call it a few hundred times at most; and those of its
# threads.
SHORT = {
    "memcheck": (
        "test_native.py::test_scenes_that_do_not_fit",
        "test_native.py::test_paths_of_motions_that_do_not_fit",
        "test_native.py::test_plans_and_paths_of_steps_that_do_not_fit",
        "test_native.py::test_tasks_and_ticks_that_do_not_fit",
        "test_native.py::test_a_workspace_answers_rows_of_every_kind",
        "test_native.py::test_threads_change_no_bit[steps]",
        "test_native_batches.py::test_forces_from_outside",
        "test_native_contacts.py::test_alternating_directions_of_islands",
        "test_native_contacts.py::test_corners_beside_soles_that_constraints_hold",
        "test_native_contacts.py::test_steps_of_other_times_are_of_these",
        "test_native_contacts.py::test_steps_and_their_derivatives[at_stops]",
        "test_native_contacts.py::test_steps_and_their_derivatives[soles]",
        "test_native_contacts.py::test_steps_and_their_derivatives[foot_on_a_leg]",
        "test_native_control.py::test_a_tick_begins_from_the_active_set_of_the_last",
        "test_native_control.py::test_ticks[every_kind_of_task]",
        "test_native_control.py::test_ticks[infinite_weights]",
        "test_native_control.py::test_ticks[springs_of_cassie]",
        "test_native_control.py::test_ticks[chains_of_few_joints]",
        "test_native_control.py::test_ticks[arms]",
    ),
    "helgrind": ("test_native.py::test_threads_change_no_bit",),
}

OURS = "condyn_pin_native"

# Helgrind takes what the C library does inside a wait with a time limit for a signal without lock.
INSIDE_A_WAIT = re.compile(r"associated lock is not held.*\n.*\n.*__pthread_cond_wait_common")


def reports(log: str) -> Iterator[str]:
    """Yield what valgrind says that has the core in its stack."""
    lines = [re.sub(r"^==\d+== ?", "", line) for line in log.splitlines() if line.startswith("==")]
    for block in "\n".join(lines).split("\n\n"):
        if OURS in block and not INSIDE_A_WAIT.search(block):
            yield block


def run(tool: str, tests: list[str]) -> list[str]:
    """Return the reports of a tool, each once."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        command = ["valgrind", f"--tool={tool}", f"--log-file={log}", "--num-callers=20"]
        command += [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        ended = subprocess.run(
            command,
            check=False,
            env=os.environ | {"PYTHONMALLOC": "malloc", "OMP_NUM_THREADS": "1"},
        )
        if ended.returncode:
            sys.exit(f"{tool}: the tests ended with {ended.returncode}")
        return list(dict.fromkeys(reports(log.read_text())))


def main() -> None:
    """Run tests under both tools, or the one that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--tool", choices=tuple(SHORT), action="append")
    parser.add_argument("tests", nargs="*")
    given = parser.parse_args()
    here = Path(__file__).parent
    found = {
        tool: run(tool, given.tests or [str(here / test) for test in SHORT[tool]])
        for tool in given.tool or SHORT
    }
    for tool, said in found.items():
        print(f"{tool}: {len(said)} reports of the core", *said, sep="\n\n")
    sys.exit(any(found.values()))


if __name__ == "__main__":
    main()
