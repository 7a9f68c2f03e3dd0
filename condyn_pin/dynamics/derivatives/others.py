"""Derivatives by differences, by Pinocchio, and of compliant constraints.

    f'(0) ~ (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / (12 h)

along ``pin.integrate(model, q, t e_i)`` and its like for v, and max(M_ii) t e_i for tau, which
also the heaviest joint feels: (a, lam) is linear in tau, no step is too large. One step h serves
all, that of a sweep at which the result changes least. Where rows are redundant q is closed again
after each step from closed loops, and the derivatives by q are those along the constraints: zero
across. At states off the constraints all columns are those of the answer there.

`pin.computeConstraintDynamicsDerivatives` reads what `pin.constraintDynamics` left in data, at the
same settings object. What it returns points into data. For 3 rows between two bodies it adds a
multiple of a spurious term to column 0 whenever the first coordinate of the robot turns; that
column is taken from `KktDerivatives` then.

They are those of the damped matrix, off by mu / sigma and not iterated. Where rows are redundant
they are taken with mu, 2 mu and 4 mu, and continued to zero:

    Y(mu) = 2 X(mu) - X(2 mu) = X + O(mu / sigma)^2 + O(eps |G| / mu).

Neither part is known, but Y(2 mu) has four times the first and half of the second: it is off from
Y(mu) by three times what Y(mu) misses through damping, and by half of what it misses through
rounding. Where twice that is more than a tenth of what derivatives are held to, they are refused.

Along redundant rows dlam is what they contradict each other by, over mu: rounding, 1e-16 / mu, and
where q or v leaves the constraints a share of the motion itself, a million times what it should
be. With N the left null space of J, that part of dlam is replaced: the smallest lam is in the range
of J, and stays there as the rows turn (`condyn_pin.dynamics.derivatives.kkt`).

    r = M a + h - tau - J^T lam = 0,    s = J a + gamma + b J v + k c + R lam = 0,

where b is fixed, and k and R = (1 - d) / d w change with the impedance d of the gap |c| of each
constraint, but w does not: it changes with what bodies weigh (`inverse_inertias`). So with r_q, r_v
and the partials of J a + gamma of hard constraints (`condyn_pin.dynamics.derivatives.kkt`)

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da + R dlam = -s_q dq - s_v dv,
    s_q = (J a + gamma)_q + b (J v)_q + k c_q + (k_d c + R_d lam) d_q,    d_q = d' c^T c_q / |c|,
    s_v = (J a + gamma)_v + b J
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import damped_range_space, held_and_free, inverse_factor, null_space
from condyn_pin._core.models import joints_with_turning_axes
from condyn_pin._core.threads import of_workspace
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives, turning_null_space
from condyn_pin.dynamics.derivatives.solution_derivatives import (
    Derivatives,
    gravity_regressor,
    inertia_regressor,
    inverse_inertias_by_inertias,
    load_partial,
)
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.soft import (
    SolImp,
    SolRef,
    impedance,
    impedance_slope,
    reference_by,
)
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import (
    DerivativesDisagree,
    InvalidArgument,
    SolveFailed,
    UnsupportedConstraint,
)

# Rounding of f is divided by h, the remainder of the stencil goes with h^4.
STEPS = (1e-3, 3e-4, 1e-4, 3e-5)

# Impedance bends within a gap of a millimetre.
_SOFT_STEPS = (1e-5, 3e-6, 1e-6, 3e-7)

# What refinement gains is lost in the differences.
_PLAIN = Reference(refinements=0)

# A step of 1e-3 opens a loop by 1e-6, one Newton step leaves 1e-12, two leave rounding.
_CLOSINGS = 2

BLOCKS = ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau")


class DifferenceDerivatives(Derivatives):
    """Central differences of `Reference`, or of a solver of soft constraints itself."""

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        self._v, self._tau = v, tau
        self._workspace, self._loads = workspace, workspace.loads
        self._model, self._equations = workspace.model, workspace.equations
        scene = solution.scene
        terms = self._equations.terms(solution.q, v)
        self._bound = None if workspace.solver.exact else workspace.bound
        redundant = scene.nominal.dependent and workspace.solver.exact
        # (k, nv) orthonormal directions in which q was moved
        self.along = directions(terms.J, redundant and solution._missed is None)
        self._heaviest = float(np.diag(terms.M).max(initial=0.0))
        self.step = 0.0  # the step that was chosen [rad, m, and so on]

    @of_workspace
    def _form(self) -> tuple[Array, Array, Array]:
        steps = STEPS if self._bound is None else _SOFT_STEPS
        tables = [self._table(h) for h in steps]
        changes = [np.abs(a - b).max() for a, b in pairwise(tables)]
        best = int(np.argmin(changes)) + 1
        self.step = steps[best]
        by_q, by_v, by_tau = np.hsplit(tables[best], 3)
        return by_q, by_v, by_tau

    def _table(self, h: float) -> Array:
        """Return the derivatives of (a, lam) by (q, v, tau) with one step."""
        q, v, tau = self.solution.q, self._v, self._tau
        answer, unit, size = self._answer, np.eye(self._n), self._n + self._m
        still = np.zeros_like(tau)

        def moved(step: Array) -> Array:
            there = self._moved(step)
            return answer(there, v, self._pushed(there, tau))

        by_q = _central(moved, self.along, h, size)
        # (a, lam) is linear in the torques, and how it changes with v does not depend on them:
        # without them there is less to lose in the differences
        by_v = _central(lambda step: answer(q, v + step, still), unit, h, size)
        by_tau = _central(lambda step: answer(q, v, self._heaviest * step), unit, h, size)
        return np.hstack([by_q @ self.along, by_v, by_tau / self._heaviest])

    def _answer(self, q: Array, v: Array, tau: Array) -> Array:
        if self._bound is not None:
            return np.concatenate((self._bound.acceleration(q, v, tau), self._bound.lam()))
        terms = self._equations.terms(q, v)
        left = self._equations.left_out(terms.J, self._equations.violation(q))
        return np.concatenate(_PLAIN.solve(terms.kept(left) if left else terms, tau))

    def _pushed(self, q: Array, tau: Array) -> Array:
        """Return the torques together with those of the forces from outside."""
        applied = self.solution.applied
        return tau + self._loads.at(q, applied).torque if applied else tau

    def _moved(self, step: Array) -> Array:
        q = np.array(pin.integrate(self._model, self.solution.q, step))
        if len(self.along) == self._n:
            return q
        for _ in range(_CLOSINGS):
            c, J = self._equations.violation(q), self._equations.jacobian(q)
            back = np.linalg.lstsq(J, c, rcond=tolerances.RANK)[0]
            q = np.array(pin.integrate(self._model, q, -back))
        return q


def directions(J: Array, redundant: bool) -> Array:
    """Return the directions in which q is moved: all, or those along the constraints."""
    return null_space(J) if redundant else np.eye(J.shape[1])


def _central(f: Callable[[Array], Array], directions: Array, h: float, size: int) -> Array:
    """Return the derivative of f (size,) along each of the directions, a column each."""
    columns = [
        (8 * (f(h * d) - f(-h * d)) - (f(2 * h * d) - f(-2 * h * d))) / (12 * h) for d in directions
    ]
    return np.column_stack(columns) if columns else np.zeros((size, 0))


def check_derivatives(found: Derivatives, differences: DifferenceDerivatives) -> None:
    """Raise `DerivativesDisagree` where derivatives differ from central differences."""
    # By q, where rows are redundant and loops closed, only along the constraints. The largest
    # difference is kept as the `disagreement` of what was `found`.
    worst = 0.0
    for name in BLOCKS:
        wanted: Array = getattr(differences, name)
        had: Array = getattr(found, name)
        if name.endswith("_dq"):
            had = had @ differences.along.T @ differences.along
        error = np.abs(had - wanted)
        size = max(float(np.abs(wanted).max(initial=0.0)), 1.0)
        if error.size and not error.max() <= tolerances.DERIVATIVES * size:
            row, column = np.unravel_index(int(np.argmax(error)), error.shape)
            raise DerivativesDisagree(
                f"{name}[{row}, {column}] = {had[row, column]:.9g}, and differences with a step of "
                f"{differences.step:g} give {wanted[row, column]:.9g}; the largest entry is "
                f"{size:.3g}. Near a singular state or at an open loop neither is reliable"
            )
        worst = max(worst, float(error.max(initial=0.0)) / size)
    found.disagreement = worst


# What may be off, of the largest entry: torques in which that one plays a small part are no less.
_LARGEST_OFF: Final = 0.1 * tolerances.DERIVATIVES

# What X(mu) and X(2 mu) may differ by: where that is mu / sigma, or rounding eps |G| / mu, Y(mu)
# and Y(2 mu) are apart by 6 (mu / sigma)^2, or by twice that rounding, and would be refused.
_HOPELESS: Final = 2e-3

# Of a and lam by q, v and tau, each (nv + m, nv).
Blocks = tuple[Array, Array, Array]


class PinocchioDerivatives(Derivatives):
    """`pin.computeConstraintDynamicsDerivatives` for `Proximal`, copied and repaired."""

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        _check(workspace)
        _check_state(workspace, solution)
        settings, q = workspace.proximal_settings, solution.q
        if solution.applied:
            tau = tau + workspace.loads.at(q, solution.applied).torque
        by_q, by_v, by_tau = _damped(workspace, q, v, tau, settings)
        nominal = workspace.scene.nominal
        if nominal.rounded or not nominal.independent:
            one, mu = (by_q, by_v, by_tau), settings.mu
            twice = _damped(workspace, q, v, tau, _weighted(settings, 2))
            _check_agreement(workspace, solution, mu, one, twice, _HOPELESS)
            more = _damped(workspace, q, v, tau, _weighted(settings, 4))
            by_q, by_v, by_tau = found = _extrapolated(one, twice)
            rougher = _extrapolated(twice, more)
            _check_agreement(workspace, solution, mu, found, rougher, _LARGEST_OFF)
            _make_smallest(workspace, solution, found)
        if solution.applied:  # they are torques that change with q
            by_q += by_tau @ load_partial(workspace.loads, q, solution.applied)
        if _first_column_is_wrong(workspace):
            first = np.eye(self._n)[0]
            still = np.zeros(self._n)
            exact = KktDerivatives(workspace, solution, v, tau).jvp(first, still, still)
            by_q[:, 0] = np.concatenate(exact)
        self._given = by_q, by_v, by_tau


def _damped(workspace: Workspace, q: Array, v: Array, tau: Array, settings: Any) -> Blocks:
    """Return Pinocchio's derivatives of a and lam by q, v and tau, with the mu of the settings."""
    model, data = workspace.model, workspace.data
    models, datas = workspace.constraint_models, workspace.constraint_datas
    # again, with nothing in between: the derivatives read what this leaves behind
    pin.constraintDynamics(model, data, q, v, tau, models, datas, settings)
    found = pin.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)
    n, m = model.nv, workspace.scene.rows
    parts = [np.reshape(part, (-1, n)) for part in found]  # a column comes as a vector
    empty = [np.zeros((0, n))] * 3
    of_lam = [workspace.scene_forces(part) for part in parts[3:]] if m else empty
    by_q, by_v, by_tau = map(np.vstack, zip(parts[:3], of_lam, strict=True))
    return by_q, by_v, by_tau


