"""Read a robot from an MJCF file: MuJoCo compiles it, and its arrays become a Pinocchio tree.

MuJoCo places the inertia of body b in its principal axes c, with bRc from `body_iquat`:

    I = bRc · diag(body_inertia) · bRcᵀ      about `body_ipos`

`DrawnTree` says how joints move a body from where it is drawn. The configuration in which the file
draws the model is ``qpos0``: zero, but for joints with a `ref`. Quaternions are w x y z in MuJoCo
and x y z w here. The format: https://mujoco.readthedocs.io/en/stable/XMLreference.html

A transmission has a length l: of a fixed tendon l = c . q, of an actuator gear times that of its
joint or tendon. With its armature a, damping d, stiffness k, rest l0 and dry friction f, and
g = dl/dq,

    M += a g g^T,    tau -= g (k (l - l0) + d l'),    |tau_i| <= |g_i| f.

Over one joint, all of it is the joint's own. Over several, it couples them as no tree does, and
`lost` names them; an actuator there is a CoupledMotor of the weights g. A tendon that is straight
from site to site is a SpringDamper.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import inf
from os import PathLike
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin, set_dry_friction
from condyn_pin._core.arguments import listed, short_list
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.held_joint import HeldJoint
from condyn_pin.constraints.loop import Loop, LoopKind
from condyn_pin.constraints.places import WORLD
from condyn_pin.errors import InvalidModel
from condyn_pin.io.description import Description
from condyn_pin.io.mjcf_file import (
    body_names,
    compiled,
    disabled,
    joint_names,
    names_of,
    require_mujoco,
)
from condyn_pin.io.xml import place
from condyn_pin.model.joints import CoupledMotor
from condyn_pin.model.springs import Spring, SpringDamper
from condyn_pin.model.tree import DrawnJoint, DrawnTree

KINDS: Final = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
DRAWN: Final = "qpos0"
FAR: Final = 1e10  # [rad, m, N m, N] the side of a limit that does not exist: MuJoCo needs both
_UNNAMED: Final = "MuJoCo Model"  # what MuJoCo calls it
_ROUNDING: Final = 1e-12  # of coefficients that cancel
_ONE: Final = np.array([1.0, 0.0, 0.0, 0.0])  # no turn, w x y z


def read_mjcf(path: str | PathLike[str]) -> Description:
    """Read an MJCF file into a Pinocchio model and its loops, the same with every Pinocchio.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    Description
        The model, its loops, couplings and held joints, motors, springs, the keyframes as postures
        (the last one is ``qpos0``, in which the file draws the model), and what is not modelled
        or not used.

    Raises
    ------
    InvalidModel
        The file cannot be read, or its content makes no model.
    MissingExtra
        MuJoCo is not installed.

    Notes
    -----
    A body, a site and a joint are frames of their names; where several share a name it is the
    body's, then the site's. A <connect> or <weld> without sites makes the frames ``NAME_a`` and
    ``NAME_b``. Loops are rigid here, whatever their solref and solimp.
    """
    with place(path):
        return _Reader(*compiled(path, "mujoco")).read()


class _Reader:
    """A compiled model that is being read."""

    def __init__(self, mj: Any, lost: Sequence[str]) -> None:
        self.mujoco, self.mj = require_mujoco("an MJCF is read by MuJoCo"), mj
        self.bodies, self.joints = body_names(mj), joint_names(mj)
        self.sites = [mj.site(s).name for s in range(mj.nsite)]
        for name in (*self.bodies[1:], *self.joints, *self.sites):
            if name in WORLD:
                raise InvalidModel(f"the name {name!r} is the world's; rename it")
        self.tree = DrawnTree(mj.names.split(b"\0", 1)[0].decode(), self.bodies)
        self.had, self.coupled = Transmissions(mj), coupled_motors(mj)
        self.efforts = efforts(mj, self.coupled.values())
        self.unused, self.lost_rows = list(lost), list[str]()

    def read(self) -> Description:
        mj, tree = self.mj, self.tree
        tree.model.gravity.linear = mj.opt.gravity * (not disabled(mj, "GRAVITY"))
        for k in range(1, mj.nbody):
            self._add_body(k)
        for s, site in enumerate(self.sites):
            self._add_site(s, site)
        set_dry_friction(tree.model, self.had.friction)
        loops = tuple(self._equalities())
        motors = [self.joints[j] for j in driven(mj) if j is not None]
        scalar = {name for name, joint in tree.joints.items() if joint.scalar}
        springs = [Spring(self.joints[j], k, rest) for j, k, rest in self.had.springs]
        name = tree.model.name
        return Description(
            tree.model,
            loops=loops,
            actuated=tuple(dict.fromkeys(motors)),
            coupled_motors=tuple(self.coupled.values()),
            springs=tuple(spring for spring in springs if spring.joint in scalar),
            spring_dampers=tuple(
                SpringDamper(self._site_frame(a), self._site_frame(b), *values)
                for (a, b), *values in self.had.straight
            ),
            postures=self._postures(),
            unused=(*self.unused, *unused(mj, self.had, self.coupled, self.efforts)),
            unmodelled=(*self.lost_rows, *unmodelled(mj, self.had)),
            lost_rows=tuple(self.lost_rows),
            exclusions=frozenset(
                frozenset((self.bodies[a], self.bodies[b]))
                for a, b in (divmod(pair, 2**16) for pair in mj.exclude_signature.tolist())
                if a != b
            ),
            name="" if name == _UNNAMED else name,
        )

    def _add_body(self, k: int) -> None:
        mj = self.mj
        first, count = int(mj.body_jntadr[k]), int(mj.body_jntnum[k])
        R = _pose(mj.body_ipos[k], mj.body_iquat[k]).rotation
        about_centre = R @ np.diag(mj.body_inertia[k]) @ R.T
        inertia = pin.Inertia(float(mj.body_mass[k]), mj.body_ipos[k], about_centre)
        self.tree.add_body(
            self.bodies[k],
            self.bodies[mj.body_parentid[k]],
            _pose(mj.body_pos[k], mj.body_quat[k]),
            [self._joint(j) for j in range(first, first + count)],
            inertia if inertia.mass > 0 else None,
        )

    def _joint(self, j: int) -> DrawnJoint:
        mj, kind = self.mj, KINDS[int(self.mj.jnt_type[j])]
        scalar, dof = kind in ("slide", "hinge"), int(mj.jnt_dofadr[j])
        lower, upper = self.had.limits[j] if scalar else (-inf, inf)
        return DrawnJoint(
            self.joints[j],
            kind,
            axis=mj.jnt_axis[j].copy(),
            point=mj.jnt_pos[j].copy(),
            reference=float(mj.qpos0[mj.jnt_qposadr[j]]) if scalar else 0.0,
            lower=float(lower),
            upper=float(upper),
            # that of a free joint is along the axes of the world, which no Pinocchio joint has
            armature=0.0 if kind == "free" else float(self.had.armature[dof]),
            damping=float(self.had.damping[dof]),
            effort=next((most for most in sorted(self.efforts[j].tolist()) if most > 0.0), inf),
        )

    def _add_site(self, s: int, site: str) -> None:
        if not site:
            return
        mj, name = self.mj, self._site_frame(s)
        if name != site:
            self.unused.append(f"the name of site {site!r}: a body has it; {name!r} here")
        body = self.bodies[mj.site_bodyid[s]]
        self.tree.mark(name, body, _pose(mj.site_pos[s], mj.site_quat[s]))

    def _site_frame(self, s: int) -> str:
        """Return the frame of a site, "" for one without a name."""
        site = self.sites[s]
        return f"{site}_site" if site in self.bodies else site

    def _equalities(self) -> Iterator[Constraint]:
        mj, off = self.mj, disabled(self.mj, "EQUALITY", "CONSTRAINT")
        for k in range(mj.neq):
            kind = self.mujoco.mjtEq(mj.eq_type[k]).name.removeprefix("mjEQ_").lower()
            name = mj.equality(k).name or f"{kind}{k}"
            if off or not mj.eq_active0[k]:
                self.unused.append(f"equality {name!r} is not active")
            elif kind in ("connect", "weld"):
                yield self._loop(k, kind, name)
            elif kind in ("joint", "tendon"):
                yield from self._row(k, kind, name)
            else:
                self._lose(name, f", of the kind {kind}")

    def _row(self, k: int, kind: str, name: str) -> Iterator[Constraint]:
        """Yield an equality l1 - ref1 = p(l2 - ref2) of coordinates or fixed tendons.

        Each is a weighted sum of coordinates, l = w . q, or nothing.
        """
        mj, c = self.mj, self.mj.eq_data[k, :5].tolist()
        ends = [int(end[k]) for end in (mj.eq_obj1id, mj.eq_obj2id)]
        if ends[1] < 0:
            c[1:] = [0.0] * 4
        (w, ref1), (other, ref2) = (self._length(kind, end) for end in ends)
        if w is None or other is None:
            self._lose(name, ", of tendons that are not fixed ones")
        elif any(c[2:]):
            yield from self._curve(name, c, (w, ref1), (other, ref2))
        else:
            for j, weight in other.items():
                w[j] = w.get(j, 0.0) - c[1] * weight
            least = _ROUNDING * max(map(abs, w.values()), default=0.0)
            tied = {self.joints[j]: x for j, x in w.items() if abs(x) > least}
            offset = float(ref1 + c[0] - c[1] * ref2)
            if len(tied) > 2:
                yield Coupling(tied, offset=offset, name=name)
            elif len(tied) == 2:
                (one, x), (two, y) = tied.items()
                yield Coupling(one, two, -y / x, offset / x, name=name)
            elif tied:
                ((joint, x),) = tied.items()
                yield HeldJoint(joint, offset / x, name=name)
            elif abs(offset) > _ROUNDING:
                self._lose(name, ", which nothing can meet")

    def _lose(self, name: str, why: str) -> None:
        self.lost_rows.append(f"equality {name!r}{why}")

    def _curve(
        self,
        name: str,
        c: Sequence[float],
        first: tuple[Mapping[int, float], float],
        second: tuple[Mapping[int, float], float],
    ) -> Iterator[Coupling]:
        """Yield w1 q1 = ref1 + p(w2 q2 - ref2), of one joint on either side."""
        (w1, ref1), (w2, ref2) = first, second
        if not (len(w1) == len(w2) == 1 and w1.keys() != w2.keys()):
            who = listed([self.joints[j] for j in {**w1, **w2}])
            self._lose(name, f" couples {who} by a polynomial, polycoef {c}")
            return
        ((one, x),), ((two, y),) = w1.items(), w2.items()
        curve = (Polynomial(c)(Polynomial((-ref2, y))) + ref1) / x
        offset, ratio, *higher = map(float, curve.trim().coef)
        yield Coupling(self.joints[one], self.joints[two], ratio, offset, higher, name=name)

    def _length(self, kind: str, k: int) -> tuple[dict[int, float] | None, float]:
        """Coefficients by joint of a coordinate or tendon, None if spatial; its length at qpos0."""
        if k < 0:
            return {}, 0.0
        if kind == "joint":
            return {k: 1.0}, float(self.mj.qpos0[self.mj.jnt_qposadr[k]])
        return coefficients_of(self.mj, k), float(self.mj.tendon_length0[k])

    def _loop(self, k: int, tag: str, name: str) -> Loop:
        mj, data = self.mj, self.mj.eq_data[k]
        ids = int(mj.eq_obj1id[k]), int(mj.eq_obj2id[k])
        # without torquescale a weld leaves the turns free
        kind: LoopKind = "weld" if tag == "weld" and data[10] != 0 else "ball"
        if int(mj.eq_objtype[k]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            frames = [self._site_frame(s) for s in ids]
        else:
            # in a weld the anchor on body 2 comes first
            at = (data[:3], data[3:6]) if tag == "connect" else (data[3:6], data[:3])
            turns = (data[6:10] if kind == "weld" else _ONE), _ONE
            frames = [f"{name}_a", f"{name}_b"]
            for frame, body, p, wxyz in zip(frames, ids, at, turns, strict=True):
                self.tree.mark(frame, self.bodies[body], _pose(p, wxyz))
        return Loop(frames[0], frames[1], kind, name=name)

    def _postures(self) -> dict[str, Array]:
        """Keyframes by name, and last ``qpos0``, the configuration in which the file is drawn."""
        mj, drawn = self.mj, self.tree.configuration()
        found = {}
        for k in range(mj.nkey):
            q = mj.key_qpos[k].copy()
            for joint in self.tree.model.joints[1:]:
                if joint.nq > joint.nv:
                    end = joint.idx_q + joint.nq
                    wxyz = q[end - 4 : end]
                    norm = np.linalg.norm(wxyz)
                    # zero is no rotation: MuJoCo reads it as 1 0 0 0, and files count on that
                    q[end - 4 : end] = np.roll(wxyz, -1) / norm if norm > 0 else np.eye(4)[3]
            found[mj.key(k).name or f"key{k}"] = q
        other = found.pop(DRAWN, drawn)  # the name is taken
        if np.abs(other - drawn).max(initial=0.0) > tolerances.DRAWN:
            self.unused.append(
                f"keyframe {DRAWN!r}: the pose in which the file draws the model has this name; "
                "rename it"
            )
        return found | {DRAWN: drawn}


def _pose(translation: Array, wxyz: Array) -> Any:
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(translation))


class JointSpring(NamedTuple):
    """A spring on a joint, by the number of the joint."""

    joint: int
    stiffness: float  # [N m/rad or N/m]
    rest: float  # [rad or m]


class StraightTendon(NamedTuple):
    """A tendon that is straight between two sites, by their numbers."""

    ends: tuple[int, int]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    rest: float  # [m]


class Transmissions:
    """Armature, damping, friction, limits and springs of joints, tendons and actuators included.

    Attributes
    ----------
    armature, damping, friction : (nv,) array
    limits : (njnt, 2) array
        Of hinges and slides [rad or m].
    springs : list of JointSpring
    straight : list of Straight
    lost : list of str
        Effects of tendons on the motion that are none of these, a sentence each.
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
        self.straight: list[StraightTendon] = []
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
        """Add the armature and damping of actuators to their joints and tendons."""
        mj = self.mj
        if not hasattr(mj, "actuator_armature"):  # MuJoCo of before
            return
        carried = mj.actuator_armature, mj.actuator_damping * damped
        for k, (kind, target) in enumerate(actuator_targets(mj)):
            square = mj.actuator_gear[k, 0] ** 2
            at = mj.dof_jntid == target if kind == "joint" else [target]
            to = (self.armature, self.damping)
            if kind == "tendon":
                to = (self._of_tendons["armature"], self._of_tendons["damping"])
            for values, each in zip(to, carried, strict=True):
                if each[k]:
                    values[at] += square * each[k]

    def _add_tendon(self, t: int, name: str) -> None:
        """Add a tendon to its joint, or to the straight ones; its other effects go to `lost`."""
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
        """Add the tendon t of length c q_j to joint j; return its properties that are modelled."""
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
        """Add a tendon that is straight between two sites; return its modelled properties."""
        mj, first = self.mj, self.mj.tendon_adr[t]
        wraps = slice(first, first + mj.tendon_num[t])
        site = int(require_mujoco("").mjtWrap.mjWRAP_SITE)
        if mj.wrap_type[wraps].tolist() != [site, site]:
            return ()
        a, b = mj.wrap_objid[wraps].tolist()
        here, there = mj.body_weldid[mj.site_bodyid[[a, b]]]
        if here != there and (has["stiffness"] or has["damping"]):
            self.straight.append(StraightTendon((a, b), has["stiffness"], has["damping"], rest))
        return ("stiffness", "damping") if here != there else tuple(has)


