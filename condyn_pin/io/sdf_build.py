"""From what an SDF file says to a model: each step hands links and joints to the next one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from condyn_pin.constraints.coupling import Coupling
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.io.inertia import Body, doubts
from condyn_pin.io.sdf_copies import with_copies
from condyn_pin.io.sdf_gears import coupling_of
from condyn_pin.io.sdf_kinds import chosen_joints, in_series
from condyn_pin.io.sdf_span import Span, span
from condyn_pin.io.sdf_tree import Tree
from condyn_pin.io.sdf_types import Closure, Description, Joint, Link, SdfRobot
from condyn_pin.io.sdf_unused import unused_parts, unused_settings


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What the caller of `read_sdf`, which explains them, has chosen."""

    root: str | None
    root_joint: Any | None
    kinds: Mapping[str, str]
    drop: Sequence[str]
    cut: Sequence[str]
    actuated: Sequence[str]
    as_file: bool


def build(sdf: Description, choices: Choices) -> SdfRobot:
    """Return the model of a description, with what closes its loops."""
    choices = _complete(sdf, choices)
    chosen = chosen_joints(sdf, choices.kinds, choices.drop)
    links, chosen = in_series(sdf.links, chosen)
    gearboxes = tuple(joint for joint in chosen if joint.kind == "gearbox")
    joints = tuple(joint for joint in chosen if joint.kind != "gearbox")
    couplings = tuple(coupling_of(gearbox, joints) for gearbox in gearboxes)
    kept = _kept(links, joints, couplings, choices.actuated)
    welds: tuple[Closure, ...] = ()
    if choices.as_file:
        links, joints, welds = with_copies(links, joints)
    sdf = replace(sdf, links=links)
    floating = choices.root_joint is not None
    spanned = span(sdf, joints, choices.root, floating=floating, kept=kept, cut=choices.cut)
    tree = _grow(sdf, spanned, choices.root_joint)
    closing = [joint for joint in spanned.cut if tree.parts(joint)]
    idle = [joint.name for joint in spanned.cut if joint not in closing]
    closures = tuple(tree.close(joint) for joint in closing)
    for name, (link, oMf) in sdf.frames.items():
        tree.mark(name, link, oMf)
    root_pose = tree.poses[spanned.start] if floating else None
    return SdfRobot(
        model=tree.model,
        closures=closures + welds,
        couplings=couplings,
        springs=_springs(joints, spanned.cut),
        reversed=spanned.reversed,
        unused=(
            *unused_parts(sdf, choices.kinds, choices.drop, root_pose, idle),
            *unused_settings((*joints, *gearboxes), (*spanned.cut, *gearboxes)),
            *doubts(_bodies(links)),
        ),
    )


def _complete(sdf: Description, choices: Choices) -> Choices:
    """Return the choices with what `as_file` means for gearboxes."""
    if not isinstance(choices.as_file, bool):
        raise InvalidArgument(f"as_file = {choices.as_file!r}: True or False is needed")
    if not choices.as_file:
        return choices
    if choices.cut:
        raise InvalidArgument(
            f"cut = {list(choices.cut)!r}: with as_file no joint is cut; give one of the two"
        )
    hinges = {joint.name: "revolute" for joint in sdf.joints if joint.kind == "gearbox"}
    return replace(choices, kinds=hinges | dict(choices.kinds))


def _kept(
    links: Sequence[Link],
    joints: Sequence[Joint],
    couplings: Sequence[Coupling],
    actuated: Sequence[str],
) -> dict[str, str]:
    """Return the joints that must stay in the tree, with the reason as errors say it."""
    names = [joint.name for joint in joints]
    for name in actuated:
        if name not in names:
            raise unknown_name("joint", name, names)
    kept = dict.fromkeys(actuated, "is actuated")
    for coupling in couplings:
        for name in (coupling.joint_a, coupling.joint_b):
            kept.setdefault(name, f"is a hinge of the gearbox {coupling.name!r}")
    crosses = {link.name for link in links if link.massless}
    for joint in joints:
        if joint.parent in crosses or joint.child in crosses:
            kept.setdefault(joint.name, "is half of a universal joint")
    return kept


def _grow(sdf: Description, spanned: Span, root_joint: Any | None) -> Tree:
    tree = Tree(sdf)
    tree.plant(spanned.start, root_joint)
    for joint in spanned.tree:
        tree.attach(joint)
    return tree


def _springs(joints: Sequence[Joint], cut: Sequence[Joint]) -> dict[str, tuple[float, float]]:
    """Return stiffness and reference of the springs of joints that are in the tree."""
    return {
        joint.name: (joint.axis.stiffness, joint.axis.reference)
        for joint in joints
        if joint.axis.stiffness != 0 and joint.has_axis and joint not in cut
    }


def _bodies(links: Sequence[Link]) -> Iterator[Body]:
    for link in links:
        if link.inertia is not None and not link.massless:
            yield link.name, link.inertia.mass, link.inertia.inertia