def _weighted(settings: Any, times: float) -> Any:
    """Return the settings with a multiple of their mu."""
    return _pin.proximal_settings(
        settings.absolute_accuracy,
        settings.relative_accuracy,
        times * settings.mu,
        settings.max_iter,
    )


def _extrapolated(one: Blocks, twice: Blocks) -> Blocks:
    """Return derivatives with some mu and with twice that, continued to zero."""
    by_q, by_v, by_tau = (2.0 * x - y for x, y in zip(one, twice, strict=True))
    return by_q, by_v, by_tau


def _make_smallest(workspace: Workspace, solution: Solution, found: Blocks) -> None:
    """Replace what derivatives of lam are along redundant rows by that of the smallest lam."""
    # N^T dlam = N^T (dJ w) by q, and zero by v and tau.
    q, n, equations = solution.q, len(solution.a), workspace.equations
    J = equations.jacobian(q)
    motions = held_and_free(inverse_factor(equations.mass(q)), J, tolerances.RANK)
    N = motions.N
    for block in found:
        block[n:] -= N @ (N.T @ block[n:])
    by_q, _, _ = found
    w = motions.held(solution.lam)
    by_q[n:] += turning_null_space(workspace.linearisation, q, w, N)


def _check_agreement(
    workspace: Workspace, solution: Solution, mu: float, found: Blocks, rougher: Blocks, most: float
) -> None:
    """Refuse derivatives of a from mu that those from 2 mu do not agree with."""
    # Those by tau are for torques in proportion to M_jj^1/2, as each joint feels them. What they
    # accelerate are the motions that the rows leave: those by q and v are compared along them. Sums
    # over the columns count, for rounding along one redundant row is the same in all of them.
    nominal, n = workspace.scene.nominal, len(solution.a)
    size = max(float(np.abs(solution.a).max()), nominal.estimator.gravity) / 1e3
    felt = np.sqrt(np.diag(workspace.equations.mass(solution.q)))
    along = found[2][:n] * felt
    # where everything is held there is none, and what the heaviest joint feels stands for it
    largest = max(float(np.abs(along).max()), float(nominal.estimator.weights.min()))
    for x, y, step, least in (
        (found[0], rougher[0], along, size * largest),
        (found[1], rougher[1], along, size * largest),
        (found[2], rougher[2], np.diag(felt), largest),
    ):
        off = 2.0 * float(np.abs((x - y)[:n] @ step).sum(axis=1).max())
        off /= max(float((np.abs(x)[:n] @ np.abs(step)).max()), least) or 1.0
        if not off <= most:
            raise DerivativesDisagree(
                f"method = 'pinocchio': from mu = {mu:.1e}, and from twice that, its "
                f"derivatives differ by {off / 2.0:.1e} of their size: mu is not small beside what "
                "holds the constraints at this state, or rounding along redundant rows is larger; "
                "take method='kkt'"
            )


