"""The states of a batch: shapes, finiteness, unit quaternions, every row looked at."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import HIGH, LOW, Arguments
from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument


def check_states(
    model: Any, Q: ArrayLike, V: ArrayLike, TAU: ArrayLike, *, suffix: str = ""
) -> tuple[Array, Array, Array]:
    """Return the arrays of a batch, converted where necessary.

    Parameters
    ----------
    model : pin.Model
    Q, V : (N, nq), (N, nv) array_like
    TAU : (N, nv) or (nv,) array_like, or 0
    suffix : str
        Of the names of the first two arguments: "0" where they are the first states of motions.

    Raises
    ------
    InvalidArgument
        Naming the argument, the row and the entry, the value, and what would do.
    """
    name = f"Q{suffix}"
    count = _rows(name, Q, model.nq)
    q = finite(name, Q, (count, model.nq))
    v = finite(f"V{suffix}", V, (count, model.nv))
    if isinstance(TAU, int | float) and TAU == 0:
        TAU = np.zeros(model.nv)
    for_all = np.ndim(TAU) == 1
    tau = finite("TAU", TAU, (model.nv,) if for_all else (count, model.nv))
    for i, part, norm in loose(model, q):
        raise InvalidArgument(
            f"{name}[{i}, {part.start}:{part.stop}] = {q[i, part]} has norm {norm:.9g}: a unit "
            "quaternion (x y z w) or (cos, sin) is needed; "
            f"pin.normalize(robot.model, {name}[{i}]) makes one"
        )
    return np.ascontiguousarray(q), np.ascontiguousarray(v), np.ascontiguousarray(tau)


def loose(model: Any, q: Array) -> Iterator[tuple[int, slice, float]]:
    """Yield row, place and norm of the parts of q (N, nq) that should have norm 1 and have not."""
    for part in Arguments(model).units:
        norms = np.einsum("ij,ij->i", q[:, part], q[:, part])
        for i in np.flatnonzero(~((norms > LOW) & (norms < HIGH))):
            yield int(i), part, float(norms[i] ** 0.5)


def _rows(name: str, value: ArrayLike, width: int) -> int:
    """Return the number of rows of an array of states."""
    try:
        shape = np.shape(value)
    except ValueError as error:
        raise InvalidArgument(f"{name}: an array of shape (N, {width}) is needed") from error
    if len(shape) != 2:
        raise InvalidArgument(
            f"{name} has shape {shape}: an array of shape (N, {width}) is needed, a row a state"
        )
    return int(shape[0])
