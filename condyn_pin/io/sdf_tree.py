"""From the joints of an SDF file to a Pinocchio tree and the loops that are closed again.

Types. universal, revolute2 are two hinges in series with a link without mass between them,

    parent --name_axis--> cross --name_axis2--> child,       R = R(axis, q1) R(axis2, q2)

whose axes never become parallel, so that both hinges always move the inertia behind the joint. A
gearbox is no joint of the tree, but a proportion between two hinges. It names a reference link.
With theta_1 the angle from there to its parent about `axis`, and theta_2 the one to its child about
`axis2`, both zero as drawn, the format asks for

    theta_2 = -ratio theta_1

where theta = q if the hinge between the reference link and the other has the same direction and the
reference link is its parent; each of the two that is the other way round changes the sign. A joint
with <mimic> is a proportion too, with an offset; its two joints stay as they are.

`with_copies` opens loops as Pinocchio's C++ parser does: every joint in the tree, on a copy of its
child. A link with n parent joints is drawn n times, with m/n and I/n each. The first joint of the
file carries the link itself, every other one a copy that is welded to it by 6 rows: a joint that
closes a loop keeps its coordinate, at the price of as many freedoms and rows more.

Span. The links are the nodes of a graph and the joints its edges. Joints are taken one by one,
those with the least freedom first, and put into the tree unless they close a loop: Kruskal's
spanning tree. So each joint that is cut has the most freedom of its loop, and costs the fewest
rows. Direction does not matter: a joint that leads from the tree to its parent is reversed.

Tree. With o the model frame, j a joint between the links p (parent) and c (child), and i the
Pinocchio joint that carries a link, the placements are

    pMj = oMp⁻¹ · oMj        jMc = oMj⁻¹ · oMc
    joint j in the tree:  placed in p's Pinocchio joint at  iMp · pMj;  it carries c at  jMc
    fixed joint:          c is carried by p's Pinocchio joint at  iMp · pMj · jMc
    cut joint:            frame_a at  iMp · pMj  and  frame_b at  iMc · jMc⁻¹  must coincide,
                          both turned so that z is the axis of a hinge or slider

and at the configuration in which the file draws the model, they do. Each factor of these products
adds a rounding to the rotation; what goes into the model is made orthonormal once more.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import dry_friction, pin, set_dry_friction
from condyn_pin._core.arguments import quoted_names
from condyn_pin._core.models import z_along
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop, LoopKind
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.description import circle_of
from condyn_pin.io.sdf_file import NO_AXIS, Axis, Gear, Joint, Link, SdfModel
from condyn_pin.io.sdf_parts import WORLD
from condyn_pin.model.tree import TreeBuilder, one_coordinate

# The degrees of freedom that each type leaves, as far as the tree is concerned.
FREEDOM: Final[Mapping[str, int]] = {
    "fixed": 0, "revolute": 1, "continuous": 1, "prismatic": 1, "screw": 1, "ball": 3,
}  # fmt: skip
_SERIES: Final = ("universal", "revolute2")
KINDS: Final = (*FREEDOM, *_SERIES, "gearbox")
_NEEDED: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("revolute", "continuous", "prismatic", "screw"), ("axis",)),
    "universal": ("axis", "axis2"), "revolute2": ("axis", "axis2"), "gearbox": ("axis", "axis2"),
}  # fmt: skip


def chosen_joints(
    sdf: SdfModel, kinds: Mapping[str, str], drop: Sequence[str]
) -> tuple[Joint, ...]:
    """Return the joints that are kept, each with its type."""
    names = [joint.name for joint in sdf.joints]
    for name in (*kinds, *drop):
        if name not in names:
            raise unknown_name("joint", name, names)
    for kind in kinds.values():
        if kind not in KINDS:
            raise unknown_name("joint type", kind, KINDS)
    joints = tuple(
        replace(joint, kind=kinds.get(joint.name, joint.kind))
        for joint in sdf.joints
        if joint.name not in drop
    )
    for joint in joints:
        _check(joint)
    return joints


def _check(joint: Joint) -> None:
    """Refuse a joint of an unknown type, or without an element that its type needs."""
    if joint.kind not in KINDS:
        raise InvalidModel(
            f"joint {joint.name!r} has the type {joint.kind!r}, which is not supported: read "
            f"it as {', '.join(KINDS[:-1])} or {KINDS[-1]} with kinds={{{joint.name!r}: ...}}, "
            f"or leave it out with drop=[{joint.name!r}]"
        )
    for tag in _NEEDED.get(joint.kind, ()):
        if getattr(joint, tag).direction is None:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and has no <{tag}/xyz>; give it one"
            )
    if joint.kind == "gearbox" and joint.gear is None:
        raise InvalidModel(
            f"joint {joint.name!r} is a gearbox and has no <gearbox_reference_body>; name the link "
            "from which both of its angles are measured"
        )
    if joint.kind == "screw" and joint.pitch == 0:
        raise InvalidModel(
            f"joint {joint.name!r} is a screw and has no <screw_thread_pitch> [m per turn]; write "
            "one other than zero"
        )
    if joint.kind in _SERIES:
        a, b = np.asarray(joint.axis.direction), np.asarray(joint.axis2.direction)
        sine = np.linalg.norm(np.cross(a, b))
        if sine < tolerances.PARALLEL:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and its <axis> and <axis2> are parallel, "
                "which is one freedom twice; write it as revolute"
            )


def in_series(
    links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with each universal joint as two hinges and a cross."""
    taken = {link.name for link in links} | {joint.name for joint in joints}
    crosses: list[Link] = []
    hinges: list[Joint] = []
    for joint in joints:
        if joint.kind not in _SERIES:
            hinges.append(joint)
            continue
        first, cross, second = (f"{joint.name}_{part}" for part in ("axis", "cross", "axis2"))
        for name in (first, cross, second):
            if name in taken:
                raise InvalidModel(
                    f"joint {joint.name!r} is {joint.kind} and needs the name {name!r}, which is "
                    "taken; rename one of them"
                )
        crosses.append(Link(cross, joint.pose, None, massless=True))
        hinge = replace(joint, kind="revolute", axis2=NO_AXIS)
        hinges.append(replace(hinge, name=first, child=cross))
        hinges.append(replace(hinge, name=second, parent=cross, axis=joint.axis2))
    return (*links, *crosses), tuple(hinges)


