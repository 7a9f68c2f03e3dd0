"""A robot and the same robot in MuJoCo: joints, states and terms, one by one.

MujocoBridge: a state of Pinocchio in MuJoCo's numbers, and back.

    joint        Pinocchio                         MuJoCo
    free-flyer   pose in its placement, x y z w    pose in the world, w x y z
                 v and omega in body axes          v in world axes, omega in body axes
    spherical    x y z w                           w x y z
    unbounded    (cos alpha, sin alpha)            alpha

With R the rotation of a free body, and the joints in the order of either,

    qvel = X v,            X = diag(R, 1, 1, ...)
    qacc = X a + Xdot v,   Xdot v = R (omega x v) in the linear rows of a free joint, else 0
    tau  = X' qfrc         by the principle of virtual work.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import asin, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import HIGH, LOW, check_type, checked_names, listed
from condyn_pin._core.arrays import Array, finite, finite_rows
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.mjcf import KINDS
from condyn_pin.io.mjcf_file import joint_names, require_mujoco
from condyn_pin.io.mjcf_write import scalar_axis
from condyn_pin.model.robot import Robot

if TYPE_CHECKING:
    from condyn_pin.study.mujoco.compare import CrossCheck


@dataclass(frozen=True, eq=False)
class MujocoBridge:
    """States, accelerations and torques of a robot in MuJoCo's numbers, by joint names.

    qvel = X v,    qacc = X a + Xdot v,    tau = X' qfrc

    The verbs take one state or many: shapes (nq,) and (nv,), or the same with other axes in front.

    Parameters
    ----------
    robot : Robot
    model : mujoco.MjModel
        The same robot in MuJoCo: of `Robot.to_mjcf`, or from a file of its own.
    names : mapping of str to str, optional
        Joints that are named otherwise in MuJoCo: our name to MuJoCo's. A joint without a name is
        ``BODY_joint`` there, after its body.
    without : sequence of str, optional
        Joints of MuJoCo's model that the robot lacks. They are held.

    Raises
    ------
    InvalidModel
        If the joints do not correspond; the text names one that is missing on either side, has
        another type, hangs on another joint or has another axis.
    InvalidArgument
        If `model` is no mujoco.MjModel, or `names` no mapping.
    UnknownName
        If `names` or `without` has a joint that does not exist.
    MissingExtra
        If MuJoCo is not installed.

    Notes
    -----
    Placements and inertias are not checked: `compare` does that.
    """

    robot: Robot
    model: Any
    names: Mapping[str, str] = field(default_factory=dict)
    without: Sequence[str] = ()

    def __post_init__(self) -> None:
        mujoco = require_mujoco("a MujocoBridge is to MuJoCo")
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(f"robot = {type(self.robot).__name__}: a Robot is needed")
        if not isinstance(self.model, mujoco.MjModel):
            raise InvalidArgument(
                f"model = {type(self.model).__name__}: a mujoco.MjModel is needed; "
                "mujoco.MjModel.from_xml_string(robot.to_mjcf()) makes one"
            )
        self.robot.check_unedited()
        paired = pairs_of(self.robot, self.model, self.names, self.without)
        object.__setattr__(self, "names", MappingProxyType(dict(self.names)))
        object.__setattr__(self, "without", tuple(self.without))
        object.__setattr__(self, "_pairs", paired)
        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        check_axes(self.robot, data, paired, self.from_mujoco(data.qpos, data.qvel)[0])

    @property
    def pairs(self) -> tuple[JointPair, ...]:
        """The joints in both engines, in the order of q."""
        return self._pairs  # type: ignore[attr-defined, no-any-return]

    @cached_property
    def _map(self) -> VelocityMap:
        return VelocityMap(self.robot.model, self.pairs)

    def to_mujoco(self, q: ArrayLike, v: ArrayLike, *, data: Any = None) -> tuple[Array, Array]:
        """Return (qpos, qvel) of a state.

        Parameters
        ----------
        q, v : (..., nq), (..., nv) array_like
        data : mujoco.MjData, optional
            Where the joints of `without` are, and how fast; qpos0 and at rest by default.

        Returns
        -------
        qpos, qvel : (..., model.nq), (..., model.nv) array
            A joint without limits is an angle from -pi to pi: Pinocchio counts no turns.

        Raises
        ------
        InvalidArgument
            If a size is wrong, a number not finite, or a quaternion not normalised.
        """
        q_ = self._configuration(q)
        v_ = finite("v", v, (*q_.shape[:-1], self.robot.nv))
        given = (self.model.qpos0, np.zeros(self.model.nv))
        if data is not None:
            given = self._held(data)
        qpos, qvel = (np.array(np.broadcast_to(x, (*q_.shape[:-1], x.size))) for x in given)
        for pair in self.pairs:
            x = q_[..., pair.q]
            if pair.kind == "free":
                x = moved_pose(self.robot.model.jointPlacements[pair.here], x)
            if pair.kind in ("free", "ball"):
                x = reordered(x, 1)
            if pair.kind == "hinge" and x.shape[-1] == 2:
                x = np.arctan2(x[..., 1:], x[..., :1])
            qpos[..., pair.qpos] = x
        return qpos, self._map.spread(q_, v_, qvel)

    def from_mujoco(self, qpos: ArrayLike, qvel: ArrayLike) -> tuple[Array, Array]:
        """Return (q, v) of MuJoCo's state.

        Parameters
        ----------
        qpos, qvel : (..., model.nq), (..., model.nv) array_like
            As of a mujoco.MjData, or of many states of a mujoco.rollout [rad, m; rad/s, m/s].

        Returns
        -------
        q, v : (..., nq), (..., nv) array

        Raises
        ------
        InvalidArgument
            If a size is wrong, a number not finite, or a quaternion not normalised.
        """
        qpos_ = finite_rows("qpos", qpos, self.model.nq)
        qvel_ = finite("qvel", qvel, (*qpos_.shape[:-1], self.model.nv))
        q = np.zeros((*qpos_.shape[:-1], self.robot.nq))
        for pair in self.pairs:
            x = qpos_[..., pair.qpos]
            if pair.kind in ("free", "ball"):
                x = reordered(x, -1)
                check_units("qpos", x[..., -4:], slice(pair.qpos.stop - 4, pair.qpos.stop))
            if pair.kind == "free":
                x = moved_pose(self.robot.model.jointPlacements[pair.here].inverse(), x)
            if pair.kind == "hinge" and pair.q.stop - pair.q.start == 2:
                x = np.concatenate((np.cos(x), np.sin(x)), axis=-1)
            q[..., pair.q] = x
        return q, self._map.gather(q, qvel_)

    def acceleration_to_mujoco(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return qacc = X a + Xdot v, (..., model.nv), of `a` at a state (q, v).

        Of a free joint, qacc is the acceleration of its origin as an observer in the world sees it,
        and `a` the spatial one. Joints of `without` have none.
        """
        q_ = self._configuration(q)
        v_, a_ = (finite(n, x, (*q_.shape[:-1], self.robot.nv)) for n, x in (("v", v), ("a", a)))
        turning = self._map.turning(v_)
        return self._map.spread(q_, a_ + turning, np.zeros((*q_.shape[:-1], self.model.nv)))

    def acceleration_from_mujoco(self, q: ArrayLike, v: ArrayLike, qacc: ArrayLike) -> Array:
        """Return a = X' qacc - X' Xdot v, (..., nv), of MuJoCo's `qacc` at our state (q, v)."""
        q_ = self._configuration(q)
        v_ = finite("v", v, (*q_.shape[:-1], self.robot.nv))
        qacc_ = finite("qacc", qacc, (*q_.shape[:-1], self.model.nv))
        return self._map.gather(q_, qacc_) - self._map.turning(v_)

    def torque_to_mujoco(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Return generalised forces (..., model.nv) for ``data.qfrc_applied``, zero elsewhere."""
        q_ = self._configuration(q)
        tau_ = finite("tau", tau, (*q_.shape[:-1], self.robot.nv))
        return self._map.spread(q_, tau_, np.zeros((*q_.shape[:-1], self.model.nv)))

    def torque_from_mujoco(self, q: ArrayLike, qfrc: ArrayLike) -> Array:
        """Return tau = X' qfrc, (..., nv), of any `qfrc` of MuJoCo at our configuration q."""
        q_ = self._configuration(q)
        return self._map.gather(q_, finite("qfrc", qfrc, (*q_.shape[:-1], self.model.nv)))

    def velocity_map(self, q: ArrayLike) -> Array:
        """Return X (model.nv, nv) at q (nq,): qvel = X v, M = X' M_mujoco X, J = J_mujoco X."""
        q_ = self._configuration(finite("q", q, self.robot.nq))
        columns = np.eye(self.robot.nv)
        return self._map.spread(q_, columns, np.zeros((self.robot.nv, self.model.nv))).T

    def compare(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, *, tolerance: float = tolerances.ENGINES
    ) -> CrossCheck:
        """Return M, h, springs and damping, a and loops of both engines at one state.

        Parameters
        ----------
        q, v, tau : (nq,), (nv,), (nv,) array_like
            A state that moves in every joint tests most; loops are compared where they are closed.
        tolerance : float
            Relative error that counts as none; of gaps the error itself [m, rad].

        Raises
        ------
        InvalidArgument
            If an argument has a wrong size, is not finite, or has an unnormalised quaternion.
        """
        from condyn_pin.study.mujoco.compare import cross_check

        return cross_check(self, q, v, tau, tolerance)

    def __reduce__(self) -> tuple[Any, ...]:
        return MujocoBridge, (self.robot, self.model, dict(self.names), self.without)

    def __repr__(self) -> str:
        held = f", {len(self.without)} held" if self.without else ""
        return f"MujocoBridge({self.robot.name!r}: {len(self.pairs)} joints{held})"

    def _configuration(self, q: ArrayLike) -> Array:
        q_ = finite_rows("q", q, self.robot.nq)
        for part in self.robot.arguments.units:
            check_units("q", q_[..., part], part)
        return q_

    def _held(self, data: Any) -> tuple[Array, Array]:
        import mujoco

        if not isinstance(data, mujoco.MjData):
            raise InvalidArgument(f"data = {type(data).__name__}: a mujoco.MjData is needed")
        qpos = finite("data.qpos", data.qpos, self.model.nq)
        return qpos, finite("data.qvel", data.qvel, self.model.nv)


# MuJoCo's terms in Pinocchio's coordinates.
#
# By qvel = X v (`velocity_map` has X) and the principle of virtual work,
#
#     M = X' M_mj X,    h = X' (h_mj + M_mj Xdot v),    tau_passive = X' qfrc_passive,
#     a = X' (qacc_smooth - Xdot v),    J = J_mj X.


# What would add rows beside equalities, and torques beside those given.
_OFF: Final = ("ACTUATION", "CONTACT", "LIMIT", "FRICTIONLOSS")


class LoopRows(NamedTuple):
    """A loop in one engine: its rows of J (m, nv), and its gap [m, rad]."""

    J: Array
    violation: ConstraintViolation


class MujocoTerms:
    """MuJoCo's terms at a state, in Pinocchio's coordinates; loops by the name of the equality."""

    def __init__(self, bridge: MujocoBridge, q: Array, v: Array, tau: Array) -> None:
        import mujoco

        self._bridge, self._state = bridge, (q, v)
        mj = copy.copy(bridge.model)
        for name in _OFF:
            mj.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
        mj.opt.enableflags = 0
        mj.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(mj)
        self.data.qpos[:], self.data.qvel[:] = bridge.to_mujoco(q, v)
        self.data.qfrc_applied[:] = bridge.torque_to_mujoco(q, tau)
        mujoco.mj_forward(mj, self.data)
        M = np.zeros((mj.nv, mj.nv))
        if int(mujoco.__version__.split(".")[0]) >= 4:
            mujoco.mj_fullM(mj, self.data, M)
        else:
            mujoco.mj_fullM(mj, M, self.data.qM)
        X = bridge.velocity_map(q)
        turning = bridge.acceleration_to_mujoco(q, v, np.zeros_like(v))  # Xdot v
        self.M: Array = X.T @ M @ X
        self.h: Array = X.T @ (self.data.qfrc_bias + M @ turning)
        self.passive: Array = X.T @ self.data.qfrc_passive
        self.loops: dict[str, LoopRows] = {}
        J = self.data.efc_J.reshape(-1, mj.nv) @ X
        equality = self.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        for k, tag in equalities_of(mj).items():
            here = equality & (self.data.efc_id == k)
            if here.any():
                name = mj.equality(k).name or f"{tag}{k}"
                gap = _gap(self.data.efc_pos[here], mj.eq_data[k, 10])
                self.loops[name] = LoopRows(J[here], gap)

    def acceleration(self, tau: Array) -> Array:
        """Return a without constraints; MuJoCo's own, unless joints are held that it would move."""
        if self._bridge.without:
            return np.asarray(np.linalg.solve(self.M, tau + self.passive - self.h), dtype=float)
        return self._bridge.acceleration_from_mujoco(*self._state, self.data.qacc_smooth)


def equalities_of(mj: Any) -> dict[int, str]:
    """Return the kinds of equalities that are like loops or couplings, by index."""
    import mujoco

    kinds = {"connect": mujoco.mjtEq.mjEQ_CONNECT, "weld": mujoco.mjtEq.mjEQ_WELD,
             "joint": mujoco.mjtEq.mjEQ_JOINT, "tendon": mujoco.mjtEq.mjEQ_TENDON}  # fmt: skip
    tags = {int(kind): tag for tag, kind in kinds.items()}
    return {k: tags[int(kind)] for k, kind in enumerate(mj.eq_type) if int(kind) in tags}


def _gap(rows: Array, torque_scale: float) -> ConstraintViolation:
    """Gap of an equality [m, rad]; the angular rows of a weld are scale sin(angle / 2)."""
    sine = float(np.linalg.norm(rows[3:])) / (torque_scale or 1.0)
    return ConstraintViolation(float(np.linalg.norm(rows[:3])), 2.0 * asin(min(sine, 1.0)))


# Joints of a robot and of a MuJoCo model, matched by name.
#
# A coordinate means the same in both if the joint has the same type, hangs on the same joint, and
# turns about, or slides along, the same axis. Whatever breaks that is refused by name: a state
# would be taken over into another motion without a word.


_BALLS: Final = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}


