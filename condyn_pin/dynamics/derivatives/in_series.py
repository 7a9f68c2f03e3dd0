"""Joints whose axes turn with their own q, as joints in series.

    v_J = S(q) v

Pinocchio's derivatives of velocities, accelerations and torques, and its Coriolis matrix, take S
for constant in the axes of the body. Where it is not, and the joint is made of others
(SphericalZYX, Universal, Composite), the same joint as its parts in series, with nothing between
them, has the same q, v, M and h, and every S is constant. What turns still is not made of other
joints: `condyn_pin.dynamics.derivatives.carried`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from condyn_pin._core._pin import pin
from condyn_pin._core.joints import turning
from condyn_pin.constraints.rows.any_bound import AnyBound


def in_series(model: Any, bounds: Sequence[AnyBound]) -> tuple[Any, tuple[AnyBound, ...]]:
    """Return model and constraints with such joints in series; the same ones if there are none."""
    if not turning(model):
        return model, tuple(bounds)
    series, last = pin.Model(), [0]
    for i in range(1, model.njoints):
        parent, placement = last[model.parents[i]], model.jointPlacements[i]
        for k, (joint, at) in enumerate(_parts(model.joints[i])):
            parent = series.addJoint(parent, joint, placement * at, f"{model.names[i]}.{k}")
            placement = pin.SE3.Identity()
        series.inertias[parent] = model.inertias[i]
        last.append(parent)
    series.armature, series.gravity = model.armature, model.gravity
    return series, tuple(bound.moved(last) for bound in bounds)


def _parts(joint: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the joints that one is made of, each with its placement on the one before."""
    name, here = joint.shortname(), pin.SE3.Identity()
    if name == "JointModelSphericalZYX":
        yield from (
            (kind(), here) for kind in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        )
    elif name == "JointModelUniversal":
        universal = joint.extract()
        for axis in (universal.axis1, universal.axis2):
            yield pin.JointModelRevoluteUnaligned(*axis.tolist()), here
    elif name == "JointModelComposite":
        composite = joint.extract()
        for part, at in zip(composite.joints, composite.jointPlacements, strict=True):
            for each, within in _parts(part):
                yield each, at * within
                at = here
    else:
        yield joint, here
