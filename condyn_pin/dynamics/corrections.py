"""What is done to an answer of Pinocchio's own before it is one of the scene's equations.

Refinement. The residuals of an answer are solved for with the factor that it came from:

    [ -mu 1  J ] [ -dlam ]     [ s ]
    [  J^T   M ] [   da  ] = - [ r ],     r = M a + h - tau - J^T lam,   s = J a + gamma - a_ref

They are recomputed by Newton-Euler and forward kinematics. So the damping mu and what the factor
lost to rounding are both made up for; each correction leaves a share mu / (sigma + mu).

Open loops. Rows that are redundant where the loops are closed look independent beside that, and
Pinocchio's iteration believes them. With N the combinations that are left out at the precision of
the state (`condyn_pin.constraints.rows.redundancy`), P = 1 - N N^T, and its answer (a, l),

    U^T G U eta = U^T (a_ref - gamma - J a + G l),    U U^T = P,
    lam = U eta,      a <- a + M^-1 J^T (lam - l),

all from the factor that is there: G = J M^-1 J^T without its damping, and M^-1 J^T y with
K [y'; M^-1 J^T y] = [(G + mu) y; 0]. On closed loops whose J v is not 0 the rows contradict each
other along N: a does not change, and lam keeps P l.

Approximated kinds. A hinge as two points and a planar pin as a ball are exact where the loop is
closed. Where it is open by a gap g, or J v is not 0, their J and gamma differ by about g omega. Hot
loops have the answer of these rows, which is that of the closed machine to the first order as well;
`solve` has that of the scene's own rows (`NullSpace`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.mass_factor import lapack
from condyn_pin._core.quietly import quietly
from condyn_pin.dynamics.solvers.base import BoundSolver, Singular
from condyn_pin.dynamics.solvers.null_space import NullSpace

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import Redundancy
    from condyn_pin.dynamics.workspace import Workspace

# Squares of violations [m] and velocities [m/s] from which on a loop counts as open.
OPEN_SQUARED: Final = tolerances.OPEN**2

# Velocity of rows from which on hot loops have the scene's own rows [m/s, rad/s]: what points in
# place of a hinge differ by is as small as that. Stages of a step have one field and no limit.
SLIPPING: Final = 1e-4


class Refinement:
    """Corrections by the factor that `pin.constraintDynamics` leaves behind.

    `lam` are the forces of the rows that Pinocchio has, after the last correction.
    """

    def __init__(self, workspace: Workspace, times: int) -> None:
        self._workspace, self._times = workspace, times
        self._cholesky = _pin.constraint_cholesky(workspace.data)
        self.lam: Array = np.zeros(0)

    def correct(self, q: Array, v: Array, tau: Array, a: Array, lam: Array) -> Array:
        """Return a (nv,) after the corrections, from a and the forces of Pinocchio's rows."""
        workspace, m = self._workspace, len(lam)
        residuals = workspace.equations.residuals
        for _ in range(self._times):
            r, s = residuals(q, v, tau, a, workspace.scene_forces(lam))
            rows = workspace.pinocchio_velocity(s)
            steps = self._cholesky.solve(np.concatenate([rows, r])).ravel()
            a = a - steps[m:]
            lam = lam + steps[:m]
        self.lam = lam
        return a


def consistent_where_open(workspace: Workspace, closed: BoundSolver) -> BoundSolver:
    """A method that leaves out redundant rows where loops are open, from one that does not.

    Open loops are solved by `NullSpace`. Where J v is not 0, forces lose what moves nothing.
    """
    exact = cache(lambda: NullSpace(tolerances.REFERENCE_RANK).start(workspace))
    rounded = workspace.scene.nominal.rounded_file is not None
    method, moving_at = closed, np.zeros(0)
    open_by = quietly(workspace.equations.open_by)  # of numbers that are none the status says it

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method, moving_at
        gap, rate = open_by(q, v)
        method = exact() if rounded or gap > tolerances.OPEN else closed
        moving_at = q.copy() if method is closed and rate > tolerances.OPEN else np.zeros(0)
        return method.acceleration(q, v, tau)

    @quietly
    def lam() -> Array:
        lam = method.lam()
        if not moving_at.size:
            return lam
        J = workspace.equations.jacobian(moving_at)
        return workspace.scene.nominal.redundancy.left_out(J, np.zeros(len(lam))).kept(lam)

    return BoundSolver(acceleration, lam, lambda: method.iterations())


