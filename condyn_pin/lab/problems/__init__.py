"""Benchmark problems with a known answer: one file each.

Every module of this folder is imported once, and each subclass of `Problem` enters `PROBLEMS` under
its name, so that to add a problem is to add one file; tests, `condyn lab problem` and
`benchmarks/problems.py` find it there.
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.lab.problems.base import PROBLEMS, Problem, load_problem

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["PROBLEMS", "Problem", "load_problem"]
