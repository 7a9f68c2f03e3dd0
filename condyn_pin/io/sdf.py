"""Read a robot from an SDF file (1.4 and later): a tree, and the joints that close its loops.

The other files of the reader, in the order in which a file passes through them:

    sdf_parts    the models of the file and of those that it includes; where each part is drawn
    sdf_file     what the file says: links, joints and axes as values
    sdf_tree     the types of joints; which of them make the tree, and what closes its loops

The format: http://sdformat.org/spec
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from os import PathLike
from types import MappingProxyType
from typing import Any, Final

from condyn_pin._core.arguments import check_type, quoted_names
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.io.description import Description, implausible_inertias
from condyn_pin.io.sdf_file import Joint, Link, SdfModel, parse
from condyn_pin.io.sdf_tree import (
    MOTOR,
    SdfTree,
    chosen_joints,
    coupling_of,
    in_series,
    mimics_of,
    span,
    with_copies,
)
from condyn_pin.io.xml import place
from condyn_pin.model.springs import Spring
from condyn_pin.model.whole_joints import Settings

# Settings of joints that change nothing, or that a scene adds, and those that change the motion.
_FRICTION: Final = "joint friction, which robot.frictions() adds to the contacts of a scene"
_SMALL: Final = (
    "second axis", _FRICTION, "joint limits that the type has not", "settings of fixed joints",
)  # fmt: skip
_LARGE: Final = ("joint friction", "joint damping", "joint spring", "joint limits")


def read_sdf(
    path: str | PathLike[str],
    *,
    model: str | Sequence[str] | None = None,
    root: str | None = None,
    root_joint: Any | None = None,
    kinds: Mapping[str, str] = MappingProxyType({}),
    drop: Sequence[str] = (),
    cut: Sequence[str] = (),
    actuated: Sequence[str] = (),
    as_file: bool = False,
) -> Description:
    """Read an SDF file into a Pinocchio model and the closures of its loops.

    Parameters
    ----------
    path : str or path
    model : str or sequence of str, optional
        The model of the file. By default the only one that is not static. Several are one robot,
        with the joints of the world between them; names of parts begin with that of their model,
        as in ``arm::tool``, where another part has the rest of it too.
    root : str, optional
        Link on which the tree stands. By default the one that is no joint's child, or of several
        the canonical link.
    root_joint : pin.JointModel, optional
        Joint between the world and the root link, such as ``pin.JointModelFreeFlyer()``: its
        configuration replaces the root link's pose of the file. By default the root link is
        fixed where the file puts it.
    kinds : mapping of str to str
        Joint name to the type that replaces the file's: fixed, revolute, continuous, prismatic,
        screw, ball, universal or revolute2.
    drop : sequence of str
        Joints to leave out.
    cut : sequence of str
        Joints to cut, each in a loop. By default the reader chooses.
    actuated : sequence of str
        Joints with a motor, which are cut last: a motor needs a coordinate.
    as_file : bool
        Open loops as Pinocchio's C++ parser does: every joint is in the tree, and the links with n
        parent joints are there n times, each with m/n and I/n, and welded. A gearbox is a hinge
        without its ratio.

    Returns
    -------
    Description
        The model, its loops, couplings and springs, and the unused content of the file. Each link
        is a BODY frame, each joint a JOINT frame (FIXED_JOINT for a fixed one), each frame of the
        file an OP_FRAME, and so are the two ends of a joint that is cut, ``NAME_a`` on
        its parent link and ``NAME_b`` on its child, z along the axis of a hinge or slider. What is
        in a model of the model, written or included there, is named ``INNER::NAME``.

    Raises
    ------
    InvalidModel
        The file cannot be read, or its content makes no model.
    UnknownName
        `model`, `root`, `kinds`, `drop`, `cut` or `actuated` has a name that the file or the reader
        does not know.
    InvalidArgument
        Both `cut` and `as_file` are given.

    Notes
    -----
    A loop is cut at its joint of most freedom: a ball before a hinge or slider, those before a
    fixed joint; among equals at one without spring, then at the last of the file. A joint that is
    cut and has a motor, a spring, damping, friction or limits is whole all the same, as
    `Robot.with_whole_joints` makes it. A universal
    joint is two hinges, ``name_axis`` and ``name_axis2``, which are not cut, and neither are
    screws, the hinges of a gearbox, and joints that mimic or are mimicked.

    Where the tree runs from child to parent, the joint is reversed: about the opposite axis, so
    that the coordinate of a hinge or slider, its limits, its spring and its damping stay what the
    file says. The quaternion of a reversed ball is the inverse of the file's.

    The file draws the model at ``pin.neutral(model)``, where therefore every loop is closed. A
    continuous joint is one angle without limits, a screw its angle.

    Gravity is that of the <world>, or Pinocchio's where there is none, and zero if <gravity> is
    false for every link that moves.
    """
    check_type("as_file", as_file, bool, "True or False is needed")
    if as_file and cut:
        cuts = list(cut)
        raise InvalidArgument(f"cut = {cuts!r}: with as_file no joint is cut; give one of the two")
    with place(path):
        sdf = parse(path, model)
        if as_file:
            kinds = {j.name: "revolute" for j in sdf.joints if j.kind == "gearbox"} | dict(kinds)
        links, chosen = in_series(sdf.links, chosen_joints(sdf, kinds, drop))
        gearboxes = tuple(joint for joint in chosen if joint.kind == "gearbox")
        joints = tuple(joint for joint in chosen if joint.kind != "gearbox")
        geared = tuple(coupling_of(gearbox, joints) for gearbox in gearboxes)
        mimics = mimics_of(joints)
        kept = _tree_joints(links, joints, geared, mimics, actuated)
        welds: tuple[Loop, ...] = ()
        if as_file:
            links, joints, welds = with_copies(links, joints)
        sdf = replace(sdf, links=links)
        floating = root_joint is not None
        spanned = span(sdf, joints, root, floating=floating, kept=kept, cut=cut)
        tree = SdfTree(sdf, spanned, root_joint)
        closing = [joint for joint in spanned.cut if tree.can_move(joint)]
        idle = [joint.name for joint in spanned.cut if joint not in closing]
        loops = tuple(tree.close(joint) for joint in closing)
        for name, (link, oMf) in sdf.frames.items():
            tree.mark(name, link, oMf)
        root_poses = [tree.poses[start] for start, _ in spanned.trees] if floating else []
        moving = [link for link in links if tree.moves(link.name)]
        light = [link.name for link in moving if not (link.weighs or link.massless)]
        if light and len(light) == sum(not link.massless for link in moving):
            tree.model.gravity.setZero()
            light = []
        elif sdf.gravity is not None:
            tree.model.gravity.linear = sdf.gravity
        settings: dict[str, list[str]] = {what: [] for what in (*_SMALL, *_LARGE)}
        for joint in (*joints, *gearboxes):
            for what in _unused_settings(joint, joint not in gearboxes):
                settings[what].append(joint.name)
        said = {what: f"{what}: {quoted_names(names)}" for what, names in settings.items() if names}
        return Description(
            tree.model,
            name=sdf.name,
            loops=(*loops, *welds, *geared, *mimics),
            springs=tuple(
                Spring(joint.name, joint.axis.stiffness, joint.axis.reference)
                for joint in joints
                if joint.axis.stiffness != 0 and joint.has_axis and joint not in spanned.cut
            ),
            reversed=spanned.reversed,
            unused=(
                *_unused_parts(sdf, kinds, drop, root_poses, idle),
                *(
                    f"left out of <inertial>, and {value} here, as the format has it: "
                    f"{quoted_names(found)}"
                    for value, names in sdf.defaults.items()
                    if (found := [link.name for link in moving if link.name in names])
                ),
                *(text for what, text in said.items() if what in _SMALL),
                *implausible_inertias(
                    (k.name, k.inertia.mass, k.inertia.inertia) for k in links if k.inertia
                ),
            ),
            unmodelled=(
                *sdf.unmodelled,
                *(
                    [f"links without gravity: {quoted_names(light)}; here they weigh"]
                    if light
                    else ()
                ),
                *(text for what, text in said.items() if what in _LARGE),
            ),
            lost_rows=sdf.lost_rows,
            whole={
                joint.name: its
                for joint in closing
                if joint.kind != "fixed"
                and ((its := _settings(joint)).act or joint.name in actuated)
            },
            exclusions=sdf.exclusions,
        )


def _tree_joints(
    links: Sequence[Link],
    joints: Sequence[Joint],
    geared: Sequence[Coupling],
    mimics: Sequence[Coupling],
    actuated: Sequence[str],
) -> dict[str, str]:
    """Joints that must stay in the tree, with the reason as in error texts."""
    names = [joint.name for joint in joints]
    for name in actuated:
        if name not in names:
            raise unknown_name("joint", name, names)
    kept = dict.fromkeys(actuated, MOTOR)
    for what, couplings in (("a hinge of the gearbox", geared), ("in the <mimic>", mimics)):
        for coupling in couplings:
            for name in coupling.joints:
                kept.setdefault(name, f"is {what} {coupling.name!r}")
    crosses = {link.name for link in links if link.massless}
    for joint in joints:
        if joint.parent in crosses or joint.child in crosses:
            kept.setdefault(joint.name, "is half of a universal joint")
        if joint.kind == "screw":
            kept.setdefault(joint.name, "is a screw")
    return kept


def _unused_parts(
    sdf: SdfModel,
    kinds: Mapping[str, str],
    drop: Sequence[str],
    root_poses: Sequence[Any],
    idle: Sequence[str],
) -> Iterator[str]:
    """Parts of the file that are not in the model, a phrase for each kind."""
    yield from sdf.unread
    if drop:
        yield f"joints left out: {quoted_names(drop)}"
    changed = [
        f"{joint.name!r} ({joint.kind} as {kinds[joint.name]})"
        for joint in sdf.joints
        if joint.name not in drop and kinds.get(joint.name, joint.kind) != joint.kind
    ]
    if changed:
        yield f"joint types of the file: {', '.join(changed)}"
    if idle:
        yield f"joints between links that cannot move against each other: {quoted_names(idle)}"
    if any(not pose.isIdentity() for pose in root_poses):
        yield "pose of the root link in the file: the root joint's configuration replaces it"


def _settings(joint: Joint) -> Settings:
    """Settings of a joint that closes a loop."""
    axis, bounded = joint.axis, joint.kind in ("revolute", "prismatic")
    return Settings(
        lower=axis.lower if bounded else -inf,
        upper=axis.upper if bounded else inf,
        effort=axis.effort,
        velocity=axis.velocity,
        damping=axis.damping,
        friction=axis.friction,
        stiffness=axis.stiffness if joint.has_axis else 0.0,
        reference=axis.reference,
    )


def _unused_settings(joint: Joint, hanging: bool) -> Iterator[str]:
    """Unused settings of a joint, `hanging` in the tree or cut."""
    axis, bound = joint.axis, joint.has_axis
    limited = axis.lower > -inf or axis.upper < inf
    if joint.axis2.direction is not None and joint.kind != "gearbox":
        yield "second axis"
    if joint.kind == "fixed":
        if limited or axis.friction or axis.damping or axis.stiffness:
            yield "settings of fixed joints"
        return
    if axis.friction != 0:
        yield _FRICTION if hanging else "joint friction"
    if axis.damping != 0 and not hanging:
        yield "joint damping"
    if axis.stiffness != 0 and not (hanging and bound):
        yield "joint spring"
    if limited and (joint.kind == "continuous" or not bound):
        yield "joint limits that the type has not"
    elif limited and not hanging:
        yield "joint limits"
