"""Pinocchio's lists of constraints, which may be read but not resized.

`pin.constraintDynamics` and `pin.lcaba` size their memory once. Called with more constraints than
that, Pinocchio 4 answers wrong numbers and corrupts the heap; with fewer, wrong numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.bound import PinocchioConstraint
from condyn_pin.errors import StaleModel


def _refuse(*_: Any) -> NoReturn:
    raise StaleModel(
        "the raw lists of a workspace keep their length: Pinocchio's memory is sized for it; "
        "workspace.use(scene) changes the constraints"
    )


class ConstraintModels(pin.StdVec_RigidConstraintModel):  # type: ignore[misc]
    """The RigidConstraintModels of a workspace."""

    append = extend = insert = __setitem__ = __delitem__ = _refuse


class ConstraintDatas(pin.StdVec_RigidConstraintData):  # type: ignore[misc]
    """The RigidConstraintDatas of a workspace."""

    append = extend = insert = __setitem__ = __delitem__ = _refuse


def raw_constraints(
    model: Any, constraints: Sequence[PinocchioConstraint], drift: Baumgarte | None
) -> tuple[ConstraintModels, ConstraintDatas]:
    """Return Pinocchio's objects of the constraints."""
    models, datas = ConstraintModels(), ConstraintDatas()
    for constraint in constraints:
        made = constraint.to_pinocchio(model)
        if drift:
            _pin.set_baumgarte(made, drift.Kp if constraint.anchored else 0.0, drift.Kd)
        pin.StdVec_RigidConstraintModel.append(models, made)
        pin.StdVec_RigidConstraintData.append(datas, made.createData())
    return models, datas


def weightless(model: Any) -> Any:
    """Return a copy of a model without gravity."""
    copy = pin.Model(model)
    copy.gravity = pin.Motion.Zero()
    return copy
