"""How the dynamics change with what bodies weigh: M a + h = Y(q, v, a) pi, the regressor form.

Ten numbers a joint, as ``pin.Inertia.toDynamicParameters``: the mass, mass times centre of mass,
and the inertia about the joint's origin xx xy yy xz yz zz.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.dynamics.at_state import weightless


class InertiaPartials:
    """The regressors of one model, in memory of their own."""

    def __init__(self, model: Any) -> None:
        self._model, self._still = model, weightless(model)
        self._data = whole_data(model)
        self.size = 10 * (model.njoints - 1)

    def forces(self, q: Array, v: Array, a: Array) -> Array:
        """Return M a + h by the inertias (nv, size)."""
        return self._rows(pin.computeJointTorqueRegressor(self._model, self._data, q, v, a))

    def momenta(self, q: Array, x: Array) -> Array:
        """Return M x by the inertias (nv, size)."""
        v = np.zeros(len(x))
        return self._rows(pin.computeJointTorqueRegressor(self._still, self._data, q, v, x))

    def _rows(self, regressor: Array) -> Array:
        return np.array(regressor).reshape(-1, self.size)  # a single row comes as a vector

    def mass(self) -> Array:
        """Return the mass of the robot by the inertias (size,)."""
        return np.tile(np.eye(10)[0], self.size // 10)
