"""Operational space: what a frame of the constrained robot feels like.

With M = L L^T, V an orthonormal basis of what the constraints block (L^-1 J^T = V S U^T), and

    W = L^-T (I - V V^T) L^-1          the inverse of M along the constraints,
    Lambda = (J_t W J_t^T)^+,          J_bar = W J_t^T Lambda,

a force f at the frame gives J_t a = Lambda^+ f more: Lambda is the inertia that it meets there.
N = I - J_bar J_t keeps of a velocity what the task does not see; N^T keeps of joint torques what
gives the task no acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.dynamics.at_state import at_state, frame_jacobian
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

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
    scene: Scene, q: ArrayLike, frame: str, *, task: Task = "pose"
) -> OperationalSpace:
    """Return inertia, inverse and null space of a frame under the constraints.

    Lambda = (J_t W J_t^T)^+,    J_bar = W J_t^T Lambda,    N = I - J_bar J_t

    Parameters
    ----------
    scene : Scene
        Redundant rows are no trouble.
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.
    frame : str
        Name of a frame of the robot.
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
        frame=frame,
    )
