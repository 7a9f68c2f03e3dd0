"""From the graph of an SDF file to a Pinocchio tree and the joints that close its loops.

With o the model frame, j a joint between the links p (parent) and c (child), and i the Pinocchio
joint that carries a link, the placements are

    pMj = oMp⁻¹ · oMj        jMc = oMj⁻¹ · oMc
    joint j in the tree:  placed in p's Pinocchio joint at  iMp · pMj;  it carries c at  jMc
    fixed joint:          c is carried by p's Pinocchio joint at  iMp · pMj · jMc
    cut joint:            frame_a at  iMp · pMj  and  frame_b at  iMc · jMc⁻¹  must coincide

and at the configuration in which the file draws the model, they do.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._pin import pin
from condyn_pin.errors import InvalidModel, unknown_name

WORLD: Final = "world"
KINDS: Final = ("fixed", "revolute", "continuous", "prismatic", "ball")
CLOSURE_KINDS: Final[Mapping[str, str]] = {"ball": "ball", "fixed": "weld"}
_HINGES: Final = ("revolute", "continuous")
# Pinocchio's own way to say that there is no limit; 3.9 cannot unpickle a model that has infinity.
_NO_LIMIT: Final = float(np.finfo(float).max)


@dataclass(frozen=True, eq=False)
class Link:
    """A link of the file, placed in the model frame.

    Attributes
    ----------
    name : str
        Its name.
    pose : pin.SE3
        oMlink.
    inertia : pin.Inertia or None
        In the link's frame; None if the file gives none.
    """

    name: str
    pose: Any
    inertia: Any | None


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file, placed in the model frame.

    Attributes
    ----------
    name, kind, parent, child : str
        Its name, its type as the file writes it, and the two links.
    pose : pin.SE3
        oMj.
    axis : (3,) array or None
        Unit vector in the joint's axes; None if the file gives none.
    lower, upper : float
        [rad or m], infinite if there is none.
    effort, velocity : float
        [N m or N], [rad/s or m/s], infinite if there is none.
    damping, friction : float
        [N m s/rad or N s/m], [N m or N].
    stiffness, reference : float
        Of its spring: [N m/rad or N/m], [rad or m].
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Any
    axis: NDArray[np.float64] | None
    lower: float
    upper: float
    effort: float
    velocity: float
    damping: float
    friction: float
    stiffness: float
    reference: float


@dataclass(frozen=True)
class Description:
    """What an SDF file says.

    Attributes
    ----------
    name : str
        Name of the model.
    pose : pin.SE3
        wMo, the model frame in the world.
    links : tuple of Link
        In the order of the file.
    joints : tuple of Joint
        In the order of the file.
    frames : mapping of str to (str, pin.SE3)
        Frames of the file: the link that carries each one, and its pose in the model.
    unread : Counter
        How many elements of each tag were not read.
    """

    name: str
    pose: Any
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: Mapping[str, tuple[str, Any]]
    unread: Counter[str]


@dataclass(frozen=True)
class Closure:
    """A joint of the file that is cut out of the tree: it closes a loop.

    Attributes
    ----------
    name : str
        The joint's name in the file.
    kind : str
        "ball" (from a ball joint, 3 rows) or "weld" (from a fixed joint, 6 rows).
    frame_a : str
        Operational frame of the model at the joint, on its parent link.
    frame_b : str
        The same on its child link.
    """

    name: str
    kind: str
    frame_a: str
    frame_b: str


@dataclass(frozen=True)
class SdfRobot:
    """What was read from an SDF file.

    Attributes
    ----------
    model : pin.Model
        The tree. Each link is a BODY frame, each joint a JOINT frame (FIXED_JOINT for a fixed
        one), each frame of the file and each end of a closure an OP_FRAME.
    closures : tuple of Closure
        The joints that close loops, in the order of the file.
    springs : mapping of str to (float, float)
        Joint name to stiffness [N m/rad or N/m] and reference [rad or m].
    unused : tuple of str
        What the file has and the model does not use, one sentence for each kind of thing.
    """

    model: Any
    closures: tuple[Closure, ...]
    springs: Mapping[str, tuple[float, float]]
    unused: tuple[str, ...]


def build(
    sdf: Description,
    root: str | None,
    root_joint: Any | None,
    kinds: Mapping[str, str],
    drop: Sequence[str],
) -> SdfRobot:
    """Return the model and the closures of a description; `read_sdf` says what the others mean."""
    joints = _chosen_joints(sdf, kinds, drop)
    start = _start(sdf, joints, root, root_joint)
    tree = _tree(joints, start)
    lost = [link.name for link in sdf.links if link.name not in tree and link.name != start]
    if lost:
        raise InvalidModel(
            f"no joint leads from {start!r} to the links {_quote(lost)}; joints are followed from "
            "parent to child: add a joint, or exchange the parent and the child of one"
        )
    grown = _Tree(sdf)
    grown.plant(start, root_joint)
    for joint in _depth_first(joints, tree, start):
        grown.attach(joint)
    cut = [joint for joint in joints if tree.get(joint.child) is not joint]
    closures = tuple(grown.close(joint) for joint in cut)
    for name, (link, oMf) in sdf.frames.items():
        grown.mark(name, link, oMf)
    springs = {
        joint.name: (joint.stiffness, joint.reference)
        for joint in joints
        if joint.stiffness != 0 and _has_coordinate(joint) and joint not in cut
    }
    root_pose = None if root_joint is None else grown.poses[start]
    unused = (*_unused_parts(sdf, kinds, drop, root_pose), *_unused_settings(joints, cut))
    return SdfRobot(grown.model, closures, springs, unused)


class _Tree:
    """A Pinocchio model while it grows: where each link is drawn, and its frame in the model."""

    def __init__(self, sdf: Description) -> None:
        self.model = pin.Model()
        self.model.name = sdf.name
        self.poses = {link.name: link.pose for link in sdf.links} | {WORLD: sdf.pose.inverse()}
        self.links = {link.name: link for link in sdf.links}
        self.frames = {WORLD: 0}  # Pinocchio's frame 0 is the universe

    def plant(self, start: str, root_joint: Any | None) -> None:
        """Add the root link; the world itself is there already."""
        if start == WORLD:
            return
        if root_joint is None:
            wMlink = self.poses[WORLD].actInv(self.poses[start])
            self._carry(start, 0, 0, wMlink)
            return
        identity = pin.SE3.Identity()
        i = self.model.addJoint(0, root_joint, identity, "root_joint")
        self._carry(start, i, self._frame("root_joint", i, 0, identity, "JOINT"), identity)

    def attach(self, joint: Joint) -> None:
        """Add a joint of the tree and its child link."""
        carrier, iMj = self._placement(joint, joint.parent)
        before = self.frames[joint.parent]
        if joint.kind == "fixed":
            frame = self._frame(joint.name, carrier, before, iMj, "FIXED_JOINT")
        else:
            carrier = self._add_joint(joint, carrier, iMj)
            iMj = pin.SE3.Identity()
            frame = self._frame(joint.name, carrier, before, iMj, "JOINT")
        jMc = joint.pose.actInv(self.poses[joint.child])
        self._carry(joint.child, carrier, frame, iMj * jMc)

    def close(self, joint: Joint) -> Closure:
        """Add the two frames of a cut joint."""
        if joint.kind not in CLOSURE_KINDS:
            raise InvalidModel(
                f"joint {joint.name!r} closes a loop and is {joint.kind}; only ball and fixed "
                f"joints can be cut: read it as a ball with kinds={{{joint.name!r}: 'ball'}}, or "
                "cut the loop elsewhere by moving this joint forward in the file"
            )
        ends = {f"{joint.name}_a": joint.parent, f"{joint.name}_b": joint.child}
        for name, link in ends.items():
            carrier, iMj = self._placement(joint, link)
            self._frame(name, carrier, self.frames[link], iMj, "OP_FRAME")
        return Closure(joint.name, CLOSURE_KINDS[joint.kind], *ends)

    def mark(self, name: str, link: str, oMf: Any) -> None:
        """Add a frame of the file."""
        on_link = self.model.frames[self.frames[link]]
        iMf = on_link.placement * self.poses[link].actInv(oMf)
        self._frame(name, on_link.parentJoint, self.frames[link], iMf, "OP_FRAME")

    def _placement(self, joint: Joint, link: str) -> tuple[int, Any]:
        """Return the Pinocchio joint i that carries the link, and iMj = iMlink · linkMj."""
        on_link = self.model.frames[self.frames[link]]
        return on_link.parentJoint, on_link.placement * self.poses[link].actInv(joint.pose)

    def _add_joint(self, joint: Joint, carrier: int, iMj: Any) -> int:
        if joint.kind == "ball":
            i = self.model.addJoint(carrier, pin.JointModelSpherical(), iMj, joint.name)
        else:
            lower, upper = joint.lower, joint.upper
            if joint.kind == "continuous":
                lower, upper = -inf, inf
            limits = np.clip([joint.effort, joint.velocity, lower, upper], -_NO_LIMIT, _NO_LIMIT)
            i = self.model.addJoint(
                carrier, _one_coordinate(joint), iMj, joint.name, *limits.reshape(4, 1)
            )
        added = self.model.joints[i]
        damping = self.model.damping.copy()
        damping[added.idx_v : added.idx_v + added.nv] = joint.damping
        self.model.damping = damping
        return int(i)

    def _carry(self, link: str, carrier: int, before: int, iMlink: Any) -> None:
        inertia = self.links[link].inertia
        if carrier and (inertia is None or inertia.mass <= 0):
            has = "no <inertial>" if inertia is None else f"the mass {inertia.mass:g} kg"
            raise InvalidModel(f"link {link!r} moves and has {has}; give it a mass > 0")
        self.frames[link] = self._frame(link, carrier, before, iMlink, "BODY", inertia)

    def _frame(
        self, name: str, carrier: int, before: int, iMf: Any, kind: str, inertia: Any | None = None
    ) -> int:
        # Pinocchio would return the older frame of the same name and type without a word.
        if self.model.existFrame(name):
            raise InvalidModel(f"two things of the model would be named {name!r}; rename one")
        inertia = pin.Inertia.Zero() if inertia is None else inertia
        frame = pin.Frame(name, carrier, before, iMf, getattr(pin.FrameType, kind), inertia)
        return int(self.model.addFrame(frame))  # adds the inertia to the joint as well


def _chosen_joints(
    sdf: Description, kinds: Mapping[str, str], drop: Sequence[str]
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
        if joint.kind not in KINDS:
            raise InvalidModel(
                f"joint {joint.name!r} has the type {joint.kind!r}, which is not supported: read "
                f"it as {', '.join(KINDS[:-1])} or {KINDS[-1]} with kinds={{{joint.name!r}: ...}}, "
                f"or leave it out with drop=[{joint.name!r}]"
            )
        if _has_coordinate(joint) and joint.axis is None:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and has no <axis/xyz>; give it one"
            )
    return joints


def _start(
    sdf: Description, joints: Iterable[Joint], root: str | None, root_joint: Any | None
) -> str:
    """Return the link on which the tree stands, or the world if joints attach links to it."""
    links = [link.name for link in sdf.links]
    if root is not None and root not in links:
        raise unknown_name("link", root, links)
    anchors = [joint for joint in joints if joint.parent == WORLD]
    if anchors:
        names = _quote([joint.name for joint in anchors])
        if root_joint is not None:
            raise InvalidModel(
                f"the joints {names} attach the model to the world: leave them out with drop, or "
                "read the model without a root joint"
            )
        if root is not None and root not in [joint.child for joint in anchors]:
            raise InvalidModel(
                f"root {root!r} is not what the joints {names} attach to the world: leave them out "
                "with drop, or do not name a root"
            )
        return WORLD
    children = {joint.child for joint in joints}
    roots = [root] if root is not None else [link for link in links if link not in children]
    if len(roots) != 1:
        found = f"no joint has the links {_quote(roots)} as child" if roots else "every link is one"
        raise InvalidModel(
            f"the tree needs one root, a link that is no joint's child, and {found}: "
            + ("connect them by joints" if roots else "name one by root=")
        )
    return roots[0]


def _tree(joints: Sequence[Joint], start: str) -> dict[str, Joint]:
    """Return for each link that can be reached from the start the joint that leads to it."""
    first: dict[str, Joint] = {}
    for joint in joints:
        first.setdefault(joint.child, joint)
    tree: dict[str, Joint] = {}
    reached = {start}
    while True:
        edges = [j for j in joints if j.parent in reached and j.child not in reached]
        if not edges:
            return tree
        # A link's first joint may hang below the link itself; then any joint that leads to it.
        joint = next((j for j in edges if first[j.child] is j), edges[0])
        tree[joint.child] = joint
        reached.add(joint.child)


def _depth_first(joints: Iterable[Joint], tree: Mapping[str, Joint], start: str) -> Iterator[Joint]:
    """Yield the joints of the tree depth-first: in another order crba is silently wrong."""
    below: dict[str, list[Joint]] = defaultdict(list)
    for joint in joints:
        if tree.get(joint.child) is joint:
            below[joint.parent].append(joint)
    waiting = below[start][::-1]
    while waiting:
        joint = waiting.pop()
        yield joint
        waiting.extend(reversed(below[joint.child]))


def _one_coordinate(joint: Joint) -> Any:
    """Return Pinocchio's hinge or slider along the joint's axis."""
    x, y, z = np.asarray(joint.axis)
    names = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
    along = names.get((x, y, z))
    hinge = joint.kind in _HINGES
    if along is not None:  # Pinocchio computes faster along these
        return getattr(pin, f"JointModel{'R' if hinge else 'P'}{along}")()
    return (pin.JointModelRevoluteUnaligned if hinge else pin.JointModelPrismaticUnaligned)(x, y, z)


def _has_coordinate(joint: Joint) -> bool:
    return joint.kind in _HINGES or joint.kind == "prismatic"


def _unused_parts(
    sdf: Description, kinds: Mapping[str, str], drop: Sequence[str], root_pose: Any | None
) -> Iterator[str]:
    """Say which parts of the file are not in the model."""
    if sdf.unread:
        counted = ", ".join(f"{n} <{tag}>" for tag, n in sorted(sdf.unread.items()))
        yield f"elements that are not read: {counted}"
    if drop:
        yield f"joints left out: {_quote(drop)}"
    changed = [
        f"{joint.name!r} ({joint.kind} as {kinds[joint.name]})"
        for joint in sdf.joints
        if joint.name not in drop and kinds.get(joint.name, joint.kind) != joint.kind
    ]
    if changed:
        yield f"joint types of the file: {', '.join(changed)}"
    if root_pose is not None and not root_pose.isIdentity():
        yield "pose of the root link in the file: the root joint's configuration replaces it"


def _unused_settings(joints: Iterable[Joint], cut: Sequence[Joint]) -> Iterator[str]:
    """Say which settings of the joints that are kept are not in the model."""
    lost: dict[str, list[str]] = {"friction": [], "damping": [], "spring": [], "limits": []}
    for joint in joints:
        hanging = joint not in cut
        uses_axis = hanging and _has_coordinate(joint)
        limited = joint.lower > -inf or joint.upper < inf
        is_lost = {
            "friction": joint.friction != 0,
            "damping": joint.damping != 0 and (not hanging or joint.kind == "fixed"),
            "spring": joint.stiffness != 0 and not uses_axis,
            "limits": limited and (not uses_axis or joint.kind == "continuous"),
        }
        for setting, names in lost.items():
            if is_lost[setting]:
                names.append(joint.name)
    for setting, names in lost.items():
        if names:
            yield f"joint {setting}: {_quote(names)}"


def _quote(names: Iterable[str]) -> str:
    return ", ".join(repr(name) for name in names)
