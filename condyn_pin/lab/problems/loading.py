"""load_problem: a benchmark problem by name."""

from __future__ import annotations

from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.lab.problems import PROBLEMS
from condyn_pin.lab.problems.base import Problem


def load_problem(name: str, *, n: int | None = None) -> Problem:
    """Return a benchmark problem: ``load_problem("A02", n=40).run()``.

    Parameters
    ----------
    name : str
        A name of `PROBLEMS`.
    n : int, optional
        Its size, for a problem that has one: cells of A02.

    Returns
    -------
    Problem

    Raises
    ------
    UnknownName
        If there is no such problem.
    InvalidArgument
        If the problem has no size, or not this one.
    """
    if name not in PROBLEMS:
        raise unknown_name("problem", str(name), PROBLEMS)
    kind = PROBLEMS[name]
    if n is None:
        return kind()
    if "n" not in kind.sizes():
        sized = ", ".join(each for each in PROBLEMS if "n" in PROBLEMS[each].sizes())
        raise InvalidArgument(f"n = {n!r}: {name} has no size; {sized} has")
    return kind(**{"n": n})
