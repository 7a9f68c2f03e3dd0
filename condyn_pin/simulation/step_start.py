"""StepStart: where a step with contacts begins, and what acts on it."""

from __future__ import annotations

from typing import NamedTuple

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.forces import AppliedForce


class StepStart(NamedTuple):
    """A state, and the torques and forces that are held over the step."""

    q: Array  # (nq,)
    v: Array  # (nv,)
    tau: Array  # (nv,) [N, N m]
    forces: tuple[AppliedForce, ...] = ()