@dataclass(frozen=True)
class JointPair:
    """One joint in both engines."""

    name: str  # here
    here: int  # its index in Pinocchio's model
    there: int  # and in MuJoCo's
    kind: str  # free, ball, slide or hinge
    q: slice  # where it is in q
    v: slice  # and in v, a and tau
    qpos: slice  # where it is in MuJoCo's qpos
    dof: slice  # and in qvel, qacc and qfrc


def pairs_of(
    robot: Robot, mj: Any, names: Mapping[str, str], without: Sequence[str]
) -> tuple[JointPair, ...]:
    """Return the joints of a robot with those of MuJoCo, in the robot's order."""
    # Joints missing on either side, of another type or with another parent, are refused.
    known = joint_names(mj)
    there = _names_there(robot, known, names)
    left_out = checked_names("without", without, known, "joint of the MuJoCo model")
    spare = [n for n in known if n not in there.values() and n not in left_out]
    for name, other in there.items():
        if other not in known or other in left_out:
            raise InvalidModel(
                f"joint {name!r} of {robot.name} is not in the MuJoCo model, which has "
                f"{listed(spare) or 'no other joint'}; if it has another name there, say "
                f"names={{{name!r}: ...}}"
            )
    if spare:
        raise InvalidModel(
            f"the MuJoCo model has joints that {robot.name} lacks: {listed(spare)}; name them in "
            "without=[...], and they stay where they are"
        )
    paired = tuple(
        _pair(robot, mj, i, known.index(there[name])) for i, name in enumerate(robot.joints, 1)
    )
    _check_parents(robot, mj, paired, known)
    return paired


