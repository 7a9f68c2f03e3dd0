"""The documentation runs: the Python of each page in one session, its commands one by one."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin._core import _pin
from condyn_pin.cli.main import app

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
# Blocks that only one Pinocchio can run say so in the line above them.
ONLY = re.compile(r"<!-- only: pinocchio (\d) -->\n")
MAJOR = "4" if _pin.HAS_LCABA else "3"


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of a language that this Pinocchio can run, those of notebooks included."""
    text = page.read_text(encoding="utf-8")
    pattern = rf"({ONLY.pattern})?^```(?:\{{code-cell\}} )?{language}\n(.*?)^```"
    found = re.findall(pattern, text, flags=re.DOTALL | re.MULTILINE)
    return [block for _, only, block in found if only in ("", MAJOR)]


def commands() -> list[str]:
    lines = [
        line.split("#")[0].strip()
        for page in PAGES
        for block in blocks(page, "console")
        for line in block.splitlines()
    ]
    return [line for line in dict.fromkeys(lines) if line]


def test_there_are_pages():
    assert len(PAGES) >= 10


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem
)
def test_python_blocks_run_in_one_session(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # where plans are kept
    session: dict[str, object] = {"__name__": "page"}
    for block in blocks(page, "python"):
        exec(compile(block, page.name, "exec"), session)
    assert len(session) > 2  # something was done


@pytest.mark.parametrize("line", [line for line in commands() if line.startswith("condyn ")])
def test_condyn_commands_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # where plans are kept
    if "compare" in line:  # what the lines above it have written
        Path("cassie.xml").write_text(cp.load_robot("cassie").to_mjcf(), encoding="utf-8")
    if line.startswith("condyn view run.npz"):
        bar = cp.load_robot("four_bar")
        scene = cp.Scene(bar, bar.loops)
        cp.simulate(scene, *scene.state(), duration=0.05).save("run.npz")
    result = CliRunner().invoke(app, shlex.split(line)[1:])
    assert result.exit_code in (0, 1), result.output


def test_every_command_is_of_a_kind_that_is_tested():
    assert {line.split()[0] for line in commands()} <= {"condyn", "make", "pip", "python"}


def test_links_between_pages_and_to_files_lead_somewhere():
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            known = link.startswith(("https://", "_figures/")) or (page.parent / link).is_file()
            assert known, f"{page.name}: {link}"


def test_headings_that_links_name_are_there():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for target, heading in re.findall(r"\]\(([\w-]*\.md|)#([\w-]+)\)", text):
            there = (page.parent / (target or page.name)).read_text(encoding="utf-8")
            titles = re.findall(r"^#+ (.*)", there, flags=re.MULTILINE)
            slugs = [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]
            assert heading in slugs, f"{page.name}: {target}#{heading}"


def test_paths_that_are_named_exist():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for path in re.findall(r"`((?:condyn_pin|benchmarks|examples|robots)/[\w/.]+)`", text):
            assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_every_figure_is_drawn():
    drawn = (ROOT / "docs" / "figures.py").read_text(encoding="utf-8")
    for page in PAGES:
        for name in re.findall(r"_figures/(\w+)\.svg", page.read_text(encoding="utf-8")):
            assert f"def {name}(" in drawn, name
