"""What an MJCF file has and the dynamics do not use, a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

import numpy as np

from condyn_pin._core.names import few
from condyn_pin.model.tree import DrawnJoint

# A joint, its stiffness [N m/rad, N/m], and where its spring rests [rad, m].
SpringOf = tuple[DrawnJoint, float, float]


def not_read(mj: Any) -> Iterator[str]:
    """Say what the compiled model has beside bodies, joints, sites and equalities."""
    counts = {
        "geoms, as bodies that touch": mj.ngeom,
        "actuators, but for their joints": mj.nu,
        "tendons": mj.ntendon,
        "flexible bodies": mj.nflex,
        "sensors": mj.nsensor,
        "joints with dry friction": np.count_nonzero(mj.dof_frictionloss),
        "bodies with gravity compensation": np.count_nonzero(mj.body_gravcomp),
        "mocap bodies, which stand still": mj.nmocap,
    }
    listed = [f"{n} {what}" for what, n in counts.items() if n]
    if listed:
        yield f"in the file and not used: {', '.join(listed)}"
    for poly in ("jnt_stiffnesspoly", "dof_dampingpoly"):
        if np.any(getattr(mj, poly, 0)):
            yield f"{poly}: springs and dampers are linear here"
    if mj.opt.density or mj.opt.viscosity or mj.opt.wind.any():
        yield "the medium around the bodies (density, viscosity, wind)"


def not_used(mj: Any, joints: Sequence[DrawnJoint], springs: Sequence[SpringOf]) -> Iterator[str]:
    """Say which settings of the joints the dynamics do not use."""
    if damped := [joint.name for joint in joints if joint.damping]:
        yield f"joint damping ({few(damped)}): add Robot.passive_torque to tau"
    if limited := [joint for joint in joints if joint.lower > -inf or joint.upper < inf]:
        yield f"limits of position ({len(limited)} joints)"
    ranges = zip(joints, mj.jnt_range, mj.jnt_limited, strict=True)
    if wide := [joint.name for joint, ends, limits in ranges if ends.any() and not limits]:
        yield f"ranges that are no limits to MuJoCo ({few(wide)})"
    if sprung := [joint.name for joint, *_ in springs if not joint.scalar]:
        yield f"springs of joints with several coordinates ({few(sprung)})"
