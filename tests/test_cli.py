"""The command line: what it prints, what it writes, and how it fails."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace

import pytest
from shared import SOLVERS
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin.cli.commands import commands
from condyn_pin.cli.main import app


def run(*words: str):
    return CliRunner().invoke(app, list(words))


def test_robots_lists_every_robot_with_its_licence():
    output = run("robots").output
    for name in cp.available_robots():
        assert name in output
    assert "32.94" in output
    assert "Apache-2.0" in output
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
    assert "how-to-close-a-loop" in output


def test_show_prints_and_draws_a_ladder(tmp_path):
    result = run("show", "talos", "--ladder", "--plot", str(tmp_path / "l.png"))
    assert result.exit_code == 0, result.output
    for said in ("eight corners", "legs alone", "LCABA" if "lcaba" in SOLVERS else "Proximal"):
        assert said in result.output
    assert (tmp_path / "l.png").read_bytes().startswith(b"\x89PNG")


def test_solvers_lists_every_solver_with_its_knobs():
    output = run("solvers").output
    for name, kind in cp.dynamics.SOLVERS.items():
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
    rows = json.loads(table.read_text())["rows"]
    methods = {row["method"] for row in rows if row["status"] != "by hand"}
    assert len(rows) == len(methods) + 3
    titles = {kind.title for kind in SOLVERS.values() if kind is not cp.dynamics.Reference}
    assert methods == titles | {"ABA, unconstrained"}


def test_bench_leaves_out_main_methods_that_do_not_take_the_scene():
    result = run("bench", "rolling_ball", "--quick")
    assert result.exit_code == 0, result.output
    assert "Dense KKT" in result.output
    assert "LCABA" not in result.output


@pytest.mark.parametrize("solver", list(SOLVERS))
def test_solve_prints_json_that_equals_the_library(solver):
    words = ("solve", "talos", "--contacts", "left_sole_link,right_sole_link", "--json")
    result = run(*words, "--solver", solver)
    assert result.exit_code == (0 if SOLVERS[solver].exact else 1), result.output
    answer = json.loads(result.stdout)
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    solution = cp.solve(scene, q, v, 0 * v, solver=cp.dynamics.SOLVERS[solver](), throw=False)
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
    result = run("export", "four_bar", "--mjcf", str(path))
    assert result.exit_code == 0
    assert result.output == f"written: {path}\n"
    assert cp.load_robot(path).loops == cp.load_robot("four_bar").loops
    words = ("export", "four_bar", "--mjcf", str(path), "--without", " coupler_rocker,")
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
        (("show", "talos", "--ladder", "--variant", "a=b"), "leave --variant out"),
        (("show", "cassie", "--variant", "springs"), "OPTION=VALUE"),
        (("show", "cassie", "--variant", "springs=lost"), "'lost'"),
        (("show", "cassie", "--variant", "spring=locked"), "did you mean 'springs'"),
        (("solve", "talos", "--solver", "proximall"), "did you mean 'proximal'"),
        (("solve", "talos", "--contacts", "left_sole"), "left_sole_link"),
        (("solve", "talos", "--posture", "sitting"), "half_sitting"),
        (("solve", "talos", "--mu", "-1"), "mu = -1.0"),
        (("solve", "talos", "--solver", "reference", "--mu", "1"), "no such parameter"),
        (("export", "pendulum", "--mjcf", "p.xml"), "'pivot' carries 1 kg"),
        (("export", "four_bar", "--mjcf", "no/such/b.xml"), "there is no folder no/such"),
        (("bench", "four_bar", "--quick", "--native", "no.json"), "make native"),
        (("bench", "four_bar", "--quick", "--plot", "b.foo"), ".png, .svg, .pdf"),
        (("bench", "four_bar", "--solvers", "nulspace"), "did you mean 'nullspace'"),
        (("bench", "four_bar", "--quick", "--csv", "no/such/b.csv"), "there is no folder no/such"),
        (("bench", "four_bar", "--quick", "--csv", "."), ".: cannot be written: Is a directory"),
        (("bench", "four_bar", "--json"), "`condyn bench --help`"),
        (("simulate", "four_bar", "--save", "a.txt"), ".npz"),
        (("simulate", "four_bar", "--gain", "5"), "add --drift baumgarte"),
        (("drift", "--dt", "0"), "--dt 0.0: a number > 0 [s]"),
        (("problem", "--n", "3"), "A01"),
        (("stress", "--seconds", "nan"), "--seconds nan"),
        (("view", "cassie", "--port", "70000"), "`condyn view --help`"),
        (("view", "cassie", "--png", "x.jpg"), "x.jpg: the ending says the format: .png"),
        (("view", "m.npz", "--no-loops"), "a motion has its own"),
        (("view", "m.npz"), "m.npz: no file of a trajectory (No such file or directory)"),
        (("nothing",), "No such command 'nothing'; `condyn --help`"),
        (("robots", "more"), "`condyn robots --help` says what there is"),
        (("solve", "cassie", "--mu", "x"), "'--mu'"),
        (("solve", "cassie", "--mux"), "`condyn solve --help`"),
        (("show",), "`condyn show --help`"),
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
    code = "from condyn_pin.cli.main import main; main()"
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)


@pytest.mark.parametrize("words", [("show", "talo", "--debug"), ("--debug", "show", "talo")])
def test_debug_shows_the_traceback_wherever_it_stands(words):
    result = alone(*words)
    assert result.returncode == 1
    assert "Traceback" in result.stderr
    assert "UnknownName" in result.stderr


def test_a_defect_is_one_line_that_says_how_to_see_more():
    code = """
