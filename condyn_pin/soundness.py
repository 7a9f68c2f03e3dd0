"""Models on which Pinocchio's algorithms are silently wrong, or crash: they are refused."""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.errors import InvalidModel


def check_model(model: Any) -> None:
    """Refuse a model on which Pinocchio's algorithms are silently wrong or crash."""
    if len(model.mimicking_joints):
        names = ", ".join(model.names[i] for i in model.mimicking_joints)
        raise InvalidModel(
            f"mimic joints ({names}): Pinocchio's constrained dynamics refuse them; "
            "load the model without mimic, as independent joints"
        )
    if not model.check(model.createData()):
        raise InvalidModel(
            "the joints were not added depth-first, and Pinocchio's crba is silently wrong on "
            "such a model; add the children of a joint before its siblings"
        )
    check_inertias(model)


def check_inertias(model: Any) -> None:
    """Refuse a joint that moves no inertia: M would be singular."""
    M = np.array(pin.crba(model, model.createData(), pin.neutral(model)))
    diagonal = np.diag(M)
    if not np.isfinite(M).all():
        raise InvalidModel("the mass matrix is not finite: a mass, inertia or placement is NaN")
    if model.nv == 0:
        raise InvalidModel("the model has no degree of freedom")
    negative = [name for name, Y in zip(model.names, model.inertias, strict=True) if Y.mass < 0]
    if negative:
        raise InvalidModel(f"the mass on {', '.join(negative)} is negative: it must be >= 0")
    bad = np.flatnonzero(diagonal <= tolerances.MASSLESS * diagonal.max())
    if bad.size:
        names = dict.fromkeys(_joint_of(model, int(i)) for i in bad)
        raise InvalidModel(
            f"no inertia moves with {', '.join(names)}: M is singular there; give the body a mass "
            "and an inertia, give the joint an armature, or lock it"
        )
    _check_combinations(model)


def _check_combinations(model: Any) -> None:
    """Refuse joints that move no inertia together.

    A massless body between two joints is fine unless one can turn without the other: then M is
    singular at every configuration, also at this one, which has nothing special.
    """
    q = pin.integrate(model, pin.neutral(model), np.linspace(0.3, 0.7, model.nv))
    M = np.array(pin.crba(model, model.createData(), q))
    scale = 1 / np.sqrt(M.diagonal())
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    if values[0] <= tolerances.MASSLESS:
        moved = np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)
        names = dict.fromkeys(_joint_of(model, int(i)) for i in moved)
        raise InvalidModel(
            f"{', '.join(names)} can move together without moving inertia: M is singular or "
            "indefinite; look for a body between them without mass, or an inertia below zero"
        )


def _joint_of(model: Any, velocity_index: int) -> str:
    for i in range(1, model.njoints):
        joint = model.joints[i]
        if joint.idx_v <= velocity_index < joint.idx_v + joint.nv:
            return str(model.names[i])
    raise IndexError(velocity_index)
