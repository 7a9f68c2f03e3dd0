"""Gearboxes: no joint of the tree, but a proportion between two hinges.

A gearbox names a reference link. With theta_1 the angle from there to its parent about `axis`, and
theta_2 the one to its child about `axis2`, both zero as drawn, the format asks for

    theta_2 = -ratio theta_1

The angles are coordinates of hinges between the reference link and the two others: theta = q if
the hinge has the same direction and the reference link is its parent, and each of the two that is
the other way round changes the sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.errors import InvalidModel
from condyn_pin.io.sdf_types import Axis, Gear, Joint


def coupling_of(gearbox: Joint, joints: Sequence[Joint]) -> Coupling:
    """Return the coupling q_a = ratio q_b of a gearbox; a is the hinge of its child."""
    gear = gearbox.gear
    assert gear is not None  # chosen_joints has looked
    hinge_1, sign_1 = _hinge(gearbox, gear, gearbox.parent, gearbox.axis, joints)
    hinge_2, sign_2 = _hinge(gearbox, gear, gearbox.child, gearbox.axis2, joints)
    ratio = -gear.ratio * sign_1 * sign_2
    return Coupling(hinge_2.name, hinge_1.name, ratio, name=gearbox.name)


def _hinge(
    gearbox: Joint, gear: Gear, link: str, axis: Axis, joints: Sequence[Joint]
) -> tuple[Joint, float]:
    """Return the hinge between the reference link and another, and the sign of theta / q."""
    for hinge in joints:
        if hinge.kind not in ("revolute", "continuous"):
            continue
        if {hinge.parent, hinge.child} != {gear.reference, link}:
            continue
        turns = 1.0 if hinge.child == link else -1.0
        a = gearbox.pose.rotation @ np.asarray(axis.direction)
        b = hinge.pose.rotation @ np.asarray(hinge.axis.direction)
        if np.linalg.norm(np.cross(a, b)) > tolerances.PARALLEL:
            raise InvalidModel(
                f"joint {gearbox.name!r} is a gearbox, and its axis for {link!r} is not that of "
                f"the hinge {hinge.name!r}: make them parallel"
            )
        return hinge, float(turns * np.sign(a @ b))
    raise InvalidModel(
        f"joint {gearbox.name!r} is a gearbox, and no revolute joint connects {link!r} to its "
        f"reference body {gear.reference!r}: add one, or read the gearbox as another type with "
        f"kinds={{{gearbox.name!r}: ...}}"
    )
