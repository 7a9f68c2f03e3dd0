"""Transmission: what the motors see of the joints through the loops.

With the columns of J split into motors A, dependent joints D and the rest, which stays at rest,

    J_A v_A + J_D v_D = 0,      v = G w,      w the speeds of the motors,

and equal power, tau . v = u . w, makes u = G^T tau the motor torques that do what tau does. Where
motors move together only in some ways, because there are more of them than degrees of freedom, G
keeps of w what fits: J G = 0 always, and u is the smallest of many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import checked, counted, listed
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.joints import indices
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.dynamics.at_state import at_state, frame_jacobian
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.closed_chains import independent_columns, passive_joints


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
        names = checked("joints", joints, self.scene.robot.joints, "joint")
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

    def jacobian(self, frame: str, *, held: Sequence[str] = ()) -> Array:
        """Return the Jacobian (6, k) of a frame from the motors: J_frame G.

        Linear velocity first [m/s, rad/s], of the origin of the frame, in the axes of the world.
        Rows along which the frame can move with the motors held are NaN: there no velocity belongs
        to those of the motors.

        Parameters
        ----------
        frame : str
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
        for joint in checked("held", held, robot.joints, "joint"):
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
            f"Transmission({self.scene.robot.name}: {counted(self.G.shape[1], 'motor')}, "
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
    J, A, gears = state.terms.J, actuation.columns, actuation.gears
    n, k = scene.robot.nv, len(A)
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
    G = np.zeros((n, k))
    G[A] = fits / gears[:, None]
    if len(D):
        G[D] = -np.linalg.lstsq(J[:, D], J_A @ fits, rcond=tolerances.DEAD_POINT)[0]
    held, model = np.setdiff1d(np.arange(n), [*A, *D]), scene.robot.model
    names = (name for name in scene.robot.joints if np.isin(indices(model, [name])[1], held).any())
    return Transmission(G, free, conflicting, tuple(names), actuation, scene, state.q)
