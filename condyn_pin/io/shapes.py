"""Shapes of a description: visual and collision geometry.

The <visual> or <collision> elements of a URDF or an SDF, the geoms of an MJCF.

The physics of a file is read, and checked, by its own reader. Here nothing is refused: a shape that
cannot be read is left out, and a sentence names it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, MissingExtra
from condyn_pin.io.meshes import Mesh, box, centred_capsule, cylinder, read_mesh, sphere
from condyn_pin.io.mjcf_file import compiled
from condyn_pin.io.sdf_parts import links_in, pose_in
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
    """Return the shapes of a file, and those that cannot be drawn, a sentence each.

    Of a file that is none of the three, or of none, nothing is drawn. `model` is the one of an SDF
    with several; in `package_dirs` meshes are looked for before all other folders.
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
    path: Path, link: str, visual: Element, colours: dict[str | None, Colour],
    package_dirs: Sequence[str],
) -> Shape:  # fmt: skip
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
        file = _file_of_uri(path, uri, package_dirs)
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


def _file_of_uri(path: Path, uri: str, package_dirs: Sequence[str]) -> Path:
    """Return the file that a description means by a URI.

    ``package://a/b/c.stl`` is c.stl in a folder a/b that lies in one of the package folders, beside
    the description, or beside one of the folders above it; without such a folder the same is tried
    with b alone. The folders of ROS_PACKAGE_PATH come last.
    """
    rest = PurePosixPath(uri.partition("://")[2] or uri)
    if rest.is_absolute() and Path(rest).is_file():
        return Path(rest)
    words = [word for word in rest.parts if word != "/"]
    ros = [Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x]
    folders = (*map(Path, package_dirs), *path.absolute().parents, *ros)
    for i in range(len(words)):
        for folder in folders:
            candidate = folder.joinpath(*words[i:])
            if candidate.is_file():
                return candidate
    raise OSError(f"no file {uri!r}")


Colour = tuple[float, float, float]  # red, green, blue from 0 to 1


BODY: Final[Colour] = (0.72, 0.74, 0.77)  # of a shape whose file says none


@dataclass(frozen=True, eq=False)
class Shape:
    """A piece of a link."""

    link: str  # that carries it: the name of a frame
    placement: Any  # its pose in the frame of the link
    kind: str  # one of `_SIZES`
    # Edges of a box, half axes of an ellipsoid, radius and length of what is round [m]; factors of
    # a mesh along its axes.
    size: tuple[float, ...]
    file: Path | None = None  # of a mesh
    colour: Colour = BODY
    triangles: Mesh | None = None  # of a mesh that was read already

    def mesh(self) -> Mesh:
        """Return its triangles, in the axes of the link."""
        if self.triangles is not None:
            shape = self.triangles
        elif self.kind == "mesh":
            assert self.file is not None
            shape = read_mesh(self.file).moved(np.diag([*self.size, 1.0]))
        else:
            shape = _SOLIDS[self.kind](*self.size)
        return shape.moved(self.placement.homogeneous)


_SOLIDS: dict[str, Callable[..., Mesh]] = {
    "box": box,
    "capsule": centred_capsule,
    "cylinder": cylinder,
    "ellipsoid": lambda *radii: sphere(1.0).moved(np.diag([*radii, 1.0])),
    "sphere": sphere,
}


WORLD: Final = "universe"  # Pinocchio's name of it, as a frame
_HIDDEN: Final = 3  # geoms of this group and above are not seen in MuJoCo's viewer, by custom
# Types of geoms in the order of MuJoCo's mjtGeom; a plane is not drawn, for the floor is.
_KINDS: Final = ("plane", "height field", "sphere", "capsule", "ellipsoid", "cylinder", "box",
                 "mesh", "signed distance field")  # fmt: skip


def geoms_of(path: Path, *, collide: bool) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Return the shapes of an MJCF file, and those that cannot be drawn, a sentence each.

    Those that are seen, or those that `collide`.
    """
    try:
        mj, missing = compiled(path)
    except (InvalidModel, MissingExtra) as error:
        return (), (f"{path.name}: its geoms are not drawn: {error}",)
    if collide:
        chosen = [g for g in range(mj.ngeom) if mj.geom_contype[g] or mj.geom_conaffinity[g]]
    else:
        seen = [g for g in range(mj.ngeom) if mj.geom_group[g] < _HIDDEN] or range(mj.ngeom)
        chosen = [g for g in seen if _geom_colour(mj, g)[3] > 0.0]
    kinds, known = {g: _KINDS[int(mj.geom_type[g])] for g in chosen}, {*_GEOM_SIZES, "mesh"}
    unknown = sorted({*kinds.values()} - known - {"plane"})
    missing += tuple(f"{path.name}: a {kind} is not drawn" for kind in unknown)
    return tuple(_geom_shape(mj, g, kind) for g, kind in kinds.items() if kind in known), missing


# Edges, or radius and length, of half axes as MuJoCo has them.
_GEOM_SIZES: Final[dict[str, Callable[[list[float]], tuple[float, ...]]]] = {
    "sphere": lambda s: (s[0],),
    "capsule": lambda s: (s[0], 2.0 * s[1]),
    "cylinder": lambda s: (s[0], 2.0 * s[1]),
    "ellipsoid": lambda s: (s[0], s[1], s[2]),
    "box": lambda s: (2.0 * s[0], 2.0 * s[1], 2.0 * s[2]),
}


def _geom_shape(mj: Any, g: int, kind: str) -> Shape:
    body = int(mj.geom_bodyid[g])
    w, x, y, z = mj.geom_quat[g]
    red, green, blue, _ = (float(each) for each in _geom_colour(mj, g))
    return Shape(
        link=(mj.body(body).name or f"body{body}") if body else WORLD,
        placement=pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), mj.geom_pos[g].copy()),
        kind=kind,
        size=(1.0, 1.0, 1.0) if kind == "mesh" else _GEOM_SIZES[kind](mj.geom_size[g].tolist()),
        colour=(red, green, blue),
        triangles=_mesh(mj, int(mj.geom_dataid[g])) if kind == "mesh" else None,
    )


def _mesh(mj: Any, m: int) -> Mesh:
    at, count = int(mj.mesh_vertadr[m]), int(mj.mesh_vertnum[m])
    first, faces = int(mj.mesh_faceadr[m]), int(mj.mesh_facenum[m])
    corners = np.array(mj.mesh_face[first : first + faces], dtype=np.uint32)
    return Mesh(np.array(mj.mesh_vert[at : at + count], dtype=float), corners)


def _geom_colour(mj: Any, g: int) -> Array:
    """Return red, green, blue and opacity of a geom: its material's, unless it has its own."""
    material = int(mj.geom_matid[g])
    return np.asarray(mj.geom_rgba[g] if material < 0 else mj.mat_rgba[material])
