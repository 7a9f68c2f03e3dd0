"""URDF: checked here, read by Pinocchio, its loops closed as authors write them beside the tree.

Pinocchio's parser prints where it should raise, drops the mass of a link whose numbers it cannot
read, and accepts NaN. So it gets a copy of the file with what was checked and nothing else: no
meshes, no extensions, numbers in one spelling. A URDF is a tree of hinges and sliders; conventions
add what is missing:

    <mimic>              q = multiplier q_other + offset, a `Coupling`
    a second parent      a joint that is cut, and closed by a `Loop`; <loop_joint>, <constraint>
                         and <joint> in <gazebo> as well
    names of links       the two halves of a cut joint
    <transmission>       a simple one names a joint with a motor
    a YAML or a TOML     loops, motors, balls and universal joints

See `urdf_loops` for how loops are closed. The kind of a joint that was cut is not in its name for
certain; `robot.toml` can say another kind.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed, quoted_names, short_list
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import UNLIMITED
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.places import WORLD
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.description import (
    Body,
    Description,
    check_root_joint,
    circle_of,
    implausible_inertias,
    tensor,
)
from condyn_pin.io.urdf_loops import (
    CompanionFile,
    close,
    closings,
    cuts_of,
    link_at,
    read_beside,
    rotation_onto,
    unpaired_halves,
)  # fmt: skip
from condyn_pin.io.xml import ElementSchema, Schema, check_counts, floats, label, open_xml, place
from condyn_pin.model.smaller import copy_numbers

_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# What <gazebo> says of a link, a joint or all of it, and the texts that mean nothing.
_OF_GAZEBO: Final = (
    "turnGravityOff", "gravity", "static", "springStiffness", "springReference", "dampingFactor",
    "kinematic", "velocity_decay", "physics",
)  # fmt: skip
_NOTHING: Final[Mapping[str, Sequence[str]]] = {
    **dict.fromkeys(_OF_GAZEBO, ("0", "0.0", "false")), "gravity": ("1", "true")
}  # fmt: skip
# Words of plugins that act by themselves, and not only as they are told.
_ACTS: Final = re.compile(
    "mimic|underactuat|buoyan|hydro|wind|lift|drag|thrust|propel|friction|spring|damp"
)
# What Drake and others say beside the joints, most of it in a namespace.
_CLOSURES: Final = ("mimic", "ball_constraint")
_OF_OTHERS: Final = (
    "motorInertia", "rotor_inertia", *_CLOSURES, "tendon_constraint", "linear_bushing_rpy",
    "linear_spring_damper",
)  # fmt: skip
_TAGS: Final = {
    "robot": ElementSchema(
        "name version", many="link joint loop_joint constraint gazebo transmission"
    ),
    "transmission": ElementSchema(
        "name type", many="type joint actuator mechanicalReduction", raw=True
    ),
    "gazebo": ElementSchema("reference", many=" ".join(("joint", "plugin", *_OF_GAZEBO)), raw=True),
    "link": ElementSchema("name", one="inertial", many="visual"),  # view draws the latter
    "inertial": ElementSchema(one="origin mass inertia"),
    "origin": ElementSchema(numbers={"xyz": 3, "rpy": 3}),
    "mass": ElementSchema(numbers={"value": 1}, needed="value"),
    "inertia": ElementSchema(numbers=dict.fromkeys(_MOMENTS, 1), needed=" ".join(_MOMENTS)),
    "joint": ElementSchema("name type", one="origin parent child axis limit dynamics mimic"),
    "parent": ElementSchema("link"),
    "child": ElementSchema("link"),
    "axis": ElementSchema(numbers={"xyz": 3}, needed="xyz"),
    "limit": ElementSchema(
        numbers=dict.fromkeys(("lower", "upper", "effort", "velocity"), 1), infinite=True
    ),
    "dynamics": ElementSchema(numbers={"damping": 1, "friction": 1}),
    "mimic": ElementSchema("joint", {"multiplier": 1, "offset": 1}),
}  # fmt: skip
_TYPES: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_SCALAR: Final = ("revolute", "continuous", "prismatic")
_AXES: Final[Mapping[str, str]] = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


def read_urdf(source: Path | str, root_joint: str = "fixed", *, mimic: bool = True) -> Description:
    """Read a URDF.

    Parameters
    ----------
    source : Path or str
        The file, or its text. Meshes are not needed.
    root_joint : {"fixed", "free_flyer"}
        How the root link is attached to the world.
    mimic : bool
        Whether <mimic> makes couplings; else such joints move on their own.

    Returns
    -------
    Description
        The model, its loops and couplings, and the content of the file that dynamics do not use.

    Raises
    ------
    InvalidModel
        If the file cannot be read; the text names the element.
    """
    check_root_joint(root_joint)
    is_file = isinstance(source, Path)
    with place(source if is_file else "the text of a URDF"):
        robot = open_xml(source, "robot")
        if macro := next((e.tag for e in robot.iter() if "xacro}" in e.tag), ""):
            tag = macro.rpartition("}")[2]
            raise InvalidModel(f"<xacro:{tag}>: a macro; expand it with `xacro FILE > robot.urdf`")
        beside = read_beside(source) if isinstance(source, Path) else CompanionFile()
        return _Reader(robot, beside, mimic).read(root_joint)


class _Reader:
    """Reader of a URDF: a checked copy of the file, with joint types that Pinocchio supports."""

    def __init__(self, robot: Element, beside: CompanionFile, mimic: bool) -> None:
        if not robot.get("name"):
            raise InvalidModel("<robot> has no name; give it one")
        self._file, self._schema, self._beside = robot, Schema(_TAGS), beside
        self.robot = self._schema.checked(robot)
        self.links, self.joints = (
            _elements_by_name(self.robot, "link"),
            _elements_by_name(self.robot, "joint"),
        )
        if not self.links:
            raise InvalidModel("<robot> has no <link>; at least one is needed")
        moving = sum(joint.get("type") != "fixed" for joint in self.joints.values())
        check_counts(len(self.links), moving)
        for name, kind in beside.joints.items():
            self._retype(name, kind)
        self.cut = self._past_the_tree()
        for name in self.cut:
            del self.joints[name]
        self.leaders = self._leaders() if mimic else {}
        # by the format both bounds are then 0, which locks it; exporters mean no bounds
        self.free = [
            name
            for name, joint in self.joints.items()
            if joint.get("type") in ("revolute", "prismatic")
            for limit in joint.findall("limit")
            if not {"lower", "upper"} & limit.attrib.keys()
        ]

    def read(self, root_joint: str) -> Description:
        root = self._root()
        for name in (*self.links, *self.joints):
            if name in WORLD and (name != root or root_joint == "free_flyer"):
                advice = "rename it" + ", or take the root joint 'fixed'" * (name == root)
                raise InvalidModel(f"the name {name!r} is the world's: {advice}")
        beside, robot = self._beside, self.robot
        named = () if beside.loops is not None else tuple(closings(self.links, self.joints))
        cuts = tuple(cuts_of(robot, self.cut.values()))
        # before joints are as Pinocchio reads them
        couplings, told = tuple(self._couplings()), tuple(self._unused(named))
        motors, idle = self._motors()
        balls = [name for name, kind in beside.joints.items() if kind == "SPHERICAL"]
        model = _with_balls(self._model(root_joint), balls)
        _turn_planes(model, self.joints)
        return Description(
            model,
            loops=(*couplings, *(beside.loops or named), *close(model, cuts)),
            unused=(*told, *idle, *beside.unused()),
            unmodelled=(
                *self._unmodelled(),
                *(
                    f"settings of the joint {cut.name!r}, which closes a loop, by its two axes"
                    for cut in cuts
                    if cut.kind == "cylindrical" and cut.settings.act
                ),
            ),
            lost_rows=tuple(self._others(_CLOSURES)),
            whole={
                cut.name: cut.settings
                for cut in cuts
                if cut.kind in ("hinge", "slider", "ball") and cut.settings.act
            },
            actuated=beside.motors or motors,
            name=robot.attrib["name"],
        )

    def _motors(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Joints of simple transmissions, and sentences on what else transmissions have."""
        motors, geared, others = dict[str, None](), list[str](), list[str]()
        for each in self.robot.findall("transmission"):
            kind = each.get("type") or (each.findtext("type") or "").strip()
            (name, *more) = [j.get("name", "") for j in each.findall("joint")] or [""]
            moves = name in self.joints and self.joints[name].get("type") != "fixed"
            if more or not moves or not kind.endswith("SimpleTransmission"):
                others.append(each.get("name") or kind)
                continue
            motors[name] = None
            ratios = {(e.text or "1").strip() for e in each.iter("mechanicalReduction")}
            geared += [name] * bool(ratios - {"1", "1.0"})
        said = []
        if geared:
            said.append(
                f"reductions of transmissions ({short_list(geared)}): torques are of the joints; "
                "Actuation(robot, ratios={...}) has those of the motors"
            )
        if others:
            said.append(
                f"transmissions that name no motors here, for they are not simple, or their joint "
                f"does not move: {listed(others)}"
            )
        return tuple(motors), tuple(said)

    # The tree

    def _past_the_tree(self) -> dict[str, Element]:
        """Joints whose child has another parent joint already: each closes a loop."""
        have_parents, past = set[str](), dict[str, Element]()
        for name, joint in self.joints.items():
            kind = joint.get("type", "")
            if kind not in _TYPES:
                raise InvalidModel(f"{label(joint)}: {unknown_name('joint type', kind, _TYPES)}")
            for end in ("parent", "child"):
                link = link_at(joint, end)
                if not link:
                    raise InvalidModel(f"{label(joint)}: no <{end} link=...>; name its {end} link")
                if link not in self.links:
                    known = unknown_name("link", link, self.links)
                    raise InvalidModel(f"{label(joint)}: <{end}>: {known}")
            if link in have_parents:
                past[name] = joint
            have_parents.add(link)
        return past

    def _root(self) -> str:
        """Root link; joints that form no tree are refused."""
        parent_of = {link_at(j, "child"): link_at(j, "parent") for j in self.joints.values()}
        roots = [link for link in self.links if link not in parent_of]
        if len(roots) != 1:
            found = f"the links {', '.join(map(repr, roots[:4]))} have" if roots else "no link has"
            advice = "; exchange parent and child of the joint that closes the loop" * (not roots)
            raise InvalidModel(
                f"{found} no parent joint; exactly one link, the root, must have none{advice}"
            )
        children = defaultdict[str, list[str]](list)
        for child, parent in parent_of.items():
            children[parent].append(child)
        reached = [roots[0]]
        for link in reached:  # it grows
            reached += children[link]
        reached_links = {*reached}
        if lost := [link for link in self.links if link not in reached_links]:
            raise InvalidModel(f"no joint leads from {roots[0]!r} to the links {lost[:4]}; add one")
        return roots[0]

    def _leaders(self) -> dict[str, str]:
        """Joints that mimic another one, with that one; those that cannot are refused."""
        leaders: dict[str, str] = {}
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None or joint.get("type") == "fixed":
                continue
            where, leader = f"{label(joint)}: <mimic", mimic.get("joint", "")
            if leader not in self.joints:
                raise InvalidModel(f"{where}>: {unknown_name('joint', leader, self.joints)}")
            for who in (name, leader):
                kind = self.joints[who].get("type", "")
                if kind not in _SCALAR:
                    raise InvalidModel(
                        f"{where}>: joint {who!r} is {kind}; joints with one degree of freedom are "
                        "needed"
                    )
            if leader == name:
                raise InvalidModel(f"{where}>: it mimics itself; name another joint")
            if float(mimic.get("multiplier", 1.0)) == 0:
                raise InvalidModel(f"{where} multiplier=0> locks it; make it fixed")
            leaders[name] = leader
        if circle := circle_of(leaders):
            raise InvalidModel(
                f"{label(self.joints[circle[0]])}: <mimic>: the joints {quoted_names(circle)} "
                "mimic each other in a circle; let one of them lead"
            )
        return leaders

    def _couplings(self) -> Iterator[Coupling]:
        for name, leader in self.leaders.items():
            for mimic in self.joints[name].findall("mimic"):
                ratio, offset = (float(mimic.get(*x)) for x in (("multiplier", 1), ("offset", 0)))
                yield Coupling(name, leader, ratio, offset)

    # For Pinocchio

    def _model(self, root_joint: str) -> Any:
        copy = Element("robot", name=self.robot.attrib["name"])
        for link in self.links.values():
            made = SubElement(copy, "link", name=link.attrib["name"])
            if (inertial := link.find("inertial")) is not None:
                for tag in ("mass", "inertia"):
                    if inertial.find(tag) is None:
                        raise InvalidModel(f"{label(link)}: <inertial> has no <{tag}>; give it one")
                made.append(inertial)
        for name, mass, _ in _bodies(self.links):
            if mass < 0:
                where = label(self.links[name])
                raise InvalidModel(f"{where}: <mass value={mass:g}>: it must not be negative")
        coupled = {*self.leaders, *self.leaders.values()}
        for name, joint in self.joints.items():
            # a continuous joint is (cos, sin) in Pinocchio; what is proportional needs an angle
            unbounded = joint.get("type") == "continuous" and name in coupled
            self._limit(joint, unbounded=unbounded)
            if unbounded:
                joint.set("type", "revolute")
            if (axis := joint.find("axis")) is not None and joint.get("type") != "fixed":
                with place(label(joint)):
                    rotation_onto(axis)
            for mimic in joint.findall("mimic"):
                joint.remove(mimic)
            copy.append(joint)
        try:
            text = ET.tostring(copy, encoding="unicode")
            if root_joint == "free_flyer":
                return pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
            return pin.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            raise InvalidModel(f"Pinocchio cannot read it: {error}") from error

    def _limit(self, joint: Element, *, unbounded: bool) -> None:
        """Write out the four limits of a joint, those left out with the defaults of the format."""
        where, kind, limit = label(joint), joint.get("type"), joint.find("limit")
        if limit is None:
            if kind in ("revolute", "prismatic"):
                raise InvalidModel(
                    f"{where}: a {kind} joint needs <limit lower=.. upper=.. effort=.. "
                    "velocity=..>; "
                    + ("-inf to inf do", "without limits it is continuous")[kind == "revolute"]
                )
            if not unbounded:
                return
            limit = SubElement(joint, "limit")
        missing = [key for key in ("lower", "upper") if key not in limit.attrib]
        free = repr(UNLIMITED)
        given = {"lower": "0", "upper": "0", "effort": free, "velocity": free} | limit.attrib
        if unbounded or joint.get("name") in self.free:
            given |= {"lower": f"-{free}", "upper": free}
        said = {k: float(np.clip(float(x), -UNLIMITED, UNLIMITED)) for k, x in given.items()}
        if said["lower"] > said["upper"]:
            advice = "exchange them"
            if missing:
                advice = f"the {missing[0]} one is not there, which is 0; give it"
            raise InvalidModel(f"{where}: limits {said['lower']:g} to {said['upper']:g}; {advice}")
        limit.attrib.update({key: repr(value) for key, value in said.items()})

    def _retype(self, name: str, kind: str) -> None:
        """Replace the type of a joint by that of the file beside; balls follow in `_with_balls`.

        The joint keeps its placement, and loses axis, limits, damping and friction.
        """
        if name not in self.joints:
            raise InvalidModel(f"joint_name: {unknown_name('joint', name, self.joints)}")
        joint = self.joints[name]
        if joint.get("type") == "fixed" and kind != "FIXED":
            raise InvalidModel(f"joint_name: {name!r} is fixed, and cannot be {kind}")
        for tag in ("axis", "limit", "dynamics", "mimic"):
            for element in joint.findall(tag):
                joint.remove(element)
        joint.set("type", "fixed" if kind == "FIXED" else "continuous")
        if kind.startswith("UJOINT"):
            self._universal(joint, name, kind[-2:])

    def _universal(self, joint: Element, name: str, axes: str) -> None:
        """Replace a joint by two hinges NAME_X and NAME_Y with a massless link NAME_cross."""
        cross, child = f"{name}_cross", joint.find("child")
        if child is None:
            raise InvalidModel(f"joint {name!r}: no <child link=...>; name its child link")
        names = [f"{name}_{axis}" for axis in axes]
        for taken in {cross} & self.links.keys() | {*names} & self.joints.keys():
            raise InvalidModel(f"joint {name!r} needs the name {taken!r}; rename the other one")
        self.links[cross] = Element("link", name=cross)
        other = Element("joint", name=names[1])
        SubElement(other, "parent", link=cross)
        SubElement(other, "child", dict(child.attrib))
        child.set("link", cross)
        joint.set("name", names[0])
        for hinge, axis in ((joint, axes[0]), (other, axes[1])):
            hinge.set("type", "revolute")
            SubElement(hinge, "axis", xyz=_AXES[axis])
            SubElement(hinge, "limit", lower="-inf", upper="inf", effort="inf", velocity="inf")
        places = {names[0] if each == name else each: x for each, x in self.joints.items()}
        self.joints = {**places, names[1]: other}

    # What is said

    def _unused(self, cuts: Sequence[Loop]) -> Iterator[str]:
        """Content of the file that is not used, and choices where it is ambiguous, as sentences."""
        joints = [*self.joints.values(), *self.cut.values()]
        still = [joint for joint in joints if joint.get("type") == "fixed"]
        moving = [joint for joint in joints if joint not in still]
        if damped := _joints_with(moving, "dynamics", "damping"):
            yield f"joint damping ({short_list(damped)}): add Robot.passive_torque to tau"
        if rubbed := _joints_with(moving, "dynamics", "friction"):
            yield f"joint friction ({short_list(rubbed)})"
        if limited := _joints_with(moving, "limit"):
            yield f"limits of position, velocity and effort ({len(limited)} joints)"
        if mimics := _joints_with(still, "mimic"):
            yield f"mimic of fixed joints ({short_list(mimics)})"
        yield from self._schema.not_read()
        if mimics := _joints_with(moving, "mimic"):
            what = "couplings of Robot.loops, which hold in scenes that contain them"
            what = what if self.leaders else "these joints move on their own"
            yield f"mimic ({short_list(mimics)}): {what}"
        if self.free:
            yield (
                f"<limit> without lower and upper ({short_list(self.free)}): without bounds here; "
                "the format has 0 to 0, which locks them"
            )
        for kind in ("ball", "weld"):
            if names := [loop.name for loop in cuts if loop.called == kind]:
                yield (
                    f"the kind of the joints cut at {short_list(names)}: {kind}s here, unless "
                    "[[loops]] of a robot.toml name the same two frames"
                )
        for name, reason in unpaired_halves(self.links, self.joints):
            what = "link" if name in self.links else "joint"
            yield f"{what} {name!r}: {reason}, so it closes nothing"
        yield from implausible_inertias(_bodies(self.links))

    def _unmodelled(self) -> Iterator[str]:
        """Unmodelled effects of Gazebo and of others on the motion, a phrase each."""
        gazebos = self.robot.findall("gazebo")
        for tag in _OF_GAZEBO:
            where = [
                gazebo.get("reference", "the robot")
                for gazebo in gazebos
                for said in gazebo.findall(tag)
                if {*" ".join(said.itertext()).lower().split()} - {*_NOTHING[tag]}
            ]
            if where:
                yield f"<{tag}> of <gazebo> ({short_list(where)})"
        changed = [gazebo.attrib["reference"] for gazebo in gazebos
                   if gazebo.get("reference") and gazebo.find("joint") is not None]  # fmt: skip
        if changed:
            yield f"<joint> of <gazebo>, which changes a joint ({short_list(changed)})"
        plugins = [plugin for gazebo in gazebos for plugin in gazebo.findall("plugin")]
        coupled = {j.get("name") for j in self._file.findall("joint[mimic]")}
        acting = [
            plugin.get("name", plugin.get("filename", ""))
            for plugin in plugins
            if _ACTS.search(f"{plugin.get('name')} {plugin.get('filename')}".lower())
            and coupled.isdisjoint(e.text for e in plugin.iter())
        ]
        if acting:
            yield f"plugins that may drive it or push ({short_list(acting)})"
        yield from self._others(_OF_OTHERS)

    def _others(self, tags: Iterable[str]) -> Iterator[str]:
        """Unread elements of these tags, with their number."""
        found = Counter(e.tag.rpartition("}")[2] for e in self._file.iter() if e.tag not in _TAGS)
        yield from (f"<{tag}> ({found[tag]})" for tag in tags if found[tag])