def coefficients_of(mj: Any, t: int) -> dict[int, float] | None:
    """Return the nonzero coefficients c of a fixed tendon by joint; None if it is spatial."""
    first = mj.tendon_adr[t]
    wraps = slice(first, first + mj.tendon_num[t])
    if (mj.wrap_type[wraps] != int(require_mujoco("").mjtWrap.mjWRAP_JOINT)).any():
        return None
    pairs = zip(mj.wrap_objid[wraps].tolist(), mj.wrap_prm[wraps].tolist(), strict=True)
    return {j: c for j, c in pairs if c}


def actuator_targets(mj: Any) -> Iterator[tuple[str, int]]:
    """Yield the target of each actuator, kind and index: a joint, a tendon, a site, a body."""
    trn = require_mujoco("").mjtTrn
    for kind, (target, _) in zip(mj.actuator_trntype, mj.actuator_trnid.tolist(), strict=True):
        word = trn(kind).name.removeprefix("mjTRN_").lower()
        word = {"jointinparent": "joint", "so3": "joint", "slidercrank": "site"}.get(word, word)
        yield word, target


def driven(mj: Any) -> list[int | None]:
    """Return the joint that each actuator drives alone, None if there is no such joint."""
    found: list[int | None] = []
    for kind, target in actuator_targets(mj):
        moves = {target: 1.0} if kind == "joint" else None
        moves = coefficients_of(mj, target) if kind == "tendon" else moves
        found.append(next(iter(moves)) if moves and len(moves) == 1 else None)
    return found


