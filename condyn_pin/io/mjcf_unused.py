"""What an MJCF file has beside what is in the model, a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array
from condyn_pin._core.names import few, listed
from condyn_pin.io.mjcf_file import body_names, disabled, joint_names, names_of, require_mujoco
from condyn_pin.io.mjcf_transmissions import Transmissions, driven, pulled

FREE, BALL = 0, 1  # of MuJoCo's mjtJoint

# What changes the motion: the array of MjModel that has it, what switches it off, what it is, and
# the number that means none. What an older MuJoCo does not have is in no file that it reads.
_CHANGES: Final = (
    ("jnt_stiffnesspoly", "SPRING", "springs that are polynomials, linear here", 0),
    ("tendon_stiffnesspoly", "SPRING", "springs of tendons that are polynomials, linear here", 0),
    ("jnt_springyield", "SPRING", "springs that yield, elastic here", 0),
    ("tendon_springyield", "SPRING", "springs of tendons that yield, elastic here", 0),
    ("dof_dampingpoly", "DAMPER", "damping that is a polynomial, linear here", 0),
    ("tendon_dampingpoly", "DAMPER", "damping of tendons that is a polynomial, linear here", 0),
    ("actuator_dampingpoly", "DAMPER", "damping of actuators that is a polynomial, linear here", 0),
    ("body_plugin", "", "plugins that push bodies", -1),
    ("actuator_plugin", "", "plugins that are actuators", -1),
)


def unmodelled(mj: Any, had: Transmissions) -> Iterator[str]:
    """Say what of a mujoco.MjModel changes the motion and is not in the model, but for loops."""
    joints, bodies = joint_names(mj), body_names(mj)
    owners = {
        "jnt": joints, "dof": [joints[j] for j in mj.dof_jntid], "body": bodies,
        "tendon": names_of(mj, "tendon"), "actuator": names_of(mj, "actuator"),
    }  # fmt: skip
    found = [
        (what, _named(owners[array.split("_")[0]], getattr(mj, array) - none))
        for array, switch, what, none in _CHANGES
        if hasattr(mj, array) and not (switch and disabled(mj, switch))
    ]
    kinds, sprung = mj.jnt_type, np.isin(range(mj.njnt), [spring.joint for spring in had.springs])
    weight = mj.opt.gravity * (not disabled(mj, "GRAVITY"))
    lifted = mj.body_gravcomp * mj.body_mass * (mj.body_weldid > 0) * weight.any()
    found += [
        (
            "armature of free joints",
            _named(joints, (kinds == FREE) & (had.armature[mj.jnt_dofadr] != 0)),
        ),
        ("springs of free joints and balls", _named(joints, (kinds <= BALL) & sprung)),
        ("limits of balls", _named(joints, (kinds == BALL) & (mj.jnt_limited > 0))),
        ("gravity compensation of bodies", _named(bodies, lifted)),
        ("flexible bodies, beside their masses", names_of(mj, "flex")),
    ]
    yield from (f"{what} ({listed(names)})" for what, names in found if names)
    yield from had.lost
    if mj.opt.density or mj.opt.viscosity:
        yield "the medium around the bodies (density, viscosity, wind)"


def unused(mj: Any, had: Transmissions) -> Iterator[str]:
    """Say what else is in a mujoco.MjModel, and is not used by itself."""
    joints, alone = joint_names(mj), driven(mj)
    counts = {
        "geoms, as bodies that touch": np.count_nonzero(mj.geom_contype | mj.geom_conaffinity),
        "pairs of geoms that touch": mj.npair,
        "actuators, but for their joints": sum(joint is not None for joint in alone),
        "sensors": mj.nsensor,
        "mocap bodies, which stand still": mj.nmocap,
    }
    if some := [f"{n} {what}" for what, n in counts.items() if n]:
        yield f"in the file and not used: {', '.join(some)}"
    of = {kind: names_of(mj, kind) for kind in ("tendon", "site")} | {"body": body_names(mj)}
    pulls = zip(names_of(mj, "actuator"), pulled(mj), alone, strict=True)
    if others := [
        f"{name} on {kind} {of[kind][target]!r}"
        for name, (kind, target), joint in pulls
        if joint is None
    ]:
        yield f"actuators that move no joint alone, which are no motors here: {listed(others)}"
    if pushing := _named(names_of(mj, "actuator"), _biased(mj)):
        yield f"servos, which push at ctrl = 0 ({few(pushing)}): here what acts is tau"
    owners = [joints[j] for j in mj.dof_jntid]
    if damped := _named(owners, had.damping):
        yield f"joint damping ({few(damped)}): add Robot.passive_torque to tau"
    if rubbed := _named(owners, had.friction):
        yield f"joint friction ({few(rubbed)}): a scene has it with JointFriction"
    scalar = mj.jnt_type > BALL
    if limited := _named(joints, scalar & np.isfinite(had.limits).any(axis=1)):
        yield f"limits of position ({len(limited)} joints)"
    if wide := _named(joints, mj.jnt_range.any(axis=1) & (mj.jnt_limited == 0)):
        yield f"ranges that are no limits to MuJoCo ({few(wide)})"


def _named(names: Sequence[str], values: ArrayLike) -> list[str]:
    """Return the names of the rows that are not zero, each once."""
    rows = zip(names, np.asarray(values), strict=True)
    return list(dict.fromkeys(name for name, row in rows if np.any(row)))


def _biased(mj: Any) -> Array:
    """Return which actuators push although nothing is asked of them."""
    types = require_mujoco("").mjtBias
    kinds = mj.actuator_biastype
    affine, none = (kinds == int(getattr(types, f"mjBIAS_{k}")) for k in ("AFFINE", "NONE"))
    acts = np.where(affine, mj.actuator_biasprm[:, :3].any(axis=1), ~none)
    off = mj.actuator_ctrllimited.astype(bool) & (mj.actuator_ctrlrange.prod(axis=1) > 0)
    integrates = mj.actuator_gaintype == int(getattr(require_mujoco("").mjtGain, "mjGAIN_PID", -1))
    return np.asarray((acts | integrates | off) & (not disabled(mj, "ACTUATION")))