def mimics_of(joints: Sequence[Joint]) -> tuple[Coupling, ...]:
    """Return the couplings q = multiplier (q_leader - reference) + offset of joints that mimic."""
    led = {joint.name: joint.axis.mimic for joint in joints if joint.axis.mimic is not None}
    scalar = [joint.name for joint in joints if joint.has_axis]
    couplings = []
    for name, mimic in led.items():
        leader = mimic.leader if mimic.axis == "axis" else ""
        if leader not in scalar:
            leader = f"{mimic.leader}_{mimic.axis}"  # of a universal joint
        for role, who in (("it", name), (f"{mimic.leader!r} by its {mimic.axis!r}", leader)):
            if who not in scalar:
                raise InvalidModel(
                    f"joint {name!r} mimics {mimic.leader!r}, and {role} is no hinge, slider or "
                    "screw of the model; take <mimic> out, or leave the joint out with drop"
                )
        couplings.append(Coupling(name, leader, mimic.ratio, mimic.offset))
    if circle := circle_of({c.joints[0]: c.joints[1] for c in couplings}):
        raise InvalidModel(
            f"the joints {quoted_names(circle)} mimic each other in a circle; let one of them lead"
        )
    return tuple(couplings)


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


def with_copies(
    links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...], tuple[Loop, ...]]:
    """Return links and joints without loops, and the welds that close them again."""
    parents = Counter(joint.child for joint in joints)
    shared = {link.name: link for link in links}
    for link in links:
        if link.inertia is not None and (n := parents[link.name]) > 1:
            m, c, I = link.inertia.mass, link.inertia.lever, link.inertia.inertia  # noqa: E741
            shared[link.name] = replace(link, inertia=pin.Inertia(m / n, c, I / n))
    copies: list[Link] = []
    hanging: list[Joint] = []
    welds: list[Loop] = []
    carried: set[str] = set()
    for joint in joints:
        if joint.child in carried:
            name = f"{joint.child}_{joint.name}"
            if name in shared or any(name == other.name for other in joints):
                raise InvalidModel(
                    f"joint {joint.name!r}: the copy of {joint.child!r} needs the name {name!r}, "
                    "which is taken; rename one of them"
                )
            copies.append(replace(shared[joint.child], name=name))
            welds.append(Loop(name, joint.child, "weld", name=joint.name))
            joint = replace(joint, child=name)
        carried.add(joint.child)
        hanging.append(joint)
    return (*shared.values(), *copies), tuple(hanging), tuple(welds)