def _check(workspace: Workspace) -> None:
    """Refuse what Pinocchio's derivatives cannot be right for."""
    if not isinstance(workspace.solver, Proximal):
        raise InvalidArgument(
            f"method = 'pinocchio': it differentiates Proximal(), not {workspace.solver!r}; "
            "take that solver, or method='kkt'"
        )
    plain = [b.is_plain for b in workspace.bounds]
    if not all(plain):
        name = workspace.bounds[plain.index(False)].name
        raise UnsupportedConstraint(
            f"method = 'pinocchio': {name} is not a ball, a weld, a point or a surface; "
            "take method='kkt'"
        )
    model = workspace.model
    for i in joints_with_turning_axes(model):
        raise UnsupportedConstraint(
            f"method = 'pinocchio': its derivatives are wrong for joint {model.names[i]!r}, a "
            f"{model.joints[i].shortname()}, whose axes turn with its own q; take method='kkt'"
        )


def _check_state(workspace: Workspace, solution: Solution) -> None:
    """Refuse states off the constraints where rows are redundant: they contradict each other."""
    error = solution.state_error
    off = max(error.position, error.velocity) > tolerances.OPEN
    if off and not workspace.scene.nominal.independent:
        raise DerivativesDisagree(
            f"method = 'pinocchio': the state is open by {error.position:.1e} m or rad, with "
            f"|J v| = {error.velocity:.1e} m/s or rad/s, where redundant rows contradict each "
            "other; take method='kkt', or a state of assemble and project_velocity"
        )


