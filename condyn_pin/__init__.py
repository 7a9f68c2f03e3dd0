"""Constrained rigid-body dynamics on Pinocchio: solve it, prove it, and see what accuracy costs.

    M(q) a + h(q, v) = tau + J(q)^T lam,    J a + gamma = a_ref

The public names are those that the stub beside this file imports. Here they are imported when they
are first used, so that `condyn doctor` also works where Pinocchio itself does not import.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any
from warnings import warn

__version__ = "0.2.0"


def _modules() -> dict[str, str]:
    """Return the module of every public name, from the stub."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [line for line in stub.body if isinstance(line, ast.ImportFrom)]
    return {alias.name: str(line.module) for line in imports for alias in line.names}


_MODULE_OF = _modules()

# Names of the last version and what they are now; they go with the next.
_RENAMED = {"Audit": "NominalAnalysis", "Moment": "Snapshot"}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        now = _RENAMED[name]
        warn(f"condyn_pin.{name} is condyn_pin.{now} now", DeprecationWarning, stacklevel=2)
        return globals()[now] if now in globals() else __getattr__(now)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