class SpanningTree(NamedTuple):
    """A spanning tree, or one for each of several models that nothing connects."""

    trees: tuple[tuple[str, tuple[Joint, ...]], ...]  # root link, or the world; depth-first joints
    cut: tuple[Joint, ...]  # in the order of the file
    reversed: tuple[str, ...]  # of the trees


def span(
    sdf: SdfModel,
    joints: Sequence[Joint],
    root: str | None,
    *,
    floating: bool,
    kept: Mapping[str, str],
    cut: Sequence[str],
) -> SpanningTree:
    """Return the trees that these joints make from their roots to every link of the file."""
    # `kept` has the joints that must not be cut, each with the reason, a motor if there is another
    # choice; `cut` those that must be.
    for name in cut:
        if name not in [joint.name for joint in joints]:
            raise unknown_name("joint", name, [joint.name for joint in joints])
    names = _spanning(joints, kept, cut)
    at: dict[str, list[Joint]] = defaultdict(list)
    for joint in joints:
        if joint.name in names:
            at[joint.parent].append(joint)
            at[joint.child].append(joint)
    children = {joint.child for joint in joints}
    anchored = _anchored(sdf, joints, root, floating)
    trees: list[tuple[str, tuple[Joint, ...]]] = []
    backwards: list[str] = []
    reached = set[str]()
    several = len(sdf.canonical) > 1
    starts = ((WORLD,) if anchored else ()) + (sdf.canonical if several or not anchored else ())
    for start in starts:
        if start in reached:
            continue
        if start != WORLD:  # the root, or the only link here without a parent, or else canonical
            here = {start, *(joint.child for joint in _depth_first(at, start)[0])}
            roots = {root} & here or here - children
            start = str(roots.pop()) if len(roots) == 1 else start
        tree, turned = _depth_first(at, start)
        trees.append((start, tree))
        backwards += turned
        reached |= {start, *(joint.child for joint in tree)}
    lost = [link.name for link in sdf.links if link.name not in reached]
    if lost:
        raise InvalidModel(
            f"no joint leads from {trees[0][0]!r} to the links {quoted_names(lost)}: add a joint "
            "that connects them, or leave them out of the file"
        )
    opened = tuple(joint for joint in joints if joint.name not in names)
    _check_cuts(names, opened, {name: why for name, why in kept.items() if why != MOTOR}, cut)
    return SpanningTree(tuple(trees), opened, tuple(backwards))


