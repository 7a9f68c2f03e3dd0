"""Pinocchio's own derivatives, behind the protocol that makes them right.

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
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import joints_with_turning_axes
from condyn_pin._core.linalg import held_and_free, inverse_factor
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives, turning_null_space
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives, load_partial
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import DerivativesDisagree, InvalidArgument, UnsupportedConstraint

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
