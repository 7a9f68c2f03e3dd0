"""What a URDF has and the model has not, or the dynamics do not use, a sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element

from condyn_pin._core.names import few
from condyn_pin.constraints.loop import Loop
from condyn_pin.io.description import Body, doubts, tensor
from condyn_pin.io.urdf_closures import alone
from condyn_pin.io.urdf_elements import without_bounds
from condyn_pin.io.xml import not_read

_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

# What <gazebo> says of a link, a joint or all of it, and the texts that mean nothing.
_OF_GAZEBO: Final = (
    "turnGravityOff", "gravity", "static", "springStiffness", "springReference", "dampingFactor",
)  # fmt: skip
_NOTHING: Final[Mapping[str, Sequence[str]]] = {
    **dict.fromkeys(_OF_GAZEBO, ("0", "0.0", "false")), "gravity": ("1", "true")
}  # fmt: skip

# What is read: the elements below each one, and its attributes. All else is counted.
_ELEMENTS: Final[Mapping[str, Sequence[str]]] = {
    "robot": ("link", "joint", "loop_joint", "constraint", "gazebo"),
    "gazebo": ("joint", *_OF_GAZEBO),
    "link": ("inertial", "visual"),  # view draws the latter
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    **dict.fromkeys(("origin", "mass", "inertia", "parent", "child", "axis"), ()),
    **dict.fromkeys(("limit", "dynamics", "mimic"), ()),
}
_ATTRIBUTES: Final[Mapping[str, Sequence[str]]] = {
    "robot": ("name", "version"),
    "gazebo": ("reference",),
    "link": ("name",),
    "inertial": (),
    "mass": ("value",),
    "inertia": _MOMENTS,
    "joint": ("name", "type"),
    "origin": ("xyz", "rpy"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
}


def unused(robot: Element, copy: Element, *, coupled: bool, cuts: Sequence[Loop]) -> Iterator[str]:
    """Say what of a URDF is not used, and what the reader made of what it leaves open.

    Parameters
    ----------
    robot, copy : Element
        The file, and what was copied out of it with every number checked.
    coupled : bool
        Whether joints that mimic another one are coupled.
    cuts : sequence of Loop
        Those that names close, see `urdf_closures`.
    """
    joints = robot.findall("joint")
    still = [joint for joint in joints if joint.get("type") == "fixed"]
    moving = [joint for joint in joints if joint not in still]
    damped, rubbed = (_having(moving, f"dynamics/{key}") for key in ("damping", "friction"))
    if damped:
        yield f"joint damping ({few(damped)}): add Robot.passive_torque to tau"
    if rubbed:
        yield f"joint friction ({few(rubbed)})"
    if limited := _having(moving, "limit"):
        yield f"limits of position, velocity and effort ({len(limited)} joints)"
    if mimics := _having(still, "mimic"):
        yield f"mimic of fixed joints ({few(mimics)})"
    yield from not_read(robot, _ELEMENTS, _ATTRIBUTES)
    if mimics := _having(moving, "mimic"):
        what = "couplings of Robot.loops, which hold in scenes that contain them"
        what = what if coupled else "these joints move on their own"
        yield f"mimic ({few(mimics)}): {what}"
    if free := [joint.attrib["name"] for joint in joints if without_bounds(joint)]:
        yield (
            f"<limit> without lower and upper ({few(free)}): without bounds here; the format has 0 "
            "to 0, which locks them"
        )
    yield from _closures(robot, cuts)
    yield from doubts(_bodies(copy))


def unmodelled(robot: Element, past_the_tree: Iterable[Element]) -> Iterator[str]:
    """Say what changes the motion, and is not in the model: Gazebo's, and of joints cut."""
    for tag in _OF_GAZEBO:
        where = [
            gazebo.get("reference", "the robot")
            for gazebo in robot.findall("gazebo")
            if (said := gazebo.findtext(tag)) and said.strip().lower() not in _NOTHING[tag]
        ]
        if where:
            yield f"<{tag}> of <gazebo> ({few(where)})"
    for joint in past_the_tree:
        dynamics = joint.find("dynamics")
        lost = [] if dynamics is None else [k for k in dynamics.attrib if float(dynamics.attrib[k])]
        if lost:
            yield f"{' and '.join(lost)} of joint {joint.attrib['name']!r}, at which a loop is cut"


def _having(joints: Iterable[Element], path: str) -> list[str]:
    """Return the joints with an element, or with ``element/attribute`` other than zero."""
    tag, _, key = path.partition("/")
    found = ((joint.attrib["name"], joint.find(tag)) for joint in joints)
    return [
        name
        for name, element in found
        if element is not None and (not key or float(element.get(key) or 0))
    ]


def _closures(robot: Element, cuts: Sequence[Loop]) -> Iterator[str]:
    """Say which kinds of joints were guessed from names, and which names close nothing."""
    for kind in ("ball", "weld"):
        if names := [loop.name for loop in cuts if loop.called == kind]:
            yield (
                f"the kind of the joints cut at {few(names)}: {kind}s here, unless [[loops]] of a "
                "robot.toml name the same two frames"
            )
    links, joints = ([e.attrib["name"] for e in robot.findall(tag)] for tag in ("link", "joint"))
    for name, reason in alone(links, joints):
        what = "link" if name in links else "joint"
        yield f"{what} {name!r}: {reason}, so it closes nothing"


def _bodies(copy: Element) -> Iterator[Body]:
    for link in copy.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is not None and inertia is not None:
            about_centre = tensor(*(float(inertia.attrib[key]) for key in _MOMENTS))
            yield link.attrib["name"], float(mass.attrib["value"]), about_centre