def _anchored(sdf: SdfModel, joints: Sequence[Joint], root: str | None, floating: bool) -> bool:
    """True if joints attach links to the world; refuse another root then."""
    links = [link.name for link in sdf.links]
    if root is not None and root not in links:
        raise unknown_name("link", root, links)
    anchors = [joint for joint in joints if joint.parent == WORLD]
    if anchors:
        names = quoted_names([joint.name for joint in anchors])
        if floating:
            raise InvalidModel(
                f"the joints {names} attach the model to the world: leave them out with drop, or "
                "read the model without a root joint"
            )
        if root is not None and root not in [joint.child for joint in anchors]:
            raise InvalidModel(
                f"root {root!r} is not what the joints {names} attach to the world: leave them out "
                "with drop, or do not name a root"
            )
    return bool(anchors)


def _spanning(
    joints: Sequence[Joint], kept: Mapping[str, str], cut: Collection[str]
) -> frozenset[str]:
    """Return the names of the joints that span the graph with the least freedom."""

    def order(joint: Joint) -> tuple[bool, bool, int, bool]:
        # A spring acts on a coordinate, which a joint that is cut has not.
        sprung = joint.axis.stiffness != 0
        return joint.name in cut, joint.name not in kept, FREEDOM[joint.kind], not sprung

    island: dict[str, str] = {}

    def home(link: str) -> str:
        while link in island:
            above = island[link]
            island[link] = above = island.get(above, above)  # shorten the way for the next one
            link = above
        return link

    names = []
    for joint in sorted(joints, key=order):  # stable: the order of the file decides a tie
        parent, child = home(joint.parent), home(joint.child)
        if parent != child:
            island[child] = parent
            names.append(joint.name)
    return frozenset(names)