import condyn_pin.io.load
from condyn_pin.cli.main import main
def broken(*_, **__): raise ZeroDivisionError("of ours\\nin two lines")
condyn_pin.io.load.load_robot = broken
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
import condyn_pin.io.load
from condyn_pin.cli.main import main
def interrupted(*_, **__): raise KeyboardInterrupt
condyn_pin.io.load.load_robot = interrupted
main()
"""
    words = [sys.executable, "-c", code, "show", "talos"]
    result = subprocess.run(words, capture_output=True, text=True)
    assert result.returncode == 130
    assert result.stderr == "condyn: interrupted\n"


def stopping_after(count: int):
    """A bar of progress during which Ctrl-C comes."""
    calls = iter(range(count))

    @contextmanager
    def bar():
        def progress(what: str, done: int, total: int) -> None:
            if next(calls, None) is None:
                raise KeyboardInterrupt

        yield progress

    return bar


def test_ctrl_c_keeps_the_scenes_that_were_timed(tmp_path, monkeypatch):
    monkeypatch.setattr("condyn_pin.cli.commands.bench.progress_bar", stopping_after(40))
    table = tmp_path / "b.csv"
    result = run("bench", "four_bar", "pendulum", "--quick", "--json", "-", "--csv", str(table))
    assert result.exit_code == 130
    assert {row["scene"] for row in json.loads(result.stdout)["rows"]} == {"four_bar loops"}
    assert "four_bar loops" in table.read_text()


def test_ctrl_c_keeps_the_cases_that_were_put(tmp_path, monkeypatch):
    monkeypatch.setattr("condyn_pin.cli.commands.stress.progress_bar", stopping_after(3))
    table = tmp_path / "s.csv"
    words = ("--families", "few_iterations", "--solver", "Proximal", "--csv", str(table))
    result = run("stress", "four_bar", *words, "--json")
    assert result.exit_code == 130
    assert json.loads(result.stdout)["cases"] == 4
    assert "few_iterations" in table.read_text()


def test_ctrl_c_keeps_the_runs_of_the_pendulum(monkeypatch):
    monkeypatch.setattr("condyn_pin.cli.commands.drift.progress_bar", stopping_after(25))
    result = run("drift", "--steps", "20", "--json")
    assert result.exit_code == 130
    runs = json.loads(result.stdout)["runs"]
    assert runs
    assert all(one["errors"]["status"] == "finished" for one in runs.values())


@pytest.mark.parametrize("words", [("simulate", "four_bar"), ("problem", "A01")])
def test_ctrl_c_keeps_the_motion_so_far(words, monkeypatch):
    from condyn_pin.simulation.hybrid_simulator import HybridSimulator

    whole = HybridSimulator.run

    def interrupted(self, *rest):
        self.plan = replace(self.plan, steps=3)
        whole(self, *rest)
        raise KeyboardInterrupt

    monkeypatch.setattr(HybridSimulator, "run", interrupted)
    result = run(*words)
    assert result.exit_code == 130
    assert "interrupted after t = " in result.output


def test_ctrl_c_in_one_motion_stops_the_whole_study(monkeypatch):
    from condyn_pin.simulation.hybrid_simulator import HybridSimulator

    def interrupted(self, *_):
        raise KeyboardInterrupt

    monkeypatch.setattr(HybridSimulator, "run", interrupted)
    study = cp.Study("four_bar", [cp.dynamics.NullSpace()], states=2, measure="trajectory")
    with pytest.raises(cp.errors.Interrupted):
        study.run()


def test_a_table_goes_to_stdout_as_json_and_to_people_beside():
    words = ("--quick", "--solvers", "soft,nullspace", "--json", "-")
    few = {"bench": (), "trade": ("--states", "2")}
    for command, more in few.items():
        result = run(command, "four_bar", *words, *more)
        assert result.exit_code == 0, result.output
        assert {row["scene"] for row in json.loads(result.stdout)["rows"]} == {"four_bar loops"}
        assert "four_bar loops" in result.stderr
        assert "…" not in result.stderr


def test_what_no_solver_meets_is_json_too(monkeypatch):
    def nothing(*_, **__):
        raise cp.errors.NotReached("nothing meets that")

    monkeypatch.setattr("condyn_pin.study.tuning.choose", nothing)
    result = run("tune", "four_bar", "--json")
    assert result.exit_code == 1
    answer = json.loads(result.stdout)
    assert answer["solver"] is None
    assert answer["reason"] == "nothing meets that"


def test_a_ladder_is_json_too(monkeypatch):
    from condyn_pin.lab.hierarchy_table import HierarchyTable

    monkeypatch.setattr(
        "condyn_pin.lab.hierarchy.model_hierarchy", lambda n: HierarchyTable((), {}, n, 20)
    )
    result = run("show", "talos", "--ladder", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["name"] == "talos"


def test_solve_prints_accelerations_and_says_that_nothing_holds_the_robot():
    output = run("solve", "talos").output
    assert "-9.81" in next(line for line in output.splitlines() if line.startswith("root_joint"))
    assert "--contacts takes left_sole_link, right_sole_link" in output
    assert "no constraints" not in run("solve", "four_bar").output


@pytest.mark.parametrize(
    "words",
    [("robots",), ("solvers",), ("problem",), ("show", "cassie", "--frames"), ("show", "talos")],
)
def test_a_table_of_words_is_not_cut(words):
    assert "…" not in run(*words).output


def test_a_line_of_an_answer_is_not_broken():
    lines = run("problem", "A01", "--duration", "0.1").output.splitlines()
    assert all(line.startswith(("A01", "  ")) for line in lines)


def test_a_file_that_was_there_is_kept_by_the_check(tmp_path):
    from condyn_pin.cli.commands.output import check_written

    there, new = tmp_path / "there.csv", tmp_path / "new.csv"
    there.write_text("kept")
    check_written(there, new, None)
    assert there.read_text() == "kept"
    assert not new.exists()


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("asked", [("solvers", "--json"), ("robots",), ("--help",)])
def test_a_full_disk_is_one_line(asked, unbuffered):
    code = "from condyn_pin.cli.main import main; main()"
    with open("/dev/full", "w") as full:
        result = subprocess.run(
            [sys.executable, "-c", code, *asked], env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert result.returncode == 2
    assert result.stderr.startswith("condyn: ")
    assert len(result.stderr.splitlines()) == 1


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
        (("assemble", "cassie"), {"q", "joints", "violation", "status", "branch"}),
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
    assert {row["name"] for row in listed} == {
        kind.__name__ for kind in cp.dynamics.SOLVERS.values()
    }
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
        ("condyn bench --solvers soft,nu", "soft,nullspace"),
        ("condyn simulate x --integrator rat", "rattle"),
        ("condyn simulate x --drift bau", "baumgarte"),
        ("condyn problem heavy", "heavy_top"),
        ("condyn stress --families few", "few_iterations"),
        ("condyn trade --measure fo", "forces"),
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
    assert "[kg]" in run("robots").output


def test_version():
    assert run("--version").output.strip() == f"condyn_pin {cp.__version__}"


def test_the_package_is_a_command_too():
    line = [sys.executable, "-m", "condyn_pin", "--version"]
    found = subprocess.run(line, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == f"condyn_pin {cp.__version__}"


@pytest.mark.parametrize("terminal", [True, False])
def test_a_table_of_numbers_is_folded_for_a_narrow_terminal_and_never_cut(terminal):
    from io import StringIO

    from rich.console import Console
    from rich.table import Table

    from condyn_pin._core.printing import print_whole

    table = Table("solver", "median of the times [us]", "error, worst of all", "status")
    table.add_row("Proximal(mu=0.0001, max_iterations=1)", "12.5", "2e-04", "20 inaccurate")
    paper = StringIO()
    print_whole(table, Console(file=paper, width=60, force_terminal=terminal, color_system=None))
    text = paper.getvalue()
    assert "…" not in text
    for word in ("max_iterations=1)", "12.5", "2e-04", "20 inaccurate", "median", "worst"):
        assert word in text
    assert (max(map(len, text.splitlines())) <= 60) == terminal
