"""A terminal obeys what it is sent: names of files, and names in files, are written out."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from shared import each_row, robot
from shell import condyn

import condyn_pin as cp
from condyn_pin._core.files import parse_json
from condyn_pin.cli import output
from condyn_pin.cli.main import main
from condyn_pin.errors import printable

pytestmark = pytest.mark.once

EVIL = "a\x1b[31m\x9b2J\x07\u202eb"
WRITTEN = r"a\x1b[31m\x9b2J\x07\u202eb"


@pytest.fixture
def evil(tmp_path) -> Path:
    """A robot all of whose names are hostile, in a folder whose name is."""
    text = robot("four_bar").to_mjcf()
    name = EVIL.replace("\x1b", "\x9c").replace("\x07", "")  # what xml can say
    for word in ("crank", "coupler", "rocker", "four_bar"):
        text = text.replace(f'"{word}', f'"{name}{word}')
    folder = tmp_path / EVIL
    folder.mkdir()
    (folder / "bar.xml").write_text(text, encoding="utf-8")
    (folder / "robot.toml").write_text(
        f"name = {json.dumps(EVIL)}\nsource = {json.dumps(EVIL)}\n"
        '[description]\nfile = "bar.xml"\n',
        encoding="utf-8",
    )
    return folder


def is_harmless(text: str) -> bool:
    return all(each.isprintable() or each == "\n" for each in text)


COMMANDS = (["show"], ["assemble"], ["solve"], ["simulate", "--duration", "0.01"],
            ["bench", "--quick"], ["solve", "--json"], ["show", "--json"], ["view", "--html", EVIL],
            ["export", "--mjcf", f"{EVIL}/x.xml"], ["solve", "--contacts", EVIL],
            ["compare", EVIL], ["show", "--debug", "--posture", EVIL])  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_commands_print_what_is_printable(words, evil, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["condyn", words[0], str(evil), *words[1:]])
    with pytest.raises(SystemExit):
        main()
    out, err = capsys.readouterr()
    assert is_harmless(out + err), (out, err)
    assert "\\x" in out + err or "\\u" in out


@pytest.mark.long
@pytest.mark.parametrize("words", [[f"no{EVIL}"], ["show", f"no{EVIL}"]])
def test_errors_are_printable(words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["condyn", *words])
    with pytest.raises(SystemExit):
        main()
    said = capsys.readouterr().err
    assert is_harmless(said)
    assert WRITTEN in said


@pytest.mark.long
def test_names_that_are_no_text_are_printed(tmp_path):
    """A file name of Linux is bytes, of any kind."""
    words = [b"-m", b"condyn_pin", b"show", os.fsencode(tmp_path) + b"/\xff.urdf"]
    done = subprocess.run([sys.executable, *words], capture_output=True, check=False)
    assert done.returncode == 2
    assert rb"\udcff.urdf" in done.stderr


@pytest.mark.long
def test_a_table_in_colours_stays_one():
    """On a terminal, what is ours still has its colours, and columns fit."""
    screen = output._Screen(markup=False, force_terminal=True, width=80, file=io.StringIO())
    table = output.text_table("what")
    table.add_row(EVIL)
    screen.print(table)
    screen.print("wrong", style="bold red")
    text = screen.file.getvalue()
    assert "\x1b[1;31mwrong" in text
    assert WRITTEN in text
    assert "\x1b[31m\x9b" not in text
    assert "\x07" not in text


@pytest.mark.long
def test_a_name_in_brackets_is_no_markup(monkeypatch, capsys):
    monkeypatch.setattr(output._Screen, "is_terminal", True)
    with output.progress_bar() as show:
        show("[/b] of a robot", 1, 2)
    assert "[/b] of a robot" in capsys.readouterr().err


@pytest.mark.long
def test_words_of_ours_are_as_they_are():
    text = "M a + h = τ + Jᵀ λ\nm/s²"
    assert output.printable(text) == text


INTERRUPTED_IN_AN_IMPORT = """
import signal, sys
sys.path.insert(0, {folder!r})
import condyn_pin.__main__ as start
signal.signal(signal.SIGINT, start._interrupt)
try:
    import slow
except BaseException:
    pass
print("went on")
"""


@pytest.mark.long
def test_ctrl_c_in_an_import_ends_it(tmp_path):
    """Modules in C turn it into another error, or into nothing."""
    (tmp_path / "slow.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nimport json.tool\n",
        encoding="utf-8",
    )
    code = INTERRUPTED_IN_AN_IMPORT.format(folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "condyn: interrupted\n"


@pytest.mark.long
def test_the_command_is_what_the_package_installs():
    text = (Path(cp.__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8")
    assert 'condyn = "condyn_pin.__main__:main"' in text
    assert condyn("--version").exit_code == 0


FOLDER = {
    "robot.toml": r"""
name = "evil\u001b]0;mine\u0007"
licence = "\u001b[32m"
[description]
file = "r.urdf"
[[frames]]
name = "tip\u001b[33m"
parent = "link\u0080"
translation = [0.3, 0.0, 0.0]
""",
    "r.urdf": """<robot name="r"><link name="base"/><link name="link&#128;"><inertial>
<mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j\u202e" type="revolute"><parent link="base"/><child link="link&#128;"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>""",
}


def test_names_of_files_are_written_out_wherever_python_shows_them(tmp_path):
    for name, text in FOLDER.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    robot = cp.load_robot(tmp_path)
    scene = cp.Scene(robot, [cp.PointContact(r"tip\x1b[33m")])
    q, v = scene.state()
    shown = [str(robot), repr(robot), str(scene), str(scene.summary()), *robot.unused]
    solution = cp.solve(scene, q, v, v)
    shown += [str(solution), repr(solution), *solution.notices]
    run = cp.simulate(scene, q, v, duration=0.01)
    run.save(tmp_path / "run.npz")
    back = cp.Trajectory.load(tmp_path / "run.npz")
    shown += [str(run), str(back), repr(back.scene.robot), robot.name, *robot.frames, *robot.joints]
    for wrong in (
        lambda: cp.Scene(robot, [cp.PointContact("tap")]),
        lambda: cp.load_robot(tmp_path / "no\x1b[31m.urdf"),
        lambda: robot.frame_pose(q, "\x1b[2J"),
    ):
        with pytest.raises(cp.CondynError) as error:
            wrong()
        shown.append(str(error.value))
    for text in shown:
        assert text.replace("\n", "").isprintable(), text
    assert r"tip\x1b[33m" in robot.frames
    assert robot.joints == (r"j\u202e",)
    assert robot.name == r"evil\x1b]0;mine\x07"


@each_row("text", ["plain", "two\nlines", "un\u00a0mot", "\u4e2d\u3000\u6587", r"C:\a"])
def test_texts_without_orders_to_a_terminal_stay(text):
    assert printable(text) == text
    assert parse_json(json.dumps({text: [text, 1.0]})) == {text: [text, 1.0]}
