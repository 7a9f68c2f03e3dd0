"""Equalities of a plain MJCF file.

connect   a point of body 1, and the point of body 2 that is there as the model is drawn
weld      the pose of body 2 in body 1, as drawn or as `relpose` says; or two sites, as above
joint     q1 - ref1 = c0 + c1 (q2 - ref2) + ..., here up to c1
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.mjcf_types import WORLD, Closure, End, Gear
from condyn_pin.io.mjcf_xml import Attributes


def read_equality(
    said: Attributes, tag: str, name: str, sites: Mapping[str, End]
) -> Closure | Gear | str:
    """Return a closure, a gear, or the sentence that says why there is none.

    Parameters
    ----------
    said : Attributes
    tag : {"connect", "weld", "joint"}
    name : str
        Name of the constraint.
    sites : mapping of str to End
    """
    if tag == "joint":
        return _gear(said, name)
    if "site1" in said or "site2" in said:
        for key in said.given("body1", "body2", "anchor", "relpose"):
            said.refuse(key, "an equality has bodies or sites, not both")
        ends = _site(said, "site1", sites), _site(said, "site2", sites)
    elif tag == "connect":
        anchor = pin.SE3(np.eye(3), said.floats("anchor", 3))
        ends = End(_body(said), anchor), End(said.text("body2", WORLD), None)
    else:
        ends = _weld(said)
    if ends[0].body == ends[1].body:
        raise InvalidModel(f"{said.label}: both sides are on {ends[0].body!r}")
    held = tag == "weld" and said.number("torquescale", 1.0) != 0
    return Closure(name, "weld" if held else "ball", ends)


def _body(said: Attributes) -> str:
    if not said.text("body1"):
        raise InvalidModel(f"{said.label}: no body1 and no site1; name two bodies or two sites")
    return said.text("body1")


def _site(said: Attributes, key: str, sites: Mapping[str, End]) -> End:
    name = said.text(key)
    if name not in sites:
        raise InvalidModel(f"{said.label}: {key}: {unknown_name('site', name, sites)}")
    return sites[name]


def _weld(said: Attributes) -> tuple[End, End]:
    """Return the two ends, at the anchor: a point of body 2, its origin unless the file says."""
    anchor = End(
        said.text("body2", WORLD), pin.SE3(np.eye(3), said.floats("anchor", 3, np.zeros(3)))
    )
    relpose = said.floats("relpose", 7, np.zeros(7))
    if not relpose[3:].any():
        # as drawn: the first end is where the second one is
        ends = End(_body(said), None), anchor
        return ends
    w, x, y, z = relpose[3:] / np.linalg.norm(relpose[3:])
    return End(
        _body(said), pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), relpose[:3])
    ), anchor


def _gear(said: Attributes, name: str) -> Gear | str:
    if said.count("polycoef") > 5:
        said.refuse("polycoef", "five numbers at most are needed")
    c = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    given = said.floats("polycoef", said.count("polycoef"), np.empty(0))
    c[: given.size] = given
    if not said.text("joint1"):
        raise InvalidModel(f"{said.label}: no joint1; name a joint")
    return read_polynomial(name, said.text("joint1"), said.text("joint2"), c)


def read_polynomial(name: str, joint1: str, joint2: str, c: Array) -> Gear | str:
    """Return a gear, or the sentence that says why the polynomial is none."""
    if not joint2:
        return f"equality {name!r}: it holds joint {joint1!r} still, which is not done here"
    if c[2:].any() or c[1] == 0:
        return f"equality {name!r}: polycoef is {c.tolist()}, and only a proportion is used"
    return Gear(name, joint1, joint2, ratio=float(c[1]), shift=float(c[0]))
