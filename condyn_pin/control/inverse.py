"""Inverse dynamics, and operational space.

Inverse dynamics: the motor torques of a motion.

    B u + J^T lam = M a + h - passive - sum J_f^T f,      J a + gamma = 0

Where motors work against each other there are many u, and of them the smallest is taken; where they
are too few, what comes nearest (`condyn_pin.control.actuation`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import count_text, listed
from condyn_pin._core.arrays import Array, check_overflow, finite, in_column
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.constraints.places import FrameLike, frame_text
from condyn_pin.control.actuation import Actuation, ActuationFactors, motors_of
from condyn_pin.control.distribution import ForceDistribution
from condyn_pin.control.limits import TorqueLimits
from condyn_pin.dynamics.at_state import State, at_state, frame_jacobian, load_on
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites, pulling
from condyn_pin.errors import InvalidArgument


@one_blas_thread
def inverse_dynamics(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    *,
    actuation: Actuation | None = None,
    passive: ArrayLike | None = None,
    forces: Sequence[AppliedForce] = (),
    distribution: ForceDistribution | None = None,
) -> InverseDynamics:
    """Return the motor torques and constraint forces of a motion.

    B u + J^T lam = M a + h - passive - sum J_f^T f,    J a + gamma = 0

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array_like
        Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear first.
    a : (nv,) array_like
        The acceleration that is wanted [rad/s^2, m/s^2]. Where it breaks the constraints, the
        nearest one in the metric of M that keeps them is taken, and `projected` says how far that
        was.
    actuation : Actuation, optional
        The motors; those of the robot by default.
    passive : (nv,) array_like, optional
        Torques that act anyway [N m, N], such as ``robot.passive_torque(q, v)``; none by default.
    forces : sequence of AppliedForce, optional
        Forces from outside that act anyway; none by default.
    distribution : ForceDistribution, optional
        Which of all u and lam of this motion to take, such as ``LargestMargin(cones)``: no foot
        pulls or slips. By default those of the smallest u, wherever they are.

    Returns
    -------
    InverseDynamics
        ``solve(scene, q, v, answer.tau + passive, forces=forces)`` gives ``answer.a``, which is
        `a` wherever `a` keeps the constraints and the motors suffice.

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size or is not finite, or the robot has no motors.
    UnknownName
        If a force is on a frame that does not exist.
    Infeasible
        If a `distribution` is asked for, and the floor cannot give the motion.

    Notes
    -----
    Cost O(n^3 + m^2 n). If motors can work against each other, as with two feet on the ground, u is
    the solution with the smallest sum of squares of motor torques: gear ratios count, and the units
    of hinges and sliders are not distinguished. ``null_space`` gives all others.

    References
    ----------
    Aghili. A unified approach for inverse and direct dynamics of constrained multibody systems
    based on linear projection operator. IEEE Transactions on Robotics, 2005.
    """
    actuation = motors_of(scene, actuation)
    if not isinstance(distribution, ForceDistribution | None):
        raise InvalidArgument(
            f"distribution = {distribution!r}: one such as LargestMargin(cones) is needed, or None"
        )
    state = at_state(scene, q, v)
    terms, factors, n = state.terms, state.factors, scene.robot.nv
    asked = finite("a", a, n)
    extra = np.zeros(n) if passive is None else finite("passive", passive, n)
    applied = applied_forces(forces)
    if applied:
        extra = extra + load_on(scene, state.q, applied).torque
    wanted, missing = _nearest_allowed(state, asked, extra)
    drive = ActuationFactors(factors, terms.J, actuation.B)
    u, lam, residual = drive.share(missing)
    null_space = drive.null_space()
    if distribution is not None:
        u, lam = distribution.share(Sites(scene, state.q), u, lam, null_space)
    reached = wanted - factors.solve_mass(residual)
    return InverseDynamics(
        u=u,
        lam=lam,
        a=reached,
        residual=residual,
        projected=float(np.abs(terms.J @ asked + terms.gamma).max(initial=0.0)),
        rank=drive.rank,
        mobility=n - factors.rank,
        weakest=drive.weakest,
        null_space=null_space,
        actuation=actuation,
        scene=scene,
        q=state.q,
        applied=applied,
    )


def _nearest_allowed(state: State, asked: Array, extra: Array) -> tuple[Array, Array]:
    """Return the nearest a that the constraints allow, and its torques M a + h - extra."""
    terms = state.terms
    with np.errstate(all="ignore"):  # what overflows is refused
        wanted, _ = state.factors.solve(terms.M @ asked, -terms.gamma)
        missing = terms.M @ wanted + terms.h - extra
    check_overflow("a", asked, missing)
    return wanted, missing


@one_blas_thread
def gravity_compensation(
    scene: Scene,
    q: ArrayLike,
    *,
    actuation: Actuation | None = None,
    passive: ArrayLike | None = None,
    forces: Sequence[AppliedForce] = (),
    distribution: ForceDistribution | None = None,
) -> InverseDynamics:
    """Return the motor torques and constraint forces that hold a robot still.

    B u + J^T lam = g(q) - passive - sum J_f^T f

    The inverse dynamics at v = 0 and a = 0.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.
    actuation : Actuation, optional
    passive : (nv,) array_like, optional
        Torques that act anyway [N m, N], such as springs.
    forces : sequence of AppliedForce, optional
        Forces from outside that act anyway, such as a load in the hand.
    distribution : ForceDistribution, optional
        Which of all u and lam to take, as in `inverse_dynamics`.

    Returns
    -------
    InverseDynamics

    Raises
    ------
    InvalidArgument, Infeasible
        As `inverse_dynamics`.

    Notes
    -----
    Cost and source are those of `inverse_dynamics`.
    """
    actuation = motors_of(scene, actuation)  # which looks at the scene too
    still = np.zeros(scene.robot.nv)
    return inverse_dynamics(
        scene, q, still, still, actuation=actuation, passive=passive, forces=forces,
        distribution=distribution,
    )  # fmt: skip


# InverseDynamics: motor torques and constraint forces that produce a motion.


# Torques are large where motors drive a direction this much more weakly than their strongest.
_WEAK = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class InverseDynamics:
    """Motor torques and constraint forces that produce a motion.

    B u + J^T lam = M a + h - passive - sum J_f^T f

    Attributes
    ----------
    u : (k,) array
        Torques of the motors [N m, N], the smallest that do, of least sum of squares, or those that
        a `ForceDistribution` chose.
    lam : (m,) array
        Constraint forces, all rows, in the axes of each constraint [N, N m].
    a : (nv,) array
        The acceleration that results: the one asked for if the constraints allow it and the motors
        can make it, else the nearest in the metric of M.
    residual : (nv,) array
        Generalised force that is missing for the motion [N m, N], M a_wanted + h - passive -
        sum J_f^T f - B u - J^T lam with a_wanted the nearest that the constraints allow.
    projected : float
        max abs(J a + gamma) of the acceleration asked for [m/s^2, rad/s^2]: how far it is from
        what the constraints allow.
    rank : int
        Independent directions in which the motors drive the robot.
    mobility : int
        Directions that the constraints leave, nv minus their rank at q.
    weakest : float
        Of the directions that the motors drive, how weakly the weakest is driven: its singular
        value over the largest of L^-1 B [1]; 1 if they drive none.
    null_space : (k + m, d) array
        Internal forces: a basis of (u, lam) with B u + J^T lam = 0 [N m, N]. First the ways in
        which motors work against each other through the constraints, with orthonormal u; then
        forces of redundant rows alone.
    actuation : Actuation
    scene : Scene
    q : (nq,) array
        Configuration [rad, m].
    applied : tuple of AppliedForce
        The forces from outside that were applied.
    """

    u: Array
    lam: Array
    a: Array
    residual: Array
    projected: float  # [m/s^2, rad/s^2]
    rank: int
    mobility: int
    weakest: float
    null_space: Array
    actuation: Actuation
    scene: Scene
    q: Array
    applied: tuple[AppliedForce, ...] = ()

    @property
    def tau(self) -> Array:
        """B u (nv,): the joint torques that the motors give [N m, N], for `solve`."""
        return np.asarray(self.actuation.B @ self.u)

    @property
    def torques(self) -> dict[str, float]:
        """The torques of the motors by name [N m, N]."""
        return dict(zip(self.actuation.motors, self.u.tolist(), strict=True))

    @property
    def fully_actuated(self) -> bool:
        """True if the motors can make every motion that the constraints allow."""
        return self.rank == self.mobility

    @property
    def forces(self) -> dict[str, ConstraintForce]:
        """The constraint forces by name, as those of a `Solution`."""
        return self._sites.forces(self.lam)

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices, a sentence each."""
        said = []
        floor = max(float(np.abs(self.a).max()), 1.0)
        if self.projected > tolerances.SOLVED * floor:
            said.append(
                f"the acceleration asked for breaks the constraints by {self.projected:.3g} m/s^2 "
                "or rad/s^2: the nearest that keeps them was taken"
            )
        missing = float(np.abs(self.residual).max())
        if missing > tolerances.SOLVED * max(float(np.abs(self.tau).max()), 1.0):
            said.append(
                f"the motors drive {self.rank} of {self.mobility} degrees of freedom: up to "
                f"{missing:.3g} N or N m are missing, and `a` is what comes out"
            )
        if self.weakest < _WEAK:
            said.append(
                f"the motors drive one direction {1 / self.weakest:.0f} times more weakly than "
                "another: the configuration is nearly singular, and torques are large"
            )
        return (*said, *self._beyond_limits(), *pulling(self.forces, self._sites))

    def _beyond_limits(self) -> Iterator[str]:
        """Sentence on the torques that are outside the limits of their motors."""
        names, L, least, most = TorqueLimits.of(self.actuation)
        torques = L @ (self.actuation.gears * self.u)
        rounding = tolerances.SOLVED * np.abs(torques).max(initial=0.0)
        each = zip(names, torques.tolist(), least.tolist(), most.tolist(), strict=True)
        if outside := [
            f"{name}: {x:.4g} N or N m, where it gives {low:g} to {high:g}"
            for name, x, low, high in each
            if not low - rounding <= x <= high + rounding
        ]:
            yield f"{listed(outside)}; Controller keeps to the limits of motors"

    @cached_property
    def _sites(self) -> Sites:
        return Sites(self.scene, self.q)

    def __repr__(self) -> str:
        motors, missing = count_text(len(self.u), "motor"), np.abs(self.residual).max()
        return (
            f"InverseDynamics({self.scene.robot.name}: {motors} for {self.rank} of {self.mobility} "
            f"degrees of freedom, missing {missing:.1e})"
        )

    def __str__(self) -> str:
        lines = [repr(self), "torques of the motors [N m, N]:"]
        lines += [f"{name:<28} {text}" for name, text in in_column(self.torques)]
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# Operational space: what a frame of the constrained robot feels like.
#
# With M = L L^T, V an orthonormal basis of what the constraints block (L^-1 J^T = V S U^T), and
#
#     W = L^-T (I - V V^T) L^-1          the inverse of M along the constraints,
#     Lambda = (J_t W J_t^T)^+,          J_bar = W J_t^T Lambda,
#
# a force f at the frame gives J_t a = Lambda^+ f more: Lambda is the inertia that it meets there. N
# = I - J_bar J_t keeps of a velocity what the task does not see; N^T keeps of joint torques what
# gives the task no acceleration.


