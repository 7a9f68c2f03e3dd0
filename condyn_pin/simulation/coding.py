"""Frozen values as files have them: the name of their class, and their fields."""

from __future__ import annotations

from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np

from condyn_pin.constraints.kinds import named
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.model.spring import Spring, SpringDamper
from condyn_pin.simulation.drift import DRIFTS
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.integrators import INTEGRATORS

# What a value in a file may be, by the name of its class.
KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        *(Effects, Happened, Spring, SpringDamper),
        *(INTEGRATORS | DRIFTS | SOLVERS).values(),
    )
}


def encode(value: Any) -> dict[str, Any]:
    """Return a frozen dataclass as its name and its fields."""
    assert is_dataclass(value)
    return {"class": type(value).__name__, **asdict(value)}  # type: ignore[arg-type]


def plain(value: Any) -> Any:
    """Return a number of numpy as one of Python's: a parameter may be either."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be written to a file")


def decode(coded: dict[str, Any]) -> Any:
    """Return the frozen dataclass of a name and fields; lists become tuples."""
    values = dict(coded)
    name = values.pop("class")
    # those of the user's own have registered since
    kind = KINDS.get(name) or named(name) or (INTEGRATORS | DRIFTS | SOLVERS).get(name.lower())
    if kind is None:
        raise LookupError(f"{name} is not known here: import the module that defines it")
    return kind(**{k: tuple(x) if isinstance(x, list) else x for k, x in values.items()})
