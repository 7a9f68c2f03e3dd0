"""The verbs solve and derivatives: forward dynamics at one state, and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace

if TYPE_CHECKING:
    from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives

# A loop over `solve` with one scene, or with some in turn, builds a workspace for each.
_workspaces = ThreadCache[Workspace]()


def solve(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    accuracy: float | None = None,
    throw: bool = True,
) -> Solution:
    """Return accelerations and constraint forces at one state, with their errors.

    M(q) a + h(q, v) = tau + J(q)^T lam + sum J_f(q)^T f,    J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w, normalised.
    v : (nv,) array_like
        Velocity [rad/s, m/s]; the free-flyer's in its body frame, linear first.
    tau : 0 or (nv,) array_like
        Joint torques [N, N m]; zero in the rows of a free-flyer.
    forces : sequence of AppliedForce, optional
        Forces from outside, at frames of the robot; none by default.
    solver : Solver, optional
        `Proximal()` by default; for kinds of constraints that it cannot take, `DenseKKT()`, and
        `NullSpace()` if there are redundant rows besides.
    drift : Baumgarte, optional
        Baumgarte stabilisation: it gives a_ref, which is zero by default.
    accuracy : float, optional
        Error of a that is good enough, relative to the larger of |a|_inf and gravity: what the
        status is judged by. That of the solver by default: 1e-8, or what `tune` was asked for. It
        changes no number of the answer.
    throw : bool
        Raise if the status is not ok. With False the same Solution comes back, whatever its
        status.

    Returns
    -------
    Solution

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size, is not finite, or has an unnormalised quaternion.
    SolveFailed
        If the status is not ok; its `solution` has everything that was computed.
    StaleModel
        If the robot's model was edited since it was loaded.
    UnknownName
        If a force is on a frame that does not exist.
    UnsupportedConstraint
        If the solver cannot take a kind of constraint of the scene.

    Notes
    -----
    The first call with a scene builds a `Workspace`, which takes as long as dozens of solves; calls
    after it with the same scene and solver, in the same thread, use it again. Cost: that of the
    solver, which `condyn solvers` lists, and that of the three errors: together two to three times
    that of `Workspace.acceleration`, which is for hot loops and computes no errors.

    References
    ----------
    Carpentier, Budhiraja, Mansard. Proximal and sparse resolution of constrained dynamic equations.
    RSS, 2021; each solver names its own.
    """
    workspace = workspace_for(scene, solver, drift)
    return workspace.solve(q, v, tau, forces=forces, accuracy=accuracy, throw=throw)


def derivatives(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    method: str = "kkt",
    check: bool = False,
    accuracy: float | None = None,
) -> Derivatives:
    """Return the derivatives of accelerations and constraint forces by state and torques.

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv

    Parameters
    ----------
    scene : Scene
    q, v, tau : (nq,), (nv,), (nv,) array_like
        Configuration, velocity [rad/s, m/s] and joint torques [N m, N] or 0, as in `solve`.
    forces : sequence of AppliedForce, optional
        As in `solve`. Their components are constant; r_q has the change of J_f^T f with q.
    solver : Solver, optional
        As in `solve`, for the answer that is differentiated. With `Soft` the derivatives are those
        of its own equations, whatever its status.
    drift : Baumgarte, optional
        As in `solve`.
    method : {"kkt", "pinocchio", "differences"}
        ``kkt`` is exact for every kind of constraint, on the constraints and off them, and gives
        the derivative of the smallest lam where rows are redundant. ``pinocchio`` is Pinocchio's
        own, repaired, for `Proximal` and constraints of 3 and 6 rows; it refuses states off the
        constraints where rows are redundant. ``differences`` is slow, and where rows are redundant
        and loops closed its columns by q are those along the constraints: zero across.
    check : bool
        Compare with central differences, and raise if they disagree.
    accuracy : float, optional
        As in `solve`.

    Returns
    -------
    Derivatives
        `da_dq`, `da_dv`, `da_dtau`, `dlam_dq`, `dlam_dv`, `dlam_dtau`, with tangent columns, formed
        when they are asked for; `jvp` and `vjp` do without them.

    Raises
    ------
    DerivativesDisagree
        If `check` finds an entry that differs by more than 1e-6 of the largest of its matrix.
    SolveFailed, InvalidArgument
        As in `solve`.
    UnsupportedConstraint
        If ``pinocchio`` cannot be right for a constraint or a joint.

    Notes
    -----
    Cost O(n^3 + m^2 n) after a solve; `benchmarks/timings.py derivatives` measures it.

    Off the constraints they are those of the answer that `solve` gives, at its rank: of rows that
    are left out as redundant, N, what turns with them has its part,

        P J da = -P (s_q dq + s_v dv + dP s),    N^T dlam = N^T dP lam,    P = 1 - N N^T,

    with s = J a + gamma - a_ref, what no acceleration satisfies. On closed loops with J v = 0 that
    is 0, and along redundant rows dlam_dq holds for motions that keep the loops closed.

    References
    ----------
    Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
    """
    workspace = workspace_for(scene, solver, drift)
    return workspace.derivatives(
        q, v, tau, forces=forces, method=method, check=check, accuracy=accuracy
    )


def workspace_for(scene: Scene, solver: Solver | None, drift: Baumgarte | None) -> Workspace:
    """Return this thread's workspace for a scene: one of the last ones, or a new one."""
    workspace = _workspaces.of(  # a new one checks the scene
        scene, (solver, drift), lambda: Workspace(scene, solver, drift=drift, engine="auto")
    )
    workspace.check_unedited()
    return workspace
