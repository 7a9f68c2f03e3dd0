"""Read a robot from an SDF file (1.5 and later): a tree, and the joints that close its loops.

An SDF model is a graph. Every link, joint and frame x is placed by a pose in another one, and the
poses multiply up to the model frame o,

    oMx = oMbase · baseMx,    base = `relative_to`, else the model (link), the child (joint)
    R   = Rz(yaw) Ry(pitch) Rx(roll)

so that, however the file writes it, the axis a of a joint and the inertia I of a link are

    a in the joint's axes:  oRjᵀ · oRx · a           x = `expressed_in`, else the joint itself
    I in the link's axes:   linkRc · I · linkRcᵀ     c = frame of the `inertial` pose

`sdf_tree` turns the graph into a Pinocchio model. The format: http://sdformat.org/spec
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from math import inf, isnan
from os import PathLike
from types import MappingProxyType
from typing import Any, Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from condyn_pin._pin import pin
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_tree import WORLD, Closure, Description, Joint, Link, SdfRobot, build

__all__ = ["Closure", "SdfRobot", "read_sdf"]

_MODEL: Final = "__model__"
_DIAGONAL: Final = ("ixx", "iyy", "izz")
_OFF_DIAGONAL: Final = ("ixy", "ixz", "iyz")
_UNLIMITED: Final = 1e16  # the format's older way to write an infinite limit
# A tensor typed with few digits may have a principal moment that is zero but for rounding.
_ROUNDING: Final = 1e-12

# What is read below each element; everything else is counted and reported.
_READ: Final[Mapping[str, Container[str]]] = {
    "sdf": ("model", "world"),
    "world": ("model",),
    "model": ("pose", "link", "joint", "frame"),
    "link": ("pose", "inertial"),
    "inertial": ("pose", "mass", "inertia"),
    "inertia": (*_DIAGONAL, *_OFF_DIAGONAL),
    "joint": ("pose", "parent", "child", "axis"),
    "axis": ("xyz", "limit", "dynamics", "use_parent_model_frame"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference"),
    "frame": ("pose",),
}


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
    parts = _parts(model)
    wMo, base = _pose(model)
    if base not in ("", WORLD):
        raise InvalidModel(f"{_label(model)}: pose relative to {base!r}; place it in the world")
    link_of = _links_of(parts, model.get("canonical_link"))
    poses = _model_poses(parts, wMo.inverse())
    return Description(
        name=model.get("name", ""),
        pose=wMo,
        links=tuple(_link(e, n, poses) for n, e in parts.items() if e.tag == "link"),
        joints=tuple(_joint(e, n, poses, link_of) for n, e in parts.items() if e.tag == "joint"),
        frames={n: (link_of[n], poses[n]) for n, e in parts.items() if e.tag == "frame"},
        unread=_unread(sdf),
    )


def _only_model(sdf: Element) -> Element:
    if sdf.tag != "sdf":
        raise InvalidModel(f"the file holds <{sdf.tag}>; a file that starts with <sdf> is needed")
    version = sdf.get("version", "")
    # Before 1.5 an axis without a frame was meant in the axes of the model.
    if not all(p.isdecimal() for p in version.split(".")) or _version(version) < (1, 5):
        raise InvalidModel(f"<sdf> has version {version!r}; 1.5 or later is needed")
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if len(models) != 1:
        names = ", ".join(repr(m.get("name")) for m in models) or "no <model>"
        raise InvalidModel(f"the file has {names}; exactly one <model> is needed")
    for tag in ("model", "include"):
        if models[0].find(tag) is not None:
            raise InvalidModel(f"{_label(models[0])}: <{tag}> in it is not followed; write it out")
    return models[0]


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split("."))


def _parts(model: Element) -> dict[str, Element]:
    """Return links, joints and frames by name, in the order of the file: they share one scope."""
    parts: dict[str, Element] = {}
    for element in model:
        if element.tag not in ("link", "joint", "frame"):
            continue
        name = element.get("name", "")
        if not name.strip() or name in (WORLD, _MODEL):
            raise InvalidModel(f"a <{element.tag}> is named {name!r}; give it a name of its own")
        if name in parts:
            raise InvalidModel(f"{_label(parts[name])} and {_label(element)}: rename one of them")
        parts[name] = element
    if not any(element.tag == "link" for element in parts.values()):
        raise InvalidModel(f"{_label(model)}: no <link>; at least one is needed")
    return parts


def _chain(
    name: str, base: Mapping[str, str], ends: Container[str], parts: Mapping[str, Element]
) -> list[str]:
    """Return `name`, its base, the base of that, and so on up to one of `ends`."""
    chain = {name: None}  # a dict keeps the order and finds members at once
    while name not in ends:
        if base[name] not in base and base[name] not in ends:
            known = unknown_name("link or frame", base[name], base)
            raise InvalidModel(f"{_label(parts[name])}: {known}")
        name = base[name]
        if name in chain:
            raise InvalidModel(
                f"{_label(parts[name])}: {' -> '.join([*chain, name])} are placed in a circle; "
                "place one of them in the model"
            )
        chain[name] = None
    return list(chain)


def _model_poses(parts: Mapping[str, Element], oMw: Any) -> dict[str, Any]:
    """Return oMx of every part x."""
    base, placement = {}, {}
    for name, element in parts.items():
        placement[name], named = _pose(element)
        if element.tag == "joint":
            base[name] = named or _word(element, "child")
        else:
            base[name] = named or element.get("attached_to") or _MODEL
    poses = {_MODEL: pin.SE3.Identity(), WORLD: oMw}
    for name in parts:
        for member in reversed(_chain(name, base, poses, parts)[:-1]):
            poses[member] = poses[base[member]] * placement[member]
    return poses


def _links_of(parts: Mapping[str, Element], canonical: str | None) -> dict[str, str]:
    """Return the link that every part moves with: a joint moves with its child."""
    links = [name for name, element in parts.items() if element.tag == "link"]
    base = {name: name for name in links}
    for name, element in parts.items():
        if element.tag == "joint":
            base[name] = _word(element, "child")
        elif element.tag == "frame":
            base[name] = element.get("attached_to") or canonical or links[0]
    ends = {*links, WORLD}
    return {WORLD: WORLD} | {name: _chain(name, base, ends, parts)[-1] for name in parts}


def _link(element: Element, name: str, poses: Mapping[str, Any]) -> Link:
    inertial = _find(element, "inertial")
    if inertial is None:
        return Link(name, poses[name], None)
    if inertial.get("auto", "false") not in ("false", "0"):
        raise InvalidModel(f"{_label(element)}: <inertial auto>; write its mass and inertia out")
    mass = _number(element, "inertial/mass")
    xx, yy, zz = (_number(element, f"inertial/inertia/{entry}") for entry in _DIAGONAL)
    xy, xz, yz = (_number(element, f"inertial/inertia/{entry}", 0.0) for entry in _OFF_DIAGONAL)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # [kg m^2]
    smallest, _, largest = np.linalg.eigvalsh(tensor)
    if smallest < -_ROUNDING * abs(largest):
        raise InvalidModel(
            f"{_label(element)}: <inertia> has the principal moment {smallest:g}; none may be < 0"
        )
    linkMc, base = _pose(element, "inertial/pose")
    if base not in ("", name):
        linkMc = poses[name].actInv(_pose_of(base, poses, element) * linkMc)
    R = linkMc.rotation
    return Link(name, poses[name], pin.Inertia(mass, linkMc.translation, R @ tensor @ R.T))


def _joint(
    element: Element, name: str, poses: Mapping[str, Any], link_of: Mapping[str, str]
) -> Joint:
    ends = [_word(element, end) for end in ("parent", "child")]
    for end in ends:
        if end not in link_of:
            raise InvalidModel(f"{_label(element)}: {unknown_name('link', end, link_of)}")
    parent, child = (link_of[end] for end in ends)
    if child in (WORLD, parent):
        raise InvalidModel(f"{_label(element)}: joins {parent!r} to {child!r}; name another child")
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
        damping=_number(element, "axis/dynamics/damping", 0.0),
        friction=_number(element, "axis/dynamics/friction", 0.0),
        stiffness=_number(element, "axis/dynamics/spring_stiffness", 0.0),
        reference=_number(element, "axis/dynamics/spring_reference", 0.0),
    )
    if joint.lower > joint.upper:
        raise InvalidModel(
            f"{_label(element)}: limits {joint.lower:g} to {joint.upper:g}; exchange them"
        )
    return joint


def _axis(element: Element, name: str, poses: Mapping[str, Any]) -> NDArray[np.float64] | None:
    xyz = _find(element, "axis/xyz")
    if xyz is None:
        return None
    axis = _floats(xyz.text, 3, f"{_label(element)}: <axis/xyz>")
    if not axis.any():
        raise InvalidModel(f"{_label(element)}: <axis/xyz> is zero; give it a direction")
    flag = _find(element, "axis/use_parent_model_frame")
    in_model = "0" if flag is None else (flag.text or "").strip()
    if in_model not in ("0", "1", "false", "true"):
        raise InvalidModel(
            f"{_label(element)}: <axis/use_parent_model_frame> is {in_model!r}; write 0 or 1"
        )
    frame = xyz.get("expressed_in") or (_MODEL if in_model in ("1", "true") else name)
    if frame != name:
        oRx = _pose_of(frame, poses, element).rotation
        axis = poses[name].rotation.T @ (oRx @ axis)
    axis = axis / np.abs(axis).max()  # first, so that the squares cannot overflow or vanish
    return np.asarray(axis / np.linalg.norm(axis))


def _limit(element: Element, limit: str, unlimited: float) -> float:
    value = _number(element, f"axis/limit/{limit}", unlimited, infinite=True)
    if value < 0 and limit in ("effort", "velocity"):
        return inf  # the format's way to say that it is not enforced
    return float(np.copysign(inf, value)) if abs(value) >= _UNLIMITED else value


def _pose(element: Element, path: str = "pose") -> tuple[Any, str]:
    """Return baseMx and the name of its base, "" for the default one."""
    pose = _find(element, path)
    if pose is None:
        return pin.SE3.Identity(), ""
    base = pose.get("relative_to") or pose.get("frame") or ""
    degrees = pose.get("degrees", "false") not in ("false", "0")
    if degrees or pose.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise InvalidModel(
            f"{_label(element)}: <{path}> has other units; write x y z [m], roll pitch yaw [rad]"
        )
    if not (pose.text or "").strip():
        return pin.SE3.Identity(), base
    x = _floats(pose.text, 6, f"{_label(element)}: <{path}>")
    return pin.SE3(pin.rpy.rpyToMatrix(x[3], x[4], x[5]), x[:3]), base


def _pose_of(name: str, poses: Mapping[str, Any], element: Element) -> Any:
    if name not in poses:
        raise InvalidModel(f"{_label(element)}: {unknown_name('frame', name, poses)}")
    return poses[name]


def _label(element: Element) -> str:
    return f"<{element.tag}> {element.get('name', '')!r}"


def _find(element: Element, path: str) -> Element | None:
    for tag in path.split("/"):
        found = element.findall(tag)
        if len(found) > 1:
            raise InvalidModel(f"{_label(element)}: <{tag}> is there {len(found)} times; keep one")
        if not found:
            return None
        element = found[0]
    return element


def _word(element: Element, tag: str) -> str:
    found = _find(element, tag)
    word = "" if found is None else (found.text or "").strip()
    if not word:
        raise InvalidModel(f"{_label(element)}: no <{tag}>; name its {tag} link")
    return word


def _number(
    element: Element, path: str, default: float | None = None, *, infinite: bool = False
) -> float:
    found = _find(element, path)
    if found is not None:
        return float(_floats(found.text, 1, f"{_label(element)}: <{path}>", infinite)[0])
    if default is None:
        raise InvalidModel(f"{_label(element)}: no <{path}>; one number is needed")
    return default


def _floats(
    text: str | None, count: int, where: str, infinite: bool = False
) -> NDArray[np.float64]:
    words = (text or "").split()
    try:
        values = [float(word) for word in words if "_" not in word]  # Python reads 1_0 as 10
    except ValueError:
        values = []
    if len(values) != count or len(words) != count:
        raise InvalidModel(f"{where} is {text!r}; {count} number(s) are needed")
    if any(isnan(x) or (abs(x) >= _UNLIMITED and not infinite) for x in values):
        raise InvalidModel(f"{where} is {text!r}; finite numbers are needed, less than 1e16")
    return np.array(values)


def _unread(element: Element) -> Counter[str]:
    """Count, by tag, the elements whose content is not read."""
    counts: Counter[str] = Counter()
    for child in element:
        if child.tag not in _READ[element.tag]:
            counts[child.tag] += 1
        elif child.tag in _READ:
            counts += _unread(child)
    return counts
