"""Constrained rigid-body dynamics on Pinocchio: solve it, prove it, and see what accuracy costs.

    M(q) a + h(q, v) = tau + J(q)^T lam,    J a + gamma = a_ref

The names that users need first are here, everything else is in its room: `condyn_pin.study`,
`condyn_pin.simulation`, ... The stubs next to this file and next to the `__init__.py` of each room
list them. They are imported on first use, so that `condyn doctor` works even if Pinocchio does not
import.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any
from warnings import warn

import lazy_loader

__version__ = "0.3.0"

_public, _listed, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Names of the last version and what they are now; they go with the next.
_RENAMED = {
    "Audit": "dynamics.NominalAnalysis",
    "Errors": "mechanism.ReductionErrors",
    "Gap": "constraints.ConstraintViolation",
    "Knife": "constraints.KnifeEdge",
    "Method": "dynamics.BoundSolver",
    "Moment": "simulation.Snapshot",
    "Proof": "dynamics.Residuals",
    "Step": "mechanism.ReductionStep",
}

# What was the room `lab`, and its names: they measure the library.
_IN_CHECKOUT = (
    "lab", "EXTREMES", "CONTACT_EXTREMES", "Verdict", "judge", "judge_contact", "right_answers",
    "HIERARCHIES", "ModelHierarchy", "HierarchyModel", "HierarchyEffort", "HierarchyRow",
    "HierarchyTable", "model_hierarchy", "PROBLEMS", "Problem", "ProblemResult", "load_problem",
    "LADDERS", "Ladder", "LadderEffort", "LadderRow", "LadderTable", "Rung", "ladder",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in __all__:
        return _public(name)
    if name in _IN_CHECKOUT:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}: it measures the library and lives in "
            "a checkout: benchmarks/lab; with `benchmarks` on the path, `import lab`"
        )
    if now := _now(name):
        warn(f"condyn_pin.{name} is condyn_pin.{now} now", DeprecationWarning, stacklevel=2)
        room, _, member = now.partition(".")
        return getattr(import_module(f"{__name__}.{room}"), member)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _now(name: str) -> str:
    """Room and name today of a public name of the last version; empty if there is none."""
    if name in _RENAMED or name.startswith("_"):
        return _RENAMED.get(name, "")
    rooms = (room for room in __all__ if find_spec(f"{__name__}.{room}"))  # of the names, modules
    found = (room for room in rooms if name in import_module(f"{__name__}.{room}").__all__)
    return next((f"{room}.{name}" for room in found), "")


def __dir__() -> list[str]:
    return [*_listed(), "__version__"]