def _depth_first(
    at: Mapping[str, Sequence[Joint]], start: str
) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Return the joints of a tree depth-first, as crba needs them, and which ones are reversed."""
    # `at` has the joints of the tree at each link.
    tree: list[Joint] = []
    backwards: list[str] = []
    waiting = [(joint, start) for joint in reversed(at[start])]
    while waiting:
        joint, before = waiting.pop()
        if joint.parent != before:
            backwards.append(joint.name)
            joint = joint.reversed()
        tree.append(joint)
        waiting.extend(
            (other, joint.child) for other in reversed(at[joint.child]) if other.name != joint.name
        )
    return tuple(tree), tuple(backwards)


def _check_cuts(
    tree: Collection[str], opened: Sequence[Joint], kept: Mapping[str, str], cut: Sequence[str]
) -> None:
    for name in cut:
        if name in tree or name in kept:
            reason = kept.get(name, "is in no loop, or in one that is open already")
            raise InvalidModel(f"joint {name!r} cannot be cut: it {reason}; leave it in")
    for joint in opened:
        if joint.name in kept:
            raise InvalidModel(
                f"joint {joint.name!r} {kept[joint.name]}, and its loop has no other joint that "
                "could be cut: read a passive joint there as another type with kinds, or leave "
                "one out with drop"
            )


MOTOR: Final = "is actuated"  # the reason to keep a joint that is cut where its loop has no other

_LOOP_KINDS: Final[Mapping[str, LoopKind]] = {
    "ball": "ball",
    "fixed": "weld",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
}


class SdfTree(TreeBuilder):
    """The Pinocchio model of a spanning tree.

    root_joint: between the world and the root link; without one the link stands where the file puts
        it
    """

    def __init__(self, sdf: SdfModel, spanned: SpanningTree, root_joint: Any | None) -> None:
        super().__init__(sdf.name)
        self.poses = {link.name: link.pose for link in sdf.links} | {WORLD: sdf.pose.inverse()}
        self._links = {link.name: link for link in sdf.links}
        self._frames = {WORLD: 0}  # Pinocchio's frame 0 is the universe
        for start, joints in spanned.trees:
            name = "root_joint" if len(spanned.trees) == 1 else f"{start}_root_joint"
            self._plant(start, root_joint, name)
            for joint in joints:
                self._attach(joint)

    def _plant(self, start: str, root_joint: Any | None, name: str) -> None:
        """Add a root link; the world itself is there already."""
        if start == WORLD:
            return
        if root_joint is None:
            wMlink = self.poses[WORLD].actInv(self.poses[start])
            self._carry(start, 0, 0, wMlink)
            return
        identity = pin.SE3.Identity()
        i = self.add_joint(0, root_joint, identity, name)
        self._carry(start, i, self.add_frame(name, i, identity, "JOINT"), identity)

    def _attach(self, joint: Joint) -> None:
        """Add a joint of the tree and its child link."""
        carrier, iMj = self._placement(joint.parent, joint.pose)
        before = self._frames[joint.parent]
        if joint.kind == "fixed":
            frame = self.add_frame(joint.name, carrier, iMj, "FIXED_JOINT", before=before)
        else:
            carrier = self._add(joint, carrier, iMj)
            iMj = pin.SE3.Identity()
            frame = self.add_frame(joint.name, carrier, iMj, "JOINT", before=before)
        jMc = joint.pose.actInv(self.poses[joint.child])
        self._carry(joint.child, carrier, frame, iMj * jMc)

    def can_move(self, joint: Joint) -> bool:
        """True if the two links of a joint can move relative to each other."""
        first, second = (self._frames[link] for link in (joint.parent, joint.child))
        frames = self.model.frames
        return bool(frames[first].parentJoint != frames[second].parentJoint)

    def moves(self, link: str) -> bool:
        """True if a link can move relative to the world."""
        return bool(self.model.frames[self._frames[link]].parentJoint)

    def close(self, joint: Joint) -> Loop:
        """Add the two frames of a cut joint, and return its loop closure."""
        oMj = joint.pose
        axis: Literal["z"] | None = None
        if joint.has_axis:
            oMj, axis = oMj * pin.SE3(z_along(np.asarray(joint.axis.direction)), np.zeros(3)), "z"
        ends = f"{joint.name}_a", f"{joint.name}_b"
        for name, link in zip(ends, (joint.parent, joint.child), strict=True):
            self.mark(name, link, oMj)
        return Loop(*ends, _LOOP_KINDS[joint.kind], axis, name=joint.name)

    def mark(self, name: str, link: str, oMx: Any) -> None:
        """Add a frame x that moves with a link."""
        carrier, iMx = self._placement(link, oMx)
        self.add_frame(name, carrier, iMx, "OP_FRAME", before=self._frames[link])

    def _placement(self, link: str, oMx: Any) -> tuple[int, Any]:
        """Return the Pinocchio joint i that carries the link, and iMx = iMlink · linkMx."""
        on_link = self.model.frames[self._frames[link]]
        return on_link.parentJoint, on_link.placement * self.poses[link].actInv(oMx)

    def _add(self, joint: Joint, carrier: int, iMj: Any) -> int:
        axis, limits = joint.axis, list[float]()
        if joint.kind == "ball":
            made = pin.JointModelSpherical()
        else:
            if joint.kind == "screw":
                made = pin.JointModelHelicalUnaligned(np.asarray(axis.direction), joint.pitch)
            else:
                made = one_coordinate(axis.direction, hinge=joint.kind != "prismatic")
            bounded = joint.kind != "continuous"
            bounds = (axis.lower, axis.upper) if bounded else (-inf, inf)
            limits = [axis.effort, axis.velocity, *bounds]
        i = self.add_joint(carrier, made, iMj, joint.name, limits=limits, damping=axis.damping)
        first = self.model.joints[i].idx_v
        friction = dry_friction(self.model)
        friction[first:] = axis.friction
        set_dry_friction(self.model, friction)
        return i

    def _carry(self, link: str, carrier: int, before: int, iMlink: Any) -> None:
        inertia, massless = self._links[link].inertia, self._links[link].massless
        if carrier and not massless and inertia is not None and inertia.mass <= 0:
            mass = inertia.mass
            raise InvalidModel(
                f"link {link!r} moves and has the mass {mass:g} kg; give it a mass > 0"
            )
        self._frames[link] = self.add_frame(link, carrier, iMlink, "BODY", inertia, before)
