"""README and documentation run: the Python of each page in one session, its commands one by one.

To add a page: write a Markdown file in `docs/`, and name it in `docs/index.md` (`how-to-*.md` are
found there by themselves). Each thing is said on one page, and linked from the others. A block for
one Pinocchio has `<!-- only: pinocchio 4 -->` in the line above it. A figure is a function in
`docs/figures.py`. The API pages are generated from the public names; `test_api.py` says what a
docstring must have. The README stays below 9 kB with three tables and at most three pictures:
what is new goes into the docs, and is linked.
"""

from __future__ import annotations

import re
import shlex
import tomllib
from functools import reduce
from importlib import import_module
from pathlib import Path

import pytest
from PIL import Image
from shared import each_row
from shell import condyn
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin._core import _pin
from lab.cli import app as lab_app

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").glob("*.md"))]
TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}
# Their code repeats in loops what other pages do once.
LONG = ("contact-models", "monte-carlo", "painleve")
# Blocks that only one Pinocchio can run say so in the line above them.
ONLY = re.compile(r"<!-- only: pinocchio (\d) -->\n")
MAJOR = "4" if _pin.HAS_LCABA else "3"


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of a language that this Pinocchio can run, those of notebooks included."""
    pattern = rf"({ONLY.pattern})?^```(?:\{{code-cell\}} )?{language}\n(.*?)^```"
    found = re.findall(pattern, TEXTS[page], flags=re.DOTALL | re.MULTILINE)
    return [block for _, only, block in found if only in ("", MAJOR)]


def commands() -> dict[str, Path]:
    """The lines of all consoles, each with the first page that has it."""
    lines = [
        (line.split("#")[0].strip(), page)
        for page in PAGES
        for block in blocks(page, "console")
        for line in block.splitlines()
    ]
    return dict(reversed([(line, page) for line, page in lines if line]))


@pytest.fixture
def elsewhere(tmp_path, monkeypatch) -> Path:
    """A folder to work in, where plans are kept too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def session_of(page: Path) -> dict[str, object]:
    """What the Python of a page leaves behind."""
    session: dict[str, object] = {"__name__": "page"}
    for block in blocks(page, "python"):
        exec(compile(block, page.name, "exec"), session)
    return session


@pytest.mark.long
def test_there_are_pages():
    assert len(PAGES) >= 10


def pages_of_python() -> list[object]:
    """The pages with blocks of Python; some use the compiled core where it is installed."""
    marks = {page: [pytest.mark.long] if page.stem in LONG else [] for page in PAGES}
    for page in PAGES:
        if "MissingExtra" in TEXTS[page]:
            marks[page].append(pytest.mark.native(optional=True))
    return [
        pytest.param(page, marks=marks[page], id=page.stem)
        for page in PAGES[1:]
        if blocks(page, "python")
    ]


@pytest.mark.parametrize("page", pages_of_python())
def test_python_blocks_run_in_one_session(page, elsewhere, capsys):
    assert len(session_of(page)) > 2  # something was done


def test_the_readme_says_what_its_python_does(elsewhere, capsys):
    session = session_of(README)
    assert "rank 10" in capsys.readouterr().out
    assert session["sol"].status.ok
    assert session["fall"].status.ok
    assert len([line for line in blocks(README, "python")[0].splitlines() if line]) == 9
    assert (elsewhere / "fall.html").is_file()


def marked(line: str) -> object:
    """A line; one that draws a PNG needs a browser."""
    return pytest.param(line, marks=pytest.mark.chromium if "--png" in line else (), id=line)


@pytest.mark.once
@pytest.mark.parametrize("line", [marked(line) for line in commands() if line[:7] == "condyn "])
def test_condyn_commands_run(line, elsewhere):
    if "compare" in line:  # what the lines above it have written
        Path("cassie.xml").write_text(cp.load_robot("cassie").to_mjcf(), encoding="utf-8")
    if line.startswith("condyn view run.npz"):
        bar = cp.load_robot("four_bar")
        scene = cp.Scene(bar, bar.loops)
        cp.simulate(scene, *scene.state(), duration=0.05).save("run.npz")
    result = condyn(*shlex.split(line)[1:])
    assert result.exit_code in ((0,) if commands()[line] == README else (0, 1)), result.output


@pytest.mark.once
@pytest.mark.parametrize("line", [x for x in commands() if x.startswith("python benchmarks/lab ")])
def test_commands_of_the_laboratory_run(line, elsewhere):
    result = CliRunner().invoke(lab_app, shlex.split(line)[2:])
    assert result.exit_code in (0, 1), result.output


