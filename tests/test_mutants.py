"""The mutants are Python, each with one change, and the same every time."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import mutants
import pytest

pytestmark = pytest.mark.once

TESTS = Path(__file__).parent
chosen = cache(mutants.chosen)


def test_there_are_some_of_every_room_and_the_same_again():
    of_rooms = chosen(0)
    assert sum(len(found) for _, found in of_rooms) > 450
    assert all(found for _, found in of_rooms)
    assert mutants.chosen(0) == of_rooms


def test_the_tests_of_every_room_exist():
    names = {name for room in mutants.ROOMS for name in room.tests.split()}
    assert [name for name in names if not (TESTS / f"test_{name}.py").is_file()] == []


def test_every_kind_of_mistake_is_python():
    source = """
def root(x: float) -> float:
    if x < 0.0:
        raise ValueError("negative")
    log.append(x + 1)
    return x - 2.0

def is_even(n: int) -> bool:
    return n % 2 == 0
"""
    texts = [(ast.unparse(node), text) for _, node, text in mutants.replacements(ast.parse(source))]
    assert texts == [
        ("x < 0.0", "(x >= 0.0)"),
        ("0.0", "1.0"),
        ("log.append(x + 1)", "pass"),
        ("x + 1", "(x - 1)"),
        ("1", "2"),
        ("return x - 2.0", "return - (x - 2.0)"),
        ("x - 2.0", "(x + 2.0)"),
        ("2.0", "4.0"),
        ("return n % 2 == 0", "return not (n % 2 == 0)"),
        ("n % 2 == 0", "(n % 2 != 0)"),
        ("2", "3"),
        ("0", "1"),
    ]
    for _, found in chosen(0):
        source = (mutants.ROOT / mutants.PACKAGE / found[0].file).read_bytes()
        assert ast.dump(ast.parse(found[0].applied(source))) != ast.dump(ast.parse(source))
