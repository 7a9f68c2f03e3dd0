"""Shape: a piece of a link, as a description draws it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin.viewing import meshes
from condyn_pin.viewing.meshes import Mesh
from condyn_pin.viewing.palette import BODY, Colour


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
            shape = meshes.read_mesh(self.file).moved(np.diag([*self.size, 1.0]))
        elif self.kind == "ellipsoid":
            shape = meshes.sphere(1.0).moved(np.diag([*self.size, 1.0]))
        elif self.kind == "box":
            shape = meshes.box(*self.size)
        elif self.kind == "cylinder":
            shape = meshes.cylinder(*self.size)
        elif self.kind == "capsule":
            radius, length = self.size
            down = np.eye(4)
            down[2, 3] = -0.5 * length
            shape = meshes.capsule(radius, length).moved(down)
        else:
            shape = meshes.sphere(*self.size)
        return shape.moved(self.placement.homogeneous)
