"""Inverse dynamics: the motor torques of a motion.

    B u + J^T lam = M a + h - passive - sum J_f^T f,      J a + gamma = 0

Where motors work against each other there are many u, and of them the smallest is taken; where they
are too few, what comes nearest (`condyn_pin.control.drive`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.control.distribution.base import ForceDistribution
from condyn_pin.control.drive import Drive
from condyn_pin.control.inverse_answer import InverseDynamics
from condyn_pin.dynamics.at_state import State, at_state, load_on
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites
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
    wanted, missing = _needed(state, asked, extra)
    drive = Drive(factors, terms.J, actuation.B)
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


def _needed(state: State, asked: Array, extra: Array) -> tuple[Array, Array]:
    """Return the nearest a that the constraints allow, and M a + h - extra: what it takes."""
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
