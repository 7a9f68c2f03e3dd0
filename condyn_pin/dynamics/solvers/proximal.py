"""Proximal: Pinocchio's constraintDynamics, and the rows that it keeps where loops are open.

Rows that are redundant where the loops are closed look independent beside that, and
Pinocchio's iteration believes them. With N the combinations that are left out at the precision of
the state (`condyn_pin.constraints.rows.redundancy`), P = 1 - N N^T, and its answer (a, l),

    V^T G V eta = V^T (a_ref - gamma - J a + G l),    V across N,
    lam = V eta,      a <- a + M^-1 J^T (lam - l),

all from the factor that is there: G = J M^-1 J^T without its damping, and M^-1 J^T y with
K [y'; M^-1 J^T y] = [(G + mu) y; 0]. On closed loops whose J v is not 0 the rows contradict each
other along N: a does not change, and lam keeps P l. Rows that are redundant at every configuration,
as in a linkage in a plane, are no others where it is open: the iteration ends, and is the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_proximal,
    check_refinements,
)
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import lapack
from condyn_pin.dynamics.mu import FEW, MuAtState, default_accuracy, default_mu
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.dynamics.proof import OPEN_SQUARED, Refinement, fallback_off_manifold
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import KeptRows
    from condyn_pin.dynamics.workspace import Workspace

_EPS = float(np.finfo(float).eps)

# With a limit below this, an iteration that meets it is what was asked for.
_PATIENT = 20


class Iteration(NamedTuple):
    """Parameters of the iteration by `pin.constraintDynamics`."""

    mu: float  # [1/kg]
    accuracy: float  # [N], the step of lam that ends it
    limit: int
    patient: bool  # whether another weight is looked for where this one does not converge
    refinements: int


@dataclass(frozen=True)
class Proximal(Solver):
    """Proximal iteration on the sparse Cholesky factor of the KKT matrix.

    With G = J M^-1 J^T and b = a_ref - gamma - J a_free what the free motion lacks, iterate

        lam_(k+1) = lam_k + (G + mu I)^-1 (b - G lam_k)

    from lam_0 = 0. Each step shrinks the error by mu / (sigma + mu) for every nonzero eigenvalue
    sigma of G; the limit does not depend on mu, and is the minimum-norm lam where rows are
    redundant.

    Parameters
    ----------
    mu : float or "auto", optional
        Proximal weight [1/kg]. A larger one takes more iterations and leaves less noise in lam
        along redundant rows, about 1e-16 |a| / mu. Zero is a plain solve, and gives NaN on
        redundant rows. "auto", the default, scales with the largest eigenvalue of G at the nominal
        state, so that it means the same on a hand and on an excavator: 1e-6 of it where rows are
        redundant, or a hundredth of the smallest nonzero eigenvalue if that is less, but at least
        1e-12; 1e-12 of it where no row is redundant but those that are zero, or 1e-5 of the
        smallest eigenvalue if that is less. Talos then takes two iterations and Cassie three. If
        six do not converge, as near a singular posture or where loops are open, the others use a
        share of the smallest eigenvalue there that is not rounding: 0.09 for the fourteen left by
        default, 0.17 for eighteen, the most, and 0.001 for five, where corrections follow, or where
        that eigenvalue is more than a hundredth of the largest (`condyn_pin.dynamics.mu`).
    max_iterations : int
        Upper limit. It is met without harm where lam keeps a little noise; convergence is judged
        by the errors of the `Solution`, never by this.
    relative_accuracy : float, optional
        Iterate until |lam_k - lam_(k-1)|_inf is below this [N]: despite its name in Pinocchio, an
        absolute number. By default 1e-9 of the robot's weight, or 4e-9 where rows are redundant:
        above the noise of such rows, where Pinocchio's 1e-12 never fires and doubles the time for
        nothing, and small enough, since the next iterate is better by mu / sigma again; less where
        that could still move a joint by 1e-9 of gravity.
    refinements : int, optional
        Corrections with residuals of our own and the same factor
        (`condyn_pin.dynamics.proof`). Each costs as much as the verification in `solve`, and
        recovers what rounding took where M or G is badly conditioned: light bodies under heavy
        ones, long chains, singular postures. By default one where that may exceed the error of a
        status of ok, eps cond(M) > 1e-8 or eps cond(G) > 1e-8 at the nominal state without
        redundant rows, and none otherwise.
    absolute_accuracy : float
        Handed to Pinocchio as it is. Pinocchio compares it with a number that is not a residual
        (|J a_free - 2 b|_inf), so it has no use; 0 keeps it from ever stopping the iteration.

    Raises
    ------
    InvalidArgument
        If `mu` or an accuracy is negative or not finite, or a limit is not positive.

    Notes
    -----
    Pinocchio represents a hinge, an edge and a planar pin by points, which is exact on closed
    loops. If they are open by more than 1e-11 m, or their velocity error exceeds 1e-11 m/s, `solve`
    has the answer of `NullSpace`, and `Workspace.acceleration` that of the points, which is right
    to first order in the gap as well. At open states rows that are redundant on closed loops are
    left out, at the cost of one factorisation of the rows (`condyn_pin.dynamics.proof`).

    Cost O(n d^2 + m^2 d) with d the depth of the tree; `condyn bench` measures it.

    References
    ----------
    Carpentier, Budhiraja, Mansard. Proximal and sparse resolution of constrained dynamic
    equations. Robotics: Science and Systems, 2021.
    """

    title: ClassVar[str] = "Proximal"
    cost: ClassVar[str] = "O(n d^2 + m^2 d), d the depth of the tree"
    use: ClassVar[str] = "by default; the fastest for closed chains"
    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS, "max_iterations": (1, 20)},
        {"max_iterations": ITERATIONS},
        {"relative_accuracy": ACCURACIES},
    )

    mu: float | Literal["auto"] | None = None  # [1/kg]
    max_iterations: int = 20
    relative_accuracy: float | None = None  # [N]
    absolute_accuracy: float = 0.0
    refinements: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mu == "auto":
            object.__setattr__(self, "mu", None)
        if self.refinements is not None:
            check_refinements(self.refinements)
        check_proximal(self.mu, self.max_iterations, smallest_mu=0.0)
        if self.relative_accuracy is not None:
            check_accuracy("relative_accuracy", self.relative_accuracy)
        check_accuracy("absolute_accuracy", self.absolute_accuracy)

    def weight(self, nominal: NominalAnalysis) -> float:
        """Return mu [1/kg], by the `nominal` analysis unless it is given."""
        return default_mu(nominal) if self.mu is None else float(self.mu)

    def iteration(self, nominal: NominalAnalysis) -> Iteration:
        """Return the iteration parameters of a scene, by its `nominal` analysis unless given."""
        mu = self.weight(nominal)
        accuracy = self.relative_accuracy
        if accuracy is None:
            accuracy = default_accuracy(nominal, mu)
        patient = self.mu is None and self.max_iterations >= _PATIENT
        limit = FEW if patient else self.max_iterations
        refinements = _refinements(nominal) if self.refinements is None else self.refinements
        return Iteration(mu, accuracy, limit, patient, refinements)

    def mu_at_state(self, workspace: Workspace) -> MuAtState:
        """Return the search for a weight at states where the usual one does not converge."""
        nominal = workspace.scene.nominal
        mu, accuracy, limit, _, refinements = self.iteration(nominal)
        corrected = _refinements(nominal) > 0 and refinements > 0
        return MuAtState(workspace, mu, accuracy, self.max_iterations - limit, corrected)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return `pin.constraintDynamics` bound to the memory of `workspace`."""
        nominal = workspace.scene.nominal
        mu, accuracy, limit, patient, refinements = self.iteration(nominal)
        settings = _pin.proximal_settings(self.absolute_accuracy, accuracy, mu, limit)
        workspace.proximal_settings = settings
        at_state = cache(lambda: self.mu_at_state(workspace))
        approximated = bool(workspace.pinocchio_constraints.approximated)
        rows = OpenRows(workspace, mu) if approximated or nominal.looks_independent else None
        method = _pinocchios(workspace, accuracy, at_state if patient else None, rows)
        if refinements:
            method = _refined(workspace, method, refinements, rows)
        if approximated:
            exact = fallback_off_manifold(workspace, method)
            slipping = fallback_off_manifold(workspace, method, slips=True)
            return replace(slipping, open_rows=method.open_rows, exact=exact)
        return replace(method, exact=_refined_where_open(method, rows)) if rows else method


