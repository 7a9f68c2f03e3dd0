"""Pinocchio's own derivatives, behind the protocol that makes them right.

`pin.computeConstraintDynamicsDerivatives` reads what `pin.constraintDynamics` left in data, at the
same settings object. What it returns points into data. For 3 rows between two bodies it adds a
multiple of a spurious term to column 0 whenever the first coordinate of the robot turns; that
column is taken from `KktDerivatives` then.

They are those of the damped matrix, off by mu / sigma and not iterated. Where rows are redundant
they are taken with mu and with 2 mu, and continued to zero:

    X = 2 X(mu) - X(2 mu) + O(mu / sigma)^2,

and refused where the two are further apart than a third of the root of what derivatives are held
to.
dlam is noise of size 1e-16/mu along redundant rows all the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.errors import DerivativesDisagree, InvalidArgument, UnsupportedConstraint
from condyn_pin._core.joints import turning
from condyn_pin._core.tolerances import DERIVATIVES
from condyn_pin.constraints.rows.bound import POINT, Bound
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.derivatives.loads import load_partial
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.proximal import Proximal

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# What is left, a small multiple of (mu / sigma)^2, is within DERIVATIVES then.
_APART: Final = 0.3 * DERIVATIVES**0.5


class PinocchioDerivatives(Derivatives):
    """`pin.computeConstraintDynamicsDerivatives`, copied and repaired.

    Parameters
    ----------
    workspace : Workspace
        Its solver has to be `Proximal`.
    solution : Solution
    v, tau : (nv,) array
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        _check(workspace)
        settings, q = workspace.proximal_settings, solution.q
        if solution.applied:
            tau = tau + workspace.loads.at(q, solution.applied).torque
        by_q, by_v, by_tau = _damped(workspace, q, v, tau, settings)
        audit = workspace.scene.audit
        if audit.rounded or not audit.independent:
            twice = _pin.proximal_settings(
                settings.absolute_accuracy,
                settings.relative_accuracy,
                2.0 * settings.mu,
                settings.max_iter,
            )
            more = _damped(workspace, q, v, tau, twice)
            _check_damping(workspace, settings.mu, by_tau[: self._n], more[2][: self._n])
            by_q, by_v, by_tau = (
                2.0 * x - y for x, y in zip((by_q, by_v, by_tau), more, strict=True)
            )
        if solution.applied:  # they are torques that change with q
            by_q += by_tau @ load_partial(workspace.loads, q, solution.applied)
        if _first_column_is_wrong(workspace):
            first = np.eye(self._n)[0]
            still = np.zeros(self._n)
            exact = KktDerivatives(workspace, solution, v, tau).jvp(first, still, still)
            by_q[:, 0] = np.concatenate(exact)
        self._formed = by_q, by_v, by_tau

    def _form(self) -> tuple[Array, Array, Array]:
        return self._formed


def _damped(
    workspace: Workspace, q: Array, v: Array, tau: Array, settings: Any
) -> tuple[Array, Array, Array]:
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


def _check_damping(workspace: Workspace, mu: float, one: Array, twice: Array) -> None:
    """Refuse da_dtau, with mu and with 2 mu, that are too far apart to be continued to zero."""
    # where everything is held there is none, and what the heaviest joint feels stands for it
    heaviest = float(workspace.scene.audit.yardstick.weights.min()) ** 2
    apart = float(np.abs(twice - one).max()) / max(float(np.abs(one).max()), heaviest)
    if not apart < _APART:
        raise DerivativesDisagree(
            f"method = 'pinocchio': with mu = {mu:.1e} and twice that its derivatives differ by "
            f"{apart:.1e} of their size: it is not small beside what holds the constraints at this "
            "state, or rounding along redundant rows is larger; take method='kkt'"
        )


def _check(workspace: Workspace) -> None:
    """Refuse what Pinocchio's derivatives cannot be right for."""
    if not isinstance(workspace.solver, Proximal):
        raise InvalidArgument(
            f"method = 'pinocchio': it differentiates Proximal(), not {workspace.solver!r}; "
            "take that solver, or method='kkt'"
        )
    plain = [isinstance(b, Bound) and b.is_plain for b in workspace.bounds]
    if not all(plain):
        name = workspace.bounds[plain.index(False)].name
        raise UnsupportedConstraint(
            f"method = 'pinocchio': {name} is not a ball, a weld, a point or a surface; "
            "take method='kkt'"
        )
    model = workspace.model
    for i in turning(model):
        raise UnsupportedConstraint(
            f"method = 'pinocchio': its derivatives are wrong for joint {model.names[i]!r}, a "
            f"{model.joints[i].shortname()}, whose axes turn with its own q; take method='kkt'"
        )


def _first_column_is_wrong(workspace: Workspace) -> bool:
    """Whether there are 3 rows between two bodies, and the first coordinate turns."""
    between: list[Any] = [
        b for b in workspace.bounds if isinstance(b, Bound) and b.selection == POINT and b.joint2
    ]
    return bool(between) and bool(np.any(workspace.data.J[3:, 0]))
