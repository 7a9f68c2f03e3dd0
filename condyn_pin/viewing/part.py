"""Parts, in the words of meshcat's viewer, and their colours.

Part: a shape that never changes, with a pose that does.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.io.meshes import Mesh
from condyn_pin.io.shapes import BODY as BODY
from condyn_pin.io.shapes import Colour as Colour
from condyn_pin.viewing.instant import Instant

# The words of meshcat's viewer: commands that set objects of three.js, as it reads them in JSON.
#
# They are written here, and not by meshcat's own Python: importing that takes 0.6 s, with IPython
# and ZeroMQ, which is most of the time in which a picture is to be there.


Command = dict[str, Any]

_FRONT, _BOTH_SIDES = 0, 2  # what others drew may be open, or wound either way
# Types of extensions by which msgpack-lite, in the viewer, knows typed arrays.
_EXTENSION: Final = {"uint16": ("Uint16Array", 0x14), "uint32": ("Uint32Array", 0x16),
                     "float32": ("Float32Array", 0x17)}  # fmt: skip


def mesh(
    path: str,
    shape: Mesh,
    colour: Colour,
    *,
    opacity: float = 1.0,
    on_top: bool = False,
    sheet: bool = False,
    coarse: Mesh | None = None,
) -> Command:
    """Return the command that draws triangles."""
    # Those of `coarse` follow those of `shape` in one geometry, from index `whole` on: a page
    # chooses between them by the range that it draws, at no cost. A mesh `on_top` is seen through
    # all before it. It is a solid wound outward, seen from one side only: three.js draws both sides
    # of a transparent mesh one after the other. A `sheet` is seen from above only.
    whole = shape.faces.size
    if coarse is not None:
        shape = shape + coarse
    small = len(shape.vertices) < 2**16
    geometry = {
        "uuid": f"{path} geometry",
        "type": "BufferGeometry",
        "data": {
            "attributes": {"position": _array(shape.vertices.astype(np.float32))},
            "index": _array(shape.faces.astype(np.uint16 if small else np.uint32).ravel()),
        },
    }
    material = {
        "uuid": f"{path} material",
        "type": "MeshLambertMaterial",
        "color": number(colour),
        "flatShading": True,
        "side": _FRONT if on_top or sheet else _BOTH_SIDES,
        "opacity": opacity,
        # three.js draws what is transparent last, and so over all that is opaque
        "transparent": on_top or opacity < 1.0,
        "depthTest": not on_top,
    }
    command = _object(path, "Mesh", [geometry], material)
    if coarse is not None:
        command["object"]["object"]["userData"] = {"whole": whole}
    return command


def label(path: str, png: bytes) -> Command:
    """Return the command that draws a picture facing the camera, on top."""
    url = f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
    image = {"uuid": f"{path} image", "url": url}
    texture = {
        "uuid": f"{path} texture",
        "image": image["uuid"],
        "wrap": [1001, 1001],  # clamp to the edge
        "repeat": [1, 1],
    }
    material = {
        "uuid": f"{path} material",
        "type": "SpriteMaterial",
        "color": 0xFFFFFF,
        "map": texture["uuid"],
        "transparent": True,
        "depthTest": False,
    }
    command = _object(path, "Sprite", [], material)
    command["object"] |= {"textures": [texture], "images": [image]}
    command["object"]["object"]["renderOrder"] = 1  # after arrows and marks, so that it can be read
    return command


def transform(path: str, T: Array) -> Command:
    """Return the command that sets the pose T (4, 4) of the object at a path."""
    return {"type": "set_transform", "path": path, "matrix": T.T.ravel().tolist()}


def hide(path: str) -> Command:
    """Return the command that hides the object at a path."""
    return {"type": "set_property", "path": path, "property": "visible", "value": False}


def delete(path: str) -> Command:
    """Return the command that removes the object at a path."""
    return {"type": "delete", "path": path}


def track(name: str, kind: str, values: Array, frames: Array) -> dict[str, Any]:
    """Return the keyframe track of a property: values (k, n) at frames (k,)."""
    return {
        "name": f".{name}",
        "type": kind,
        "times": _packed(frames.astype(np.float32)),
        "values": _packed(values.astype(np.float32)),
    }


def animation(tracks: dict[str, list[dict[str, Any]]], fps: float) -> Command:
    """Return the command that plays tracks by path, again and again."""
    clips = [
        {"path": path, "clip": {"fps": fps, "name": path, "tracks": each}}
        for path, each in tracks.items()
    ]
    return {
        "type": "set_animation",
        "animations": clips,
        "options": {"play": True, "repetitions": 1_000_000},
        "path": "",
    }


def number(colour: Colour) -> int:
    """Return a colour as one number, two hexadecimal digits each."""
    red, green, blue = (round(255 * x) for x in colour)
    return (red << 16) + (green << 8) + blue


def packed_command(command: Command) -> str:
    """Return a command as it is written into a page: msgpack in base 64."""
    import umsgpack

    return base64.b64encode(umsgpack.packb(command)).decode("ascii")


def _object(
    path: str, kind: str, geometries: Sequence[Command], material: Command
) -> dict[str, Any]:
    found = {"uuid": f"{path} object", "type": kind, "material": material["uuid"]}
    if geometries:
        found["geometry"] = geometries[0]["uuid"]
    content = {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": list(geometries),
        "materials": [material],
        "object": found,
    }
    return {"type": "set_object", "path": path, "object": content}


def _array(x: NDArray[Any]) -> Command:
    """Return the attribute of a buffer geometry."""
    size = 1 if x.ndim == 1 else x.shape[1]
    kind = _EXTENSION[x.dtype.name][0]
    return {"itemSize": size, "type": kind, "array": _packed(x), "normalized": False}


def _packed(x: NDArray[Any]) -> Any:
    import umsgpack

    return umsgpack.Ext(_EXTENSION[x.dtype.name][1], np.ascontiguousarray(x).tobytes())


# Part: a shape that never changes, with a pose that does.


# A homogeneous matrix (4, 4) in the world, or None where the part is not to be seen.
Pose = Callable[[Instant], Array | None]
Tint = Callable[[Instant], Colour]

_Found = TypeVar("_Found")

_GHOST = 0.25  # opacity of what was
_NOWHERE = np.diag([1e-9, 1e-9, 1e-9, 1.0])  # too small to be seen; zero has no rotation


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a picture."""

    path: str  # its name in meshcat's tree, such as ``closures/achilles/gap``
    pose: Pose
    meshes: tuple[tuple[Mesh, Colour], ...] = ()
    # meshes drawn during motion without a graphics card; empty: the same as at rest
    coarse: tuple[Mesh, ...] = ()
    picture: bytes = b""  # A PNG that faces the camera, in place of meshes
    opacity: float = 1.0
    on_top: bool = False  # whether it is seen through what is before it
    sheet: bool = False  # whether it is seen from its front alone, as a floor is from above
    tint: Tint | None = None  # its colour, where that changes with the instant

    def place(self, at: Instant) -> Array:
        """Return its pose (4, 4) at an instant; if it is hidden, one of negligible size."""
        T = self.pose(at)
        return _NOWHERE if T is None else T

    def commands(self, at: Instant) -> Iterator[Command]:
        """Return the commands that draw it at an instant."""
        for i, (shape, colour) in enumerate(self.meshes):
            chosen = colour if self.tint is None else self.tint(at)
            yield mesh(
                f"{self.path}/{i}", shape, chosen, opacity=self.opacity, on_top=self.on_top,
                sheet=self.sheet, coarse=self.coarse[i] if self.coarse else None,
            )  # fmt: skip
        if self.picture:
            yield label(f"{self.path}/0", self.picture)
        yield transform(self.path, self.place(at))

    def ghost(self, at: Instant) -> Part:
        """Return its pale copy, fixed in its pose at an instant."""
        T, tint = self.pose(at), self.tint
        colour = None if tint is None else tint(at)
        return replace(
            self,
            path=f"before/{self.path}",
            pose=lambda _: T,
            tint=None if colour is None else lambda _: colour,
            opacity=self.opacity if self.on_top else _GHOST,
        )


