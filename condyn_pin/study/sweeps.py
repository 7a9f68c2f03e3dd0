"""Sweeps: a solver, or a measure, with its parameters turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import product
from typing import Any, Final, TypeVar

from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import untaken
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.study.measures import Measure
from condyn_pin.study.measures.acceleration import AccelerationMeasure
from condyn_pin.study.method import Method

_Knobbed = TypeVar("_Knobbed", bound=Method | Measure)

_ACCELERATION: Final = AccelerationMeasure()


def sweep(one: _Knobbed, **parameters: Sequence[Any]) -> tuple[_Knobbed, ...]:
    """Return a solver, or a measure, with every combination of some parameters.

    Parameters
    ----------
    one : Solver, ContactSolver or Measure
        Parameters that are not named keep the values that they have here.
    **parameters : sequence
        Values by name: ``sweep(Proximal(), mu=[1e-8, 1e-4], max_iterations=[1, 20])``.
        Without any, `one` itself and what its class declares to be worth a look.

    Returns
    -------
    tuple of what `one` is
        Each once, the first parameter slowest.

    Raises
    ------
    InvalidArgument
        If a value cannot be used, or is no sequence.
    UnknownName
        If there is no such parameter.
    """
    if not is_dataclass(one) or not hasattr(one, "sweeps"):
        raise InvalidArgument(f"{one!r}: a solver such as Proximal(), or a measure, is needed")
    grids = ({}, *one.sweeps) if not parameters else (parameters,)
    known = [field.name for field in fields(one)]
    for name, values in parameters.items():
        if name not in known:
            raise unknown_name(f"parameter of {type(one).__name__}", name, known)
        if isinstance(values, str) or not hasattr(values, "__iter__"):
            raise InvalidArgument(f"{name} = {values!r}: a list of values is needed")
    made = [
        replace(one, **dict(zip(grid, values, strict=True)))
        for grid in grids
        for values in product(*grid.values())
    ]
    return tuple(dict.fromkeys(made))


def default_sweep(scene: Scene, measure: Measure = _ACCELERATION) -> tuple[Method, ...]:
    """Return all that a measure asks with parameters turned; what does not take the scene once.

    `Reference` is what the others are compared with, and is not among them.
    """
    chosen: list[Method] = []
    for kind in measure.methods.values():
        method = kind()
        if not isinstance(method, Reference):
            chosen += [method] if _refuses(method, scene) else sweep(method)
    return tuple(chosen)


def _refuses(method: Method, scene: Scene) -> bool:
    """Whether a solver cannot take a scene, or is not there."""
    if not isinstance(method, Solver):
        return False
    return bool(method.missing() or untaken(scene, method))
