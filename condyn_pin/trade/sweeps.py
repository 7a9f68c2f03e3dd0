"""Sweeps: a solver with its knobs turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import product
from typing import Any

from condyn_pin import _pin
from condyn_pin.choice import untaken
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.scene import Scene
from condyn_pin.solvers import SOLVERS, Solver
from condyn_pin.solvers.lcaba import LCABA
from condyn_pin.solvers.reference import Reference


def sweep(solver: Solver, **knobs: Sequence[Any]) -> tuple[Solver, ...]:
    """Return a solver with every combination of some knobs.

    Parameters
    ----------
    solver : Solver
        Knobs that are not named keep the values that they have here.
    **knobs : sequence
        Values by name: ``sweep(Proximal(), mu=[1e-8, 1e-4], max_iterations=[1, 20])``.
        Without any, `solver` itself and what its class declares to be worth a look.

    Returns
    -------
    tuple of Solver
        Each once, the first knob slowest.

    Raises
    ------
    InvalidArgument
        If a value cannot be used, or is no sequence.
    UnknownName
        If the solver has no such knob.
    """
    if not isinstance(solver, Solver):
        raise InvalidArgument(f"solver = {solver!r}: a solver such as Proximal() is needed")
    grids = ({}, *solver.sweeps) if not knobs else (knobs,)
    known = [field.name for field in fields(solver)]  # type: ignore[arg-type]
    for name, values in knobs.items():
        if name not in known:
            raise unknown_name(f"knob of {type(solver).__name__}", name, known)
        if isinstance(values, str) or not hasattr(values, "__iter__"):
            raise InvalidArgument(f"{name} = {values!r}: a list of values is needed")
    made = [
        replace(solver, **dict(zip(grid, values, strict=True)))  # type: ignore[type-var]
        for grid in grids
        for values in product(*grid.values())
    ]
    return tuple(dict.fromkeys(made))


def default_sweep(scene: Scene) -> tuple[Solver, ...]:
    """Return every solver with its knobs turned; those that do not take the scene once.

    `Reference` judges the others, and is not among them.
    """
    chosen: list[Solver] = []
    for kind in SOLVERS.values():
        solver = kind()
        missing = isinstance(solver, LCABA) and not _pin.HAS_LCABA
        if not isinstance(solver, Reference):
            chosen += [solver] if missing or untaken(scene, solver) else sweep(solver)
    return tuple(chosen)