def _names_there(robot: Robot, known: list[str], names: Mapping[str, str]) -> dict[str, str]:
    """Return MuJoCo's names of the robot's joints."""
    check_type("names", names, Mapping, "a mapping of our names to MuJoCo's is needed")
    for name, other in names.items():
        if name not in robot.joints:
            raise unknown_name("joint", str(name), robot.joints)
        if other not in known:
            raise unknown_name("joint of the MuJoCo model", str(other), known)
    there = {name: names.get(name, name) for name in robot.joints}
    for name, other in there.items():
        if list(there.values()).count(other) > 1:
            raise InvalidArgument(f"names: {name!r} and another joint are both {other!r} in MuJoCo")
    return there


def _pair(robot: Robot, mj: Any, i: int, j: int) -> JointPair:
    joint, kind = robot.model.joints[i], KINDS[int(mj.jnt_type[j])]
    short = joint.shortname()
    ours = scalar_axis(robot.model, i)[0] if joint.nv == 1 else _BALLS.get(short, "")
    if ours != kind:
        raise InvalidModel(
            f"joint {robot.model.names[i]!r} is a {short} here and a {kind} in MuJoCo: their "
            "coordinates do not mean the same"
        )
    if kind == "free" and robot.model.parents[i] != 0:
        raise InvalidModel(
            f"joint {robot.model.names[i]!r} is a free-flyer on another joint here, and free of "
            "all others in MuJoCo"
        )
    at, dof = int(mj.jnt_qposadr[j]), int(mj.jnt_dofadr[j])
    return JointPair(
        name=str(robot.model.names[i]),
        here=i,
        there=j,
        kind=kind,
        q=slice(joint.idx_q, joint.idx_q + joint.nq),
        v=slice(joint.idx_v, joint.idx_v + joint.nv),
        qpos=slice(at, at + {"free": 7, "ball": 4}.get(kind, 1)),
        dof=slice(dof, dof + joint.nv),
    )


