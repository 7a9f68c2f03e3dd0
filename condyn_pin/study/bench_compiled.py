"""What `bench` times in C++: batches of the same states, without Python in between.

Each method gets the settings that its solver in Python has on the scene, and is compiled by one
compiler with the same flags: from headers of Pinocchio 3.9, or of 4.1 where only that has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any, Final

import numpy as np

from condyn_pin._core.compiled import compiled_lcaba, constrained_aba
from condyn_pin._core.timing import Call, Times
from condyn_pin.dynamics.compiled import CompiledMethod
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.constrained_aba import ConstrainedABA
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.pv import PV
from condyn_pin.dynamics.workspace import Workspace, untaken
from condyn_pin.study.bench_table import BenchRow
from condyn_pin.study.case import Case
from condyn_pin.study.measures.base import relative

CPP: Final = "C++"  # the origin of such rows

# Names of rows: those of solvers in Python, where there is one of the same equations.
_OF_SOLVERS: Final[Mapping[str, type[Solver]]] = {
    "ConstrainedABA": ConstrainedABA,
    "pinocchio::constrainedABA": ConstrainedABA,
    "PV": PV,
    "pinocchio::lcaba": LCABA,
    "pinocchio::constraintDynamics": Proximal,
}
_TITLES: Final = {
    "ConstrainedABA": ConstrainedABA.title,
    "PV": PV.title,
    "pinocchio::lcaba": LCABA.title,
    "pinocchio::constraintDynamics": Proximal.title,
    "pinocchio::constrainedABA": "constrainedABA, Pinocchio's driver",
    "pinocchio::aba": "ABA, unconstrained",
}
FREE: Final = "pinocchio::aba"


@dataclass(frozen=True)
class Compiled:
    """A row without a time, and the call that answers all states of the case."""

    row: BenchRow
    call: Call
    states: int
    is_dense: bool

    def timed(self, times: Times, dense: Times | None) -> BenchRow:
        """Return the row with the time of one state; `dense` is the fastest that is."""
        each = Times(tuple(spent / self.states for spent in times.samples))
        x = dense.ratio(times) if dense and self.row.rows else nan
        return replace(self.row, bare_us=each.median, bare_p95_us=each.p95, to_dense=x)


def compiled_by() -> dict[str, str]:
    """Return what the machine of a table says besides, where something is compiled."""
    module = constrained_aba()
    return {
        "C++ compiler": module.compiler,
        "C++ headers": f"Pinocchio {module.pinocchio}, {compiled_lcaba().pinocchio} for LCABA, "
        f"Eigen {module.eigen} with {module.simd}",
    }


def compiled_methods(case: Case, damping: float) -> list[Compiled]:
    """Return every method that is compiled and takes the scene; dense ones with a damping [1/kg].

    MissingExtra if none is.
    """
    made = [_compiled(case, name, method) for name, method in _methods(case, damping)]
    return [one for one in made if not one.row.rows or isfinite(one.row.error)]


def fastest_dense(methods: list[Compiled], times: Mapping[int, Times]) -> Times | None:
    """Return the time of the fastest of the dense methods, by their place in the list."""
    plain = [times[i] for i, method in enumerate(methods) if method.is_dense]
    return min(plain, key=lambda spent: spent.median, default=None)


def _methods(case: Case, damping: float) -> Iterator[tuple[str, CompiledMethod]]:
    scene, settings = case.scene, {}
    for name, kind in _OF_SOLVERS.items():
        if not kind.missing() and not untaken(scene, kind()):
            settings[name] = _settings(Workspace(scene, kind()))
    workspace = Workspace(scene)
    constraints = workspace.pinocchio_constraints.constraints
    if workspace.pinocchio_constraints.unsupported:
        return
    plain = {"mu": damping, "accuracy": 0.0, "limit": 1}
    for module in (constrained_aba(), compiled_lcaba()):
        for name in module.methods:
            solver_is_in_other = module is compiled_lcaba() and name != "pinocchio::lcaba"
            if solver_is_in_other or (name in _OF_SOLVERS and name not in settings):
                continue
            chosen: dict[str, Any] = settings.get(name, plain)
            model = workspace.model
            yield name, CompiledMethod(name, model, constraints, None, **chosen, module=module)


def _settings(workspace: Workspace) -> dict[str, Any]:
    """Return what a solver iterates with on its scene: the accuracy is the one that it reads."""
    found = workspace.proximal_settings
    relative_one = isinstance(workspace.solver, Proximal)
    accuracy = found.relative_accuracy if relative_one else found.absolute_accuracy
    return {"mu": found.mu, "accuracy": accuracy, "limit": found.max_iter}


def _compiled(case: Case, name: str, method: CompiledMethod) -> Compiled:
    """Return a method with its worst error at the states."""
    states = [np.ascontiguousarray(x) for x in map(np.array, zip(*case.states, strict=True))]
    answers, scene = method.many(*states), case.scene
    gravity, error = scene.nominal.estimator.gravity, nan
    if name != FREE:
        pairs = zip(answers, case.truth, strict=True)
        error = max(relative(a, truth, gravity) for a, truth in pairs)
    row = BenchRow(
        case.label,
        _TITLES.get(name, name),
        rows=0 if name == FREE else scene.rows,
        rank=0 if name == FREE else scene.nominal.rank,
        error=error,
        origin=CPP,
    )
    is_dense = name.startswith("Dense")
    return Compiled(row, lambda *_: method.many(*states), len(answers), is_dense)
