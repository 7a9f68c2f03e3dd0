"""Actuation: on which joints motors act, and through which gears, differentials and cables.

With u the torques of the motors and w their speeds,

    tau = B u,    w = B^T v,

one column of B for each motor: its gear ratio in the row of its joint, or its weights in the rows
of several joints, and zero elsewhere.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_type, checked_names, count_text, listed
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import MinimumNorm
from condyn_pin._core.models import indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.places import FrameLike
from condyn_pin.control.tasks.task import entry_names
from condyn_pin.dynamics.at_state import at_state, frame_jacobian
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.mechanism.closed_chains import independent_columns, passive_joints
from condyn_pin.model.joints import CoupledMotor, check_coupled
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class Actuation:
    """The motors of a robot; a frozen value that can be pickled and compared.

    Parameters
    ----------
    robot : Robot
    joints : sequence of str or CoupledMotor, optional
        The joints with a motor of their own, and motors that act on several joints; by default
        ``robot.actuated`` and ``robot.coupled_motors``. A joint of several degrees of freedom has a
        motor for each of them.
    ratios : sequence of float or mapping of str to float, optional
        Turns of the motor for one turn of its joint, one number for each joint with a motor of its
        own or by name of the joint [1]; 1 where nothing is said. Of a motor that drives a slider
        through a screw, turns of the motor for a metre [rad/m].

    Raises
    ------
    UnknownName
        If there is no such joint; the text lists the nearest names.
    InvalidArgument
        If there is no motor at all, a ratio is zero, or two motors share a name.

    Notes
    -----
    More motors than joints, such as cables that pull against each other, are no trouble: B need not
    have full rank.

    A rotor of inertia I adds ratio^2 I to the inertia of its joint. Put that into the model, as
    ``armature`` of the joint: ratios do not change the mass matrix here.
    """

    robot: Robot
    joints: Sequence[str | CoupledMotor] | None = None
    ratios: Sequence[float] | Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(f"robot = {type(self.robot).__name__}: a Robot is needed")
        chosen = self.joints
        if chosen is None:
            chosen = (*self.robot.actuated, *self.robot.coupled_motors)
        motors = _motors(self.robot, chosen)
        if not motors:
            raise InvalidArgument(
                f"joints: {self.robot.name} names no joint with a motor; "
                "load_robot(..., actuated=[...]) or Actuation(robot, [...]) does"
            )
        own = [motor for motor in motors if isinstance(motor, str)]
        object.__setattr__(self, "joints", motors)
        object.__setattr__(self, "ratios", _ratios(own, self.ratios))
        for name, count in Counter(self.motors).items():
            if count > 1:
                raise InvalidArgument(
                    f"motors: two are named {name!r}, one of them for a coordinate of its joint; "
                    "rename the other"
                )

    @cached_property
    def B(self) -> Array:
        """The map (nv, k) from motor torques to joint torques."""
        B = np.zeros((self.robot.nv, len(self._each)))
        for k, motor in enumerate(self._each):
            B[[*motor.weights], k] = [*motor.weights.values()]
        B.flags.writeable = False
        return B

    @cached_property
    def motors(self) -> tuple[str, ...]:
        """A name for each motor: its own, or that of its joint, numbered if a joint has several."""
        return tuple(motor.name for motor in self._each)

    @cached_property
    def gears(self) -> Array:
        """The ratio of every motor, and the length of its column of B if it is coupled (k,)."""
        return np.array([motor.gear for motor in self._each])

    @cached_property
    def E(self) -> Array:
        """The map (nv, k) from torques behind the gears, t = gears u: columns of length 1."""
        return self.B / self.gears

    @cached_property
    def columns(self) -> NDArray[np.int_]:
        """Indices in v on which motors act, each once, in the order of the motors."""
        found = dict.fromkeys(i for motor in self._each for i in motor.weights)
        return np.array(list(found), dtype=np.int_)

    @cached_property
    def coupled(self) -> NDArray[np.int_]:
        """Indices of the motors that act on several joints."""
        return np.flatnonzero([motor.coupled for motor in self._each])

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """Least and largest torques of the motors (k,), without those of their joints [N m, N]."""
        least, largest = np.array([motor.limits for motor in self._each]).T
        return least, largest

    @cached_property
    def _each(self) -> tuple[_Motor, ...]:
        model = self.robot.model
        ratios: Iterator[float] = iter(self.ratios or ())  # type: ignore[arg-type]
        names = entry_names(model, np.arange(self.robot.nv))
        found: list[_Motor] = []
        for motor in self.joints or ():
            if isinstance(motor, str):
                ratio, joint = next(ratios), model.joints[model.getJointId(motor)]
                entries = range(joint.idx_v, joint.idx_v + joint.nv)
                found += [_Motor(names[i], {i: ratio}, ratio) for i in entries]
            else:
                at = indices(model, [*motor.weights])[1].tolist()
                weights = dict(zip(at, motor.weights.values(), strict=True))
                least, largest = motor.limits
                gear = float(np.linalg.norm([*weights.values()]))
                found.append(_Motor(motor.name, weights, gear, (least, largest), coupled=True))
        return tuple(found)


class _Motor(NamedTuple):
    """A motor, with its weights by index in v."""

    name: str
    weights: dict[int, float]
    gear: float
    limits: tuple[float, float] = (-inf, inf)
    coupled: bool = False


def _motors(robot: Robot, chosen: Any) -> tuple[str | CoupledMotor, ...]:
    """Names of joints, and motors that act on several, each once."""
    if isinstance(chosen, str) or not isinstance(chosen, Iterable):
        return checked_names("joints", chosen, robot.joints, "joint")  # which refuses it
    motors = [*chosen]
    coupled = [motor for motor in motors if isinstance(motor, CoupledMotor)]
    others = [motor for motor in motors if not isinstance(motor, CoupledMotor)]
    checked_names("joints", others, robot.joints, "joint")
    check_coupled(robot.model, [*dict.fromkeys(coupled)])
    return tuple(dict.fromkeys(motors))


def _ratios(
    joints: Sequence[str], ratios: Sequence[float] | Mapping[str, float] | None
) -> tuple[float, ...]:
    """Return one ratio for each joint."""
    if ratios is None:
        ratios = {}
    if isinstance(ratios, Mapping):
        for name in ratios:
            if name not in joints:
                raise unknown_name("joint with a motor", str(name), joints)
        ratios = [ratios.get(name, 1.0) for name in joints]
    if isinstance(ratios, str) or not isinstance(ratios, Iterable):
        raise InvalidArgument(f"ratios = {ratios!r}: numbers, or a mapping of joints, are needed")
    found = finite("ratios", list(ratios), len(joints))
    for name, ratio in zip(joints, found, strict=True):
        if ratio == 0.0:
            raise InvalidArgument(f"ratios: that of {name!r} is 0: such a motor drives nothing")
    return tuple(float(ratio) for ratio in found)


def motors_of(scene: Scene, actuation: Actuation | None) -> Actuation:
    """Return the motors that a caller chose, or those of the robot; they have to fit the scene."""
    check_scene(scene)
    if actuation is None:
        return Actuation(scene.robot)
    check_type("actuation", actuation, Actuation, "Actuation(robot, joints) is needed, or None")
    if actuation.robot is not scene.robot and actuation.robot.model != scene.robot.model:
        raise InvalidArgument(
            f"actuation: it is made for the model of {actuation.robot.name!r}, and the scene has "
            f"another of {scene.robot.name!r}; Actuation(scene.robot, ...) fits"
        )
    return actuation


# Transmission: what the motors see of the joints through the loops.
#
# With the columns of J split into motors A, dependent joints D and the rest, which stays at rest,
#
#     J_A v_A + J_D v_D = 0,      v = G w,      w the speeds of the motors,
#
# where a motor on several joints, e its column of E, is one more coordinate x and one more row,
# e^T v - x = 0,
#
# and equal power, tau . v = u . w, makes u = G^T tau the motor torques that do what tau does. Where
# motors move together only in some ways, because there are more of them than degrees of freedom, G
# keeps of w what fits: J G = 0 always, and u is the smallest of many.


@dataclass(frozen=True, eq=False, repr=False)
class Transmission:
    """The map between motors and joints at one configuration.

    v = G w,    u = G^T tau

    Attributes
    ----------
    G : (nv, k) array
        v = G w: velocities of all joints for speeds of the motors, gears included
        [1, m, 1/m].
    free : (nv, d) array
        Orthonormal basis of the motions that are left with the motors held [rad, m].
    conflicting : int
        Conditions among the motors themselves: more than zero if there are more motors than
        degrees of freedom, and at a dead point. Then G keeps of w the nearest that fits.
    at_rest : tuple of str
        Joints that neither motors nor constraints determine: they do not move in G. A spring is
        among them rather than another joint.
    actuation : Actuation
    scene : Scene
    q : (nq,) array
        Configuration [rad, m].
    """

    G: Array
    free: Array
    conflicting: int
    at_rest: tuple[str, ...]
    actuation: Actuation
    scene: Scene
    q: Array

    @property
    def undetermined(self) -> int:
        """Directions in which the robot can still move with the motors held."""
        return int(self.free.shape[1])

    def velocities(self, w: ArrayLike) -> Array:
        """Return v (nv,) for speeds w of the motors (k,)."""
        return np.asarray(self.G @ finite("w", w, self.G.shape[1]))

    def motor_torques(self, tau: ArrayLike) -> Array:
        """Return the motor torques (k,) that do what joint torques (nv,) do: G^T tau.

        What `tau` does along `free` no motor sees: ``free.T @ tau`` is that part.
        """
        return np.asarray(self.G.T @ finite("tau", tau, self.G.shape[0]))

    def joint_torques(self, u: ArrayLike, joints: Sequence[str]) -> Array:
        """Return the torques at some `joints` that do what motor torques u (k,) do.

        Raises
        ------
        InvalidArgument
            If these joints cannot: fewer than the motors drive, or in a dead point of them.
        """
        motors = finite("u", u, self.G.shape[1])
        names = checked_names("joints", joints, self.scene.robot.joints, "joint")
        rows = self.G[indices(self.scene.robot.model, names)[1]]
        # what conflicts among the motors cancels does nothing
        done = np.linalg.pinv(self.G, rcond=tolerances.RANK) @ self.G @ motors
        U, S, Vt = np.linalg.svd(rows, full_matrices=False)
        # what hardly moves with the motors cannot act on them
        kept = tolerances.RANK * np.linalg.norm(self.G) < S
        found: Array = U[:, kept] @ ((Vt[kept] @ done) / S[kept])
        missing = np.abs(rows.T @ found - done).max(initial=0.0)
        if missing > tolerances.SOLVED * np.abs(done).max(initial=0.0):
            raise InvalidArgument(
                f"joints {listed(names)}: torques there cannot do what the motors do, "
                f"{missing:.3g} N m is left at one of them; name as many joints as the motors "
                "drive, away from their dead points"
            )
        return found

    def jacobian(self, frame: FrameLike, *, held: Sequence[str] = ()) -> Array:
        """Return the Jacobian (6, k) of a frame from the motors: J_frame G.

        Linear velocity first [m/s, rad/s], of the origin of the frame, in the axes of the world.
        Rows along which the frame can move with the motors held are NaN: there no velocity belongs
        to those of the motors.

        Parameters
        ----------
        frame : str, (joint, pin.SE3) or pin.Frame
        held : sequence of str
            Joints of `at_rest` that do not move, such as springs or the base of a robot that stands
            nowhere: what they leave to the motors is determined.

        Raises
        ------
        InvalidArgument
            If a joint that is to be held is not at rest, or the frame is the world's.
        UnknownName
            If a name does not exist.
        """
        robot = self.scene.robot
        J = frame_jacobian(self.scene, self.q, frame)
        for joint in checked_names("held", held, robot.joints, "joint"):
            if joint not in self.at_rest:
                raise InvalidArgument(
                    f"held: {joint} is not at rest; those that can be held are "
                    f"{listed(self.at_rest) or 'none'}"
                )
        columns = indices(robot.model, held)[1]
        still = columns[~self.G[columns].any(axis=1)]  # of a ball perhaps its spin alone
        found = np.asarray(J @ self.G)
        _, S, Vt = np.linalg.svd(self.free[still])
        others = Vt[np.count_nonzero(S > tolerances.DEAD_POINT) :]  # that leave these at rest
        moves = np.linalg.norm(J @ self.free @ others.T, axis=1)
        found[moves > tolerances.DEAD_POINT * float(np.linalg.norm(J))] = np.nan
        return found

    def __repr__(self) -> str:
        return (
            f"Transmission({self.scene.robot.name}: {count_text(self.G.shape[1], 'motor')}, "
            f"{self.undetermined} undetermined, {self.conflicting} conflicting)"
        )


@one_blas_thread
def transmission(scene: Scene, q: ArrayLike, *, actuation: Actuation | None = None) -> Transmission:
    """Return the map between joint torques and motor torques through the loops.

    v = G w,    u = G^T tau

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.
    actuation : Actuation, optional
        The motors; those of the robot by default.

    Returns
    -------
    Transmission

    Raises
    ------
    InvalidArgument
        If `q` has a wrong size or is not finite, or the robot has no motors.

    Notes
    -----
    Statics and kinematics only; for inertial torques use `inverse_dynamics`. Cost O(n^3 + m^2 n).

    References
    ----------
    Merlet. Parallel Robots. Springer, 2006.
    """
    actuation = motors_of(scene, actuation)
    state = at_state(scene, q)
    J, A = _with_motors(state.terms.J, actuation)
    n, k, gears = scene.robot.nv, len(A), actuation.gears
    classes = passive_joints(scene.robot, A)
    passive = np.sort(np.concatenate(classes))
    least = tolerances.DEAD_POINT * float(np.linalg.norm(J))
    U, S, Vt = np.linalg.svd(J[:, passive])
    rank = int(np.count_nonzero(least < S))
    free = np.zeros((n, len(passive) - rank))
    free[passive] = Vt[rank:].T
    # the rows that no passive joint can satisfy are conditions on the motors
    J_A = J[:, A] / gears
    _, T, Wt = np.linalg.svd(U[:, rank:].T @ J_A)
    conflicting = int(np.count_nonzero(least / np.abs(gears).min() < T))
    fits = np.eye(k) - Wt[:conflicting].T @ Wt[:conflicting]
    D = independent_columns(J, classes)
    G = np.zeros((J.shape[1], k))
    G[A] = fits / gears[:, None]
    if len(D):
        G[D] = -np.linalg.lstsq(J[:, D], J_A @ fits, rcond=tolerances.DEAD_POINT)[0]
    held, model = np.setdiff1d(np.arange(n), [*A, *D]), scene.robot.model
    names = (name for name in scene.robot.joints if np.isin(indices(model, [name])[1], held).any())
    return Transmission(G[:n], free, conflicting, tuple(names), actuation, scene, state.q)


def _with_motors(J: Array, actuation: Actuation) -> tuple[Array, NDArray[np.int_]]:
    """Return J with coordinates and rows of motors on several joints, and the columns of motors."""
    # The speed of a motor is its gear times that of its column.
    coupled, (m, n) = actuation.coupled, J.shape
    A = actuation.E.argmax(axis=0)
    if not len(coupled):
        return J, A
    A[coupled] = np.arange(n, n + len(coupled))
    rows = np.hstack((actuation.E[:, coupled].T, -np.eye(len(coupled))))
    return np.vstack((np.hstack((J, np.zeros((m, len(coupled))))), rows)), A


# Drive: what motors and constraints can give together.
#
#     B u + J^T lam = f
#
# With M = L L^T and V an orthonormal basis of what the constraints block, L^-1 J^T = V S U^T, the
# forces lam drop out of
#
#     (I - V V^T) L^-1 B u = (I - V V^T) L^-1 f,
#
# which has many solutions where motors work against each other, and none where too few of them are
# there. Taken is, among all u that come nearest in the metric of M^-1, the smallest; lam follows
# from it, the smallest again where rows are redundant. What is then missing, r, leaves J M^-1 r =
# 0: the robot moves with a - M^-1 r, of all accelerations that the motors can give the nearest in
# the metric of M, and with the same lam.


# The second round takes out what rounding left in the first: on Cassie, Talos and Stewart's
# platform a factor of 5 to 30. A third gains nothing.
_ROUNDS = 2


class ActuationFactors:
    """The factors of [B J^T], from those of M and J.

    `rank` is that of (I - V V^T) L^-1 B, and `weakest` its smallest singular value within that
    rank, both relative to the size of L^-1 B.
    """

    def __init__(self, factors: MinimumNorm, J: Array, B: Array) -> None:
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg import solve_triangular

        self._of, self._J, self._B = factors, J, B
        self._Bw = solve_triangular(factors.L, B, lower=True)
        V = factors.V
        self._X, self._S, Yt = np.linalg.svd(self._Bw - V @ (V.T @ self._Bw))
        strengths = self._S / float(np.linalg.norm(self._Bw, 2))
        self.rank = int(np.count_nonzero(strengths > tolerances.RANK))
        self.weakest = float(strengths[self.rank - 1]) if self.rank else 1.0
        self._Y = Yt.T

    def share(self, required: Array) -> tuple[Array, Array, Array]:
        """Return u, lam, and what is missing of a generalised force (nv,)."""
        from scipy.linalg import solve_triangular

        X, S, Y = self._X[:, : self.rank], self._S[: self.rank], self._Y[:, : self.rank]
        u, lam = np.zeros(self._B.shape[1]), np.zeros(len(self._J))
        missing = required
        for _ in range(_ROUNDS):
            y = solve_triangular(self._of.L, missing, lower=True)
            du = Y @ ((X.T @ y) / S)
            u += du
            lam += self._through(y - self._Bw @ du)
            missing = required - self._B @ u - self._J.T @ lam
        return u, lam, missing

    def null_space(self) -> Array:
        """Return a basis (k + m, d) of the (u, lam) with B u + J^T lam = 0."""
        N = self._Y[:, self.rank :]
        redundant = self._of.U[:, self._of.rank :]
        zero = np.zeros((len(N), redundant.shape[1]))
        return np.block([[N, zero], [-self._through(self._Bw @ N), redundant]])

    def _through(self, y: Array) -> Array:
        """Return the smallest lam with V V^T y = L^-1 J^T lam, for one or many y."""
        of = self._of
        U, S = of.U[:, : of.rank], of.S[: of.rank]
        return np.asarray(U @ ((of.V.T @ y).T / S).T)