def coupled_motors(mj: Any) -> dict[int, CoupledMotor]:
    """Return the motors on fixed tendons over several joints, by the number of the actuator.

    Servos are none: they push at ctrl = 0. Nor are dampers, whose force is not theirs to choose.
    """
    joints, fixed = joint_names(mj), int(require_mujoco("").mjtGain.mjGAIN_FIXED)
    acts = (mj.actuator_gaintype == fixed) & np.logical_not(_has_bias_force(mj))
    names = names_of(mj, "actuator")
    taken, found = {*joints, *names}, {}
    each = zip(names, actuator_targets(mj), _force_limits(mj).tolist(), strict=True)
    for k, (name, (kind, target), (least, largest)) in enumerate(each):
        weights = coefficients_of(mj, target) if kind == "tendon" and acts[k] else None
        gear = float(mj.actuator_gear[k, 0])
        if weights and len(weights) > 1 and gear and least < largest:
            if name in joints:
                name = unused_name(f"{name}_motor", taken)
                taken.add(name)
            pulls = {joints[j]: gear * c for j, c in weights.items()}
            found[k] = CoupledMotor(name, pulls, (least, largest))
    return found


def unused_name(name: str, taken: Collection[str]) -> str:
    """Name that is not taken, with as many underscores behind it as that needs."""
    while name in taken:
        name += "_"
    return name


