"""BatchDerivatives: how the answers at many states change."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin.arrays import Array
from condyn_pin.batch.solution import BatchSolution


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
    Where the status of a state is not ok, there is nothing to differentiate: its rows are NaN, and
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

    def __repr__(self) -> str:
        return f"BatchDerivatives({self.solution!r})"