def _pinocchios(
    workspace: Workspace,
    accuracy: float,
    at_state: Callable[[], MuAtState] | None,
    rows: OpenRows | None,
) -> BoundSolver:
    """`pin.constraintDynamics` with the settings of the workspace."""
    # Where the last step of lam is above `accuracy` [N], what `at_state` returns finds better ones;
    # `rows` have the answer where loops are open.
    settings, solve = workspace.proximal_settings, pin.constraintDynamics
    model, data = workspace.model, workspace.data
    models, datas = workspace.constraint_models, workspace.constraint_datas
    gaps = rows.gaps if rows else []
    least = -1.0 if rows and rows.always_open else OPEN_SQUARED
    to_scene = workspace.pinocchio_constraints.to_scene

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        return solve(model, data, q, v, tau, models, datas, settings)  # type: ignore[no-any-return]

    def persistent(q: Array, v: Array, tau: Array) -> Array:
        a = solve(model, data, q, v, tau, models, datas, settings)
        workspace.proximal_settings = settings
        for square, gap in gaps:
            if rows and square(gap) > least:
                if settings.relative_residual <= accuracy and rows.redundant_everywhere:
                    break  # lam has come to an end: no row is beside the others
                return rows.answer(a)
        if rows:
            rows.is_open = False
        step = settings.relative_residual
        better = None if step <= accuracy or at_state is None else at_state().settings(step)
        if better is None:
            return a  # type: ignore[no-any-return]
        workspace.proximal_settings = better
        return solve(model, data, q, v, tau, models, datas, better)  # type: ignore[no-any-return]

    def lam() -> Array:
        if rows:
            return rows.forces()
        lam = np.array(data.lambda_c)
        return lam if to_scene is None else to_scene.dot(lam)

    def iterations() -> int:
        last = workspace.proximal_settings
        return int(settings.iter) + (0 if last is settings else int(last.iter))

    run = persistent if at_state or rows else acceleration
    return BoundSolver(run, lam, iterations, open_rows=rows)


