"""BatchDerivatives: how the answers at many states change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np

from condyn_pin._core.arrays import Array, read_only
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.solution import Solution
from condyn_pin.simulation.batch.solution import BatchSolution, Some


@dataclass(frozen=True, eq=False, repr=False)
class BatchDerivatives:
    """Derivatives at N states; columns are tangent, as in `Derivatives`.

    Attributes
    ----------
    solution : BatchSolution
        The answers, with their statuses.
    da_dq, da_dv, da_dtau : (N, nv, nv) array
    dlam_dq, dlam_dv, dlam_dtau : (N, m, nv) array
        Where rows are redundant, those of the smallest lam.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    ``batch[i]`` is the `Derivatives` of state i, and ``batch[2:4]`` a batch of some. Where the
    status of a state is not ok, there is nothing to differentiate: its rows are NaN, and
    ``solution.failed`` has its index.
    """

    solution: BatchSolution
    da_dq: Array
    da_dv: Array
    da_dtau: Array
    dlam_dq: Array
    dlam_dv: Array
    dlam_dtau: Array
    seconds: float  # [s]

    def __len__(self) -> int:
        return len(self.solution)

    @overload
    def __getitem__(self, i: int | np.integer[Any]) -> Derivatives: ...

    @overload
    def __getitem__(self, i: Some) -> BatchDerivatives: ...

    def __getitem__(self, i: int | np.integer[Any] | Some) -> Derivatives | BatchDerivatives:
        blocks = {name: getattr(self, name)[i] for name in BLOCKS}
        if isinstance(i, slice | list | np.ndarray):
            some = {name: read_only(block) for name, block in blocks.items()}
            return replace(self, solution=self.solution[i], **some)
        return StoredDerivatives(self.solution[i], blocks)

    def __repr__(self) -> str:
        return f"BatchDerivatives({self.solution!r})"


class StoredDerivatives(Derivatives):
    """The derivatives at one state, their six matrices read from a batch.

    Parameters
    ----------
    solution : Solution
    blocks : dict of str to array
        By name, each of `BLOCKS`.
    """

    def __init__(self, solution: Solution, blocks: dict[str, Array]) -> None:
        super().__init__(solution)
        self._stored = blocks

    def _form(self) -> tuple[Array, Array, Array]:
        stored = self._stored
        by_q, by_v, by_tau = (
            read_only(np.concatenate([stored[f"da_{x}"], stored[f"dlam_{x}"]]))
            for x in ("dq", "dv", "dtau")
        )
        return by_q, by_v, by_tau