def _force_limits(mj: Any) -> Array:
    """Least and largest force (nu, 2) of each actuator: its forcerange, and gain times ctrlrange.

    Where it pulls on a tendon alone, that tendon's range of force too.
    """
    types = require_mujoco("")
    fixed = mj.actuator_gaintype == int(types.mjtGain.mjGAIN_FIXED)
    direct = mj.actuator_dyntype == int(types.mjtDyn.mjDYN_NONE)
    clamped = (mj.actuator_ctrllimited > 0) & (not disabled(mj, "CLAMPCTRL"))
    pulls = _held_tendons(mj)
    on_tendon = np.isin(np.arange(mj.nu), [*pulls])
    of_tendon = np.zeros((mj.nu, 2))
    of_tendon[[*pulls]] = mj.tendon_actfrcrange[[*pulls.values()]]
    found = np.tile([-inf, inf], (mj.nu, 1))
    for holds, ranges in (
        (mj.actuator_forcelimited > 0, mj.actuator_forcerange),
        # ctrl of a servo is no force
        (
            clamped & fixed & direct & np.logical_not(_has_bias_force(mj)),
            np.sort(mj.actuator_gainprm[:, :1] * mj.actuator_ctrlrange, axis=1),
        ),
        (on_tendon, of_tendon),
    ):
        found[holds, 0] = np.maximum(found[holds, 0], ranges[holds, 0])
        found[holds, 1] = np.minimum(found[holds, 1], ranges[holds, 1])
    return np.where(np.abs(found) < FAR, found, [-inf, inf])


