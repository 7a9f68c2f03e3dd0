"""MujocoBridge: a state of Pinocchio in MuJoCo's numbers, and back.

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, finite, finite_rows
from condyn_pin.errors import InvalidArgument
from condyn_pin.io.mjcf_file import require_mujoco
from condyn_pin.model.robot import Robot
from condyn_pin.study.mujoco.pairs import Pair, check_axes, check_units, pairs_of
from condyn_pin.study.mujoco.velocity_map import VelocityMap, moved, reordered

if TYPE_CHECKING:
    from condyn_pin.study.mujoco.cross_check import CrossCheck


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
    def pairs(self) -> tuple[Pair, ...]:
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
                x = moved(self.robot.model.jointPlacements[pair.here], x)
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
                x = moved(self.robot.model.jointPlacements[pair.here].inverse(), x)
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
        from condyn_pin.study.mujoco.comparing import cross_check

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