def _refined(
    workspace: Workspace, method: BoundSolver, times: int, rows: OpenRows | None
) -> BoundSolver:
    """The method with corrections of its answers on closed loops."""
    refinement, run, data = Refinement(workspace, times), method.acceleration, workspace.data

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        a = run(q, v, tau)
        if rows and rows.is_open:
            return a
        return refinement.correct(q, v, tau, a, np.array(data.lambda_c))

    def lam() -> Array:
        if rows is None:
            return workspace.scene_forces(refinement.lam)
        return rows.forces(refinement.lam)

    return BoundSolver(acceleration, lam, lambda: method.iterations() + times, open_rows=rows)


def _refined_where_open(method: BoundSolver, rows: OpenRows) -> BoundSolver:
    """The method with a correction of its answers on open loops."""

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        rows.held = None  # those of this state alone
        a = method.acceleration(q, v, tau)
        return rows.refined(q, v, tau, a) if rows.is_open else a

    return replace(method, acceleration=acceleration)


def _refinements(nominal: NominalAnalysis) -> int:
    """Return the number of corrections of a scene: one where rounding alone spoils an answer."""
    most = tolerances.SOLVED / _EPS
    return int(nominal.delassus_condition > most or nominal.factors.mass.condition_exceeds(most))


class _OpenState(NamedTuple):
    """An open state, in rows of Pinocchio's."""

    J: Array  # (m, nv)
    V: Array  # (m, rank), a basis of the combinations that are kept
    damped: Array  # (m, m), J M^-1 J^T + mu 1
    G: Array  # (m, m), J M^-1 J^T
    R: Array  # (rank, rank), V^T G V = R^T R


