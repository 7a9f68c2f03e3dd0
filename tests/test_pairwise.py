"""Few cases of a product, and none that is lost: those that are left out are counted."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from itertools import combinations, product
from pathlib import Path

import pytest
from pairwise import cover

pytestmark = pytest.mark.once  # about tests alone


@pytest.mark.parametrize("sizes", [(6, 46, 11), (4, 19, 2, 3, 2), (2, 2, 2), (3, 1, 4)], ids=str)
def test_every_pair_is_there_and_every_value_twice(sizes):
    cases = [*product(*map(range, sizes))]
    chosen = cover(cases)
    assert chosen <= {*cases}
    for i, j in combinations(range(len(sizes)), 2):
        assert len({(case[i], case[j]) for case in chosen}) == sizes[i] * sizes[j]
    assert min(Counter(value for case in chosen for value in enumerate(case)).values()) >= 2
    assert len(chosen) < 1.3 * max(a * b for a, b in combinations(sizes, 2))


@pytest.mark.parametrize("sizes", [(19, 5), (5, 19), (3, 4, 7), (1, 4), (2, 2)], ids=str)
def test_every_value_is_there_and_all_are_used_alike(sizes):
    chosen = cover([*product(*map(range, sizes))], together=1)
    assert len(chosen) == max(sizes)
    for i, size in enumerate(sizes):
        used = Counter(case[i] for case in chosen)
        assert len(used) == size
        assert max(used.values()) - min(used.values()) <= 1


def test_pairs_that_cannot_meet_are_not_looked_for():
    cases = [case for case in product("abc", "xyz", "12") if case[:2] != ("a", "x")]
    assert len({case[:2] for case in cover(cases)}) == 8


def test_parameters_that_change_together_are_one():
    rows = [("sticks", 0.0), ("slides", 0.9), ("lifts", 0.8)]
    cases = [(solver, law, *row) for solver in "abcd" for law in "xyz" for row in rows]
    assert len(cover(cases)) < 16  # of 36


def test_the_same_cases_are_chosen_again():
    cases = [*product(range(6), range(9), range(4))]
    assert cover(cases) == cover([*cases])
    assert cover(cases[:1]) == {*cases[:1]}


def collected(*options: str) -> tuple[list[str], str]:
    """Names of the cases that pytest would run of a file, and its last words."""
    pytest_ = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only", "-q"]
    run = subprocess.run(
        [*pytest_, *options],
        cwd=Path(__file__).parent.parent, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [line for line in run.stdout.splitlines() if "::" in line], run.stdout


def test_none_is_lost():
    few, said = collected("tests/test_impact.py")
    every, _ = collected("tests/test_impact.py", "--long")
    assert {*few} < {*every}
    count = len(every) - len(few)
    assert f"{count} long tests were left out: pytest --long has them" in said
    assert f"{len(few)}/{len(every)} tests collected ({count} deselected)" in said
    named = min({*every} - {*few})
    assert collected(named)[0] == [named]
