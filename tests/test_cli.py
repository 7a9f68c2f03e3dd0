"""The command line: what it prints, what it writes, and how it fails."""

from __future__ import annotations

import csv
import json
import subprocess
import sys

import pytest
from shared import SOLVERS
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin.cli import app
from condyn_pin.commands import commands


def run(*words: str):
    return CliRunner().invoke(app, list(words))


def test_robots_lists_every_robot_with_its_licence():
    output = run("robots").output
    for name in cp.available_robots():
        assert name in output
    assert "32.9400" in output
    assert "Apache-2.0" in output
    assert "stewart.xml" in output
    assert "…" not in output


def test_show_names_the_redundant_rows():
    output = run("show", "cassie").output
    assert "12, rank 10, mobility 22" in output
    assert "left-plantar-foot-joint.z" in output
    assert "springs" in output


def test_show_without_loops_says_what_is_left_out():
    output = run("show", "four_bar", "--no-loops").output
    assert "mobility 3" in output
    assert "coupler_rocker" in output


def test_show_prints_and_draws_a_ladder(tmp_path):
    result = run("show", "talos", "--ladder", "--plot", str(tmp_path / "l.png"))
    assert result.exit_code == 0, result.output
    for said in ("eight corners", "legs alone", "LCABA" if "lcaba" in SOLVERS else "Proximal"):
        assert said in result.output
    assert (tmp_path / "l.png").read_bytes().startswith(b"\x89PNG")


def test_solvers_lists_every_solver_with_its_knobs():
    output = run("solvers").output
    for name, kind in cp.SOLVERS.items():
        assert kind.__name__ in output, name
    assert "rank_tolerance=1e-07" in output


def test_bench_takes_solvers_by_name():
    result = run("bench", "four_bar", "--quick", "--solvers", "nullspace, Soft")
    assert result.exit_code == 0, result.output
    for said, there in {"Null space": True, "Soft": True, "Proximal": False}.items():
        assert (said in result.output) == there


def test_bench_of_all_leaves_out_what_does_not_take_the_scene(tmp_path):
    table = tmp_path / "b.json"
    result = run("bench", "four_bar", "--quick", "--solvers", "all", "--json", str(table))
    assert result.exit_code == 0, result.output
    methods = {row["method"] for row in json.loads(table.read_text())["rows"]}
    titles = {kind.title for kind in SOLVERS.values() if kind is not cp.Reference}
    assert methods == titles | {"ABA, unconstrained"}


@pytest.mark.parametrize("solver", list(SOLVERS))
def test_solve_prints_json_that_equals_the_library(solver):
    words = ("solve", "talos", "--contacts", "left_sole_link,right_sole_link", "--json")
    result = run(*words, "--solver", solver)
    assert result.exit_code == (0 if SOLVERS[solver].exact else 1), result.output
    answer = json.loads(result.stdout)
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    solution = cp.solve(scene, q, v, 0 * v, solver=cp.SOLVERS[solver](), throw=False)
    assert answer["a"] == solution.a.tolist()
    assert answer["status"] == ("ok" if SOLVERS[solver].exact else "inaccurate")
    assert answer["forces"]["left_sole_link"] == solution.forces["left_sole_link"].tolist()


def test_a_singular_solve_exits_with_one_and_valid_json():
    result = run("solve", "four_bar", "--solver", "densekkt", "--json")
    assert result.exit_code == 1
    answer = json.loads(result.stdout)
    assert answer["status"] == "singular"
    assert answer["a"] == [None] * 3


def test_frames_can_be_named_with_a_kind():
    result = run("solve", "solo12", "--contacts", "FL_FOOT:point, base_link:surface")
    assert result.exit_code == 0, result.output
    assert "base_link" in result.output


def test_export_writes_a_file_that_reads_back(tmp_path):
    path = tmp_path / "bar.xml"
    assert run("export", "four_bar", "--mjcf", str(path)).exit_code == 0
    assert cp.load_robot(path).loops == cp.load_robot("four_bar").loops
    words = ("export", "four_bar", "--mjcf", str(path), "--without", "coupler_rocker")
    assert run(*words).exit_code == 0
    assert cp.load_robot(path).loops == ()


