"""Descriptions and tables that ask for too much are refused before the work, in one line."""

from __future__ import annotations

import json

import pytest
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin._core import files as texts
from condyn_pin.io import xml
from condyn_pin.io.mjcf_file import compiled

pytestmark = pytest.mark.once

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = f'<inertial><mass value="1"/>{INERTIA}</inertial>'


def urdf(count: int, kind: str = "revolute") -> str:
    """A chain of so many joints."""
    links = (f'<link name="l{i}">{LINK}</link>' for i in range(count + 1))
    joints = (
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>'


def sdf(count: int) -> str:
    mass = "<mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
    links = (f'<link name="l{i}"><inertial>{mass}</inertial></link>' for i in range(count + 1))
    joints = (
        f'<joint name="j{i}" type="revolute"><parent>l{i}</parent><child>l{i + 1}</child>'
        "<axis><xyz>0 0 1</xyz></axis></joint>"
        for i in range(count)
    )
    return f'<sdf version="1.7"><model name="m">{"".join(links)}{"".join(joints)}</model></sdf>'


BODY = '<body><joint type="hinge"/><geom size=".1"/>{}</body>'


def mjcf(inside: str = "", beside: str = "") -> str:
    return f"<mujoco>{beside}<worldbody>{BODY.format('')}{inside}</worldbody></mujoco>"


def replicated(*counts: int) -> str:
    inside = BODY.format("")
    for count in counts:
        inside = f'<replicate count="{count}">{inside}</replicate>'
    return mjcf(inside)


LAUGHS = "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True)
)
LAUGHTER = f'<!DOCTYPE r [<!ENTITY a "ha">{LAUGHS}]><robot name="&j;"/>'

TOO_MUCH = {
    "chain.urdf": (urdf(3000), "3000 joints found; at most 2000 can be read"),
    "links.urdf": (urdf(6000, "fixed"), "6001 links found; at most 5000 can be read"),
    "long.urdf": (urdf(100_000), "more than 500000 elements"),
    "chain.sdf": (sdf(3000), "3000 joints found; at most 2000"),
    "bodies.xml": (mjcf("<body/>" * 6000), "6001 links found; at most 5000"),
    "deep.xml": (mjcf("<body>" * 3000 + "</body>" * 3000), "(?i)nest"),
    "replicate.xml": (replicated(10**9), "<replicate> makes more than 10000 parts"),
    "replicates.xml": (replicated(100, 100, 100), "<replicate> makes more than 10000 parts"),
    "flexcomp.xml": (
        mjcf('<flexcomp name="f" type="grid" count="300 300 300" spacing=".1 .1 .1"/>'),
        "<flexcomp> 'f' makes more than 10000 parts",
    ),
    "mesh.xml": (
        mjcf(beside='<asset><mesh name="m" builtin="cone" params="100000000 1"/></asset>'),
        "<mesh> 'm': params = '100000000 1': more than 10000000 entries",
    ),
    "comments.urdf": ("<robot name='r'><!-- -- " + "<!--" * 100_000, "cannot be read as XML"),
    "hfield.xml": (
        mjcf(beside='<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'),
        "<hfield> 'h': nrow = '100000', ncol = '100000': more than 10000000 entries",
    ),
    "keys.xml": (mjcf(beside='<size nkey="2000000000"/>'), "nkey = '2000000000'"),
    "users.xml": (mjcf(beside='<size nuser_body="2000000000"/>'), "nuser_body"),
    "attach.xml": (
        mjcf('<attach model="c" body="b" prefix="p"/>',
        '<asset><model name="c" file="attach.xml"/></asset>'), "attach each other without an end",
    ),
    "laughs.urdf": (LAUGHTER, "amplification"),
    "digits.urdf": (urdf(1).replace("1", "1" * 5000, 1), r"'1{60}'\.\.\. \(5000 characters\)"),
}  # fmt: skip