def pose_from(found: Callable[[Instant], _Found | None], place: Callable[[_Found], Array]) -> Pose:
    """Return the pose place(found(instant)); hidden where `found` gives None."""

    def pose(at: Instant) -> Array | None:
        known = found(at)
        return None if known is None else place(known)

    return pose


def span(start: Array, end: Array) -> Array:
    """Return the matrix (4, 4) that maps the unit segment along z to one from start to end."""
    along = end - start
    length = float(np.linalg.norm(along))
    z = along / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :4] = np.column_stack([x, np.cross(z, x), max(length, 1e-9) * z, start])
    return T


def joint_pose(i: int) -> Pose:
    """Return the pose of joint i as a function of the instant."""
    return lambda at: np.asarray(at.joints[i].homogeneous)


def at_point(point: Array) -> Array:
    """Return the translation (4, 4) of the origin to a point."""
    T = np.eye(4)
    T[:3, 3] = point
    return T


# Colours: those of Okabe and Ito, told apart by colour-blind eyes.


GHOST: Final[Colour] = (0.55, 0.55, 0.60)
ACTUATED: Final[Colour] = (0.902, 0.624, 0.0)  # orange
PASSIVE: Final[Colour] = (0.25, 0.25, 0.25)
CONTACT: Final[Colour] = (0.8, 0.475, 0.655)  # purple
GROUND: Final[Colour] = (1.0, 0.97, 0.88)
CONE: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
AWAY: Final[Colour] = (0.55, 0.55, 0.55)
STICKS: Final[Colour] = CONTACT
SLIDES: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion
FORCE: Final[Colour] = (0.0, 0.447, 0.698)  # blue
REACTION: Final[Colour] = (0.337, 0.706, 0.914)  # sky blue
MOMENT: Final[Colour] = (0.533, 0.133, 0.333)  # wine
SPRING: Final[Colour] = (0.35, 0.40, 0.55)
SUPPORT: Final[Colour] = (0.0, 0.62, 0.451)  # green
PRESSURE: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion
CAPTURE: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
DIVERGENT: Final[Colour] = (0.337, 0.706, 0.914)  # sky blue
GRID: Final[Colour] = (0.78, 0.78, 0.78)
FLOOR: Final[Colour] = (1.0, 1.0, 1.0)
MASS: Final[Colour] = (0.0, 0.0, 0.0)
AXES: Final[tuple[Colour, Colour, Colour]] = ((0.85, 0.1, 0.1), (0.1, 0.6, 0.1), (0.1, 0.2, 0.9))

CLOSED: Final[Colour] = (0.0, 0.62, 0.451)  # green
AJAR: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
OPEN: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion

_MODES: Final = {"open": AWAY, "stick": STICKS, "slide": SLIDES}
_WIDE: Final = 1e-2  # [m] a gap that everybody sees


def gap_colour(length: float) -> Colour:
    """Return the colour of a gap [m]: green is closed, then from yellow to vermillion."""
    # Up to 1e-10 m it is closed; from 1 cm on it is vermillion, on a scale of logarithms in
    # between.
    if length <= tolerances.CLOSED:
        return CLOSED
    decades = math.log(_WIDE / tolerances.CLOSED)
    x = min(math.log(length / tolerances.CLOSED) / decades, 1.0)
    red, green, blue = (a + x * (b - a) for a, b in zip(AJAR, OPEN, strict=True))
    return red, green, blue


def mode_colour(mode: str) -> Colour:
    """Return the colour of a contact mode: open, stick or slide; or unknown."""
    return _MODES.get(mode, CONTACT)