class OpenRows:
    """The rows that are kept at open states, solved by the factor of `pin.constraintDynamics`.

    mu: what the factor has on the diagonal of G [1/kg]
    gaps: c of each constraint that has a position, with its own product: views of Pinocchio's
        memory
    is_open: the last answer is that of kept rows; who has another sets it back
    held: Within a step, a list of its own: the basis of the rows that its first open state keeps,
        and all after it. On closed loops every choice of independent rows is the same field, and
        beside them a smooth one, so that the stages keep their order. None outside of steps.
    always_open: digits of the file hide which rows are redundant, on closed loops too
    """

    held: list[Array] | None
    _last: _OpenState

    def __init__(self, workspace: Workspace, mu: float) -> None:
        natives, nominal = workspace.pinocchio_constraints, workspace.scene.nominal
        data, datas = workspace.data, workspace.constraint_datas
        self._workspace, self._nominal = workspace, nominal
        self._cholesky = _pin.constraint_cholesky(data)
        self._jacobian = _pin.placed_jacobian(
            workspace.model, data, workspace.constraint_models, datas
        )
        self.gaps: list[tuple[Callable[[Array], float], Array]] = []
        self._moving: list[Array] = []
        self._c: list[Array] = []
        for native, its_data in zip(natives.constraints, datas, strict=True):
            gap = its_data.contact_placement_error.vector[: native.size]
            if native.anchored:
                self.gaps.append((gap.dot, gap))
            self._c.append(gap if native.anchored else np.zeros(native.size))
            self._moving.append(its_data.contact_velocity_error.vector[: native.size])
        m = self._m = sum(map(len, self._c))
        # views of Pinocchio's memory, as the gaps are
        self._wanted, self._damped_lam = data.primal_rhs_contact[:m], data.lambda_c
        self._damping = mu * np.eye(m)
        self._right = np.zeros((m + workspace.model.nv, 2), order="F")
        self._one_right = self._right[:, 0]
        self._lam = np.zeros(0)
        self.is_open, self.held = False, None
        self.always_open = nominal.rounded_file is not None

    @cached_property
    def redundant_everywhere(self) -> bool:
        """Rows that are redundant on closed loops are so at every configuration."""
        # As in a linkage in a plane, and as points of one body are. J is made of analytic functions
        # of q: at a place of no special choice its rank is the largest.
        workspace, found = self._workspace, self._kept_rows.redundancy
        if self.always_open:
            return False
        model, data = workspace.model, workspace.model.createData()
        datas = pin.StdVec_RigidConstraintData()
        models = workspace.constraint_models
        for constraint in models:
            datas.append(constraint.createData())
        anywhere = np.random.default_rng(0).normal(size=model.nv)
        pin.computeJointJacobians(model, data, pin.integrate(model, self._nominal.q, anywhere))
        J = _pin.constraints_jacobian(model, data, models, datas)()
        return found.left_out(J, np.zeros(self._m)).rank == found.floor

    @cached_property
    def _kept_rows(self) -> KeptRows:
        """Kept rows among those of Pinocchio."""
        from condyn_pin.constraints.rows.redundancy import KeptRows  # closed loops need none

        to_scene, found = self._workspace.pinocchio_constraints.to_scene, self._nominal.redundancy
        J = self._nominal.terms.J
        if to_scene is None:
            return KeptRows(found, J)
        # s' = E s: a row of Pinocchio's is as large as the scales of the rows that it is made of
        sizes = (np.abs(to_scene.T) / found.R).max(axis=1)
        R = 1.0 / np.where(sizes > 0.0, sizes, sizes.max())
        return KeptRows(replace(found, R=R), to_scene.T.dot(J))

    @cached_property
    def _from_natives(self) -> Array | None:
        """E^+ (m, m'): rows of the scene from Pinocchio's; None where they are the same."""
        to_scene = self._workspace.pinocchio_constraints.to_scene
        return None if to_scene is None else np.asarray(np.linalg.pinv(to_scene.T))

    def answer(self, a: Array) -> Array:
        """Accelerations a (nv,) with the kept rows, from those with all."""
        J, held = self._jacobian(), self.held
        if held:
            V = held[0]
        else:
            V = self._kept_rows.basis(J, np.concatenate(self._c))
            if held is not None:
                held.append(V)
        damped = self._cholesky.getInverseOperationalSpaceInertiaMatrix()
        G, lam = damped - self._damping, self._damped_lam
        missing = self._wanted - J.dot(a) + G.dot(lam)
        R, x, info = lapack().dposv(V.T.dot(G).dot(V), V.T.dot(missing), 0, 1, 1)
        if info:
            raise Singular
        self._last, self.is_open = _OpenState(J, V, damped, G, R), True
        self._lam = V.dot(x.ravel())
        return a + self._pulled(damped.dot(self._lam - lam))

    def closing_moves(self, gaps: Array) -> Array:
        """Moves (nv, 2) that close two gaps (m, 2) along the rows kept in the last answer."""
        _, V, damped, _, R = self._last
        self._right[: self._m] = damped.dot(V.dot(lapack().dpotrs(R, V.T.dot(gaps))[0]))
        return np.asarray(self._cholesky.solve(self._right)[self._m :])

    def refined(self, q: Array, v: Array, tau: Array, a: Array) -> Array:
        """Accelerations a (nv,) of an open state after a correction by recomputed residuals."""
        workspace, m = self._workspace, self._m
        J, V, damped, G, R = self._last
        r, s = workspace.equations.residuals(q, v, tau, a, self.forces())
        s = workspace.pinocchio_velocity(s)
        steps = self._cholesky.solve(np.concatenate([s, r])).ravel()
        da: Array = -steps[m:]
        dlam = steps[:m]
        missing = G.dot(dlam) - J.dot(da) - s
        kept = V.dot(lapack().dpotrs(R, V.T.dot(missing))[0].ravel())
        self._lam = self._lam + kept
        return a + da + self._pulled(damped.dot(kept - dlam))

    def _pulled(self, x: Array) -> Array:
        """M^-1 J^T lam (nv,) by the damped factor, from x = (G + mu 1) lam (m,)."""
        self._one_right[: self._m] = x
        return self._cholesky.solve(self._one_right).ravel()[self._m :]  # type: ignore[no-any-return]

    def forces(self, lam: Array | None = None) -> Array:
        """Forces (m,) of the scene's rows, without a part that moves nothing."""
        # `lam` are those of Pinocchio's rows on closed loops, by default of its last answer.
        if self.is_open:
            return self._smallest(self._last.J, np.concatenate(self._c), self._lam)
        lam = self._damped_lam.copy() if lam is None else lam
        if self._from_natives is None and not any(
            gap.dot(gap) > OPEN_SQUARED for gap in (*self._moving, *self._c)
        ):
            return lam
        return self._smallest(self._jacobian(), np.zeros(len(lam)), lam)

    def _smallest(self, J: Array, c: Array, lam: Array) -> Array:
        """Forces (m,) of the scene's rows, the smallest, from those of Pinocchio's."""
        if self._nominal.every_row_counts:
            return self._workspace.scene_forces(lam)
        back, kept = self._from_natives, self._nominal.redundancy.kept
        if back is None:
            return kept(lam, J, c)
        return kept(self._workspace.scene_forces(lam), back.dot(J), back.dot(c))
