"""Meshes of files: what is drawn has the area and the bounds of a plain reading of each file."""

from __future__ import annotations

import numpy as np
import plain_meshes as plain
import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin.io import meshes
from condyn_pin.io.shapes import shapes_of

pytestmark = pytest.mark.once


def files(name):
    """The mesh files that a robot is drawn with."""
    shapes, missing = shapes_of(cp.load_robot(name).description)
    assert missing == ()
    return sorted({shape.file for shape in shapes if shape.file})


def area(mesh):
    return plain.area(mesh.vertices[mesh.faces])


def is_as_plainly_read(path):
    """Whether what is drawn of a file has the area and the bounds of a plain reading of it."""
    drawn = meshes.read_mesh(path)
    corners, expected = drawn.vertices[drawn.faces], plain.once(plain.triangles(path))
    size = np.ptp(expected.reshape(-1, 3), axis=0).max()
    return area(drawn) == pytest.approx(plain.area(expected), rel=1e-5) and all(
        np.abs(bound(corners, axis=(0, 1)) - bound(expected, axis=(0, 1))).max() < 1e-6 * size
        for bound in (np.min, np.max)
    )


@pytest.mark.parametrize("name", cp.io.available_robots())
def test_meshes_have_the_area_and_the_bounds_of_their_files(name):
    assert [path.name for path in files(name) if not is_as_plainly_read(path)] == []


@pytest.mark.long
def test_robots_are_drawn_by_files():
    assert len(files("cassie")) > 10


_SOURCE = """<source id="{id}"><float_array id="{id}-array" count="{n}">{numbers}</float_array>
<technique_common><accessor source="#{id}-array" count="{count}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>"""
_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="{unit}" meter="{metres}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse>
<color>1 0 0 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>{source}
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="one"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2</p></triangles>
<triangles count="1" material="other"><input semantic="VERTEX" source="#v" offset="0"/>
<p>3 4 5</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n">
<matrix>0 -1 0 1  1 0 0 0  0 0 1 0  0 0 0 1</matrix>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="one" target="#m"/><instance_material symbol="other" target="#m"/>
</technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
_POINTS = "0 0 0  1 0 0  0 1 0  5 5 5  7 5 5  5 5 6"


def dae(path, unit="meter", metres="1", up="Z_UP"):
    source = _SOURCE.format(id="p", n=18, count=6, numbers=_POINTS)
    path.write_text(_DAE.format(source=source, unit=unit, metres=metres, up=up))
    return path


@pytest.mark.long
def test_a_second_material_has_its_own_corners(tmp_path):
    path = dae(tmp_path / "two.dae")
    assert area(meshes.read_mesh(path)) == pytest.approx(0.5 + 1.0)
    assert is_as_plainly_read(path)


@pytest.mark.long
@pytest.mark.parametrize(("unit", "metres"), [("millimeter", "0.001"), ("inch", "0.0254")])
def test_a_collada_file_in_other_units_is_drawn_in_metres(tmp_path, unit, metres):
    mesh = meshes.read_mesh(dae(tmp_path / "small.dae", unit, metres))
    assert area(mesh) == pytest.approx(1.5 * float(metres) ** 2)


@pytest.mark.long
def test_the_axis_that_a_collada_file_calls_up_does_not_turn_it(tmp_path):
    """A link's frame says where its mesh is; ROS's viewers leave it at that, and so does Gazebo."""
    upright = meshes.read_mesh(dae(tmp_path / "z.dae", up="Z_UP"))
    lying = meshes.read_mesh(dae(tmp_path / "y.dae", up="Y_UP"))
    assert np.allclose(upright.vertices, lying.vertices)


_OBJ = """mtllib nowhere.mtl
v 0 0 0
v 1 0 0
v 1 2 0
v 0 2 0
v 0 0 3
usemtl a
f 1 2 3 4
usemtl b
f -5/1/1 2/2/2 5/3/3
"""
_TEXT_STL = """solid thing
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 2 0
 endloop
endfacet
endsolid thing
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "text", "wanted"), [("a.obj", _OBJ, 2.0 + 1.5), ("a.stl", _TEXT_STL, 1.0)]
)
def test_other_formats_are_read(tmp_path, name, text, wanted):
    path = tmp_path / name
    path.write_text(text)
    assert area(meshes.read_mesh(path)) == pytest.approx(wanted)
    assert is_as_plainly_read(path)


@each_row(
    ("name", "content"),
    [
        ("no.dae", b"<COLLADA"),
        ("no.dae", b""),
        ("no.obj", b"f 1 2 3\n"),
        ("no.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("no.stl", b"solid x\nfacet"),
        ("no.stl", b"\0" * 90),
        ("no.fbx", b"?"),
        ("no", b"?"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(cp.errors.InvalidModel, match=name):
        meshes.read_mesh(path)
