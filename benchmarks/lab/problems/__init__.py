"""Benchmark problems with a known answer.

Each subclass of `Problem` enters `PROBLEMS` under its name; tests, `python benchmarks/lab problem`
and `benchmarks/problems.py runs` find it there.
"""

from lab.problems import mechanisms
from lab.problems.base import PROBLEMS, Problem, ProblemResult, load_problem

__all__ = ["PROBLEMS", "Problem", "ProblemResult", "load_problem", "mechanisms"]