def without_idle_rows(method: BoundSolver, idle: NDArray[np.bool_]) -> BoundSolver:
    """A method without forces along rows that are zero at every configuration.

    Where J v is not 0 such a row may miss a gamma that no acceleration meets, and damping makes a
    force of it.
    """

    def lam() -> Array:
        found = method.lam()
        found[idle] = 0.0
        return found

    exact = method.exact and without_idle_rows(method.exact, idle)
    return replace(method, lam=lam, exact=exact)


def exact_where_slipping(workspace: Workspace, method: BoundSolver) -> BoundSolver:
    """A method with the scene's own rows where J v is far from 0, and Pinocchio's differ by it."""
    return replace(exact_where_open(workspace, method, slips=True), open_rows=method.open_rows)


def exact_where_open(workspace: Workspace, closed: BoundSolver, slips: bool = False) -> BoundSolver:
    """A method with the scene's own rows where Pinocchio's, which stand for them, differ.

    With `slips`, only where rows slip by more than SLIPPING, whatever is open.
    """
    dense: list[BoundSolver] = []  # started at the first state that needs it
    method = closed
    views = _gaps(workspace, slips)
    run, squares = closed.acceleration, [(gap.dot, gap) for gap in views]
    least = -1.0 if workspace.scene.nominal.rounded_file else OPEN_SQUARED
    least = SLIPPING**2 if slips else least
    rows = closed.open_rows

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method
        a = run(q, v, tau)
        if rows and rows.held:
            method = closed
            return a
        for square, gap in squares:
            if square(gap) > least:
                if not dense:
                    dense.append(NullSpace(tolerances.REFERENCE_RANK).start(workspace))
                method = dense[0]
                return method.acceleration(q, v, tau)
        method = closed
        return a

    return BoundSolver(acceleration, lambda: method.lam(), lambda: method.iterations())


def _gaps(workspace: Workspace, slips: bool = False) -> list[Array]:
    """Views of c and J v in Pinocchio's memory, of the rows that stand for others."""
    gaps = []
    pairs = zip(
        workspace.pinocchio_constraints.constraints, workspace.constraint_datas, strict=True
    )
    for native, data in pairs:
        if not native.approximates:
            continue
        if native.anchored and not slips:
            gaps.append(data.contact_placement_error.vector[: native.size])
        gaps.append(data.contact_velocity_error.vector[: native.size])
    return gaps


class _Open(NamedTuple):
    """An open state, in rows of Pinocchio's."""

    J: Array  # (m, nv)
    c: Array  # (m,)
    U: Array  # (m, rank), orthonormal combinations that are kept
    G: Array  # (m, m), J M^-1 J^T
    R: Array  # (rank, rank), U^T G U = R^T R
    mu: float  # that the factor has on the diagonal of G [1/kg]


