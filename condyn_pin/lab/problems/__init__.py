"""Benchmark problems with a known answer.

Each subclass of `Problem` enters `PROBLEMS` under its name; tests, `condyn lab problem` and
`benchmarks/problems.py` find it there.
"""

from condyn_pin.lab.problems import mechanisms
from condyn_pin.lab.problems.base import PROBLEMS, Problem, ProblemResult, load_problem

__all__ = ["PROBLEMS", "Problem", "ProblemResult", "load_problem", "mechanisms"]