def _held_tendons(mj: Any) -> dict[int, int]:
    """Tendons with a range of force on which one actuator pulls alone, by that actuator."""
    targets = [*actuator_targets(mj)]
    counts = Counter(targets)
    return {
        k: t
        for k, (kind, t) in enumerate(targets)
        if kind == "tendon" and mj.tendon_actfrclimited[t] and counts[kind, t] == 1
    }


def efforts(mj: Any, coupled: Iterable[CoupledMotor]) -> Array:
    """Largest torques (njnt, 2) of all motors on each joint down and up [N m, N].

    Infinite where there is no limit, or where `coupled` motors act too: those have their own.
    """
    own, moved = np.zeros((mj.njnt, 2)), np.zeros(mj.njnt, dtype=bool)
    each = zip(actuator_targets(mj), driven(mj), _force_limits(mj).tolist(), strict=True)
    for k, ((kind, target), j, limits) in enumerate(each):
        if j is not None:
            arm = coefficients_of(mj, target) if kind == "tendon" else None
            gear = float(mj.actuator_gear[k, 0]) * (arm[j] if arm else 1.0)
            down, up = sorted(gear * x if gear else 0.0 for x in limits)
            own[j] += -down, up
            moved[j] = True
    several = {name for motor in coupled for name in motor.weights}
    alone = moved & ~np.isin(joint_names(mj), [*several])
    within = np.where(mj.jnt_actfrclimited[:, None], mj.jnt_actfrcrange * [-1.0, 1.0], inf)
    return np.asarray(np.minimum(np.where(alone[:, None], own, inf), within))


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
    """Yield the parts of a mujoco.MjModel, but for loops, that act on the motion unmodelled."""
    joints, bodies = joint_names(mj), body_names(mj)
    owners = {
        "jnt": joints, "dof": [joints[j] for j in mj.dof_jntid], "body": bodies,
        "tendon": names_of(mj, "tendon"), "actuator": names_of(mj, "actuator"),
    }  # fmt: skip
    found = [
        (what, _names_of_nonzero(owners[array.split("_")[0]], getattr(mj, array) - none))
        for array, switch, what, none in _CHANGES
        if hasattr(mj, array) and not (switch and disabled(mj, switch))
    ]
    kinds, sprung = mj.jnt_type, np.isin(range(mj.njnt), [spring.joint for spring in had.springs])
    weight = mj.opt.gravity * (not disabled(mj, "GRAVITY"))
    lifted = mj.body_gravcomp * mj.body_mass * (mj.body_weldid > 0) * weight.any()
    found += [
        (
            "armature of free joints",
            _names_of_nonzero(joints, (kinds == FREE) & (had.armature[mj.jnt_dofadr] != 0)),
        ),
        ("springs of free joints and balls", _names_of_nonzero(joints, (kinds <= BALL) & sprung)),
        ("limits of balls", _names_of_nonzero(joints, (kinds == BALL) & (mj.jnt_limited > 0))),
        ("gravity compensation of bodies", _names_of_nonzero(bodies, lifted)),
        ("flexible bodies, beside their masses", names_of(mj, "flex")),
    ]
    yield from (f"{what} ({listed(names)})" for what, names in found if names)
    yield from had.lost
    if mj.opt.density or mj.opt.viscosity:
        yield "the medium around the bodies (density, viscosity, wind)"