def _check_parents(robot: Robot, mj: Any, paired: Sequence[JointPair], known: list[str]) -> None:
    here = {pair.there: pair.here for pair in paired}
    for pair in paired:
        parent = carrier(mj, pair.there, here)
        if robot.model.parents[pair.here] != here.get(parent, 0):
            raise InvalidModel(
                f"joint {pair.name!r} hangs on {robot.model.names[robot.model.parents[pair.here]]} "
                f"here and on {known[parent] if parent >= 0 else 'the world'} in MuJoCo"
            )


def carrier(mj: Any, joint: int, among: Mapping[int, int]) -> int:
    """Return the joint that carries one of MuJoCo's, -1 for the world; held ones are skipped."""
    body, j = int(mj.jnt_bodyid[joint]), joint - 1
    if j >= int(mj.body_jntadr[body]):
        return j if j in among else carrier(mj, j, among)
    return last_moving_joint(mj, int(mj.body_parentid[body]), among)


def last_moving_joint(mj: Any, body: int, among: Mapping[int, int]) -> int:
    """Return the last joint that moves a body of MuJoCo, -1 if none of those given does."""
    while body:
        first, count = int(mj.body_jntadr[body]), int(mj.body_jntnum[body])
        for j in reversed(range(first, first + count)):
            if j in among:
                return j
        body = int(mj.body_parentid[body])
    return -1


