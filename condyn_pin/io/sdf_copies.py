"""Loops as Pinocchio's C++ parser opens them: every joint in the tree, on a copy of its child.

A link with n parent joints is drawn n times, with m/n and I/n each. The first joint of the file
carries the link itself, every other one a copy, and the copy is welded to the link by 6 rows. A
joint that closes a loop so keeps its coordinate, at the price of as many freedoms and rows more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel
from condyn_pin.io.sdf_types import Closure, Joint, Link


def with_copies(
    links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...], tuple[Closure, ...]]:
    """Return links and joints without loops, and the welds that close them again."""
    parents = Counter(joint.child for joint in joints)
    shared = {link.name: _share(link, parents[link.name]) for link in links}
    copies: list[Link] = []
    hanging: list[Joint] = []
    welds: list[Closure] = []
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
            welds.append(Closure(joint.name, "weld", name, joint.child))
            joint = replace(joint, child=name)
        carried.add(joint.child)
        hanging.append(joint)
    return (*shared.values(), *copies), tuple(hanging), tuple(welds)


def _share(link: Link, n: int) -> Link:
    """Return a link with one n-th of its inertia."""
    if link.inertia is None or n < 2:
        return link
    Y = link.inertia
    return replace(link, inertia=pin.Inertia(Y.mass / n, Y.lever, Y.inertia / n))