def _elements_by_name(robot: Element, tag: str) -> dict[str, Element]:
    """Return elements by name, in the order of the file."""
    found: dict[str, Element] = {}
    for element in robot.findall(tag):
        name = element.get("name", "")
        if not name.strip():
            raise InvalidModel(f"a <{tag}> has no name; give it one")
        if name in found:
            raise InvalidModel(f"two <{tag}> are named {name!r}; rename one")
        found[name] = element
    return found


def _joints_with(joints: Iterable[Element], tag: str, key: str = "") -> list[str]:
    """Return the joints with an element, or with an attribute of it other than zero."""
    found = ((joint.attrib["name"], joint.find(tag)) for joint in joints)
    return [
        name
        for name, element in found
        if element is not None and (not key or float(element.get(key) or 0))
    ]


def _bodies(links: Mapping[str, Element]) -> Iterator[Body]:
    for name, link in links.items():
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is not None and inertia is not None:
            about_centre = tensor(*(float(inertia.attrib[key]) for key in _MOMENTS))
            yield name, float(mass.attrib["value"]), about_centre


def _with_balls(model: Any, names: Collection[str]) -> Any:
    """Model with balls in the place of some joints, all its other numbers kept."""
    if not names:
        return model
    made = pin.Model()
    made.name = model.name
    made.gravity = pin.Motion(model.gravity.vector.copy())
    made.inertias[0] = pin.Inertia(model.inertias[0])
    for i in range(1, model.njoints):
        name = model.names[i]
        joint = pin.JointModelSpherical() if name in names else model.joints[i]
        made.addJoint(model.parents[i], joint, model.jointPlacements[i], name)
        made.appendBodyToJoint(i, model.inertias[i], pin.SE3.Identity())
    for frame in list(model.frames)[1:]:
        made.addFrame(frame, False)  # the inertia is on the joint already
    copy_numbers(model, made, [name for name in list(model.names)[1:] if name not in names])
    return made


def _turn_planes(model: Any, joints: Mapping[str, Element]) -> None:
    """Rotate the planar joints of a model so that their planes are normal to their axes.

    Pinocchio has them across z: with R z = axis, the joint is placed by M R, and all that is on it
    by R^-1.
    """
    for name, joint in joints.items():
        if joint.get("type") != "planar":
            continue
        i = model.getJointId(name)
        R = rotation_onto(joint.find("axis"))
        model.jointPlacements[i] = model.jointPlacements[i] * R
        model.inertias[i] = R.actInv(model.inertias[i])
        for k in range(i + 1, model.njoints):
            if model.parents[k] == i:
                model.jointPlacements[k] = R.actInv(model.jointPlacements[k])
        for frame in model.frames:
            if frame.parentJoint == i and frame.type != pin.FrameType.JOINT:
                frame.placement = R.actInv(frame.placement)


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