def test_bench_writes_table_and_picture(tmp_path):
    table, rows, picture = (tmp_path / name for name in ("b.json", "b.csv", "b.png"))
    words = ("--json", str(table), "--csv", str(rows), "--plot", str(picture))
    result = run("bench", "four_bar", "--quick", *words)
    assert result.exit_code == 0, result.output
    assert "Proximal" in result.output
    saved = json.loads(table.read_text())
    assert saved["machine"]["pinocchio"]
    assert {row["method"] for row in saved["rows"]} >= {
        "ABA, unconstrained",
        "Proximal",
        "Dense KKT",
    }
    lines = [line for line in rows.read_text().splitlines() if not line.startswith("#")]
    assert len(list(csv.DictReader(lines))) == len(saved["rows"])
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("show", "talo"), "did you mean 'talos'"),
        (("show", "talos", "--plot", "l.png"), "add --ladder"),
        (("show", "solo12", "--ladder"), "no ladder named 'solo12'"),
        (("show", "talos", "--ladder", "--plot", "l.foo"), ".png, .svg, .pdf"),
        (("show", "talos", "--ladder", "--json"), "neither variants nor json"),
        (("show", "cassie", "--variant", "springs"), "OPTION=VALUE"),
        (("show", "cassie", "--variant", "springs=lost"), "'lost'"),
        (("show", "cassie", "--variant", "spring=locked"), "did you mean 'springs'"),
        (("solve", "talos", "--solver", "proximall"), "did you mean 'proximal'"),
        (("solve", "talos", "--contacts", "left_sole"), "left_sole_link"),
        (("solve", "talos", "--posture", "sitting"), "half_sitting"),
        (("solve", "talos", "--mu", "-1"), "mu = -1.0"),
        (("solve", "talos", "--solver", "reference", "--mu", "1"), "no such knob"),
        (("export", "pendulum", "--mjcf", "p.xml"), "'pivot' carries 1 kg"),
        (("export", "four_bar", "--mjcf", "no/such/b.xml"), "b.xml: cannot be written"),
        (("bench", "four_bar", "--quick", "--native", "no.json"), "make native"),
        (("bench", "four_bar", "--quick", "--plot", "b.foo"), ".png, .svg, .pdf"),
        (("bench", "four_bar", "--solvers", "nulspace"), "did you mean 'nullspace'"),
        (("bench", "four_bar", "--quick", "--csv", "no/such/b.csv"), "there is no folder no/such"),
        (("nothing",), "No such command 'nothing'; `condyn --help`"),
        (("robots", "more"), "`condyn robots --help` says what there is"),
        (("solve", "cassie", "--mu", "x"), "'--mu'"),
        (("solve", "cassie", "--mux"), "`condyn solve --help`"),
        (("show",), "Missing argument 'ROBOT'"),
    ],
)
def test_a_mistake_is_a_sentence_and_not_a_traceback(words, said):
    result = alone(*words)
    assert result.returncode == 2
    assert said in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr


def alone(*words: str):
    """Run in a process of its own, as a user does."""
    code = "from condyn_pin.cli import main; main()"
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)


@pytest.mark.parametrize("words", [("show", "talo", "--debug"), ("--debug", "show", "talo")])
def test_debug_shows_the_traceback_wherever_it_stands(words):
    result = alone(*words)
    assert result.returncode == 1
    assert "Traceback" in result.stderr
    assert "UnknownName" in result.stderr


def test_a_defect_is_one_line_that_says_how_to_see_more():
    code = """
import condyn_pin.load
from condyn_pin.cli import main
def broken(*_, **__): raise ZeroDivisionError("of ours\\nin two lines")
condyn_pin.load.load_robot = broken
main()
"""
    words = [sys.executable, "-c", code, "show", "talos"]
    result = subprocess.run(words, capture_output=True, text=True)
    assert result.returncode == 3
    assert len(result.stderr.splitlines()) == 1
    assert "ZeroDivisionError: of ours in two lines" in result.stderr
    assert "--debug" in result.stderr
    assert "Traceback" in subprocess.run([*words, "--debug"], capture_output=True, text=True).stderr


