"""SRDF: named configurations, the rotors behind the joints, and links that do not collide.

Pinocchio's own reader ends the process at a joint named universe, and at texts where it wants
numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.xml import floats, label, open_xml, place


def read_srdf(
    model: Any, path: Path, *, rotors: bool = False, inverted: Sequence[str] = ()
) -> dict[str, Array]:
    """Return the configurations of an SRDF; joints that the model lacks are left out."""
    # The model gets them too, and with `rotors` these and their armature. Joints that are
    # `inverted` run from child to parent in the tree.
    with place(path):
        root = open_xml(path, "robot")
        if rotors:
            _read_rotors(model, root)
        found: dict[str, Array] = {}
        for state in root.findall("group_state"):
            found.setdefault(state.get("name", ""), _configuration(model, state))
    for name, q in found.items():
        model.referenceConfigurations[name] = q.copy()
    for name in inverted:
        joint = model.joints[model.getJointId(name)] if model.existJointName(name) else None
        if joint is not None and joint.nq == 4:  # the quaternion of a ball, x y z w
            for q in found.values():
                q[joint.idx_q : joint.idx_q + 3] *= -1.0
    return found


def read_exclusions(model: Any, path: Path) -> tuple[frozenset[frozenset[str]], tuple[str, ...]]:
    """Pairs of links that do not collide, and a sentence on links that the model lacks."""
    # With <disable_default_collisions> a link collides with those of <enable_collisions> alone.
    with place(path):
        root = open_xml(path, "robot")
    links = {frame.name for frame in model.frames}
    bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    off, on = (
        {frozenset((e.get("link1", ""), e.get("link2", ""))) for e in root.findall(tag)}
        for tag in ("disable_collisions", "enable_collisions")
    )
    alone = {e.get("link", "") for e in root.findall("disable_default_collisions")}
    of_alone = {frozenset((link, body)) for link in alone for body in bodies}
    pairs = frozenset(p for p in off | (of_alone - on) if len(p) == 2 and p <= links)
    unknown = sorted(alone.union(*off, *on) - links - {""})
    said = f"links of {path.name} that the robot does not have: {listed(unknown)}"
    return pairs, (said,) if unknown else ()


def _read_rotors(model: Any, root: Element) -> None:
    """Set rotor inertias I and gear ratios n, and the armature n^2 I."""
    if root.find("rotor_params") is None:
        raise InvalidModel("it has no <rotor_params>; leave out rotors = true")
    for element, joint in _joints(model, root.findall("rotor_params")):
        model.rotorInertia[joint.idx_v] = _number(element, "mass")  # [kg m^2]
        model.rotorGearRatio[joint.idx_v] = _number(element, "gear_ratio")
        rotor, ratio = model.rotorInertia[joint.idx_v], model.rotorGearRatio[joint.idx_v]
        model.armature[joint.idx_v] = rotor * ratio**2


def _configuration(model: Any, state: Element) -> Array:
    q: Array = np.array(pin.neutral(model))
    for element, joint in _joints(model, [state]):
        where = f"{label(state)}: {label(element)}: value"
        angle = joint.nq == 2 and joint.nv == 1  # whose q is (cos, sin)
        values = floats(element.get("value"), 1 if angle else joint.nq, where)
        if angle:
            values = np.array([np.cos(values[0]), np.sin(values[0])])
        q[joint.idx_q : joint.idx_q + joint.nq] = values
    return q


def _joints(model: Any, groups: list[Element]) -> Iterator[tuple[Element, Any]]:
    """<joint> elements of groups, each with its joint of the model; unknown ones are left out."""
    known = {name: i for i, name in enumerate(model.names) if i}
    for group in groups:
        for element in group.findall("joint"):
            if element.get("name") in known:
                yield element, model.joints[known[element.attrib["name"]]]


def _number(element: Element, key: str) -> float:
    return float(floats(element.get(key), 1, f"{label(element)}: {key}")[0])
