"""Which joints of an SDF file make the tree, in which order, and which ones are cut.

The links are the nodes of a graph and the joints its edges. Joints are taken one by one, those with
the least freedom first, and put into the tree unless they close a loop: Kruskal's spanning tree.
So each joint that is cut has the most freedom of its loop, and costs the fewest rows. Direction
does not matter: a joint that leads from the tree to its parent is reversed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from condyn_pin._core.names import quoted
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_kinds import FREEDOM
from condyn_pin.io.sdf_types import WORLD, Joint, SdfModel


class Span(NamedTuple):
    """A spanning tree."""

    start: str  # the link on which it stands, or the world
    tree: tuple[Joint, ...]  # depth-first, each from the root on
    cut: tuple[Joint, ...]  # in the order of the file
    reversed: tuple[str, ...]  # of the tree


def span(
    sdf: SdfModel,
    joints: Sequence[Joint],
    root: str | None,
    *,
    floating: bool,
    kept: Mapping[str, str],
    cut: Sequence[str],
) -> Span:
    """Return the tree that these joints make from the root to every link of the file.

    `kept` has the joints that must not be cut, each with the reason; `cut` those that must be.
    """
    for name in cut:
        if name not in [joint.name for joint in joints]:
            raise unknown_name("joint", name, [joint.name for joint in joints])
    start = _start(sdf, joints, root, floating)
    names = _spanning(joints, kept, cut)
    tree, backwards = _depth_first([joint for joint in joints if joint.name in names], start)
    reached = {start, *(joint.child for joint in tree)}
    lost = [link.name for link in sdf.links if link.name not in reached]
    if lost:
        raise InvalidModel(
            f"no joint leads from {start!r} to the links {quoted(lost)}: add a joint that connects "
            "them, or leave them out of the file"
        )
    opened = tuple(joint for joint in joints if joint.name not in names)
    _check_cuts(names, opened, kept, cut)
    return Span(start, tree, opened, backwards)


def _start(sdf: SdfModel, joints: Sequence[Joint], root: str | None, floating: bool) -> str:
    """Return the link on which the tree stands, or the world if joints attach links to it."""
    links = [link.name for link in sdf.links]
    if root is not None and root not in links:
        raise unknown_name("link", root, links)
    anchors = [joint for joint in joints if joint.parent == WORLD]
    if anchors:
        names = quoted([joint.name for joint in anchors])
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
    return roots[0] if len(roots) == 1 else sdf.canonical


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


def _depth_first(joints: Iterable[Joint], start: str) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Return the joints of a tree depth-first, as crba needs them, and which ones are reversed."""
    at: dict[str, list[Joint]] = defaultdict(list)
    for joint in joints:
        at[joint.parent].append(joint)
        at[joint.child].append(joint)
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
