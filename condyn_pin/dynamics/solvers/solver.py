"""The contract of a solver, and how to write one.

1. Add one file to this folder with one frozen dataclass that inherits from `Solver`. Its fields
   are its parameters, each with a default, a unit, and in the docstring the reason of the default.
2. Set `title` (what tables show), `cost`, `use` (when to take it) and `takes_redundant`. The class
   registers itself under its lower-case name in `SOLVERS`; tests and the command line find it
   there. Its `sweeps` are the values of its parameters that `Study` tries.
3. Write `start(workspace)`. It runs once per workspace, may take hundreds of microseconds, and
   returns a `BoundSolver`: three callables closed over what they need. `workspace.data` and
   `workspace.equations` are made when they are first read, and cost a `pin.Data` each: read the
   one if you need it, and the other in the call.
4. `acceleration(q, v, tau)` is the hot loop. It returns an array that nobody else will write to,
   reads nothing that an earlier call left behind, and does not write to its arguments. It raises
   `Singular` rather than return numbers that mean nothing, and ValueError for arguments of another
   size (`free_force`); NaN may come out, the workspace catches it.
5. `lam()` returns an owned array: the forces of the last call, with M a + h = tau + J^T lam for the
   J of the scene. Pinocchio's own lam is that of `workspace.pinocchio_constraints`;
   `workspace.scene_forces` turns it into the scene's.
6. A solver sees rows, not kinds: `workspace.equations.consistent_terms` has M, h, J and gamma of
   whatever the scene contains, without combinations of rows that are redundant where loops are
   closed. A solver that does without them sets `takes_open = False`, and is not called there.
   One with `takes_redundant = False` raises `Singular` where rows are redundant, and has a field
   `mu`, the damping [1/kg] with which it answers there too.
   `workspace.constraint_models` has Pinocchio's objects, of 3 and 6 rows only: a solver
   that uses them sets `takes_every_kind = False` and is never started on kinds without such an
   equivalent. Kinds that are imitated, such as a hinge by two points, bring a row too many: with
   `takes_approximated = False` it is not started on those either, and with `takes_world_first =
   False` not on a planar pin whose first frame is the world's, and with `takes_loops = False` on
   nothing that joins two moving bodies.
7. `accuracy` is of every solver, and no parameter: what a status of ok promises where nothing else
   is said. `tune` and `Table.cheapest` return solvers with the one that they were chosen for.
8. A solver of another problem, such as soft constraints, sets `exact = False`: its answer is judged
   by the hard equations like all others, and is called inaccurate by what it differs. It writes
   `differentiated`, for the derivatives of its answers are others too.
9. Sources: cite the paper in the docstring.
10. A solver that not every installation has says in `missing` what to install; tests and the
    command line leave it out where it is missing, and to start it raises the same sentence.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import Grid, check_accuracy_of_a, register
from condyn_pin._core.arrays import Array
from condyn_pin._core.tolerances import SOLVED

if TYPE_CHECKING:
    from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
    from condyn_pin.dynamics.solution import Solution
    from condyn_pin.dynamics.solvers.proximal import OpenRows
    from condyn_pin.dynamics.workspace import Workspace

SOLVERS: dict[str, type[Solver]] = {}


class Singular(ArithmeticError):
    """Raised by a method whose matrix is singular; the workspace turns it into a status."""


@dataclass(frozen=True)
class BoundSolver:
    """A solver bound to one workspace.

    Attributes
    ----------
    acceleration : callable
        Of q (nq,), v (nv,) and tau (nv,); returns a (nv,), an array of its own.
    lam : callable
        Returns the constraint forces (m,) of the last acceleration, in the axes of each constraint.
    iterations : callable
        Returns how many iterations the last acceleration took.
    approximate_delassus : (m,) array, optional
        Of compliant rows: what a unit of force moves [1/kg, 1/(kg m^2)].
    exact : BoundSolver, optional
        The method of `solve`, if hot loops have rows that differ from the scene's where it is open.
    open_rows : OpenRows, optional
        The rows that are kept at open states, if it is these that the method then solves for.
    """

    acceleration: Callable[[Array, Array, Array], Array]
    lam: Callable[[], Array]
    iterations: Callable[[], int]
    approximate_delassus: Array | None = None
    exact: BoundSolver | None = None
    open_rows: OpenRows | None = None


def free_force(tau: Array, h: Array, out: Array | None = None) -> Array:
    """Return tau - h, in `out` if given; a tau of another shape is refused, as numpy would not."""
    if tau.shape != h.shape:
        raise ValueError
    return np.subtract(tau, h, out=out)


@dataclass(frozen=True)
class Solver(ABC):
    """A way to solve the two equations; a frozen value.

    Attributes
    ----------
    accuracy : float
        Error of a that is good enough, relative to the larger of |a|_inf and gravity, unless
        `solve` is told another: what the status is judged by. It changes no number of the answer.

    Raises
    ------
    InvalidArgument
        If the accuracy is finer than doubles can have.
    """

    title: ClassVar[str]
    cost: ClassVar[str]
    use: ClassVar[str]  # when to take it
    takes_redundant: ClassVar[bool]  # whether redundant rows are no trouble
    takes_every_kind: ClassVar[bool] = True  # or only kinds that Pinocchio has, or can imitate
    takes_approximated: ClassVar[bool] = True  # or only kinds that Pinocchio has
    takes_world_first: ClassVar[bool] = True  # or only a moving body as the first of the two
    takes_loops: ClassVar[bool] = True  # or only what holds a body at the world
    takes_open: ClassVar[bool] = True  # or only closed loops, where redundant rows are so
    exact: ClassVar[bool] = True  # whether it solves the two equations, or others near them

    sweeps: ClassVar[tuple[Grid, ...]] = ()  # values of parameters that are worth a look

    accuracy: float = field(default=SOLVED, kw_only=True)

    def __post_init__(self) -> None:
        check_accuracy_of_a(self.accuracy)

    def __repr__(self) -> str:
        shown = [parameter.name for parameter in parameter_fields(type(self))]
        shown += ["accuracy"] if self.accuracy != SOLVED else []
        parameters = ", ".join(f"{name}={getattr(self, name)!r}" for name in shown)
        return f"{type(self).__qualname__}({parameters})"

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # a dataclass that finds one in its own namespace does not write another
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]
        if getattr(cls.start, "__isabstractmethod__", False):
            return
        name = cls.__name__.lower()
        register(SOLVERS, name, cls, f"a solver named {cls.__name__}")
        for known in sorted(SOLVERS):  # in one order, whatever is imported first
            SOLVERS[known] = SOLVERS.pop(known)

    @classmethod
    def missing(cls) -> str:
        """Return the missing package and the way to install it, in a sentence; usually empty."""
        return ""

    @abstractmethod
    def start(self, workspace: Workspace) -> BoundSolver:
        """Return this solver bound to `workspace`."""

    def differentiated(
        self, workspace: Workspace, solution: Solution, v: Array, tau: Array
    ) -> Derivatives | None:
        """Return derivatives of its `solution` at v and tau; None if its constraints are hard."""
        return None


def parameter_fields(kind: type[Solver]) -> tuple[Field[Any], ...]:
    """Return the parameters of a solver: its fields but for the accuracy, which all have."""
    return tuple(parameter for parameter in fields(kind) if parameter.name != "accuracy")