def check_axes(robot: Robot, data: Any, paired: Sequence[JointPair], q: Array) -> None:
    """Refuse joint axes that differ at q, the configuration of MuJoCo's `data`."""
    placed = whole_data(robot.model)
    pin.forwardKinematics(robot.model, placed, q)
    for pair in paired:
        ours, theirs = axes(robot.model, placed, data, pair)
        if np.abs(ours - theirs).max() > tolerances.PARALLEL:
            what = "axis is" if pair.kind in ("hinge", "slide") else "frame has the axes"
            raise InvalidModel(
                f"joint {pair.name!r}: its {what} {_numbers(ours)} here and {_numbers(theirs)} in "
                "MuJoCo, in the world as the file draws the model: a coordinate does not mean the "
                "same motion"
            )


def axes(model: Any, placed: Any, data: Any, pair: JointPair) -> tuple[Array, Array]:
    """Return the axis of a joint in the world in both engines; of a ball, three."""
    R = placed.oMi[pair.here].rotation
    if pair.kind in ("hinge", "slide"):
        return R @ scalar_axis(model, pair.here)[1], np.array(data.xaxis[pair.there])
    theirs = data.xmat[data.model.jnt_bodyid[pair.there]]
    return np.array(R), np.array(theirs).reshape(3, 3)


def _numbers(values: Array) -> str:
    columns = np.atleast_2d(np.round(values.T, 4) + 0.0)  # no minus zero
    return ", ".join(f"({', '.join(f'{x:g}' for x in column)})" for column in columns)


