"""What the tendons and actuators of an MJCF are to the joints that they pull.

A transmission has a length l: of a fixed tendon l = c . q, of an actuator gear times that of its
joint or tendon. With its armature a, damping d, stiffness k, rest l0 and dry friction f, and
g = dl/dq,

    M += a g g^T,    tau -= g (k (l - l0) + d l'),    |tau_i| <= |g_i| f.

Over one joint, all of it is the joint's own. Over several, it couples them as no tree does, and
`lost` says so. A tendon that is straight from site to site is a SpringDamper.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core.names import listed
from condyn_pin.io.mjcf_file import disabled, joint_names, names_of, require_mujoco


class JointSpring(NamedTuple):
    """A spring on a joint, by the number of the joint."""

    joint: int
    stiffness: float  # [N m/rad or N/m]
    rest: float  # [rad or m]


class Straight(NamedTuple):
    """A tendon that is straight between two sites, by their numbers."""

    ends: tuple[int, int]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    rest: float  # [m]


class Transmissions:
    """What joints have: by themselves, by tendons, and by actuators.

    Attributes
    ----------
    armature, damping, friction : (nv,) array
    limits : (njnt, 2) array
        Of hinges and slides [rad or m].
    springs : list of JointSpring
    straight : list of Straight
    lost : list of str
        What tendons do to the motion that is none of these, a sentence each.
    """

    def __init__(self, mj: Any) -> None:
        self.mj, self._joints = mj, joint_names(mj)
        constrained = not disabled(mj, "CONSTRAINT")
        on = {what: not disabled(mj, what) for what in ("SPRING", "DAMPER")}
        on |= {what: constrained and not disabled(mj, what) for what in ("FRICTIONLOSS", "LIMIT")}
        self.armature = mj.dof_armature.copy()
        self.damping = mj.dof_damping * on["DAMPER"]
        self.friction = mj.dof_frictionloss * on["FRICTIONLOSS"]
        limited = (mj.jnt_limited > 0)[:, None]
        self.limits = np.where(limited, mj.jnt_range, [-inf, inf])
        stiffness = mj.jnt_stiffness * on["SPRING"]
        self.springs = [
            JointSpring(j, float(stiffness[j]), float(mj.qpos_spring[mj.jnt_qposadr[j]]))
            for j in np.flatnonzero(stiffness).tolist()
        ]
        self.straight: list[Straight] = []
        self.lost: list[str] = []
        self._of_tendons = {
            "armature": np.array(getattr(mj, "tendon_armature", np.zeros(mj.ntendon))),
            "damping": mj.tendon_damping * on["DAMPER"],
            "stiffness": mj.tendon_stiffness * on["SPRING"],
            "dry friction": mj.tendon_frictionloss * on["FRICTIONLOSS"],
            "limits": mj.tendon_limited * on["LIMIT"],
        }
        with np.errstate(over="ignore"):  # what is too large is refused with the model
            self._add_actuators(damped=on["DAMPER"])
            for t, name in enumerate(names_of(mj, "tendon")):
                self._add_tendon(t, name)

    def _add_actuators(self, *, damped: bool) -> None:
        """Add to joints and tendons what their actuators carry."""
        mj = self.mj
        if not hasattr(mj, "actuator_armature"):  # MuJoCo of before
            return
        carried = mj.actuator_armature, mj.actuator_damping * damped
        for k, (kind, target) in enumerate(pulled(mj)):
            square = mj.actuator_gear[k, 0] ** 2
            at = mj.dof_jntid == target if kind == "joint" else [target]
            to = (self.armature, self.damping)
            if kind == "tendon":
                to = (self._of_tendons["armature"], self._of_tendons["damping"])
            for values, each in zip(to, carried, strict=True):
                if each[k]:
                    values[at] += square * each[k]

    def _add_tendon(self, t: int, name: str) -> None:
        """Add a tendon to its joint, or to what is straight, and say what is left of it."""
        mj, has = self.mj, {key: float(values[t]) for key, values in self._of_tendons.items()}
        coefficients = coefficients_of(mj, t)
        if coefficients == {}:
            return  # it has one length
        where, modelled = "which is spatial", tuple[str, ...]()
        lower, upper = mj.tendon_lengthspring[t].tolist()
        if coefficients is None:
            if lower == upper and min(has["stiffness"], has["damping"]) >= 0:
                modelled = self._add_straight(t, has, lower)
        else:
            where = f"over {listed([self._joints[j] for j in coefficients])}"
            if len(coefficients) == 1:
                modelled = self._add_to_joint(*coefficients.popitem(), t, has)
        left = [f"{key} {x:g}" for key, x in has.items() if x and key not in modelled]
        if left and left[-1] == "limits 1":
            least, most = mj.tendon_range[t]
            left[-1] = f"limits from {least:g} to {most:g}"
        if left:
            slack = f" from {lower:g} to {upper:g} m slack" if lower < upper else ""
            self.lost.append(f"tendon {name!r}, {where}: {', '.join(left)}{slack}")

    def _add_to_joint(self, j: int, c: float, t: int, has: Mapping[str, float]) -> tuple[str, ...]:
        """Add the tendon t, c times the coordinate of joint j long; return what is modelled."""
        dof = self.mj.jnt_dofadr[j]
        self.armature[dof] += c**2 * has["armature"]
        self.damping[dof] += c**2 * has["damping"]
        self.friction[dof] += abs(c) * has["dry friction"]
        if has["limits"]:
            lower, upper = sorted(self.mj.tendon_range[t] / c)
            self.limits[j] = max(self.limits[j, 0], lower), min(self.limits[j, 1], upper)
        own = ("armature", "damping", "dry friction", "limits")
        rest, other = self.mj.tendon_lengthspring[t].tolist()
        if rest != other:
            return own
        if has["stiffness"]:
            self.springs.append(JointSpring(j, c**2 * has["stiffness"], rest / c))
        return (*own, "stiffness")

    def _add_straight(self, t: int, has: Mapping[str, float], rest: float) -> tuple[str, ...]:
        """Add a tendon that only its two sites bend; return what is modelled."""
        mj, first = self.mj, self.mj.tendon_adr[t]
        wraps = slice(first, first + mj.tendon_num[t])
        site = int(require_mujoco("").mjtWrap.mjWRAP_SITE)
        if mj.wrap_type[wraps].tolist() != [site, site]:
            return ()
        a, b = mj.wrap_objid[wraps].tolist()
        here, there = mj.body_weldid[mj.site_bodyid[[a, b]]]
        if here != there and (has["stiffness"] or has["damping"]):
            self.straight.append(Straight((a, b), has["stiffness"], has["damping"], rest))
        return ("stiffness", "damping") if here != there else tuple(has)


def coefficients_of(mj: Any, t: int) -> dict[int, float] | None:
    """Return by joint how a fixed tendon's length follows it, if it does; None if it is spatial."""
    first = mj.tendon_adr[t]
    wraps = slice(first, first + mj.tendon_num[t])
    if (mj.wrap_type[wraps] != int(require_mujoco("").mjtWrap.mjWRAP_JOINT)).any():
        return None
    pairs = zip(mj.wrap_objid[wraps].tolist(), mj.wrap_prm[wraps].tolist(), strict=True)
    return {j: c for j, c in pairs if c}


def pulled(mj: Any) -> Iterator[tuple[str, int]]:
    """Yield what each actuator pulls, and the number of it: a joint, a tendon, a site, a body."""
    trn = require_mujoco("").mjtTrn
    for kind, (target, _) in zip(mj.actuator_trntype, mj.actuator_trnid.tolist(), strict=True):
        word = trn(kind).name.removeprefix("mjTRN_").lower()
        word = {"jointinparent": "joint", "so3": "joint", "slidercrank": "site"}.get(word, word)
        yield word, target


def driven(mj: Any) -> list[int | None]:
    """Return the joint that each actuator drives alone, None if there is no such joint."""
    found: list[int | None] = []
    for kind, target in pulled(mj):
        moves = {target: 1.0} if kind == "joint" else None
        moves = coefficients_of(mj, target) if kind == "tendon" else moves
        found.append(next(iter(moves)) if moves and len(moves) == 1 else None)
    return found
