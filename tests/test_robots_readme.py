"""The README of every robot: source and licence, a table that is right, an example that runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from shared import robot, standard_scenes
from test_robots import ROBOTS

import condyn_pin as cp
from condyn_pin.io.description import robots_folder

FOLDERS = sorted(path.parent for path in robots_folder().glob("*/robot.toml"))
each_folder = pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)


@each_folder
def test_a_readme_names_source_and_licence(folder):
    text = (folder / "README.md").read_text(encoding="utf-8")
    loaded = robot(folder.name)
    assert loaded.licence.split(" (")[0] in text
    assert Path(loaded.source).name in text
    assert "## Choices" in text


@each_folder
def test_the_table_of_a_readme_is_right(folder):
    """Rows that are standard scenes are compared, all others only in size."""
    rows = table(folder / "README.md")
    loaded = robot(folder.name)
    scenes = {label.removeprefix(f"{folder.name} "): s for label, s in measured(loaded).items()}
    assert rows.keys() & scenes.keys() >= set(scenes) - {"free"}
    for label, row in rows.items():
        nq, nv, mass, loops, *counts = row
        assert (nq, nv, mass) == (str(loaded.nq), str(loaded.nv), f"{loaded.mass:.3f}")
        if label in scenes:
            scene = scenes[label]
            used = sum(isinstance(c, cp.Loop) for c in scene.constraints)
            wanted = (used, scene.rows, scene.nominal.rank, scene.nominal.mobility)
            assert (loops, *counts) == tuple(map(str, wanted)), label


def measured(loaded: cp.Robot) -> dict[str, cp.Scene]:
    return {f"{loaded.name} free": cp.Scene(loaded)} | standard_scenes(loaded)


def table(path: Path) -> dict[str, list[str]]:
    """Return the rows of the table of scenes, by scene."""
    text = path.read_text(encoding="utf-8")
    head = "| scene | nq | nv | mass [kg] | loops | rows | rank | mobility |\n"
    body = text.split(head)[1].split("\n\n")[0].splitlines()[1:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in body]
    return {row[0]: row[1:] for row in cells}


@each_folder
def test_the_examples_of_a_readme_run(folder, capsys):
    text = (folder / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, str(folder), "exec"), {})
    assert "ok" in capsys.readouterr().out


def test_the_list_of_robots_is_complete_and_right():
    text = (robots_folder() / "README.md").read_text(encoding="utf-8")
    listed = {}
    for line in re.findall(r"^\| .*`\w+`.*\|$", text, flags=re.MULTILINE):
        name, _, *figures = (cell.strip() for cell in line.strip("|").split("|"))
        listed[re.search(r"`(\w+)`", name).group(1)] = figures
    wanted = {
        name: [str(f.nv), f"{robot(name).mass:.4g}", *map(str, f[3:])] for name, f in ROBOTS.items()
    }
    assert listed == wanted
    for folder in re.findall(r"\]\((\w+)/README.md\)", text):
        assert (robots_folder() / folder / "robot.toml").is_file()
    assert len(re.findall(r"\]\(", text)) == len(FOLDERS)