def unused(mj: Any, had: Transmissions, coupled: Collection[int], most: Array) -> Iterator[str]:
    """Yield the other parts of a mujoco.MjModel that are not used, or not by default.

    `coupled` are the numbers of actuators that are motors on several joints, and `most` what
    `efforts` has found.
    """
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
    pulls = enumerate(zip(names_of(mj, "actuator"), actuator_targets(mj), alone, strict=True))
    others = {
        k: f"{name} on {kind} {of[kind][target]!r}"
        for k, (name, (kind, target), joint) in pulls
        if joint is None
    }
    if several := [what for k, what in others.items() if k in coupled]:
        yield f"motors of Robot.coupled_motors, not in Robot.actuated: {listed(several)}"
    if no_motors := [what for k, what in others.items() if k not in coupled]:
        yield f"actuators that are no motors here: {listed(no_motors)}"
    if had.lost:
        yield (
            f"armature, damping and the like of tendons that couple joints ({len(had.lost)}): "
            "Robot.unmodelled lists them"
        )
    groups = mj.opt.disableactuator >> np.clip(mj.actuator_group, 0, 30)
    if off := _names_of_nonzero(names_of(mj, "actuator"), (groups & 1) | disabled(mj, "ACTUATION")):
        yield f"actuators that the file switches off, and are motors here: {short_list(off)}"
    if pushing := _names_of_nonzero(names_of(mj, "actuator"), _has_bias_force(mj)):
        yield f"servos, which push at ctrl = 0 ({short_list(pushing)}): here what acts is tau"
    owners = [joints[j] for j in mj.dof_jntid]
    if damped := _names_of_nonzero(owners, had.damping):
        yield f"joint damping ({short_list(damped)}): add Robot.passive_torque to tau"
    if rubbed := _names_of_nonzero(owners, had.friction):
        yield f"joint friction ({short_list(rubbed)}): a scene has it with robot.frictions()"
    scalar = mj.jnt_type > BALL
    if limited := _names_of_nonzero(joints, scalar & np.isfinite(had.limits).any(axis=1)):
        yield f"limits of position ({len(limited)} joints)"
    if uneven := _names_of_nonzero(joints, scalar & (most[:, 0] != most[:, 1])):
        yield (
            f"torque limits that differ by direction ({short_list(uneven)}): the effort limit is "
            "the smaller one that is not zero"
        )
    held = {*_held_tendons(mj).values()}
    shared = [
        name for t, name in enumerate(of["tendon"]) if mj.tendon_actfrclimited[t] and t not in held
    ]
    if shared:
        names = short_list(shared)
        yield f"ranges of force of tendons that motors share, or over one joint ({names})"
    if wide := _names_of_nonzero(joints, mj.jnt_range.any(axis=1) & (mj.jnt_limited == 0)):
        yield f"ranges that are no limits to MuJoCo ({short_list(wide)})"


def _names_of_nonzero(names: Sequence[str], values: ArrayLike) -> list[str]:
    """Names of the nonzero rows of `values`, each once."""
    rows = zip(names, np.asarray(values), strict=True)
    return list(dict.fromkeys(name for name, row in rows if np.any(row)))


def _has_bias_force(mj: Any) -> Array:
    """Mask of the actuators with a force at ctrl = 0."""
    types = require_mujoco("").mjtBias
    kinds = mj.actuator_biastype
    affine, none = (kinds == int(getattr(types, f"mjBIAS_{k}")) for k in ("AFFINE", "NONE"))
    acts = np.where(affine, mj.actuator_biasprm[:, :3].any(axis=1), ~none)
    off = mj.actuator_ctrllimited.astype(bool) & (mj.actuator_ctrlrange.prod(axis=1) > 0)
    integrates = mj.actuator_gaintype == int(getattr(require_mujoco("").mjtGain, "mjGAIN_PID", -1))
    return np.asarray((acts | integrates | off) & (not disabled(mj, "ACTUATION")))
