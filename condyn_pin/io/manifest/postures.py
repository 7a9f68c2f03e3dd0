"""Postures: configurations by name, from a robot.toml and from an SRDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidModel, UnknownName, unknown_name
from condyn_pin.io.manifest.srdf import read_srdf


def posture(model: Any, values: Mapping[str, Any], where: str) -> Array:
    """Return the configuration with these values by joint, and neutral otherwise.

    Parameters
    ----------
    model : pin.Model
    values : mapping
        Joint to its configuration; of a joint that is (cos, sin), also its angle [rad].
    where : str
        What an error says first.
    """
    q, joints = np.array(pin.neutral(model)), tuple(model.names)[1:]
    for name, value in values.items():
        if name not in joints:
            raise UnknownName(f"{where}: {unknown_name('joint', name, joints)}")
        joint = model.joints[model.getJointId(name)]
        one = isinstance(value, Real)
        if one and joint.nq == 2 and joint.nv == 1:
            angle = finite(f"{where}: {name}", value, ())
            value = [np.cos(angle), np.sin(angle)]
        elif one and joint.nq == 1:
            value = [value]
        numbers = finite(f"{where}: {name}", value, joint.nq)
        q[joint.idx_q : joint.idx_q + joint.nq] = numbers
    return q


def srdf_postures(
    model: Any, srdf: Path, rotors: bool, inverted: Sequence[str]
) -> dict[str, Array]:
    """Return the postures of an SRDF; joints that the model has not are left out.

    Parameters
    ----------
    model : pin.Model
        It gets the armature of the motors, if there are rotors.
    srdf : Path
    rotors : bool
        Whether the SRDF has rotors to read.
    inverted : sequence of str
        Joints that the tree holds from child to parent.
    """
    if not srdf.is_file():
        raise InvalidModel(f"{srdf}: no such file")
    postures = read_srdf(model, srdf, rotors=rotors)
    for name, q in postures.items():
        model.referenceConfigurations[name] = q.copy()
    if rotors:
        # reflected inertia of a geared rotor: n^2 I
        model.armature = np.array(model.rotorInertia) * np.array(model.rotorGearRatio) ** 2
    for name in inverted:
        joint = model.joints[model.getJointId(name)] if model.existJointName(name) else None
        if joint is not None and joint.nq == 4:  # the quaternion of a ball, x y z w
            for q in postures.values():
                q[joint.idx_q : joint.idx_q + 3] *= -1.0
    return postures