Task = Literal["pose", "position"]


@dataclass(frozen=True, eq=False, repr=False)
class OperationalSpace:
    """The dynamics of one frame under the constraints of a scene.

    Lambda = (J W J^T)^+,    J_bar = W J^T Lambda,    N = I - J_bar J

    with W the inverse inertia that the constraints leave.

    Attributes
    ----------
    J : (r, nv) array
        Jacobian of the frame, r = 6 for a pose and 3 for a position: linear first, in the axes of
        the world.
    Lambda : (r, r) array
        Inertia [kg, kg m, kg m^2]; zero in directions that the constraints or the joints block.
    Lambda_inverse : (r, r) array
        J W J^T [1/kg, 1/(kg m), 1/(kg m^2)], of which Lambda is the pseudo-inverse.
    J_bar : (nv, r) array
        The dynamically consistent inverse of J: the joint motion of least kinetic energy [1, 1/m].
    N : (nv, nv) array
        Projector onto motions that the task does not see [1, m, 1/m].
    rank : int
        Directions of the frame that constraints and joints leave.
    delassus : (m, m) array
        G = J_c M^-1 J_c^T of the constraints themselves [1/kg], J_c their Jacobian.
    delassus_inverse : (m, m) array
        Its inverse, the pseudo-inverse where rows are redundant [kg]: the inertia that holds the
        constraints against a push.
    scene : Scene
    frame : str
        Name of a frame of the robot.
    """

    J: Array
    Lambda: Array
    Lambda_inverse: Array
    J_bar: Array
    N: Array
    rank: int
    delassus: Array
    delassus_inverse: Array
    scene: Scene
    frame: str

    def __repr__(self) -> str:
        return (
            f"OperationalSpace({self.scene.robot.name}, {self.frame}: "
            f"{self.rank} of {len(self.J)} directions free)"
        )


