"""Read a robot from an SDF file (1.5 and later): a tree, and the joints that close its loops.

With oMx the pose of a part x in the model frame o (`sdf_graph`), the axis a of a joint j and the
inertia I of a link are, however the file writes them,

    a in the joint's axes:  oRjᵀ · oRx · a           x = `expressed_in`, else the joint itself
    I in the link's axes:   linkRc · I · linkRcᵀ     c = frame of the `inertial` pose

The other files of the reader: `sdf_xml` finds elements and reads their numbers, `sdf_types` has the
values that are handed on, `sdf_span` chooses the joints of the tree, `sdf_tree` builds the model.
The format: http://sdformat.org/spec
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import copysign, inf
from os import PathLike
from types import MappingProxyType
from typing import Any, Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from condyn_pin._pin import pin
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_graph import MODEL, links_of, model_poses, parts_of, pose_in, pose_of
from condyn_pin.io.sdf_tree import build
from condyn_pin.io.sdf_types import WORLD, Closure, Description, Joint, Link, SdfRobot
from condyn_pin.io.sdf_xml import UNLIMITED, find, floats, label, number, unread, word

__all__ = ["Closure", "SdfRobot", "read_sdf"]

# A tensor typed with few digits may have a principal moment that is zero but for rounding.
_ROUNDING: Final = 1e-12


def read_sdf(
    path: str | PathLike[str],
    *,
    root: str | None = None,
    root_joint: Any | None = None,
    kinds: Mapping[str, str] = MappingProxyType({}),
    drop: Sequence[str] = (),
) -> SdfRobot:
    """Read an SDF file into a Pinocchio model and the closures of its loops.

    Parameters
    ----------
    path : str or path
        File with exactly one model.
    root : str, optional
        Link on which the tree stands. By default the one that is no joint's child.
    root_joint : pin.JointModel, optional
        Joint between the world and the root link, such as ``pin.JointModelFreeFlyer()``: its
        configuration replaces the root link's pose of the file. By default the root link is
        fixed where the file puts it.
    kinds : mapping of str to str
        Joint name to the type that replaces the file's: fixed, revolute, continuous, prismatic
        or ball.
    drop : sequence of str
        Joints to leave out.

    Returns
    -------
    SdfRobot
        The model, its closures, its springs, and what the file has and the model does not use.

    Raises
    ------
    InvalidModel
        The file cannot be read, or what it says cannot be made a model.
    UnknownName
        `root`, `kinds` or `drop` has a name that the file or the reader does not know.

    Notes
    -----
    A joint whose child link already hangs on the tree closes a loop: it is cut and becomes a
    closure. Of several parent joints of a link, the first in the file makes the tree, unless the
    root does not lead to it. Only ball and fixed joints can be cut. The file draws the model at
    ``pin.neutral(model)``, where therefore every loop is closed. A continuous joint is one angle
    without limits.
    """
    try:
        return build(_parse(path), root, root_joint, kinds, drop)
    except InvalidModel as error:
        error.args = (f"{path}: {error}",)
        raise


def _parse(path: str | PathLike[str]) -> Description:
    try:
        sdf = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError, ValueError, LookupError) as error:
        raise InvalidModel(f"cannot be read as XML: {error}") from error
    model = _only_model(sdf)
    parts = parts_of(model)
    wMo, base = pose_in(model)
    if base not in ("", WORLD):
        raise InvalidModel(f"{label(model)}: pose relative to {base!r}; place it in the world")
    link_of = links_of(parts, model.get("canonical_link"))
    poses = model_poses(parts, wMo.inverse())

    def tagged(tag: str) -> list[tuple[str, Element]]:
        return [(name, element) for name, element in parts.items() if element.tag == tag]

    return Description(
        name=model.get("name", ""),
        pose=wMo,
        links=tuple(Link(n, poses[n], _inertia(e, n, poses)) for n, e in tagged("link")),
        joints=tuple(_joint(e, n, poses, link_of) for n, e in tagged("joint")),
        frames={n: (link_of[n], poses[n]) for n, _ in tagged("frame")},
        unread=unread(sdf),
    )


def _only_model(sdf: Element) -> Element:
    if sdf.tag != "sdf":
        raise InvalidModel(f"the file holds <{sdf.tag}>; a file that starts with <sdf> is needed")
    version = sdf.get("version", "")
    parts = version.split(".")
    # Before 1.5 an axis without a frame was meant in the axes of the model.
    if not all(part.isdecimal() for part in parts) or tuple(map(int, parts)) < (1, 5):
        raise InvalidModel(f"<sdf> has version {version!r}; 1.5 or later is needed")
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if len(models) != 1:
        names = ", ".join(repr(m.get("name")) for m in models) or "no <model>"
        raise InvalidModel(f"the file has {names}; exactly one <model> is needed")
    if models[0].get("placement_frame"):
        raise InvalidModel("<model> has a placement_frame, which is not supported; write its pose")
    for tag in ("model", "include"):
        if models[0].find(tag) is not None:
            raise InvalidModel(f"{label(models[0])}: <{tag}> in it is not followed; write it out")
    return models[0]


def _inertia(element: Element, name: str, poses: Mapping[str, Any]) -> Any | None:
    """Return the inertia of a link in its own frame; None if the file gives none."""
    inertial = find(element, "inertial")
    if inertial is None:
        return None
    if inertial.get("auto", "false") not in ("false", "0"):
        raise InvalidModel(f"{label(element)}: <inertial auto>; write its mass and inertia out")
    mass = number(element, "inertial/mass")
    xx, yy, zz = (number(element, f"inertial/inertia/i{ab}") for ab in ("xx", "yy", "zz"))
    xy, xz, yz = (number(element, f"inertial/inertia/i{ab}", 0.0) for ab in ("xy", "xz", "yz"))
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # [kg m^2]
    smallest, _, largest = np.linalg.eigvalsh(tensor)
    if smallest < -_ROUNDING * abs(largest):
        raise InvalidModel(
            f"{label(element)}: <inertia> has the principal moment {smallest:g}; none may be < 0"
        )
    linkMc, base = pose_in(element, "inertial/pose")
    if base not in ("", name):
        linkMc = poses[name].actInv(pose_of(base, poses, element) * linkMc)
    R = linkMc.rotation
    return pin.Inertia(mass, linkMc.translation, R @ tensor @ R.T)


def _joint(
    element: Element, name: str, poses: Mapping[str, Any], link_of: Mapping[str, str]
) -> Joint:
    ends = [word(element, end) for end in ("parent", "child")]
    for end in ends:
        if end not in link_of:
            raise InvalidModel(f"{label(element)}: {unknown_name('link', end, link_of)}")
    parent, child = (link_of[end] for end in ends)
    if child in (WORLD, parent):
        raise InvalidModel(f"{label(element)}: joins {parent!r} to {child!r}; name another child")
    joint = Joint(
        name=name,
        kind=element.get("type", ""),
        parent=parent,
        child=child,
        pose=poses[name],
        axis=_axis(element, name, poses),
        lower=_limit(element, "lower", -inf),
        upper=_limit(element, "upper", inf),
        effort=_limit(element, "effort", inf),
        velocity=_limit(element, "velocity", inf),
        damping=number(element, "axis/dynamics/damping", 0.0),
        friction=number(element, "axis/dynamics/friction", 0.0),
        stiffness=number(element, "axis/dynamics/spring_stiffness", 0.0),
        reference=number(element, "axis/dynamics/spring_reference", 0.0),
    )
    if joint.lower > joint.upper:
        raise InvalidModel(
            f"{label(element)}: limits {joint.lower:g} to {joint.upper:g}; exchange them"
        )
    return joint


def _axis(element: Element, name: str, poses: Mapping[str, Any]) -> NDArray[np.float64] | None:
    xyz = find(element, "axis/xyz")
    if xyz is None:
        return None
    axis = floats(xyz.text, 3, f"{label(element)}: <axis/xyz>")
    if not axis.any():
        raise InvalidModel(f"{label(element)}: <axis/xyz> is zero; give it a direction")
    flag = find(element, "axis/use_parent_model_frame")
    in_model = "0" if flag is None else (flag.text or "").strip()
    if in_model not in ("0", "1", "false", "true"):
        raise InvalidModel(
            f"{label(element)}: <axis/use_parent_model_frame> is {in_model!r}; write 0 or 1"
        )
    frame = xyz.get("expressed_in") or (MODEL if in_model in ("1", "true") else name)
    if frame != name:
        oRx = pose_of(frame, poses, element).rotation
        axis = poses[name].rotation.T @ (oRx @ axis)
    axis = axis / np.abs(axis).max()  # first, so that the squares cannot overflow or vanish
    return np.asarray(axis / np.linalg.norm(axis))


def _limit(element: Element, limit: str, unlimited: float) -> float:
    value = number(element, f"axis/limit/{limit}", unlimited, infinite=True)
    if value < 0 and limit in ("effort", "velocity"):
        return inf  # the format's way to say that it is not enforced
    return copysign(inf, value) if abs(value) >= UNLIMITED else value
