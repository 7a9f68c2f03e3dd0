"""Choice of a solver: which one takes which scene."""

from __future__ import annotations

from collections.abc import Sequence

from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.null_space import NullSpace
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.errors import UnsupportedConstraint

_USUAL = Proximal()


def default_solver(scene: Scene) -> Solver:
    """Return the default solver.

    `Proximal`; for kinds of constraints that it cannot take, `DenseKKT`, and `NullSpace` if there
    are redundant rows besides.
    """
    if not pinocchio_constraints_of(scene).unsupported:
        return _USUAL
    return NullSpace() if scene.nominal.dependent else DenseKKT()


def kinds_of(solver: type[Solver]) -> str:
    """Return in words which kinds of constraints a solver takes."""
    if solver.takes_every_kind:
        return "every kind"
    if not solver.takes_loops:
        return "points, welds, hinges and edges that hold bodies at the world"
    if solver.takes_approximated:
        return "points, welds, hinges, edges and the planar pins of linkages in a plane"
    return "points and welds"


def untaken(scene: Scene, solver: Solver) -> tuple[str, ...]:
    """Return the names of the constraints that a solver cannot take."""
    found = pinocchio_constraints_of(scene)
    if solver.takes_every_kind:
        return ()
    names: tuple[str, ...] = ()
    if not solver.takes_approximated:
        names += found.approximated
    elif not solver.takes_world_first:
        names += found.world_first
    if not solver.takes_loops:
        names += found.loops
    return tuple(dict.fromkeys(names + found.unsupported))


def check_kinds(scene: Scene, solver: Solver) -> None:
    """Raise `UnsupportedConstraint` if a solver cannot take a constraint of the scene."""
    names = untaken(scene, solver)
    if names:
        raise UnsupportedConstraint(_refusal(scene, solver, names))


def _refusal(scene: Scene, solver: Solver, names: Sequence[str]) -> str:
    """Return why a solver cannot take these constraints, and which ones can."""
    from condyn_pin.dynamics.solvers import SOLVERS  # imports them all

    found, able, why = pinocchio_constraints_of(scene), ["Proximal()"], []
    loops = [] if solver.takes_loops else [name for name in names if name in found.loops]
    others = [name for name in names if name not in loops]
    first = solver.takes_approximated and set(others) <= set(found.world_first)
    if loops:
        why.append(f"its recursion ends at the world, and {', '.join(loops)} joins moving bodies")
        able.append("LCABA()")
    if others and first:
        why.append(f"its recursion fails where the world comes first, as in {', '.join(others)}")
        able.append("exchange its frames")
    elif others:
        why.append(
            f"Pinocchio has constraints of 3 and of 6 rows, and {', '.join(others)} cannot be made "
            "of those"
        )
    if found.unsupported:
        able = [f"{k.__name__}()" for k in SOLVERS.values() if k.takes_every_kind and k.exact]
    taken = f"{type(solver).__name__} takes {kinds_of(type(solver))}"
    return f"{taken}: {', and '.join(why)}; use {' or '.join(able)}"
