"""Read a robot from an SDF file (1.5 and later): a tree, and the joints that close its loops.

The other files of the reader, in the order in which a file passes through them:

    sdf_xml      reads the words and numbers of elements (`xml` finds these)
    sdf_graph    where each link, joint and frame is drawn: oMx in the model frame o
    sdf_joint    axes, limits, springs, gears
    sdf_types    the values that all of them hand on
    sdf_build    the way from the file's joints to a model, which takes these steps:
    sdf_kinds    the types of joints; a universal joint becomes two hinges
    sdf_gears    a gearbox becomes a coupling of two hinges
    sdf_copies   loops as Pinocchio's C++ parser opens them, if asked for
    sdf_span     which joints make the tree, and which are cut
    sdf_tree     the Pinocchio model, and frames for what was cut
    sdf_unused   what is not in the model

The format: http://sdformat.org/spec
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin.errors import InvalidModel
from condyn_pin.io.inertia import inertia_in, tensor
from condyn_pin.io.sdf_build import Choices, build
from condyn_pin.io.sdf_graph import links_of, model_poses, parts_of, pose_in, pose_of
from condyn_pin.io.sdf_joint import joint_of
from condyn_pin.io.sdf_types import WORLD, Closure, Description, Link, SdfRobot
from condyn_pin.io.sdf_xml import number, unread
from condyn_pin.io.xml import check_counts, find, label, parsed

__all__ = ["Closure", "SdfRobot", "read_sdf"]


def read_sdf(
    path: str | PathLike[str],
    *,
    root: str | None = None,
    root_joint: Any | None = None,
    kinds: Mapping[str, str] = MappingProxyType({}),
    drop: Sequence[str] = (),
    cut: Sequence[str] = (),
    actuated: Sequence[str] = (),
    as_file: bool = False,
) -> SdfRobot:
    """Read an SDF file into a Pinocchio model and the closures of its loops.

    Parameters
    ----------
    path : str or path
        File with exactly one model.
    root : str, optional
        Link on which the tree stands. By default the one that is no joint's child.
    root_joint : pin.JointModel, optional
        Joint between the world and the root link, such as ``pin.JointModelFreeFlyer()``: its
        configuration replaces the root link's pose of the file. By default the root link is
        fixed where the file puts it.
    kinds : mapping of str to str
        Joint name to the type that replaces the file's: fixed, revolute, continuous, prismatic,
        ball, universal or revolute2.
    drop : sequence of str
        Joints to leave out.
    cut : sequence of str
        Joints to cut, each in a loop. By default the reader chooses.
    actuated : sequence of str
        Joints with a motor, which are never cut: a motor needs a coordinate.
    as_file : bool
        Open loops as Pinocchio's C++ parser does: every joint is in the tree, and the links with n
        parent joints are there n times, each with m/n and I/n, and welded. A gearbox is a hinge
        without its ratio.

    Returns
    -------
    SdfRobot
        The model, its closures and couplings, its springs, and what the file has and the model
        does not use.

    Raises
    ------
    InvalidModel
        The file cannot be read, or what it says cannot be made a model.
    UnknownName
        `root`, `kinds`, `drop`, `cut` or `actuated` has a name that the file or the reader does
        not know.
    InvalidArgument
        Both `cut` and `as_file` are given.

    Notes
    -----
    A loop is cut at its joint of most freedom: a ball before a hinge or slider, those before a
    fixed joint; among equals at one without spring, then at the last of the file. A universal
    joint is two hinges, ``name_axis`` and ``name_axis2``, which are not cut, and neither are the
    hinges of a gearbox.

    Where the tree runs from child to parent, the joint is reversed: about the opposite axis, so
    that the coordinate of a hinge or slider, its limits, its spring and its damping stay what the
    file says. The quaternion of a reversed ball is the inverse of the file's.

    The file draws the model at ``pin.neutral(model)``, where therefore every loop is closed. A
    continuous joint is one angle without limits.
    """
    choices = Choices(
        root=root,
        root_joint=root_joint,
        kinds=kinds,
        drop=drop,
        cut=cut,
        actuated=actuated,
        as_file=as_file,
    )
    try:
        return build(_parse(path), choices)
    except InvalidModel as error:
        error.args = (f"{path}: {error}",)
        raise


def _parse(path: str | PathLike[str]) -> Description:
    try:
        sdf = parsed(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InvalidModel(f"cannot be opened: {reason}; give the path of an SDF file") from error
    except ValueError as error:
        raise InvalidModel(f"cannot be read as XML: {error}") from error
    model = _only_model(sdf)
    joints = [joint for joint in model.findall("joint") if joint.get("type") != "fixed"]
    check_counts(len(model.findall("link")), len(joints))
    parts = parts_of(model)
    wMo, base = pose_in(model)
    if base not in ("", WORLD):
        raise InvalidModel(f"{label(model)}: pose relative to {base!r}; place it in the world")
    link_of = links_of(parts, model.get("canonical_link"))
    poses = model_poses(parts, wMo.inverse())

    def tagged(tag: str) -> list[tuple[str, Element]]:
        return [(name, element) for name, element in parts.items() if element.tag == tag]

    return Description(
        name=model.get("name", ""),
        pose=wMo,
        links=tuple(Link(n, poses[n], _inertia(e, n, poses)) for n, e in tagged("link")),
        joints=tuple(joint_of(e, n, poses, link_of) for n, e in tagged("joint")),
        frames={n: (link_of[n], poses[n]) for n, _ in tagged("frame")},
        unread=unread(sdf),
    )


def _only_model(sdf: Element) -> Element:
    if sdf.tag != "sdf":
        raise InvalidModel(f"the file holds <{sdf.tag}>; a file that starts with <sdf> is needed")
    version = sdf.get("version", "")
    parts = version.split(".")
    # Before 1.5 an axis without a frame was meant in the axes of the model.
    if not all(part.isdecimal() for part in parts) or tuple(map(int, parts)) < (1, 5):
        raise InvalidModel(f"<sdf> has version {version!r}; 1.5 or later is needed")
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if len(models) != 1:
        found = ", ".join(repr(m.get("name")) for m in models) or "no <model>"
        included = _includes([*sdf.findall("include"), *sdf.findall("world/include")])
        found += f", but{included}" if included else ""
        raise InvalidModel(f"the file has {found}; exactly one <model> is needed")
    if models[0].get("placement_frame"):
        raise InvalidModel("<model> has a placement_frame, which is not supported; write its pose")
    nested = models[0].find("model")
    if nested is not None:
        raise InvalidModel(
            f"{label(models[0])}: {label(nested)} in it is not followed; write its links and "
            "joints out in the model around it"
        )
    included = _includes(models[0].findall("include"))
    if included:
        raise InvalidModel(
            f"{label(models[0])} has{included}, which is not followed; write out what is included"
        )
    return models[0]


def _includes(elements: Sequence[Element]) -> str:
    """Return how errors list what a file includes."""
    uris = [repr((element.findtext("uri") or "").strip()) for element in elements]
    return f" <include> {', '.join(uris)}" if uris else ""


def _inertia(element: Element, name: str, poses: Mapping[str, Any]) -> Any | None:
    """Return the inertia of a link in its own frame; None if the file gives none."""
    inertial = find(element, "inertial")
    if inertial is None:
        return None
    if inertial.get("auto", "false") not in ("false", "0"):
        raise InvalidModel(f"{label(element)}: <inertial auto>; write its mass and inertia out")
    mass = number(element, "inertial/mass")
    moments = (number(element, f"inertial/inertia/i{ab}") for ab in ("xx", "yy", "zz"))
    products = (number(element, f"inertial/inertia/i{ab}", 0.0) for ab in ("xy", "xz", "yz"))
    inertia = tensor(*moments, *products)
    smallest, _, largest = np.linalg.eigvalsh(inertia)
    if smallest < -tolerances.MOMENT * abs(largest):
        raise InvalidModel(
            f"{label(element)}: <inertia> has the principal moment {smallest:g}; none may be < 0"
        )
    linkMc, base = pose_in(element, "inertial/pose")
    if base not in ("", name):
        linkMc = poses[name].actInv(pose_of(base, poses, element) * linkMc)
    return inertia_in(mass, linkMc, inertia)
