"""States and external forces of a batch, row by row."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from threading import get_ident
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import HIGH, LOW, is_none, not_of_norm_one
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.threads import ThreadCache
from condyn_pin._core.work import Arrays
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace, workspace_for
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


def check_states(
    robot: Robot, Q: ArrayLike, V: ArrayLike, TAU: ArrayLike, *, suffix: str = ""
) -> tuple[Array, Array, Array]:
    """Return Q (N, nq), V (N, nv) and TAU (N, nv) or (nv,), converted where necessary."""
    # What cannot be is refused by row and entry; `suffix` is that of the names of Q and V.
    name, model = f"Q{suffix}", robot.model
    count = _rows(name, Q, model.nq)
    q = finite(name, Q, (count, model.nq))
    v = finite(f"V{suffix}", V, (count, model.nv))
    if is_none(TAU):
        TAU = np.zeros(model.nv)
    for_all = np.ndim(TAU) == 1
    tau = finite("TAU", TAU, (model.nv,) if for_all else (count, model.nv))
    for i, part, norm in denormalised_parts(robot, q):
        raise not_of_norm_one(name, f"{part.start}:{part.stop}", q[i, part], norm, row=f"{i}")
    return np.ascontiguousarray(q), np.ascontiguousarray(v), np.ascontiguousarray(tau)


def denormalised_parts(
    robot: Robot, q: Array, low: float = LOW, high: float = HIGH
) -> Iterator[tuple[int, slice, float]]:
    """Yield row, place and norm of the parts of q (N, nq) that should have norm 1 and have not."""
    # Squared norms between `low` and `high` are as good as 1.
    for part in robot.arguments.units:
        norms = np.einsum("ij,ij->i", q[:, part], q[:, part])
        for i in np.flatnonzero(~((norms > low) & (norms < high))):
            yield int(i), part, float(norms[i] ** 0.5)


def _rows(name: str, value: ArrayLike, width: int) -> int:
    """Return the number of rows of an array of states."""
    try:
        shape = np.shape(value)
    except ValueError as error:
        raise InvalidArgument(f"{name}: an array of shape (N, {width}) is needed") from error
    if len(shape) != 2:
        raise InvalidArgument(
            f"{name} has shape {shape}: an array of shape (N, {width}) is needed, one row per state"
        )
    return int(shape[0])


def split(
    robot: Robot, forces: Sequence[AppliedForce], count: int, *, functions: bool = False
) -> tuple[tuple[AppliedForce, ...], tuple[AppliedForce, ...], Arrays]:
    """Return the forces of a batch checked, those of the first state, and rows of the others."""
    checked = applied_forces(forces, functions=functions, rows=count)
    for force in checked:
        robot.frame(force.frame)  # what is no frame is refused before the work
    inputs = {f"force{k}": force.numbers for k, force in enumerate(checked) if force.has_rows}
    return checked, tuple(force.row(0) for force in checked) if count else (), inputs


def forces_in(inputs: Arrays, forces: tuple[AppliedForce, ...]) -> tuple[AppliedForce, ...]:
    """Forces of some inputs, at one state or at many; `forces` are those of the first state."""
    return tuple(
        AppliedForce(force.frame, inputs[name], force.frame_of) if name in inputs else force
        for name, force in ((f"force{k}", force) for k, force in enumerate(forces))
    )


# Where driven rows are to be all along some steps, as a table that the compiled core reads.
#
#     c(q) = s(t_i),    J v = s'(t_i),    J a + gamma = s''(t_i),    t_i = t_0 + i dt / 2
#
# Paths are functions of Python: they are evaluated here, once for all states, so that no step has
# to call them.


class DrivenPath:
    """The paths of the driven rows of a workspace on the way of some steps, from a time [s] on."""

    def __init__(self, workspace: Workspace, dt: float, steps: int, begin: float = 0.0) -> None:
        equations = workspace.equations
        self.rows = equations.driven.astype(np.int32)  # (k,) the rows that are driven
        count = 2 * steps + 1 if self.rows.size else 0
        # (2 steps + 1, 3, k) s, s' and s'' of each at each half step; NaN from where on a path has
        # no values. A motion that gets there is made by Python, which says why.
        self.wanted = np.full((count, 3, len(self.rows)), np.nan)
        for i in range(count):
            try:
                self.wanted[i] = equations.wanted_at(begin + i * dt / 2)[:, self.rows]
            except Exception:
                break

    def power(self, lam: Array, every: int) -> Array:
        """Return lam . s' [W] of motions (n, kept) at every so many steps, and at the last one."""
        last = len(self.wanted) - 1
        rates = self.wanted[[*range(0, last, 2 * every), last], 1]
        return np.asarray(np.einsum("nkr,kr->nk", lam[:, :, self.rows], rates))


_paths = ThreadCache[DrivenPath]()


def driven_path_of(workspace: Workspace, dt: float, steps: int) -> DrivenPath:
    """Return the paths on the way of a motion of so many steps, evaluated once for all chunks."""
    return _paths.of(workspace, (dt, steps), lambda: DrivenPath(workspace, dt, steps))


# Recipe: what a worker makes its workspace from, once.


# Workspaces that a process keeps: a study has dozens of scenes and solvers, each in turn.
_KEPT: Final = 32


@dataclass(frozen=True)
class Recipe:
    """A scene, its solver and its drift control."""

    scene: Scene
    solver: Solver | None = None
    drift: Baumgarte | None = None

    def workspace(self) -> Workspace:
        """Workspace of this thread for the scene, solver and drift control."""
        return workspace_for(self.scene, self.solver, self.drift)

    def pickled(self) -> PickledRecipe:
        """Return the recipe as it travels; InvalidArgument if it is of a class that cannot."""
        self.scene.robot.check_unedited()
        parts = self.scene, self.solver, self.drift
        try:
            pickled = pickle.dumps(parts, pickle.HIGHEST_PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidArgument(
                f"solver = {self.solver!r}, drift = {self.drift!r}: workers need what pickles, "
                f"such as an object whose class is in a module ({error})"
            ) from error
        return PickledRecipe(blake2b(pickled, digest_size=16).digest(), pickled)


@dataclass(frozen=True)
class PickledRecipe:
    """A recipe that is equal to others with the same pickle: one of them need be unpickled."""

    token: bytes
    content: bytes = field(compare=False, repr=False)

    def workspace(self) -> Workspace:
        """Return the workspace of this thread, made when it is first asked for."""
        return _workspace(self, get_ident())


@lru_cache(_KEPT)
def _workspace(recipe: PickledRecipe, _thread: int) -> Workspace:
    scene, solver, drift = pickle.loads(recipe.content)
    return Workspace(scene, solver, drift=drift)