def _first_column_is_wrong(workspace: Workspace) -> bool:
    """True if 3 rows act between two bodies, and the first coordinate turns."""
    between = any(b.is_ball for b in workspace.bounds)
    return between and bool(np.any(workspace.data.J[3:, 0]))


class SoftDerivatives(Derivatives):
    """Exact derivatives of the answer of `Soft`, off the constraints too.

    Notes
    -----
    Cost as `KktDerivatives`, and one more evaluation, of c and J v by q. Where the gap of a
    constraint is zero and impedance rises at once, power = 1, they are those of a gap that stays.
    """

    def __init__(
        self, workspace: Workspace, solution: Solution, v: Array, approximate_delassus: Array,
        solref: SolRef, solimp: SolImp,
    ) -> None:  # fmt: skip
        super().__init__(solution)
        self._workspace, self._v = workspace, v
        self._softness = approximate_delassus, solref, solimp
        self._linearise()

    @of_workspace
    def _linearise(self) -> None:
        """Keep what a step of q and v leaves to solve, and what solves it."""
        workspace, solution, v = self._workspace, self.solution, self._v
        (w, solref, solimp), q, lam, n = self._softness, solution.q, solution.lam, self._n
        equations, still = workspace.equations, np.zeros(n)
        c, velocity = equations.gaps(q, v)
        of = workspace.linearisation.at(q, v, solution.a, lam)
        J, rhs, rows = equations.drop_roundoff_rows(of.J), of.rhs, of.rhs[n:]
        if solution.applied:
            rhs[:n, :n] += load_partial(workspace.loads, q, solution.applied)
        M, R = equations.mass(q) if of.M is None else of.M, np.zeros(self._m)
        self._by_solref, self._by_w = np.zeros((self._m, 2)), np.zeros(self._m)
        if self._m:
            c_q = workspace.linearised_gaps.at(q, still, still, 0.0 * lam).s_q
            d, d_q = self._impedance(c, c_q)
            b, k, k_d, self._by_solref = reference_by(c, velocity, d, solref, solimp)
            R, R_d = (1 - d) / d * w, -w / d**2
            self._by_w = (1 - d) / d * lam
            rows[:, :n] -= b * workspace.linearisation.turning(q, v) + k[:, None] * c_q
            rows[:, :n] -= (k_d * c + R_d * lam)[:, None] * d_q
            rows[:, n:] -= b * J
        factors = damped_range_space(M, J, R)
        if factors is None:
            raise SolveFailed("M is not positive definite here", solution)
        self._rhs, self._factors = rhs, factors

    def _impedance(self, c: Array, c_q: Array) -> tuple[Array, Array]:
        """Return d of the constraint of each row (m,), and d by q (m, nv)."""
        bounds, (_, _, solimp) = self._workspace.bounds, self._softness
        starts, sizes = [b.rows.start for b in bounds], [b.size for b in bounds]
        gaps = np.sqrt(np.add.reduceat(c * c, starts))
        widens = np.add.reduceat(c[:, None] * c_q, starts) / np.where(gaps > 0, gaps, 1.0)[:, None]
        d_q = impedance_slope(gaps, solimp)[:, None] * widens
        return np.repeat(impedance(gaps, solimp), sizes), np.repeat(d_q, sizes, axis=0)

    def by_solref(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 2) and lam (m, 2) by the two numbers of `solref`."""
        return self._factors.solve(np.zeros((self._n, 2)), self._by_solref)

    def by_gravity(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 3) and lam (m, 3) by the vector of gravity [m/s^2]."""
        pulled = gravity_regressor(self._workspace.model, self.solution.q)
        return self._factors.solve(-pulled, np.zeros((self._m, 3)))

    @of_workspace
    def by_inertias(self) -> tuple[Array, Array]:
        """Return the derivatives of a and lam by the inertial parameters of the bodies."""
        # Ten columns a joint, as `KktDerivatives.by_inertias`; R is among them: compliances change
        # with the inertias of the bodies.
        model, of = self._workspace.model, self.solution
        r = inertia_regressor(model, of.q, self._v, of.a)
        s = self._by_w[:, None] * inverse_inertias_by_inertias(self._workspace)
        return self._factors.solve(-r, -s)

    def _form(self) -> tuple[Array, Array, Array]:
        n, rhs = self._n, self._rhs
        by_state = np.concatenate(self._factors.solve(rhs[:n], rhs[n:]))
        by_tau = np.concatenate(self._factors.solve(np.eye(n), np.zeros((self._m, n))))
        return by_state[:, :n], by_state[:, n:], by_tau