@each_row("name", TOO_MUCH)
def test_descriptions_that_ask_for_too_much_are_refused(name, tmp_path):
    text, words = TOO_MUCH[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(cp.errors.InvalidModel, match=words) as refused:
        cp.load_robot(tmp_path / name)
    size = len(str(refused.value))
    assert size < 600 + len(str(tmp_path)), f"an error of {size} characters: shorten with `shown`"


@pytest.mark.long
def test_a_wedge_of_many_degrees_is_one_mesh(tmp_path):
    (tmp_path / "a.xml").write_text(
        mjcf('<body><joint/><geom size="1"/></body>',
        '<asset><mesh name="s" builtin="wedge" params="37 37 45 45 0"/></asset>')
    )  # fmt: skip
    assert cp.load_robot(tmp_path / "a.xml").nv == 2


@pytest.mark.long
def test_mujoco_is_not_asked_either(tmp_path):
    """`condyn compare` and pictures have it read files."""
    path = tmp_path / "a.xml"
    path.write_text(replicated(10**9))
    with pytest.raises(cp.errors.InvalidModel, match="makes more than 10000 parts"):
        compiled(path)


@pytest.mark.long
def test_what_robots_have_is_read(tmp_path):
    (tmp_path / "a.xml").write_text(replicated(20, 2))
    assert cp.load_robot(tmp_path / "a.xml").nv == 41
    (tmp_path / "b.urdf").write_text(urdf(30))
    assert cp.load_robot(tmp_path / "b.urdf").nv == 30


def test_large_files_are_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(texts, "LARGEST", 10_000)
    monkeypatch.setattr(xml, "_MOST_ELEMENTS", 50)
    path = tmp_path / "a.urdf"
    for text, words in ((urdf(100), "larger than 0 MB"), (urdf(12), "more than 50 elements")):
        path.write_text(text)
        with pytest.raises(cp.errors.InvalidModel, match=words):
            cp.load_robot(path)


CARD = 'name = "x"\n[description]\nfile = "bar.urdf"\n'
CARDS = {
    "lists": ("x = " + "[" * 3000 + "]" * 3000 + "\n" + CARD, "nested too deep"),
    "tables": ("x = " + "{a=" * 3000 + "1" + "}" * 3000 + "\n" + CARD, "nested too deep"),
    "dots": (".".join("a" * 200) + " = 1\n" + CARD, "nested more than 32 deep"),
    "digits": ("x = " + "1" * 5000 + "\n" + CARD, "thousands of digits"),
    "large": (CARD + "[postures.p]\nj0 = 1" + "0" * 400, "int too large"),
    "flag": (CARD + "[postures.p]\nj0 = true", r"postures\.p: j0.*not True or False"),
    "flags": (CARD + "[postures]\np = true", r"postures\.p = True: a table is needed"),
    "bytes": ("\udcff", "utf-8"),
}


@each_row("name", CARDS)
def test_cards_that_cannot_be_read_are_one_line(name, tmp_path):
    text, words = CARDS[name]
    (tmp_path / "bar.urdf").write_text(urdf(2))
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(cp.CondynError, match=words):
        cp.load_robot(tmp_path)


@pytest.mark.long
def test_a_card_with_a_byte_order_mark_is_read(tmp_path):
    (tmp_path / "bar.urdf").write_text(urdf(2))
    (tmp_path / "robot.toml").write_text(CARD, encoding="utf-8-sig")
    assert cp.load_robot(tmp_path).nv == 2


JSONS = {
    "deep": ("[" * 100_000 + "]" * 100_000, "nested too deep"),
    "digits": ("1" * 5000, "thousands of digits"),
    "mark": ("\ufeff{}", "KeyError|format"),
}


@each_row("name", JSONS)
def test_tables_that_cannot_be_read_are_one_line(name, tmp_path):
    text, words = JSONS[name]
    path = tmp_path / "a.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(cp.InvalidArgument, match=words):
        cp.study.Table.from_json(path)


def test_a_device_without_an_end_is_no_file(tmp_path):
    for read in (cp.study.Table.from_json, cp.Trajectory.load, cp.simulation.BatchTrajectory.load):
        with pytest.raises(cp.InvalidArgument, match="not a file"):
            read("/dev/zero")
    path = tmp_path / "a.xml"
    path.write_text('<mujoco><include file="/dev/zero"/></mujoco>')
    with pytest.raises(
        cp.errors.InvalidModel, match="/dev/zero: cannot be read as XML: it is not a file"
    ):
        cp.load_robot(path)


@pytest.mark.long
def test_rows_say_what_rows_say(tmp_path):
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    table, path = cp.Study([scene], [cp.DenseKKT()], states=1).run(timed=False), tmp_path / "a.json"
    table.to_json(path)
    saved = json.loads(path.read_text())
    for key, value in (("scene", 3), ("rows", "x"), ("n", 1.5), ("statuses", {"ok": "x"}),
                       ("parameters", [1]), ("how", {"a": []})):  # fmt: skip
        row = saved["rows"][0] | {key: value}
        path.write_text(json.dumps(saved | {"rows": [row]}))
        with pytest.raises(cp.InvalidArgument, match=f"{key} = "):
            cp.study.Table.from_json(path)
