"""What comes into a batch, row by row: states, and forces from outside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import HIGH, LOW, is_none, not_of_norm_one
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.work import Arrays
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


def check_states(
    robot: Robot, Q: ArrayLike, V: ArrayLike, TAU: ArrayLike, *, suffix: str = ""
) -> tuple[Array, Array, Array]:
    """Return Q (N, nq), V (N, nv) and TAU (N, nv) or (nv,), converted where necessary.

    What cannot be is refused by row and entry; `suffix` is that of the names of Q and V.
    """
    name, model = f"Q{suffix}", robot.model
    count = _rows(name, Q, model.nq)
    q = finite(name, Q, (count, model.nq))
    v = finite(f"V{suffix}", V, (count, model.nv))
    if is_none(TAU):
        TAU = np.zeros(model.nv)
    for_all = np.ndim(TAU) == 1
    tau = finite("TAU", TAU, (model.nv,) if for_all else (count, model.nv))
    for i, part, norm in loose(robot, q):
        raise not_of_norm_one(name, f"{part.start}:{part.stop}", q[i, part], norm, row=f"{i}")
    return np.ascontiguousarray(q), np.ascontiguousarray(v), np.ascontiguousarray(tau)


def loose(
    robot: Robot, q: Array, low: float = LOW, high: float = HIGH
) -> Iterator[tuple[int, slice, float]]:
    """Yield row, place and norm of the parts of q (N, nq) that should have norm 1 and have not.

    Squared norms between `low` and `high` are as good as 1.
    """
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


@dataclass(frozen=True)
class RowForces:
    """Forces as they travel with a kernel: those of the first state, and inputs with the others."""

    forces: tuple[AppliedForce, ...] = ()
    rows: tuple[
        tuple[int, str], ...
    ] = ()  # which have one row per state, and the name of the input

    def of_all(self, inputs: Arrays) -> tuple[AppliedForce, ...]:
        """Return the forces at all states of some inputs, with their rows."""
        found = list(self.forces)
        for k, name in self.rows:
            found[k] = AppliedForce(found[k].frame, inputs[name], found[k].frame_of)
        return tuple(found)

    def at(self, inputs: Arrays, i: int) -> tuple[AppliedForce, ...]:
        """Return the forces at state i of some inputs."""
        if not self.rows:
            return self.forces
        found = list(self.forces)
        for k, name in self.rows:
            found[k] = AppliedForce(found[k].frame, inputs[name][i], found[k].frame_of)
        return tuple(found)


def split(
    robot: Robot, forces: Sequence[AppliedForce], count: int, *, functions: bool = False
) -> tuple[tuple[AppliedForce, ...], RowForces, Arrays]:
    """Return the forces of a batch checked, as a kernel has them, and their inputs."""
    checked = applied_forces(forces, functions=functions, rows=count)
    for force in checked:
        robot.frame(force.frame)  # what is no frame is refused before the work
    some = tuple((k, f"force{k}") for k, force in enumerate(checked) if force.has_rows)
    inputs = {name: checked[k].numbers for k, name in some}
    first = tuple(force.row(0) for force in checked) if count else ()
    return checked, RowForces(first, some), inputs
