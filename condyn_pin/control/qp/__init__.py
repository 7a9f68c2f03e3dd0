"""Solvers of quadratic programs: frozen values whose fields are their parameters, one file each.

Every module of this folder is imported once, and each solver in it registers itself, so that to
add one is to add one file (`qp_solver.py` has its contract). Their packages are imported when a
solver starts.
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.control.qp.qp_solver import QPS, QPSolver

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["QPS", "QPSolver"]
