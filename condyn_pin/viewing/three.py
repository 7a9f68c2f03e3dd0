"""The words of meshcat's viewer: commands that set objects of three.js, as it reads them in JSON.

They are written here, and not by meshcat's own Python: importing that takes 0.6 s, with IPython and
ZeroMQ, which is most of the time in which a picture is to be there.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.io.meshes import Mesh
from condyn_pin.viewing.palette import Colour

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
    coarse: Mesh | None = None,
) -> Command:
    """Return the command that draws triangles.

    Those of `coarse` follow those of `shape` in one geometry, `whole` says after how many indices:
    a page chooses by the range that it draws, which costs nothing.
    What is `on_top` is seen through what is before it. It is a solid that is wound outward: seen
    from one side only, since three.js draws both sides of what is transparent one after the other.
    """
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
        "side": _FRONT if on_top else _BOTH_SIDES,
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
    """Return the command that draws a picture which always faces the camera, on top."""
    image = {"uuid": f"{path} image", "url": _data_url("image/png", png)}
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
    """Return the command that places what is at a path (4, 4)."""
    return {"type": "set_transform", "path": path, "matrix": T.T.ravel().tolist()}


def set_property(path: str, name: str, value: Any) -> Command:
    """Return the command that sets a property of what is at a path."""
    return {"type": "set_property", "path": path, "property": name, "value": value}


def delete(path: str) -> Command:
    """Return the command that removes what is at a path."""
    return {"type": "delete", "path": path}


def track(name: str, kind: str, values: Array, frames: Array) -> dict[str, Any]:
    """Return how a property goes through values (k, n), each at its frame (k,)."""
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


def packed(command: Command) -> str:
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


def _data_url(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
