"""What a URDF has and the constrained dynamics do not use, a sentence each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element

from condyn_pin._core.names import few
from condyn_pin.constraints.loop import Loop
from condyn_pin.io.inertia import Body, doubts, tensor
from condyn_pin.io.urdf_check import without_bounds
from condyn_pin.io.urdf_closures import alone

_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

# What is read: the elements below each one, and its attributes. All else is counted.
_READ: Final[Mapping[str, tuple[frozenset[str], frozenset[str]]]] = {
    tag: (frozenset(elements.split()), frozenset(attributes.split()))
    for tag, elements, attributes in (
        ("robot", "link joint", "name version"),
        ("link", "inertial", "name"),
        ("inertial", "origin mass inertia", ""),
        ("mass", "", "value"),
        ("inertia", "", " ".join(_MOMENTS)),
        ("joint", "origin parent child axis limit dynamics mimic", "name type"),
        ("origin", "", "xyz rpy"),
        ("parent", "", "link"),
        ("child", "", "link"),
        ("axis", "", "xyz"),
        ("limit", "", "lower upper effort velocity"),
        ("dynamics", "", "damping friction"),
        ("mimic", "", "joint multiplier offset"),
    )
}


def unused(robot: Element) -> Iterator[str]:
    """Say what of a URDF is not used."""
    joints = [joint for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    for attribute in ("damping", "friction"):
        names = [joint.get("name", "?") for joint in joints if _dynamics(joint, attribute)]
        if names:
            advice = ": add Robot.passive_torque to tau" if attribute == "damping" else ""
            yield f"joint {attribute} ({few(names)}){advice}"
    limited = [joint.get("name", "?") for joint in joints if joint.find("limit") is not None]
    if limited:
        yield f"limits of position, velocity and effort ({len(limited)} joints)"
    still = [
        joint.get("name", "?")
        for joint in robot.findall("joint")
        if joint.get("type") == "fixed" and joint.find("mimic") is not None
    ]
    if still:
        yield f"mimic of fixed joints ({few(still)})"
    elements, attributes = Counter[str](), Counter[str]()
    _count(robot, elements, attributes)
    for what, counts in (("elements", elements), ("attributes", attributes)):
        if counts:
            listed = ", ".join(f"{n} {name}" for name, n in sorted(counts.items()))
            yield f"{what} that are not read: {listed}"


def doubtful(
    robot: Element, copy: Element, *, mimicking: list[str], coupled: bool, cuts: Sequence[Loop]
) -> Iterator[str]:
    """Say what the reader made of a file that leaves it open.

    Parameters
    ----------
    robot, copy : Element
        The file, and what was copied out of it with every number checked.
    mimicking : list of str
        Joints that mimic another one.
    coupled : bool
        Whether these are coupled.
    cuts : sequence of Loop
        Those that names close, see `urdf_closures`.
    """
    if mimicking:
        what = "couplings of Robot.loops, which hold in scenes that contain them"
        what = what if coupled else "these joints move on their own"
        yield f"mimic ({few(mimicking)}): {what}"
    free = [j.get("name", "?") for j in robot.findall("joint") if without_bounds(j)]
    if free:
        yield (
            f"<limit> without lower and upper ({few(free)}): without bounds here; the format has 0 "
            "to 0, which locks them"
        )
    for kind in ("ball", "weld"):
        if names := [loop.name for loop in cuts if loop.called == kind]:
            yield (
                f"the kind of the joints cut at {few(names)}: {kind}s here, unless [[loops]] of a "
                "robot.toml name the same two frames"
            )
    links, joints = ([e.get("name", "") for e in robot.findall(tag)] for tag in ("link", "joint"))
    for name, reason in alone(links, joints):
        what = "link" if name in links else "joint"
        yield f"{what} {name!r}: {reason}, so it closes nothing"
    yield from doubts(_bodies(copy))


def _bodies(copy: Element) -> Iterator[Body]:
    for link in copy.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is not None and inertia is not None:
            about_centre = tensor(*(float(inertia.attrib[key]) for key in _MOMENTS))
            yield link.attrib["name"], float(mass.attrib["value"]), about_centre


def _count(element: Element, elements: Counter[str], attributes: Counter[str]) -> None:
    """Count what is not read in an element and below it."""
    below, own = _READ[element.tag]
    attributes.update(f"{_short(key)} of <{element.tag}>" for key in element.attrib.keys() - own)
    for child in element:
        if not isinstance(child.tag, str):  # a comment
            continue
        if child.tag in below:
            _count(child, elements, attributes)
        else:
            elements[f"<{_short(child.tag)}>"] += 1


def _short(name: str) -> str:
    """Return a name without the address of its namespace."""
    return name.rpartition("}")[2]


def _dynamics(joint: Element, attribute: str) -> float:
    element = joint.find("dynamics")
    return 0.0 if element is None else float(element.get(attribute) or 0)
