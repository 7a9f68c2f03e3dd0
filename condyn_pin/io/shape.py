"""Shape: a piece of a link, as descriptions draw it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from condyn_pin.io.mesh_files import read_mesh
from condyn_pin.io.meshes import Mesh, box, centred_capsule, cylinder, sphere

Colour = tuple[float, float, float]  # red, green, blue from 0 to 1


BODY: Final[Colour] = (0.72, 0.74, 0.77)  # of a shape whose file says none


@dataclass(frozen=True, eq=False)
class Shape:
    """A piece of a link.

    Attributes
    ----------
    link : str
        The link that carries it: the name of a frame.
    placement : pin.SE3
        Where it is on the link.
    kind : {"mesh", "box", "cylinder", "sphere", "capsule", "ellipsoid"}
    size : tuple of float
        Edges of a box, half axes of an ellipsoid, radius and length of what is round [m]; factors
        of a mesh along its axes.
    file : Path, optional
        Of a mesh.
    colour : Colour
    triangles : Mesh, optional
        Of a mesh that was read already.
    """

    link: str
    placement: Any
    kind: str
    size: tuple[float, ...]
    file: Path | None = None
    colour: Colour = BODY
    triangles: Mesh | None = None

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


def _ellipsoid(*radii: float) -> Mesh:
    return sphere(1.0).moved(np.diag([*radii, 1.0]))


_SOLIDS: dict[str, Callable[..., Mesh]] = {
    "box": box,
    "capsule": centred_capsule,
    "cylinder": cylinder,
    "ellipsoid": _ellipsoid,
    "sphere": sphere,
}
