"""What an MJCF draws: its geoms, as MuJoCo places them.

MuJoCo reads the file, with its default classes, sizes from end points, attached parts and meshes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, MissingExtra
from condyn_pin.io.meshes import Mesh
from condyn_pin.io.mjcf_file import compiled
from condyn_pin.io.shape import Shape

WORLD: Final = "universe"  # Pinocchio's name of it, as a frame
_HIDDEN: Final = 3  # geoms of this group and above are not seen in MuJoCo's viewer, by custom
# Types of geoms in the order of MuJoCo's mjtGeom; a plane is not drawn, for the floor is.
_KINDS: Final = ("plane", "height field", "sphere", "capsule", "ellipsoid", "cylinder", "box",
                 "mesh", "signed distance field")  # fmt: skip


def geoms_of(path: Path, *, collide: bool) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Return the shapes of an MJCF file, and what could not be drawn, a sentence each.

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
    kinds = {g: _KINDS[int(mj.geom_type[g])] for g in chosen}
    unknown = sorted(
        {kind for kind in kinds.values() if kind not in (*_GEOM_SIZES, "mesh", "plane")}
    )
    missing += tuple(f"{path.name}: a {kind} is not drawn" for kind in unknown)
    shapes = (
        _geom_shape(mj, g, kind) for g, kind in kinds.items() if kind in (*_GEOM_SIZES, "mesh")
    )
    return tuple(shapes), missing


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