def test_every_command_is_of_a_kind_that_is_tested():
    assert {line.split()[0] for line in commands()} <= {"condyn", "make", "pip", "python"}


@pytest.mark.parametrize(
    "line", [x for x, page in commands().items() if x.startswith("make ") and page == README]
)
def test_make_targets_of_the_readme_exist_and_are_run_by_ci(line):
    target = line.split()[1]
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    run = re.findall(r"^make .*", (ROOT / ".ci" / "run").read_text(), flags=re.MULTILINE)
    assert any(target in words.split("#")[0].split() for words in run)


def headings(page: Path) -> list[str]:
    """The headings of a page as links name them."""
    titles = re.findall(r"^#+ (.*)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


@each_row("page", PAGES)
def test_links_paths_figures_and_names_are_there(page):
    drawn = (ROOT / "docs" / "figures.py").read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", TEXTS[page]):
        if link.startswith("https://"):
            continue
        path, _, heading = link.partition("#")
        target = page.parent / (path or page.name)
        assert path.startswith("_figures/") or target.is_file(), link
        assert not heading or heading in headings(target), link
    for path in re.findall(r"`((?:condyn_pin|benchmarks|examples|robots)/[\w/.]+)`", TEXTS[page]):
        assert (ROOT / path).exists(), path
    for name in re.findall(r"_figures/(\w+)\.svg", TEXTS[page]):
        assert f"def {name}(" in drawn, name
    for name in re.findall(r"\{py:obj\}`[^<`]*<condyn_pin\.([\w.]+)>`", TEXTS[page]):
        assert reduce(getattr, name.split("."), cp), name


@pytest.mark.long
def test_the_readme_stays_one_page():
    """A screen that says what it is and runs, a table beside others, two that are measured."""
    assert len(TEXTS[README].encode()) <= 9000
    assert TEXTS[README].count("![") <= 3
    assert len(re.findall(r"^\|---", TEXTS[README], flags=re.MULTILINE)) == 3


def test_the_gallery_has_every_picture_of_the_pages():
    def pictures(page: Path) -> set[str]:
        return set(re.findall(r"!\[[^\]]*\]\(([^)]+)\)", TEXTS[page]))

    shown = pictures(ROOT / "docs" / "gallery.md")
    assert {each for page in PAGES[1:] for each in pictures(page)} <= shown


def test_the_moving_picture_is_small_and_moves():
    path = ROOT / "docs" / "pictures" / "machines.gif"
    assert path.stat().st_size < 1.5e6
    with Image.open(path) as picture:
        assert picture.n_frames >= 20


def test_badges_are_true(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    module = import_module("badges")
    drawn = (ROOT / "docs" / "pictures" / "badges.svg").read_text("utf-8")
    assert drawn == module.badges()
    assert all(value in TEXTS[README] for value in ("Python 3.11 to 3.13", "Pinocchio 3.9 and 4.1"))
    assert module.facts()["python"] == "3.11 - 3.13"
    assert module.facts()["pinocchio"] == "3.9, 4.1"


def test_every_solver_is_in_the_table_of_solvers():
    lines = TEXTS[ROOT / "docs" / "how-to-choose-a-solver.md"].splitlines()
    for solver in cp.dynamics.SOLVERS.values():
        start = f"| `{solver.__name__}` "
        row = next((line for line in lines if line.startswith(start)), "")
        assert row.endswith(f"| {solver.cost} |"), (
            f"docs/how-to-choose-a-solver.md needs a row `{start}| ... | {solver.cost} |`"
        )


def test_changelog_has_this_version_and_a_line_an_entry():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(cp.__version__)}\] - \d{{4}}-\d\d-\d\d$", text, re.M)
    assert text.index("## [Unreleased]") < text.index(f"## [{cp.__version__}]")
    assert set(re.findall(r"^### (.*)$", text, re.M)) <= {"Added", "Changed", "Fixed"}
    entries = text.partition("## [Unreleased]")[2].splitlines()
    assert all(line[:2] in ("- ", "##", "") for line in entries if line[:3] != "###")
    long = [line for line in entries if line[:2] == "- " and len(line[2:].split()) > 25]
    assert not long


def test_every_extra_is_on_the_page_of_installation():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = set(project["optional-dependencies"]) - {"dev", "docs", "all", "peers", "native"}
    page = (ROOT / "docs" / "start.md").read_text("utf-8")
    assert not {extra for extra in extras if f"[{extra}]" not in page}
