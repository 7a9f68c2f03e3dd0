"""Method: what a study measures, a frozen value whose fields are its parameters.

Solvers of `SOLVERS`, contact solvers of `CONTACT_SOLVERS` and routes of `ROUTES` are; a measure
says which it asks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Protocol

from condyn_pin._core.arguments import Grid
from condyn_pin.contact.solvers import CONTACT_SOLVERS
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.simulation.routes import ROUTES


class Method(Protocol):
    """A solver, a contact solver, or a route to derivatives through contact."""

    title: ClassVar[str]  # what tables show
    sweeps: ClassVar[tuple[Grid, ...]]  # values of parameters that are worth a look


Methods = Mapping[str, type[Method]]  # a registry


def method_named(name: str) -> type[Method] | None:
    """Return the class of a name in any registry; None if there is none."""
    lower = name.lower()
    known: Methods = {**SOLVERS, **CONTACT_SOLVERS, **ROUTES}
    return known.get(lower)


def usual_parameters(kind: type[Method]) -> dict[str, Any]:
    """Return the parameters of a class with their defaults, but for the accuracy."""
    return {f.name: f.default for f in fields(kind) if f.name != "accuracy"}  # type: ignore[arg-type]


def with_accuracy(method: Method, accuracy: float) -> Method:
    """Return a method that says ok to an error, where it is its own field that says so."""
    if not hasattr(method, "accuracy"):
        return method
    return replace(method, accuracy=accuracy)  # type: ignore[type-var]
