"""The equations of a scene as one writes them by hand: what `bench` compares every method with.

    [ M   J^T  ] [   a  ]   [ tau - h ]
    [ J  -mu I ] [ -lam ] = [ -gamma  ]

Each is one function of q, v and tau that calls Pinocchio and then one solver of somebody else. No
argument is looked at, nothing is scaled, no condition estimated and no error computed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.groups import PlainRows
from condyn_pin.dynamics.at_state import raw_constraints
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.dynamics.scene import Scene

Answer = Callable[[Array, Array, Array], Array]


def by_hand(scene: Scene, mu: float = 0.0) -> dict[str, Answer]:
    """Return ways to a (nv,) by the name of what solves, each called with (q, v, tau).

    Damping mu [1/kg] is needed where rows are redundant. There is none for constraints that
    Pinocchio does not have, and for welds of two bodies: whoever writes these by hand has written a
    library.
    """
    rows = PlainRows(scene.robot.model, scene.robot.model.createData(), scene.bounds)
    if not (scene.rows and rows.have_gamma):
        return {}
    return {name: method(scene, mu) for name, method in METHODS.items()}


def _by_numpy(scene: Scene, mu: float) -> Answer:
    n, assemble = scene.robot.nv, _assembly(scene, mu)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        K, y = assemble(q, v, tau)
        return np.linalg.solve(K, y)[:n]  # type: ignore[return-value]

    return answer


def _by_lapack(scene: Scene, mu: float) -> Answer:
    from scipy.linalg.lapack import dsysv

    n, assemble = scene.robot.nv, _assembly(scene, mu)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        K, y = assemble(q, v, tau)
        # K^T is in the order of Fortran
        return dsysv(K.T, y, lower=1, overwrite_a=1, overwrite_b=1)[2][:n]  # type: ignore[no-any-return]

    return answer


def _assembly(scene: Scene, mu: float) -> Callable[[Array, Array, Array], tuple[Array, Array]]:
    """Return what assembles K and the right side."""
    model = pin.Model(scene.robot.model)
    data, n, still = model.createData(), model.nv, np.zeros(model.nv)
    rows, size = PlainRows(model, data, scene.bounds), model.nv + scene.rows
    damping = -mu * np.eye(scene.rows)

    def assemble(q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        K, y = np.zeros((size, size)), np.zeros(size)
        K[:n, :n] = pin.crba(model, data, q)
        y[:n] = tau - pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, still)
        pin.computeJointJacobians(model, data)
        rows.gamma(y[n:])
        y[n:] *= -1.0
        J = rows.jacobian()
        K[n:, :n], K[:n, n:] = J, J.T
        if mu:
            K[n:, n:] = damping
        return K, y

    return assemble


def _by_contact_cholesky(scene: Scene, mu: float) -> Answer:
    """Pinocchio's sparse factor of the same matrix, the rows first."""
    model = pin.Model(scene.robot.model)
    data, m, still = model.createData(), scene.rows, np.zeros(model.nv)
    models, datas = raw_constraints(model, pinocchio_constraints_of(scene).constraints, None)
    _pin.init_constraint_dynamics(model, data, models, datas)
    rows, y = PlainRows(model, data, scene.bounds), np.zeros(m + model.nv)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        y[m:] = tau - pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, still)
        rows.gamma(y[:m])
        y[:m] *= -1.0
        factor = _pin.factorise_constraints(model, data, models, datas, q, mu)
        return factor.solve(y)[m:].ravel()  # type: ignore[no-any-return]

    return answer


METHODS: Final = {
    "numpy.linalg.solve": _by_numpy,
    "LAPACK sysv": _by_lapack,
    "Contact Cholesky": _by_contact_cholesky,
}
