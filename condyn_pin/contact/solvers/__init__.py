"""Contact solvers, one file each: values that answer a `ContactProblem`.

Every module of this folder is imported once, and each solver in it registers itself, so that to
add a solver is to add one file (`contact_solver.py` says what it must contain).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.contact.solvers.contact_solver import CONTACT_SOLVERS, ContactSolver

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["CONTACT_SOLVERS", "ContactSolver"]