def test_an_interrupt_leaves_with_its_own_code():
    code = """
import condyn_pin.load
from condyn_pin.cli import main
def interrupted(*_, **__): raise KeyboardInterrupt
condyn_pin.load.load_robot = interrupted
main()
"""
    words = [sys.executable, "-c", code, "show", "talos"]
    result = subprocess.run(words, capture_output=True, text=True)
    assert result.returncode == 130
    assert "Traceback" not in result.stderr


def test_a_variant_of_a_robot():
    assert (
        "cassie, springs locked: nq 31"
        in run("show", "cassie", "--variant", "springs=locked").output
    )
    both = ("--variant", "springs=locked", "--variant", "achilles=as_file")
    assert "springs locked, achilles as_file" in run("show", "cassie", *both).output


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        (("robots",), {"cassie", "talos"}),
        (("show", "cassie"), {"rows", "rank", "redundant", "frames", "ready_contacts"}),
        (("assemble", "cassie"), {"q", "joints", "gap", "status", "branch"}),
        (("solve", "four_bar"), {"a", "lam", "forces", "status", "advice", "machine"}),
        (("doctor",), {"versions", "features", "remedy"}),
        (("problem",), {"A01", "A02"}),
    ],
)
def test_json_is_all_that_is_printed(words, keys):
    result = run(*words, "--json")
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    assert keys <= answer.keys()


def test_json_of_the_answers_equals_the_library():
    shown = json.loads(run("show", "cassie", "--json").stdout)
    cassie = cp.load_robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    assert shown["redundant"] == list(legs.summary().redundant)
    assert json.loads(run("assemble", "cassie", "--json").stdout)["q"] == legs.state()[0].tolist()
    listed = json.loads(run("solvers", "--json").stdout)
    assert {row["name"] for row in listed} == {kind.__name__ for kind in cp.SOLVERS.values()}
    assert json.loads(run("robots", "--json").stdout)["cassie"]["nv"] == 32


def test_every_command_that_prints_an_answer_has_json():
    for name, module in commands().items():
        options = getattr(module, name).__annotations__
        assert "as_json" in options or name in ("export", "view"), name


def test_help_is_a_page_of_the_manual():
    page = run("--help").output
    for name, module in commands().items():
        assert name in page
        assert getattr(module, name).__doc__.strip().split("\n")[0].rstrip(".")[:20] in page
    for said in ("First steps", "Exit codes", "interrupted", "--debug", "--install-completion"):
        assert said in page
    for name in commands():
        assert run(name, "--help").exit_code == 0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("condyn sol", "solvers"),
        ("condyn show cas", "cassie"),
        ("condyn solve x --solver nu", "nullspace"),
    ],
)
def test_the_shell_completes(line, said, monkeypatch):
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    result = CliRunner().invoke(
        app, [], prog_name="condyn", env={"_CONDYN_COMPLETE": "complete_bash", **words}
    )
    assert said in result.output.split()


def test_doctor_says_that_everything_fits():
    result = run("doctor")
    assert result.exit_code == 0, result.output
    assert "Everything fits together" in result.output
    assert "LCABA" in result.output


def test_what_looks_like_markup_is_printed():
    """A force of NaN is not a tag, and a unit in brackets is a unit."""
    result = run("solve", "four_bar", "--solver", "densekkt")
    assert "[nan nan nan]" in result.output
    assert "mass [kg]" in run("robots").output


def test_version():
    assert run("--version").output.strip() == f"condyn_pin {cp.__version__}"


def test_the_package_is_a_command_too():
    line = [sys.executable, "-m", "condyn_pin", "--version"]
    found = subprocess.run(line, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == f"condyn_pin {cp.__version__}"
