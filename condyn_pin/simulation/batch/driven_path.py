"""Where driven rows are to be all along some steps, as a table that the compiled core reads.

    c(q) = s(t_i),    J v = s'(t_i),    J a + gamma = s''(t_i),    t_i = t_0 + i dt / 2

Paths are functions of Python: they are evaluated here, once for all states, so that no step has to
call them.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.threads import Kept
from condyn_pin.dynamics.workspace import Workspace


class DrivenPath:
    """The paths of the driven rows of a workspace on the way of some steps, from a time [s] on.

    Attributes
    ----------
    rows : (k,) array of int32
        The rows that are driven.
    wanted : (2 steps + 1, 3, k) array
        s, s' and s'' of each at each half step; NaN from where on a path has no values. A motion
        that gets there is made by Python, which says why.
    """

    def __init__(self, workspace: Workspace, dt: float, steps: int, begin: float = 0.0) -> None:
        equations = workspace.equations
        self.rows = equations.driven.astype(np.int32)
        count = 2 * steps + 1 if self.rows.size else 0
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


_paths = Kept[DrivenPath]()


def driven_path_of(workspace: Workspace, dt: float, steps: int) -> DrivenPath:
    """Return the paths on the way of a motion of so many steps, evaluated once for all chunks."""
    return _paths.of(workspace, (dt, steps), lambda: DrivenPath(workspace, dt, steps))