class OpenRows:
    """The rows that are kept at open states, solved by the factor of `pin.constraintDynamics`.

    Attributes
    ----------
    gaps : list of pairs
        c of each constraint that has a position, with its own product: views of Pinocchio's memory.
    is_open : bool
        The last answer is that of kept rows; who has another sets it back.
    held : bool
        The rows that the next open state keeps are those of all after it: on closed loops every
        choice of independent rows is the same field, and beside them a smooth one, so that the
        stages of a step keep their order. Whoever sets it takes it back behind the step.
    always_open : bool
        Digits of the file hide which rows are redundant, on closed loops too.
    """

    _last: _Open

    def __init__(self, workspace: Workspace) -> None:
        natives, nominal = workspace.pinocchio_constraints, workspace.scene.nominal
        models, datas = workspace.constraint_models, workspace.constraint_datas
        self._workspace, self._nominal = workspace, nominal
        self._data, self._cholesky = workspace.data, _pin.constraint_cholesky(workspace.data)
        self._jacobian = _pin.placed_jacobian(workspace.model, workspace.data, models, datas)
        self.gaps: list[tuple[Callable[[Array], float], Array]] = []
        self._moving: list[Array] = []
        self._c: list[Array] = []
        for native, data in zip(natives.constraints, datas, strict=True):
            gap = data.contact_placement_error.vector[: native.size]
            if native.anchored:
                self.gaps.append((gap.dot, gap))
            self._c.append(gap if native.anchored else np.zeros(native.size))
            self._moving.append(data.contact_velocity_error.vector[: native.size])
        self._m = sum(map(len, self._c))
        self._right = np.zeros((self._m + workspace.model.nv, 2), order="F")
        self._lam = np.zeros(0)
        self._U: Array | None = None
        self.is_open = self._held = False
        self.always_open = nominal.rounded_file is not None

    @property
    def held(self) -> bool:
        """The same rows are kept at all states."""
        return self._held

    @held.setter
    def held(self, value: bool) -> None:
        self._held, self._U = value, None

    @cached_property
    def _of_natives(self) -> Redundancy:
        """The redundancy of Pinocchio's rows."""
        to_scene, found = self._workspace.pinocchio_constraints.to_scene, self._nominal.redundancy
        if to_scene is None:
            return found
        # s' = E s: a row of Pinocchio's is as large as the scales of the rows that it is made of
        sizes = (np.abs(to_scene.T) / found.R).max(axis=1)
        return replace(found, R=1.0 / np.where(sizes > 0.0, sizes, sizes.max()))

    @cached_property
    def _from_natives(self) -> Array | None:
        """E^+ (m, m'): rows of the scene from Pinocchio's; None where they are the same."""
        to_scene = self._workspace.pinocchio_constraints.to_scene
        return None if to_scene is None else np.asarray(np.linalg.pinv(to_scene.T))

    def answer(self, a: Array, mu: float) -> Array:
        """Accelerations a (nv,) with the kept rows, from those with all, damped by mu [1/kg]."""
        m = self._m
        J, c, U = self._jacobian(), np.concatenate(self._c), self._U
        if U is None:
            U = self._of_natives.kept_basis(J, c)
            self._U = U if self._held else None
        G = self._cholesky.getInverseOperationalSpaceInertiaMatrix()
        G.flat[:: m + 1] -= mu
        R, info = lapack().dpotrf(U.T.dot(G).dot(U), 0, 0)
        if info:
            raise Singular
        self._last, self.is_open = _Open(J, c, U, G, R, mu), True
        wanted = self._data.primal_rhs_contact[:m]
        a, self._lam = self._kept(a, self._data.lambda_c, wanted)
        return a

    def closing_moves(self, gaps: Array) -> Array:
        """Moves (nv, 2) that close two gaps (m, 2) along the rows kept in the last answer."""
        _, _, U, G, R, mu = self._last
        x = U.dot(lapack().dpotrs(R, U.T.dot(gaps))[0])
        self._right[: self._m] = G.dot(x) + mu * x
        return np.asarray(self._cholesky.solve(self._right)[self._m :])

    def refined(self, q: Array, v: Array, tau: Array, a: Array) -> Array:
        """Accelerations a (nv,) of an open state after a correction by recomputed residuals."""
        workspace, m = self._workspace, self._m
        r, s = workspace.equations.residuals(q, v, tau, a, self.forces())
        s = workspace.pinocchio_velocity(s)
        steps = self._cholesky.solve(np.concatenate([s, r])).ravel()
        da, dlam = self._kept(-steps[m:], steps[:m], -s)
        self._lam = self._lam + dlam
        return a + da

    def _kept(self, a: Array, lam: Array, wanted: Array) -> tuple[Array, Array]:
        """(a, lam) with P (J a - wanted) = 0 and N^T lam = 0, from what the damped factor gave."""
        J, _, U, G, R, mu = self._last
        missing = wanted - J.dot(a) + G.dot(lam)
        kept = U.dot(lapack().dpotrs(R, U.T.dot(missing))[0].ravel())
        x = kept - lam
        self._right[: self._m, 0] = G.dot(x) + mu * x
        return a + self._cholesky.solve(self._right[:, 0]).ravel()[self._m :], kept

    def forces(self, lam: Array | None = None) -> Array:
        """Forces (m,) of the scene's rows, without a part that moves nothing.

        `lam` are those of Pinocchio's rows on closed loops, by default of its last answer.
        """
        if self.is_open:
            return self._smallest(self._last.J, self._last.c, self._lam)
        lam = self._data.lambda_c.copy() if lam is None else lam
        if self._from_natives is None and not any(
            rate.dot(rate) > OPEN_SQUARED for rate in self._moving
        ):
            return lam
        return self._smallest(self._jacobian(), np.zeros(len(lam)), lam)

    def _smallest(self, J: Array, c: Array, lam: Array) -> Array:
        """Forces (m,) of the scene's rows, the smallest, from those of Pinocchio's."""
        back, left = self._from_natives, self._nominal.redundancy.left_out
        if back is None:
            return left(J, c).kept(lam)
        return left(back.dot(J), back.dot(c)).kept(self._workspace.scene_forces(lam))