@one_blas_thread
def operational_space(
    scene: Scene, q: ArrayLike, frame: FrameLike, *, task: Task = "pose"
) -> OperationalSpace:
    """Return inertia, inverse and null space of a frame under the constraints.

    Lambda = (J_t W J_t^T)^+,    J_bar = W J_t^T Lambda,    N = I - J_bar J_t

    Parameters
    ----------
    scene : Scene
        Redundant rows are no trouble.
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.
    frame : str, (joint, pin.SE3) or pin.Frame
        A frame of the robot, as in `Robot.frame`.
    task : {"pose", "position"}
        Six rows, or the three of the origin.

    Returns
    -------
    OperationalSpace

    Raises
    ------
    UnknownName
        If there is no such frame; the text lists the nearest names.
    InvalidArgument
        If the frame belongs to the world, or `q` has a wrong size or is not finite.

    Notes
    -----
    Cost O(n^3 + m^2 n).

    References
    ----------
    Khatib. A unified approach for motion and force control of robot manipulators: the operational
    space formulation. IEEE Journal on Robotics and Automation, 1987.
    """
    from scipy.linalg import solve_triangular

    if task not in get_args(Task):
        raise InvalidArgument(f"task = {task!r}: one of {', '.join(get_args(Task))} is needed")
    state = at_state(scene, q)
    factors = state.factors
    L, V = factors.L, factors.V
    U_c, S_c = factors.U[:, : factors.rank], factors.S[: factors.rank]
    J = frame_jacobian(scene, state.q, frame)[: 6 if task == "pose" else 3]
    Jw = solve_triangular(L, J.T, lower=True).T
    X, S, Yt = np.linalg.svd(Jw - (Jw @ V) @ V.T, full_matrices=False)
    rank = int(np.count_nonzero(tolerances.RANK * np.linalg.norm(Jw, 2) < S))
    kept, S, Y = X[:, :rank], S[:rank], Yt[:rank].T
    J_bar = solve_triangular(L, Y / S, lower=True, trans="T") @ kept.T
    return OperationalSpace(
        J=J,
        Lambda=(kept / S**2) @ kept.T,
        Lambda_inverse=(kept * S**2) @ kept.T,
        J_bar=J_bar,
        N=np.eye(scene.robot.nv) - J_bar @ J,
        rank=rank,
        delassus=(U_c * S_c**2) @ U_c.T,
        delassus_inverse=(U_c / S_c**2) @ U_c.T,
        scene=scene,
        frame=frame_text("frame", frame),
    )
