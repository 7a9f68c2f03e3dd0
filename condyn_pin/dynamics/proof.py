"""The proof of an answer, and what corrects it.

Verifier: what a method returned becomes a Solution, with its proof and its status.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from math import hypot, inf, isfinite, nan
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arguments import State
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.linalg import factorise
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import Load
from condyn_pin.constraints.rows.bound import ConstraintViolation, largest_torque, largest_violation
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import changed_by_closing, gaps
from condyn_pin.dynamics.residuals import ErrorEstimator, Residuals
from condyn_pin.dynamics.solution import Question, Solution, Status
from condyn_pin.dynamics.solvers.null_space import NullSpace
from condyn_pin.dynamics.solvers.solver import BoundSolver
from condyn_pin.errors import InvalidModel, SolveFailed
from condyn_pin.model.soundness import massless_motion

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import RedundantRows
    from condyn_pin.dynamics.workspace import Workspace


_OK = Status.OK

# Methods that may do where another one has failed.
_OTHERS: Final = {
    Status.INACCURATE: ("reference",),
    Status.SINGULAR: ("proximal", "nullspace"),
    Status.NOT_FINITE: ("proximal", "reference"),
}


class Verifier:
    """Verification of the answers of one method in one workspace."""

    def __init__(self, workspace: Workspace, method: BoundSolver) -> None:
        self._workspace, self._method = workspace, method
        self._scene = workspace.scene
        nominal = workspace.scene.nominal
        self._estimator, self._pivots = nominal.estimator, nominal.pivots
        # gaps and velocities of rows from which on a state is off its constraints
        exact = workspace.scene.robot.precision == 0.0
        self._open = inf if exact else tolerances.OPEN
        self._moving = self._open if nominal.dependent else inf
        self._closed: Equations | None = None  # made at the first state in doubt
        self._rounded = nominal.rounded_file is not None

    def verify(
        self, state: State, a: Array, accuracy: float, solve_time: float, load: Load | None
    ) -> Solution:
        """Return the solution of a method that returned `a` just now."""
        q, v, tau = state
        equations, estimator = self._workspace.equations, self._estimator
        lam = self._method.lam()
        dynamics, largest = equations.errors(q, v, tau, a, lam, load)
        off = largest[2] > self._open or largest[3] > self._moving or self._rounded
        left = self._left_out(q) if off else None
        lean = equations.lean() if estimator.leaning else 0.0
        residuals, doubtful = estimator.prove(dynamics, largest, _torques(tau, load), lean=lean)
        # near a singular posture a gap that counts as closed elsewhere may decide a
        from_here = tolerances.NOT_ROUNDING if doubtful and self._open < inf else self._open
        near = max(largest[2:4]) > from_here
        doubtful = doubtful or off
        singular, rest = False, None
        if not doubtful and self._pivots.may_fall:
            doubtful = not self._pivots.holds(residuals.bound, equations.mass(q))
        if doubtful and isfinite(residuals.bound):
            try:
                residuals, rest = self._careful_proof(state, a, lam, load, left)
            except InvalidModel:  # M is not positive definite to working precision
                singular, residuals = True, residuals._replace(bound=inf)
        if (
            residuals.bound <= accuracy
            and self._forces_hold(state, residuals, largest[1], accuracy, load)
            and (not near or self._determined(state, a, lam, left, load))
        ):
            status = _OK
        elif singular:
            status = Status.SINGULAR
        else:
            status = Status.INACCURATE if isfinite(residuals.bound) else Status.NOT_FINITE
        iterations = self._method.iterations()
        question = self._question(state, load)
        return Solution(
            a=a,
            lam=lam,
            residuals=residuals,
            status=status,
            iterations=iterations,
            solve_time=solve_time,
            scene=self._scene,
            question=question,
            missed=rest,
        )

    def _question(self, state: State, load: Load | None) -> Question:
        """State, forces and drift of a solve, in arrays that the caller does not hold."""
        q, v, tau = state
        forces = load.forces if load else ()
        return Question(q.copy(), v.copy(), tau.copy(), forces, self._workspace.drift)

    def _determined(
        self, state: State, a: Array, lam: Array, left: RedundantRows | None, load: Load | None
    ) -> bool:
        """True if closing the loops, and stopping J v, changes a by less than DOUBT of it."""
        q, v, tau = state
        equations, nominal = self._workspace.equations, self._scene.nominal
        left, sizes = left or self._left_out(q), nominal.redundancy
        if max(left.doubt, sizes.blurred(left, v, a, nominal.gravity)) >= tolerances.DOUBT:
            return False
        # of M the nominal one is near enough; light bodies change by up to six times these sizes
        pull = nominal.factors.solve_mass(equations.jacobian(q).T @ lam)
        rate = equations.gaps(q, v)[1]
        if sizes.changes(left, v, a, pull, rate, nominal.gravity) < tolerances.DOUBT / 10:
            return True
        if self._closed is None:
            self._closed = Equations(self._workspace.model, self._scene.bounds)
        self._closed.wanted[:] = equations.wanted
        a_ref = equations.terms(q, v).a_ref
        at = q, v, tau if load is None else tau + load.torque
        changed = changed_by_closing(self._scene, self._closed, at, a, a_ref)
        return changed < tolerances.DOUBT

    def _left_out(self, q: Array) -> RedundantRows:
        """Combinations of rows that are left out at q."""
        return self._scene.nominal.redundancy.at(self._workspace.equations, q)

    def _forces_hold(
        self, state: State, residuals: Residuals, max_a: float, accuracy: float, load: Load | None
    ) -> bool:
        """True if J^T lam is right to FORCES, or to ten times `accuracy` where that is more."""
        # A residual along what rows hold is an error of lam that a does not show,
        #     J^T dlam = r + M e,    |J^T dlam|_inf <= |r|_inf + bound (|M| |a|_inf)_inf.
        size = max(max_a, self._estimator.gravity)
        if residuals.dynamics <= self._estimator.negligible_dynamics_error * size:
            return True
        q, v, tau = state
        terms = self._workspace.equations.terms(q, v)
        largest = largest_torque(terms, _torques(tau, load), size)
        allowed = tolerances.FORCES * max(accuracy / tolerances.SOLVED, 1.0)
        return residuals.dynamics <= (allowed - residuals.bound) * largest

    def passing_accuracy(self, solution: Solution, state: State, load: Load | None) -> float | None:
        """Least power of ten which as `accuracy` lets an answer pass, if any does."""
        residuals = solution.residuals
        if solution.status is not Status.INACCURATE:
            return None
        largest = float(np.abs(solution.a).max())
        for accuracy in tolerances.ADVISED_ACCURACIES:
            if residuals.bound <= accuracy and self._forces_hold(
                state, residuals, largest, accuracy, load
            ):
                return accuracy
        return None

    def failed(self, state: State, solve_time: float, load: Load | None) -> Solution:
        """Return the solution of a method that met a singular matrix."""
        q, v, _ = state
        nothing = np.zeros(self._workspace.model.nv)
        lam = np.zeros(self._scene.rows)
        with np.errstate(all="ignore"):  # what overflows was said already
            _, (_, _, violation, velocity, *_) = self._workspace.equations.errors(
                q, v, nothing, nothing, lam
            )
        return Solution(
            a=np.full(self._workspace.model.nv, nan),
            lam=np.full(self._scene.rows, nan),
            residuals=Residuals(inf, inf, violation, velocity, inf),
            status=Status.SINGULAR,
            iterations=self._method.iterations(),
            solve_time=solve_time,
            scene=self._scene,
            question=self._question(state, load),
        )

    @one_blas_thread
    def _careful_proof(
        self, state: State, a: Array, lam: Array, load: Load | None, left: RedundantRows | None
    ) -> tuple[Residuals, Array | None]:
        """Proof by the factors of the state itself, and by the rounding of J^T lam."""
        # Of rows that are left out the second array has what they miss.
        equations, nominal = self._workspace.equations, self._estimator
        q, v, tau = state
        terms = equations.terms(q, np.zeros(self._workspace.model.nv))
        J = terms.J if left is None else left.kept(terms.J)
        factors = factorise(terms.M, J, tolerances.REFERENCE_RANK)
        factors = factors.above_rounding(equations.cancellation(q))
        P = equations.uncertainty(q)
        estimator = ErrorEstimator(factors, P, nominal.gravity, nominal.weight)
        r, s = equations.residuals(q, v, tau, a, lam, load)
        dynamics, largest = equations.errors(q, v, tau, a, lam, load)
        rest = None
        if left is not None:
            rest = left.rest(s)
            s = s - rest
            largest[4] = float(np.abs(s).max(initial=0.0))
        # a row that does not count carries no force: where one was found along it, it is missing
        missing = estimator.missing(r + terms.J.T @ factors.left_out(lam), s, v, a)
        residuals, _ = estimator.prove(dynamics, largest, _torques(tau, load), missing)
        scale = max(largest[1], nominal.gravity)
        rounded = estimator.rounding_of(np.abs(lam) @ P)
        bound = hypot(residuals.bound, rounded / scale if scale else 0.0)
        return residuals._replace(bound=bound), rest


def _torques(tau: Array, load: Load | None) -> Array:
    """Return the torques of which rounding is a share (nv,), sizes where forces are among them."""
    return tau if load is None else np.abs(tau) + load.size


def failure(workspace: Workspace, solution: Solution, enough: float | None = None) -> SolveFailed:
    """Return the error of an answer that is not ok; an accuracy that is `enough` lets it pass."""
    found = gaps(workspace.scene, workspace.equations.violation(solution.q))
    gap = largest_violation(found)[1] if found else ConstraintViolation(0.0, 0.0)
    reason = massless_motion(workspace.model, solution.q, data=workspace.data)
    if not reason and solution.status is Status.INACCURATE:
        from condyn_pin.dynamics.notices import undetermined  # most answers are ok

        why = undetermined(solution)
        reason = f"inaccurate: {why}" if why else ""
    reason = reason or solution.status.text(
        workspace.scene.rows, _cures(workspace, solution.status, enough)
    )
    return SolveFailed(
        f"{workspace.solver!r} on {workspace.scene.robot.name}: {reason} "
        f"(error bound {solution.error_bound:.1e}; the state is open by {gap}, with "
        f"|J v| = {solution.state_error.velocity:.1e} m/s or rad/s)",
        solution,
    )


def _cures(workspace: Workspace, status: Status, enough: float | None) -> Iterator[str]:
    """Yield cures, but for the solver that was tried just now."""
    from condyn_pin.dynamics.solvers import SOLVERS
    from condyn_pin.dynamics.workspace import unsupported_constraints  # which imports solvers

    scene, solver, inaccurate = workspace.scene, workspace.solver, status is Status.INACCURATE
    if scene.rows and inaccurate and hasattr(solver, "max_iterations"):
        yield "allow more iterations"
    if scene.rows and hasattr(solver, "mu"):
        yield "try another mu"
    for name in _OTHERS[status] if scene.rows or inaccurate else ():
        kind = SOLVERS[name]
        if type(solver) is not kind and not unsupported_constraints(scene, kind()):
            yield f"solve with {kind.__name__}()"
    if enough is not None:
        yield f"accuracy={enough:g} would pass"


# What is done to an answer of Pinocchio's own before it is one of the scene's equations.
#
# Refinement. The residuals of an answer are solved for with the factor that it came from:
#
#     [ -mu 1  J ] [ -dlam ]     [ s ]
#     [  J^T   M ] [   da  ] = - [ r ],     r = M a + h - tau - J^T lam,   s = J a + gamma - a_ref
#
# They are recomputed by Newton-Euler and forward kinematics. So the damping mu and what the factor
# lost to rounding are both made up for; each correction leaves a share mu / (sigma + mu).
#
# Approximated kinds. A hinge as two points and a planar pin as a ball are exact where the loop is
# closed. Where it is open by a gap g, or J v is not 0, their J and gamma differ by about g omega.
# Hot loops have the answer of these rows, which is that of the closed machine to the first order as
# well; `solve` has that of the scene's own rows (`NullSpace`).


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
    """A method that leaves out redundant rows where loops are open, from one that does not."""
    # Open loops are solved by `NullSpace`. Where J v is not 0, forces lose what moves nothing.
    exact = cache(lambda: NullSpace(tolerances.REFERENCE_RANK).start(workspace))
    rounded = workspace.scene.nominal.rounded_file is not None
    method, moving_at = closed, np.zeros(0)
    open_by = ignore_float_errors(
        workspace.equations.open_by
    )  # of numbers that are none the status says it

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method, moving_at
        gap, rate = open_by(q, v)
        method = exact() if rounded or gap > tolerances.OPEN else closed
        moving_at = q.copy() if method is closed and rate > tolerances.OPEN else np.zeros(0)
        return method.acceleration(q, v, tau)

    @ignore_float_errors
    def lam() -> Array:
        lam = method.lam()
        if not moving_at.size:
            return lam
        J = workspace.equations.jacobian(moving_at)
        return workspace.scene.nominal.redundancy.kept(lam, J, np.zeros(len(lam)))

    return BoundSolver(acceleration, lam, lambda: method.iterations())


def without_idle_rows(method: BoundSolver, idle: NDArray[np.bool_]) -> BoundSolver:
    """A method without forces along rows that are zero at every configuration."""
    # Where J v is not 0 such a row may miss a gamma that no acceleration meets, and damping makes a
    # force of it.

    def lam() -> Array:
        found = method.lam()
        found[idle] = 0.0
        return found

    exact = method.exact and without_idle_rows(method.exact, idle)
    return replace(method, lam=lam, exact=exact)


def fallback_off_manifold(
    workspace: Workspace, closed: BoundSolver, slips: bool = False
) -> BoundSolver:
    """A method with the scene's own rows where Pinocchio's, which stand for them, differ."""
    # With `slips`, only where rows slip by more than SLIPPING, whatever is open.
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
        if rows and rows.held is not None:
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