def check_units(name: str, x: Array, part: slice) -> None:
    """Refuse quaternions, or (cos, sin), that are not of norm 1."""
    squared = np.atleast_1d((x * x).sum(axis=-1))
    wrong = squared[~((squared > LOW) & (squared < HIGH))]
    if wrong.size:
        order = "(w x y z)" if name == "qpos" else "(x y z w) or (cos, sin)"
        raise InvalidArgument(
            f"{name}[{part.start}:{part.stop}] has norm {sqrt(wrong.flat[0]):.9g}: a unit "
            f"quaternion {order} is needed; "
            + ("mujoco.mj_normalizeQuat" if name == "qpos" else "pin.normalize")
            + " makes one"
        )


# VelocityMap: X of qvel = X v, applied and never formed, at one state or at many.
#
# With R the rotation of a free body in the world, and the joints in the order of either,
#
#     X = diag(R, 1, 1, ...),    X' Xdot v = omega x v in the linear rows of a free joint, else 0.


class VelocityMap:
    """X of one robot, by its joints in both engines."""

    def __init__(self, model: Any, pairs: Sequence[JointPair]) -> None:
        self._model = model
        dofs = [dof for pair in pairs for dof in range(pair.dof.start, pair.dof.stop)]
        self._dofs = np.array(dofs, dtype=np.int_)
        self._free = tuple(pair for pair in pairs if pair.kind == "free")

    def spread(self, q: Array, x: Array, out: Array) -> Array:
        """Write X x into `out`, which keeps its entries for joints that the robot lacks."""
        out[..., self._dofs] = x
        for pair in self._free:
            linear = slice(pair.dof.start, pair.dof.start + 3)
            out[..., linear] = rotate_by_quaternion(self._orientation(q, pair), out[..., linear])
        return out

    def gather(self, q: Array, y: Array) -> Array:
        """Return X' y."""
        x: Array = np.take(y, self._dofs, axis=-1)
        for pair in self._free:
            linear = slice(pair.v.start, pair.v.start + 3)
            back = self._orientation(q, pair) * np.array([-1.0, -1.0, -1.0, 1.0])
            x[..., linear] = rotate_by_quaternion(back, x[..., linear])
        return x

    def turning(self, v: Array) -> Array:
        """Return X' Xdot v."""
        found = np.zeros_like(v)
        for pair in self._free:
            k = pair.v.start
            found[..., k : k + 3] = np.cross(v[..., k + 3 : k + 6], v[..., k : k + 3])
        return found

    def _orientation(self, q: Array, pair: JointPair) -> Array:
        """Return the quaternion x y z w of a free body in the world."""
        placement = self._model.jointPlacements[pair.here]
        return product(quaternion(placement.rotation), q[..., pair.q][..., 3:])


# Quaternions x y z w, one or many: the last axis is theirs


def reordered(x: Array, by: int) -> Array:
    """Return x with the quaternion at its end rolled: by 1 to w x y z, by -1 back."""
    n = x.shape[-1]
    return x[..., [*range(n - 4), *np.roll(range(n - 4, n), by)]]


def moved_pose(M: Any, pose: Array) -> Array:
    """Return M times a pose (x y z, quaternion x y z w)."""
    by = quaternion(M.rotation)
    # entry by entry, as all here: a product of matrices is rounded otherwise for many than for one
    position = rotate_by_quaternion(by, pose[..., :3]) + M.translation
    return np.concatenate((position, product(by, pose[..., 3:])), axis=-1)


def quaternion(rotation: Array) -> Array:
    """Return the quaternion of a rotation matrix."""
    return np.array(pin.Quaternion(rotation).coeffs())


def product(one: Array, two: Array) -> Array:
    """Return the product of quaternions x y z w."""
    a, b, s, t = one[..., :3], two[..., :3], one[..., 3:], two[..., 3:]
    vector = s * b + t * a + np.cross(a, b)
    return np.concatenate((vector, s * t - (a * b).sum(axis=-1, keepdims=True)), axis=-1)


def rotate_by_quaternion(quaternion: Array, x: Array) -> Array:
    """Return vectors turned by quaternions x y z w."""
    u, w = quaternion[..., :3], quaternion[..., 3:]
    twice = 2.0 * np.cross(u, x)
    return x + w * twice + np.cross(u, twice)
