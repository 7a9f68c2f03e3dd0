"""Minimal: the smaller scene that was found, and what was tried to find it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.mechanism.reduction.price import ReductionErrors
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene


@dataclass(frozen=True)
class ReductionStep:
    """A simplification that was tried.

    Attributes
    ----------
    what : str
        What it leaves out, and why that may do.
    kept : bool
        Whether the step was kept.
    errors : ReductionErrors or None
        Of all simplifications so far, this one included; None if it could not be made.
    reason : str
        Why it was not kept; empty if it was.
    """

    what: str
    kept: bool
    errors: ReductionErrors | None
    reason: str = ""

    def __str__(self) -> str:
        found = f": errors {self.errors}" if self.errors else ""
        return f"{'kept' if self.kept else 'not kept'}: {self.what}{found}{self.reason}"


@dataclass(frozen=True)
class Minimal:
    """The smaller scene, its error, and its speed.

    Attributes
    ----------
    scene : ReducedScene
    nv, rows : tuple of int
        Before and after.
    us : tuple of float
        `Workspace.acceleration` before and after [us], medians of one interleaved run on this
        machine; NaN where the solver does not say ok. A measurement, not a promise.
    said : tuple of str
        What the solver says before and after: "ok", or why it was not timed.
    solver : Solver
        The solver that was timed, and that takes the smaller scene.
    errors : ReductionErrors
        Against the full scene, at random states that no simplification was tried at; at those of
        the motion if one was given.
    limit : float
        The error that was allowed.
    states : int
        States that the errors are of.
    watch : tuple of str
        Joints whose accelerations were compared.
    steps : tuple of ReductionStep
        What was tried, in order.
    """

    scene: ReducedScene
    nv: tuple[int, int]
    rows: tuple[int, int]
    us: tuple[float, float]
    said: tuple[str, str]
    solver: Solver
    errors: ReductionErrors
    limit: float
    states: int
    watch: tuple[str, ...]
    steps: tuple[ReductionStep, ...]

    def __str__(self) -> str:
        timed = [
            f"{us:.1f} us" if math.isfinite(us) else said
            for us, said in zip(self.us, self.said, strict=True)
        ]
        return "\n".join(
            [
                f"nv {self.nv[0]} -> {self.nv[1]}, rows {self.rows[0]} -> {self.rows[1]}, "
                f"{timed[0]} before, {timed[1]} after, with {self.solver!r}",
                f"errors at {self.states} states, {self.limit:g} allowed: {self.errors}",
                *map(str, self.steps),
            ]
        )
