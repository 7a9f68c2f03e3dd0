"""Which joints of an SDF file make the tree, in which order, and which ones are cut.

The links are the nodes of a graph and the joints its edges, from parent to child. A spanning tree
is grown from the root; each joint outside of it closes a loop.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_types import WORLD, Description, Joint

KINDS: Final = ("fixed", "revolute", "continuous", "prismatic", "ball")


class Span(NamedTuple):
    """A spanning tree."""

    start: str  # the link on which it stands, or the world
    tree: tuple[Joint, ...]  # depth-first
    cut: tuple[Joint, ...]  # in the order of the file


def chosen_joints(
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
        if joint.has_axis and joint.axis is None:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and has no <axis/xyz>; give it one"
            )
    return joints


def span(sdf: Description, joints: Sequence[Joint], root: str | None, floating: bool) -> Span:
    """Return the tree that these joints make from the root to every link of the file."""
    start = _start(sdf, joints, root, floating)
    leads_to = _leading_joints(joints, start)
    lost = [link.name for link in sdf.links if link.name not in leads_to and link.name != start]
    if lost:
        raise InvalidModel(
            f"no joint leads from {start!r} to the links {quote(lost)}; joints are followed from "
            "parent to child: add a joint, or exchange the parent and the child of one"
        )
    tree = [joint for joint in joints if leads_to.get(joint.child) is joint]
    cut = [joint for joint in joints if leads_to.get(joint.child) is not joint]
    return Span(start, tuple(_depth_first(tree, start)), tuple(cut))


def _start(sdf: Description, joints: Sequence[Joint], root: str | None, floating: bool) -> str:
    """Return the link on which the tree stands, or the world if joints attach links to it."""
    links = [link.name for link in sdf.links]
    if root is not None and root not in links:
        raise unknown_name("link", root, links)
    anchors = [joint for joint in joints if joint.parent == WORLD]
    if anchors:
        names = quote([joint.name for joint in anchors])
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
        return WORLD
    children = {joint.child for joint in joints}
    roots = [root] if root is not None else [link for link in links if link not in children]
    if len(roots) != 1:
        found = f"no joint has the links {quote(roots)} as child" if roots else "every link is one"
        raise InvalidModel(
            f"the tree needs one root, a link that is no joint's child, and {found}: "
            + ("connect them by joints" if roots else "name one by root=")
        )
    return roots[0]


def _leading_joints(joints: Sequence[Joint], start: str) -> dict[str, Joint]:
    """Return for each link that can be reached from the start the joint that leads to it."""
    first: dict[str, Joint] = {}
    for joint in joints:
        first.setdefault(joint.child, joint)
    leads_to: dict[str, Joint] = {}
    reached = {start}
    while True:
        edges = [j for j in joints if j.parent in reached and j.child not in reached]
        if not edges:
            return leads_to
        # A link's first joint may hang below the link itself; then any joint that leads to it.
        joint = next((j for j in edges if first[j.child] is j), edges[0])
        leads_to[joint.child] = joint
        reached.add(joint.child)


def _depth_first(tree: Iterable[Joint], start: str) -> Iterator[Joint]:
    """Yield the joints of a tree depth-first: in another order crba is silently wrong."""
    below: dict[str, list[Joint]] = defaultdict(list)
    for joint in tree:
        below[joint.parent].append(joint)
    waiting = below[start][::-1]
    while waiting:
        joint = waiting.pop()
        yield joint
        waiting.extend(reversed(below[joint.child]))


def quote(names: Iterable[str]) -> str:
    """Return names as errors list them."""
    return ", ".join(repr(name) for name in names)
