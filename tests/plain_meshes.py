"""Triangles of mesh files, read in the plainest way: what the reader of pictures is held against.

No code is shared with it. Every triangle is three corners; none is merged, none is left out.
"""

from __future__ import annotations

import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np


def triangles(path):
    """The corners (n, 3, 3) of every triangle of a STL, OBJ or COLLADA file, in metres."""
    path = Path(path)
    return {".stl": _stl, ".obj": _obj, ".dae": _dae}[path.suffix.lower()](path)


def once(corners):
    """The triangles without those that have no area or are there twice, whichever way round."""
    unique = {tuple(sorted(map(tuple, triangle.tolist()))): triangle for triangle in corners}
    return np.array([triangle for key, triangle in unique.items() if len(set(key)) == 3])


def area(corners):
    a, b, c = np.moveaxis(corners, 1, 0)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _stl(path):
    content = path.read_bytes()
    if content[:5] == b"solid" and b"facet normal" in content[:400]:
        words = [line.split()[1:] for line in content.decode().splitlines() if "vertex" in line]
        return np.array(words, dtype=float).reshape(-1, 3, 3)
    (count,) = struct.unpack_from("<I", content, 80)
    facets = [struct.unpack_from("<12f", content, 84 + 50 * i)[3:] for i in range(count)]
    return np.array(facets).reshape(-1, 3, 3)


def _obj(path):
    points, found = [], []
    for line in path.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            points.append([float(x) for x in rest[:3]])
        elif word == "f":
            corners = [int(each.split("/")[0]) for each in rest]
            corners = [k - 1 if k > 0 else k for k in corners]
            found += [[points[k] for k in _fan(corners, i)] for i in range(len(corners) - 2)]
    return np.array(found)


def _fan(corners, i):
    return corners[0], corners[i + 1], corners[i + 2]


def _dae(path):
    root = ElementTree.parse(path).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    by_id = {f"#{e.get('id')}": e for e in root.iter() if e.get("id")}
    unit = root.find("asset/unit")
    scale = 1.0 if unit is None else float(unit.get("meter", 1.0))
    shown = by_id[root.find("scene/instance_visual_scene").get("url")]
    found = [_below(node, np.eye(4), by_id) for node in shown.findall("node")]
    return scale * np.concatenate([each for some in found for each in some])


def _below(node, T, by_id):
    for child in node:
        if child.tag == "matrix":
            T = T @ np.array(child.text.split(), dtype=float).reshape(4, 4)
        elif child.tag in ("translate", "rotate", "scale"):
            numbers = np.array(child.text.split(), dtype=float)
            assert np.allclose(numbers, {"scale": 1.0}.get(child.tag, 0.0)) or (
                child.tag == "rotate" and numbers[3] == 0.0
            )
    found = [
        corners @ T[:3, :3].T + T[:3, 3]
        for instance in node.findall("instance_geometry")
        for corners in _geometry(by_id[instance.get("url")], by_id)
    ]
    for child in node.findall("node"):
        found += _below(child, T, by_id)
    return found


def _geometry(geometry, by_id):
    for kind in ("triangles", "polylist"):
        for piece in geometry.findall(f"mesh/{kind}"):
            inputs = piece.findall("input")
            vertex = next(each for each in inputs if each.get("semantic") == "VERTEX")
            stride = 1 + max(int(each.get("offset")) for each in inputs)
            position = by_id[vertex.get("source")].find("input[@semantic='POSITION']")
            numbers = by_id[position.get("source")].find("float_array").text.split()
            points = np.array(numbers, dtype=float).reshape(-1, 3)
            corners = np.array((piece.findtext("p") or "").split(), dtype=int)
            corners = corners.reshape(-1, stride)[:, int(vertex.get("offset"))].tolist()
            counts = [3] * (len(corners) // 3)
            if kind == "polylist":
                counts = [int(word) for word in piece.findtext("vcount").split()]
            first, rows = 0, []
            for count in counts:
                own = corners[first : first + count]
                rows += [_fan(own, i) for i in range(count - 2)]
                first += count
            yield points[np.array(rows)]
