"""Shapes of a description: what it draws, and what collides.

The <visual> or <collision> elements of a URDF or an SDF, the geoms of an MJCF.

The physics of a file is read, and checked, by its own reader. Here nothing is refused: a shape that
cannot be read is left out, and a sentence says so.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_geoms import geoms_of
from condyn_pin.io.sdf_graph import links_in
from condyn_pin.io.sdf_world import pose_in
from condyn_pin.io.shape import BODY, Colour, Shape
from condyn_pin.io.xml import open_xml

# How many sizes each shape has.
_SIZES = {"mesh": 3, "box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2, "sphere": 1}


def shapes_of(
    description: str,
    element: Literal["visual", "collision"] = "visual",
    *,
    model: str = "",
    package_dirs: Sequence[str] = (),
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Return the shapes of a file, and what could not be drawn, a sentence each.

    Parameters
    ----------
    description : str
        Path of a URDF, an SDF or an MJCF; of any other file, or of none, nothing is drawn.
    element : {"visual", "collision"}
        Which of them.
    model : str
        Of an SDF with several models that move, which of them.
    package_dirs : sequence of str
        Folders to look in for meshes, before all others.
    """
    path = Path(description)
    if path.suffix == ".xml" and path.is_file():
        return geoms_of(path, collide=element == "collision")
    if path.suffix not in (".urdf", ".sdf") or not path.is_file():
        return (), ()
    root = open_xml(path)
    colours = {
        material.get("name"): _colour(material)
        for material in root.findall("material")
        if material.find("color") is not None
    }
    shapes: list[Shape] = []
    missing: list[str] = []
    links = [(link.get("name", ""), link, path) for link in root.iter("link")]
    if path.suffix == ".sdf":
        try:
            links = links_in(path, model)
        except InvalidModel as error:  # several models move, and the robot is called otherwise
            return (), (f"shapes are not drawn: {error}",)
    for name, link, file in links:
        for visual in link.findall(element):
            try:
                shapes.append(_shape(file, name, visual, colours, package_dirs))
            except (ValueError, TypeError, OSError) as error:
                missing.append(f"link {name!r} is not drawn whole: {error}")
    return tuple(shapes), tuple(missing)


def _shape(
    path: Path,
    link: str,
    visual: Element,
    colours: dict[str | None, Colour],
    package_dirs: Sequence[str],
) -> Shape:
    geometry = visual.find("geometry")
    if geometry is None or not len(geometry):
        raise ValueError(f"a <{visual.tag}> without <geometry>")
    form = geometry[0]
    if form.tag not in _SIZES:
        raise ValueError(f"a <{form.tag}> is an unknown shape")
    material = visual.find("material")
    colour = BODY
    if material is not None:
        colour = colours.get(material.get("name"), _colour(material))
    file: Path | None = None
    size: tuple[float, ...] = (1.0, 1.0, 1.0)
    if form.tag == "mesh":
        uri = form.get("filename") or form.findtext("uri") or ""
        file = _found(path, uri, package_dirs)
        size = _numbers(form.get("scale") or form.findtext("scale"), size)
    elif form.tag == "box":
        size = _numbers(form.get("size") or form.findtext("size"), size)
    elif form.tag == "ellipsoid":
        size = _numbers(form.findtext("radii"), size)
    else:
        words = (form.get(key) or form.findtext(key) for key in ("radius", "length"))
        size = tuple(float(word) for word in words if word)
    if len(size) != _SIZES[form.tag]:
        raise ValueError(f"a <{form.tag}> with {len(size)} sizes in place of {_SIZES[form.tag]}")
    return Shape(link, _placement(visual), form.tag, size, file, colour)


def _placement(visual: Element) -> Any:
    """Return the placement of a <visual>: URDF writes <origin>, SDF <pose>."""
    origin, still = visual.find("origin"), (0.0, 0.0, 0.0)
    if origin is None:
        return pose_in(visual)[0]
    xyz, rpy = (_numbers(origin.get(key), still) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy[:3]), np.array(xyz[:3]))


def _colour(material: Element) -> Colour:
    """Return the colour of a <material>: an attribute in URDF, an element in SDF."""
    colour = material.find("color")
    text = colour.get("rgba") if colour is not None else material.findtext("diffuse")
    red, green, blue, *_ = _numbers(text, BODY)
    return red, green, blue


def _numbers(text: str | None, otherwise: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(float(word) for word in text.split()) if text else otherwise


def _found(path: Path, uri: str, package_dirs: Sequence[str]) -> Path:
    """Return the file that a description means by a URI.

    ``package://a/b/c.stl`` is c.stl in a folder a/b that lies in one of the package folders, beside
    the description, or beside one of the folders above it; without such a folder the same is tried
    with b alone. The folders of ROS_PACKAGE_PATH come last.
    """
    rest = PurePosixPath(uri.partition("://")[2] or uri)
    if rest.is_absolute() and Path(rest).is_file():
        return Path(rest)
    words = [word for word in rest.parts if word != "/"]
    for folder, i in _places(path, len(words), package_dirs):
        candidate = folder.joinpath(*words[i:])
        if candidate.is_file():
            return candidate
    raise OSError(f"no file {uri!r}")


def _places(path: Path, count: int, package_dirs: Sequence[str]) -> Iterator[tuple[Path, int]]:
    ros = [Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x]
    for i in range(count):
        for folder in (*map(Path, package_dirs), *path.absolute().parents, *ros):
            yield folder, i
