"""Pinocchio's own constraints, `pin.RigidConstraintModel`, as a contact or a loop.

    pin.RigidConstraintModel                   here
    -----------------------------------------  -----------------------------------------------------
    CONTACT_3D, CONTACT_6D between two joints  Loop ball, weld: frame_a, frame_b its joints 1 and 2
    ... of a joint with the world              PointContact, SurfaceContact
    ... second placement 1, and Kp = 0         without an anchor: nothing says where it belongs
    LOCAL_WORLD_ALIGNED                        axes = "world"
    LOCAL                                      axes of joint 1: where it is the world's, its frame
    Kp, Kd                                     drift = Baumgarte(Kd / 2, sqrt(Kp))

Its rows in LOCAL_WORLD_ALIGNED are those in LOCAL, turned by c1, and so is lambda_c.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, Final

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint import Constraint, FramedModel
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.places import by_name, frame_text
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.errors import InvalidArgument, InvalidConstraint

_POINT, _FRAME = pin.ContactType.CONTACT_3D, pin.ContactType.CONTACT_6D

# Fields that `pin.constraintDynamics` does not read.
_IGNORED: Final = {
    "desired_contact_placement": pin.SE3.Identity(),
    "desired_contact_velocity": pin.Motion.Zero(),
    "desired_contact_acceleration": pin.Motion.Zero(),
}


def rigid_constraint(machine: FramedModel, rigid: Any, i: int) -> Constraint:
    """Constraint i of Pinocchio's as one of a machine, or InvalidConstraint."""
    name = rigid.name or f"constraint {i}"
    _check(machine.model, rigid, name)
    try:
        drift = _drift(rigid, name)
        one, two = (
            by_name(machine, frame_text(f"joint {k}", (joint, placement)))
            for k, joint, placement in (
                (1, rigid.joint1_id, rigid.joint1_placement),
                (2, rigid.joint2_id, rigid.joint2_placement),
            )
        )
    except InvalidArgument as error:
        raise InvalidConstraint(f"{name}: {error}") from error
    axes = "world" if rigid.reference_frame == pin.LOCAL_WORLD_ALIGNED else None
    point, place = rigid.type == _POINT, rigid.joint2_placement
    if rigid.joint1_id == 0 or rigid.joint2_id:
        axes = axes or (None if rigid.joint1_id else one)
        return Loop(one, two, "ball" if point else "weld", name=name, axes=axes, drift=drift)
    anchor = None
    if (drift and drift.Kp) or place != pin.SE3.Identity():
        anchor = tuple(place.translation if point else pin.SE3ToXYZQUAT(place))
    if point:
        return PointContact(one, anchor=anchor, name=name, axes=axes, drift=drift)
    return SurfaceContact(one, anchor=anchor, name=name, axes=axes, drift=drift)


def _check(model: Any, rigid: Any, name: str) -> None:
    """Refuse what nothing here, or nothing in Pinocchio, takes from a constraint."""
    if rigid.type not in (_POINT, _FRAME):
        raise InvalidConstraint(f"{name}: type = {rigid.type}; CONTACT_3D or CONTACT_6D is needed")
    if rigid.reference_frame not in (pin.LOCAL, pin.LOCAL_WORLD_ALIGNED):
        raise InvalidConstraint(
            f"{name}: reference_frame = {rigid.reference_frame}; LOCAL or LOCAL_WORLD_ALIGNED is "
            "needed"
        )
    for field in ("joint1_id", "joint2_id"):
        if getattr(rigid, field) >= model.njoints:
            raise InvalidConstraint(
                f"{name}: {field} = {getattr(rigid, field)}, and the model has joints 0 to "
                f"{model.njoints - 1}; it was made for another one"
            )
    if _pin.is_stale(model, rigid):
        raise InvalidConstraint(
            f"{name}: it was made for other joints or another model, whose columns Pinocchio 3.9 "
            "keeps; make a new RigidConstraintModel"
        )
    for field, default in _IGNORED.items():
        if getattr(rigid, field) != default:
            raise InvalidConstraint(
                f"{name}: its {field} is set, and pin.constraintDynamics ignores it; leave it out, "
                "and drive a constraint along a path with Driven"
            )


def _drift(rigid: Any, name: str) -> Baumgarte | None:
    """Stabilisation of its gains, None without any; InvalidConstraint where rows differ."""
    Kp, Kd = _pin.baumgarte_gains(rigid)
    for gain, values in (("Kp", Kp), ("Kd", Kd)):
        if np.ptp(values) > 0.0 or not np.isfinite(values).all() or values[0] < 0.0:
            raise InvalidConstraint(
                f"{name}: {gain} = {values.tolist()}; one number >= 0 for all rows is needed"
            )
    return Baumgarte(Kd[0] / 2.0, sqrt(Kp[0])) if Kp[0] or Kd[0] else None
