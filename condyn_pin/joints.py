"""Joints: where q and v hold them, and which of their coordinates are lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int_]

# Names of Pinocchio's joints whose coordinates are all lengths begin so.
_SLIDERS = (
    "JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismatic", "JointModelTranslation",
)  # fmt: skip


def indices(model: Any, joints: Sequence[str]) -> tuple[Indices, Indices]:
    """Return where q and where v hold some joints, in the order given."""
    chosen = [model.joints[model.getJointId(name)] for name in joints]
    index_q = [i for joint in chosen for i in range(joint.idx_q, joint.idx_q + joint.nq)]
    index_v = [i for joint in chosen for i in range(joint.idx_v, joint.idx_v + joint.nv)]
    return np.array(index_q, dtype=np.int_), np.array(index_v, dtype=np.int_)


def lengths(joint: Any) -> tuple[bool, ...]:
    """Return which coordinates of a joint with nq = nv are lengths [m]; the others are [rad]."""
    if joint.shortname() == "JointModelComposite":
        return tuple(length for part in joint.extract().joints for length in lengths(part))
    return (joint.shortname().startswith(_SLIDERS),) * int(joint.nv)
