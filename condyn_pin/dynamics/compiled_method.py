"""Recursions over a tree whose bodies are held at the world: `constrainedABA` and `pv`, compiled.

A scene crosses the border as numbers: what is compiled has a Pinocchio of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import constrained_aba
from condyn_pin._core.joints import axes
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.bound import PinocchioConstraint, placement
from condyn_pin.dynamics.compiled.arrays import of_model
from condyn_pin.dynamics.solvers.base import Singular
from condyn_pin.errors import UnsupportedBackend


class CompiledMethod:
    """One of the methods that are compiled, at work on one model with the constraints of a scene.

    Parameters
    ----------
    name : str
        One of ``methods`` of the compiled module.
    model : pin.Model
    constraints : sequence of PinocchioConstraint
    drift : Baumgarte or None
    mu : float
        [1/kg]
    accuracy : float
        What ends the iterations: the method says of what.
    limit : int
        Of iterations.
    module : module, optional
        Where it is compiled; `constrained_aba` by default.
    """

    def __init__(
        self,
        name: str,
        model: Any,
        constraints: Sequence[PinocchioConstraint],
        drift: Baumgarte | None,
        *,
        mu: float,
        accuracy: float,
        limit: int,
        module: Any = None,
    ) -> None:
        module = module or constrained_aba()
        numbers = _of_model(model, module.joints) | _of_constraints(constraints, drift)
        settings = {"mu": float(mu), "accuracy": float(accuracy), "limit": int(limit)}
        self.bound = module.Bound(name, **numbers, **settings)
        self.iterations, self._nv = 0, int(model.nv)
        self._rows = sum(c.size for c in constraints)

    def acceleration(self, q: Array, v: Array, tau: Array) -> Array:
        """Return a (nv,); Singular where the matrix of the method is not positive definite."""
        a = np.empty(self._nv)
        self.iterations = self.bound.solve(q, v, tau, a)
        if not self.iterations:
            raise Singular
        return a

    def many(self, Q: Array, V: Array, TAU: Array) -> Array:
        """Return a (k, nv) of k states, without the GIL; NaN where `acceleration` is `Singular`."""
        A = np.empty((len(Q), self._nv))
        self.bound.solve_many(Q, V, TAU, A)
        return A

    def lam(self) -> Array:
        """Return the forces of Pinocchio's rows."""
        lam = np.empty(self._rows)
        self.bound.lam(lam)
        return lam


def _of_model(model: Any, compiled: Collection[str]) -> dict[str, Any]:
    """Return everything about a model that the equations read, for any joint that is compiled."""
    q = pin.neutral(model)
    subspaces = np.zeros((model.njoints - 1, 6, 2))
    for S, joint in zip(subspaces, list(model.joints)[1:], strict=True):
        if joint.shortname() not in compiled:
            raise UnsupportedBackend(
                f"joint {model.names[joint.id]!r} is a {joint.shortname()}, which is not compiled "
                "in condyn_pin_native; use LCABA() or Proximal()"
            )
        if joint.nv <= 2:  # what larger joints move along is said by their kind
            S[:, : joint.nv] = axes(joint, q)
    numbers = of_model(model)
    bodies = numbers["joints"][:, 3:]  # behind one axis, which does for joints of one coordinate
    return {
        "kinds": numbers["kinds"],
        "parents": numbers["parents"].tolist(),
        "joints": np.hstack([subspaces.reshape(-1, 12), bodies]),
        "gravity": numbers["gravity"],
        "armature": numbers["armature"],
    }


def _of_constraints(
    constraints: Sequence[PinocchioConstraint], drift: Baumgarte | None
) -> dict[str, Any]:
    """Return the constraints as Pinocchio takes them, with the gains of drift control."""
    integers = [(c.size, c.joint1, c.joint2) for c in constraints]
    Kp, Kd = (drift.Kp, drift.Kd) if drift else (0.0, 0.0)
    numbers = [
        (*placement(c.placement1), *placement(c.placement2), Kp if c.anchored else 0.0, Kd)
        for c in constraints
    ]
    return {
        "constraint_integers": np.array(integers, np.int32).reshape(-1, 3),
        "constraint_numbers": np.array(numbers, float).reshape(-1, 26),
    }
