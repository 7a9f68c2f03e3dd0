"""The command line: what it prints, what it writes, and how it fails."""

from __future__ import annotations

import csv
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from shared import SOLVERS, each_row
from typer.testing import CliRunner

import condyn_pin as cp
import lab
import lab.__main__
import lab.cli
from condyn_pin.cli.commands import PANELS
from condyn_pin.cli.main import app, main

pytestmark = pytest.mark.once

LAB = "python benchmarks/lab"
COMMANDS = {command.__name__: command for panel in PANELS.values() for command in panel} | {
    f"lab {name}": getattr(lab.cli, name) for name in ("stress", "problem", "drift", "ladder")
}


def run(line: str, *paths: object):
    """Run a line of `condyn`, or one that begins with `lab`, and paths after it."""
    words = [*shlex.split(line), *map(str, paths)]
    if words[:1] == ["lab"]:
        return CliRunner().invoke(lab.cli.app, words[1:])
    return CliRunner().invoke(app, words)


@pytest.fixture
def condyn(monkeypatch, capsys):
    """Run a line as a user does; gives the exit code, stdout and stderr."""

    def call(line: str, *, at: Callable[[], None] = main) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["condyn", *shlex.split(line)])
        with pytest.raises(SystemExit) as left:
            at()
        return (left.value.code or 0, *capsys.readouterr())

    return call


SAID = {
    "robots": (*cp.io.available_robots(), "32.94", "Apache-2.0", "[kg]", "motors"),
    "show cassie": (
        "12, rank 10, mobility 22",
        "left-roll-op,",
        "left-plantar-foot-joint.z",
        "springs",
    ),
    "show four_bar --no-loops": ("mobility 3", "coupler_rocker", "how-to-close-a-loop"),
    "show cassie --frames": ("frames",),
    "show talos": (),
    "show cassie --variant springs=locked": ("cassie, springs locked: nq 31",),
    "show cassie --variant springs=locked --variant achilles=as_file": (
        "springs locked, achilles as_file",
    ),
    "solvers": (*(kind.__name__ for kind in cp.dynamics.SOLVERS.values()), "rank_tolerance=1e-07"),
    "solve solo12 --contacts 'FL_FOOT:point, base_link:surface'": ("base_link",),
    "solve talos": ("--contacts takes left_sole_link, right_sole_link", "-9.81"),
    "solve four_bar --q crank=1.1": ("the joints are at", "crank                        1.1\n"),
    "lab problem": ("A01", "A02"),
    "control solo12": ("6.131", "KKT residual", "by Newton-Euler", "of its limit"),
    "control solo12 --lift FL_FOOT": ("lifted", "HR_FOOT: pulls", "FL_FOOT position"),
    "control cassie": ("left-foot/heel", "note: springs push"),
    "control cassie --lift left-foot --variant springs=locked": ("left-foot position",),
    "control talos --lift left_sole_link --qp daqp": ("right_sole_link: tips over +y", "DAQP"),
    "control panda": ("panda_joint4",),
    "doctor": ("Everything fits together", "LCABA"),
    "--version": (f"condyn_pin {cp.__version__}\n",),
    "bench four_bar --quick --solvers 'nullspace, Soft'": ("Null space", "Soft"),
    "bench rolling_ball --quick": ("Dense KKT",),
}
NOT_SAID = {
    "solve four_bar --q crank=1.1": "no constraints",
    "control panda": "contact",
    "bench four_bar --quick --solvers 'nullspace, Soft'": "Proximal",
    "bench rolling_ball --quick": "LCABA",  # which does not take the scene
}


@pytest.mark.parametrize("line", SAID)
def test_an_answer_is_whole(line):
    result = run(line)
    assert result.exit_code == 0, result.output
    assert [text for text in SAID[line] if text not in result.output] == []
    assert "…" not in result.output  # nothing is cut
    assert line not in NOT_SAID or NOT_SAID[line] not in result.output


@pytest.mark.long
def test_a_line_of_an_answer_is_not_broken():
    lines = run("lab problem A01 --duration 0.1").output.splitlines()
    assert all(line.startswith(("A01", "  ")) for line in lines)


@pytest.mark.long
def test_a_ladder_is_printed_drawn_and_json(tmp_path, monkeypatch):
    result = run("lab ladder talos --plot", tmp_path / "l.png")
    assert result.exit_code == 0, result.output
    for said in ("eight corners", "legs alone", "LCABA" if "lcaba" in SOLVERS else "Proximal"):
        assert said in result.output
    assert (tmp_path / "l.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(
        "lab.hierarchy.model_hierarchy",
        lambda name: lab.HierarchyTable((), {}, name, 20),
    )
    assert json.loads(run("lab ladder talos --json").stdout)["name"] == "talos"


@pytest.mark.parametrize("solver", list(SOLVERS))
def test_solve_prints_json_that_equals_the_library(solver):
    words = "solve talos --contacts left_sole_link,right_sole_link --json --solver"
    result = run(words, solver)
    assert result.exit_code == (0 if SOLVERS[solver].exact else 1), result.output
    answer = json.loads(result.stdout)
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    solution = cp.solve(scene, q, v, 0 * v, solver=SOLVERS[solver](), throw=False)
    assert answer["a"] == solution.a.tolist()
    assert answer["status"] == ("ok" if SOLVERS[solver].exact else "inaccurate")
    assert answer["forces"]["left_sole_link"] == solution.forces["left_sole_link"].tolist()


@pytest.mark.long
def test_solve_takes_what_rolls_by_the_solver_of_the_library():
    """And geared joints, rods and planes: the default was Proximal, which takes none of these."""
    done = run("solve unicycle --contacts wheel --json")
    assert done.exit_code == 0
    unicycle = cp.load_robot("unicycle")
    scene = cp.Scene(unicycle, unicycle.contacts)
    q, v = scene.state()
    assert json.loads(done.stdout)["a"] == cp.solve(scene, q, v, 0 * v).a.tolist()


def test_solve_takes_joints_torques_and_forces_by_name():
    words = "solve four_bar --q crank=1.1 --tau crank=2 --force coupler_tip=0,0,-10 --json"
    result = run(words)
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    bar = cp.load_robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q = np.array(answer["q"])
    assert q[bar.index_q("crank")] == 1.1
    assert scene.check(q).closed
    pushed = cp.AppliedForce("coupler_tip", [0.0, 0.0, -10.0])
    tau = bar.joint_vector({"crank": 2.0})
    assert answer["a"] == cp.solve(scene, q, np.zeros(3), tau, forces=[pushed]).a.tolist()


@pytest.mark.long
def test_the_base_of_a_urdf_may_float():
    path = cp.load_robot("go2").description
    fixed, floating = (run(f"show {path} {more}") for more in ("", "--floating"))
    assert "nv 12" in fixed.output
    assert "nv 18" in floating.output
    answer = json.loads(run(f"solve {path} --floating --json").stdout)
    assert answer["a"][:3] == pytest.approx([0.0, 0.0, -9.81], abs=1e-9)


@pytest.mark.long
def test_a_model_of_a_world_and_its_motors_are_chosen(tmp_path, condyn):
    link = "<link name='{0}a'/><link name='{0}b'/>"
    joint = "<joint name='{0}j' type='revolute'><parent>{0}a</parent><child>{0}b</child>"
    axis = "<axis><xyz>0 0 1</xyz></axis></joint>"
    models = "".join(
        f"<model name='{name}'>{(link + joint).format(name)}{axis}</model>" for name in "mn"
    )
    path = tmp_path / "w.sdf"
    path.write_text(f"<sdf version='1.9'><world name='w'>{models}</world></sdf>")
    code, _, said = condyn(f"show {path}")
    assert code == 2
    assert "choose one with --model 'm', or several, a --model for each" in said
    facts = json.loads(run("show --model n --actuated nj --json", path).stdout)
    assert facts["robot"] == "n"
    facts = json.loads(run("show --model n --model m --json", path).stdout)
    assert facts["robot"] == "n + m"


def test_assemble_without_loops_says_so():
    result = run("assemble solo12")
    assert result.exit_code == 0
    assert "the file has no loops, so there is nothing to close" in result.output
    assert "--no-loops leaves nothing to close" in run("assemble four_bar --no-loops").output
    assert "note" not in run("assemble four_bar").output


@pytest.mark.long
def test_advice_names_options_of_the_line(condyn):
    code, _, said = condyn("assemble cassie --q left-knee-op=9")
    assert code == 2
    assert "say --no-limits" in said
    assert "within_limits" not in said


@pytest.mark.long
def test_assemble_keeps_the_joints_that_it_is_given():
    answer = json.loads(run("assemble four_bar --q crank=0.9 --json").stdout)
    assert answer["status"] == "closed"
    assert answer["joints"]["crank"] == [0.9]


@pytest.mark.long
def test_control_prints_json_that_equals_the_library():
    answer = json.loads(run("control go2 --lift FL_foot --json").stdout)
    assert answer["status"] == "ok"
    assert "FL_foot" not in answer["forces"]
    up = [force[2] for force in answer["forces_before"].values()]
    go2 = cp.load_robot("go2")
    assert sum(up) == pytest.approx(go2.mass * 9.81, rel=1e-6)
    scene = cp.mechanism.without(cp.Scene(go2, go2.contacts), ["FL_foot"])
    forward = cp.solve(scene, *scene.state(), answer["tau"])
    assert forward.a == pytest.approx(answer["a"], abs=1e-7)
    assert answer["residuals"]["kkt"] < 1e-9
    shares = [motor["of_limit"] for motor in answer["torques"].values()]
    assert shares == sorted(shares, reverse=True)
    assert 0 < shares[0] < 1


def test_what_control_cannot_do_is_named_and_exits_with_one():
    asked = "control solo12 --com 0,0,-11"
    result = run(asked)
    assert result.exit_code == 1
    assert "CenterOfMass.z gives 1.19 m/s^2" in result.output
    answer = json.loads(run(f"{asked} --json").stdout)
    (give,) = answer["infeasible"]["gives"]
    assert (give["row"], give["unit"]) == ("CenterOfMass.z", "m/s^2")
    assert give["amount"] == pytest.approx(11 - 9.81, abs=1e-6)
    assert answer["tau"] == [None] * 18


@each_row(
    ("line", "said"),
    [
        ("--up nan", "--up = nan"),
        ("--up nan --lift FL_FOOT", "--up = nan"),
        ("--up 3", "--up 3: no foot is lifted; --lift FOOT says which"),
    ],
)
def test_an_acceleration_of_no_foot_is_not_left_out(condyn, line, said):
    code, _, complaint = condyn(f"control solo12 {line}")
    assert code == 2
    assert said in complaint


@pytest.mark.parametrize("option", ["--html", "--view"])
def test_control_is_a_page(tmp_path, option):
    result = run(f"control solo12 --json {option}", tmp_path / "solo.html")
    assert json.loads(result.stdout)["status"] == "ok"
    page = (tmp_path / "solo.html").read_text()
    assert "solo12, control: ok" in page
    assert "support polygon" in page


@pytest.mark.long
def test_a_singular_solve_exits_with_one_and_says_nan():
    answer = run("solve four_bar --solver densekkt --json")
    assert answer.exit_code == 1
    assert json.loads(answer.stdout)["status"] == "singular"
    assert json.loads(answer.stdout)["a"] == [None] * 3
    assert "[nan nan nan]" in run("solve four_bar --solver densekkt").output  # this is no markup


def test_export_writes_a_file_that_reads_back(tmp_path):
    path = tmp_path / "bar.xml"
    result = run("export four_bar --mjcf", path)
    assert result.exit_code == 0
    assert result.output == f"written: {path}\n"
    assert cp.load_robot(path).loops == cp.load_robot("four_bar").loops
    assert run("export four_bar --without ' coupler_rocker,' --mjcf", path).exit_code == 0
    assert cp.load_robot(path).loops == ()


@pytest.mark.long
def test_export_says_what_an_mjcf_has_no_place_for(tmp_path):
    path = tmp_path / "solo.xml"
    said = "limits of 12 velocities: an MJCF has no place for them"
    assert f"not written: {said}" in run("export solo12 --mjcf", path).output
    assert f"<!-- {said} -->" in path.read_text()
    assert "not written" not in run("export four_bar --mjcf", path).output
    assert "<!--" not in cp.load_robot("four_bar").to_mjcf()


@pytest.mark.long
def test_export_writes_feet_and_shapes(tmp_path):
    path = tmp_path / "solo.xml"
    assert run("export solo12 --friction 0.7 --shapes --mjcf", path).exit_code == 0
    text = path.read_text()
    assert text.count("<pair") == 4
    assert text.count("<mesh") > 3


def test_bench_writes_table_and_picture_of_all_that_take_the_scene(tmp_path):
    table, rows, picture = (tmp_path / name for name in ("b.json", "b.csv", "b.png"))
    files = ("--json", table, "--csv", rows, "--plot", picture)
    result = run("bench four_bar --quick --solvers all", *files)
    assert result.exit_code == 0, result.output
    saved = json.loads(table.read_text())
    assert saved["machine"]["pinocchio"]
    methods = {row["method"] for row in saved["rows"] if row["status"] != "by hand"}
    assert len(saved["rows"]) == len(methods) + 3
    shown = [kind for kind in SOLVERS.values() if kind is not cp.dynamics.Reference]
    titles = {kind.title for kind in shown if kind.takes_loops}
    assert methods == titles | {"ABA, unconstrained"}
    lines = [line for line in rows.read_text().splitlines() if not line.startswith("#")]
    assert len(list(csv.DictReader(lines))) == len(saved["rows"])
    assert picture.read_bytes().startswith(b"\x89PNG")


MISTAKES = {
    "show talo": "did you mean 'talos'",
    "show": "`condyn show --help`",
    "show cassie --variant springs": "OPTION=VALUE",
    "show cassie --variant springs=lost": "'lost'",
    "show cassie --variant spring=locked": "did you mean 'springs'",
    "solve talos --solver proximall": "did you mean 'proximal'",
    "solve talos --contacts left_sole": "left_sole_link",
    "solve talos --posture sitting": "half_sitting",
    "solve talos --mu -1": "mu = -1.0",
    "solve talos --solver reference --mu 1": "no such parameter",
    "control solo12 --lift FL": "'FL'; did you mean 'FL_FOOT'",
    "control solo12 --com 1,2": "three numbers",
    "control solo12 --qp prox": "did you mean 'proxqp'",
    "control solo12 --png x.jpg": "x.jpg: the ending says the format: .png",
    "solve cassie --mu x": "'--mu'",
    "solve cassie --mux": "`condyn solve --help`",
    "export sleigh --mjcf p.xml": "which MuJoCo does not have",
    "export four_bar --friction 0.7 --mjcf b.xml": "four_bar has no ready-made contacts",
    "export four_bar --mjcf no/such/b.xml": "there is no folder no/such",
    "bench four_bar --quick --plot b.foo": ".png, .svg, .pdf",
    "bench four_bar --solvers nulspace": "did you mean 'nullspace'",
    "bench four_bar --quick --csv no/such/b.csv": "there is no folder no/such",
    "bench four_bar --quick --csv .": ".: cannot be written: Is a directory",
    "bench four_bar --json": "`condyn bench --help`",
    "trade four_bar --no-save": "--save has no effect without --tune",
    "trade four_bar --tune --jobs 2": "--jobs has no effect with --tune",
    "trade four_bar pendulum --tune": "name one robot",
    "trade --tune": "name one robot",
    "simulate four_bar --save a.txt": ".npz",
    "simulate four_bar --gain 5": "add --drift baumgarte",
    "simulate four_bar --friction 0.5": "four_bar has no ready-made contacts",
    "view cassie --port 70000": "`condyn view --help`",
    "view cassie --png x.jpg": "x.jpg: the ending says the format: .png",
    "view m.npz --no-loops": "a motion has its own",
    "show cassie --floating": "--floating: it is for the path of a URDF or an SDF; cassie says",
    "solve cassie --q left-knee=1": "did you mean 'left-knee-op'",
    "solve cassie --q left-knee-op": "--q left-knee-op: NAME=NUMBER is needed, such as knee=0.3",
    "solve cassie --q left-knee-op=a": "--q left-knee-op=a: numbers",
    "solve cassie --q left-knee-op=9": "'left-knee-op' is 508 deg beyond its limits",
    "solve cassie --q left-knee-op=-1 --q left-knee-op=-2": "left-knee-op is given twice",
    "solve cassie --tau left-knee=60": "did you mean 'left-knee-op'",
    "solve cassie --tau root_joint=1,2": "root_joint has shape (2,)",
    "solve cassie --force pelvi=0,0,1": "did you mean 'pelvis'",
    "solve cassie --force pelvis=0,1": "force on 'pelvis' has shape (2,)",
    "solve cassie --tau left-knee-op=1,left-foot-op=2": "one name is needed; repeat --tau for",
    "solve cassie --variant springs=locked,achilles=as_file": "repeat --variant for others",
    "solve cassie --model a,b": "--model a,b: one name is needed; repeat it, --model a --model b",
    "control rolling_ball": "names no joint with a motor; --actuated does",
    "solve cassie --q 'left-knee-op = x'": "--q left-knee-op=x: numbers with commas",
    "view four_bar --at 0.1": "--at 0.1: it is for a motion",
    "view m.npz": "m.npz: no file of a trajectory (No such file or directory)",
    "nothing": "No such command 'nothing'; `condyn --help`",
    "robots more": "`condyn robots --help` says what there is",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_a_sentence_and_not_a_traceback(line, condyn):
    code, _, said = condyn(line)
    assert code == 2
    assert MISTAKES[line] in said
    assert len(said.splitlines()) == 1


MISTAKES_IN_THE_LABORATORY = {
    "ladder solo12": "no ladder named 'solo12'",
    "ladder talos --plot l.foo": ".png, .svg, .pdf",
    "ladder talos --variant a=b": f"`{LAB} ladder --help`",
    "drift --dt 0": "--dt 0.0: a number > 0 [s]",
    "problem --n 3": "A01",
    "stress --seconds nan": "--seconds nan",
    "nothing": f"No such command 'nothing'; `{LAB} --help`",
}


@pytest.mark.parametrize("line", MISTAKES_IN_THE_LABORATORY)
def test_a_mistake_in_the_laboratory_is_a_sentence_too(line, condyn):
    code, _, said = condyn(line, at=lab.__main__.main)
    assert code == 2
    assert said.startswith("lab: ")
    assert MISTAKES_IN_THE_LABORATORY[line] in said
    assert len(said.splitlines()) == 1


MOVED = {
    "lab": "",
    "lab stress cassie --seconds 5": " stress cassie --seconds 5",
    "lab --help": " --help",
    "problem": " problem",
    "drift --dt 0": " drift --dt 0",
    "show solo12 --ladder --json": " ladder solo12 --json",
}


@pytest.mark.parametrize("line", MOVED)
def test_what_measures_the_library_says_where_it_went(line, condyn):
    code, page, said = condyn(line)
    assert (code, page) == (2, "")
    where = f"this measures the library and lives in a checkout: `{LAB}{MOVED[line]}`"
    assert said == f"condyn: {where}\n"


@pytest.mark.long
@pytest.mark.parametrize("line", ["show talo --debug", "--debug show talo"])
def test_debug_shows_the_traceback_wherever_it_stands(line, condyn):
    code, _, said = condyn(line)
    assert code == 1
    assert "Traceback" in said
    assert "UnknownName" in said


@pytest.mark.parametrize(
    ("raised", "code", "line"),
    [
        (ZeroDivisionError("of ours\nin two lines"), 3, "ZeroDivisionError: of ours in two lines;"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_a_defect_and_an_interrupt_are_a_line_each(raised, code, line, condyn, monkeypatch):
    def broken(*_, **__):
        raise raised

    monkeypatch.setattr("condyn_pin.cli.words.load_robot", broken)
    found, _, said = condyn("show talos")
    assert found == code
    assert said.startswith(f"condyn: {line}")
    assert len(said.splitlines()) == 1
    assert ("--debug" in said) == (code == 3)
    assert code != 3 or "Traceback" in condyn("show talos --debug")[2]


OLD = {
    "tune four_bar --error 1 --json": "trade --tune four_bar --error 1 --json=-",
}


@pytest.mark.parametrize("line", OLD)
def test_a_line_of_the_last_version_says_its_words_of_today(line, condyn, monkeypatch):
    monkeypatch.setattr("condyn_pin.study.study.choose", nothing)
    old, new = condyn(line), condyn(OLD[line])
    assert old == (new[0], new[1], f"condyn: this is `condyn {OLD[line]}` now\n{new[2]}")


# What was measured is kept


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


def test_ctrl_c_keeps_what_was_measured(tmp_path, monkeypatch):
    table = tmp_path / "b.csv"

    def stopped(line: str, after: int):
        monkeypatch.setattr("condyn_pin.cli.output.progress_bar", stopping_after(after))
        result = run(line)
        assert result.exit_code == 130
        return json.loads(result.stdout)

    found = stopped(f"bench four_bar pendulum --quick --json - --csv {table}", 40)
    assert {row["scene"] for row in found["rows"]} == {"four_bar loops"}
    assert "four_bar loops" in table.read_text()
    table.unlink()
    few = "lab stress four_bar --families few_iterations --solver Proximal --json"
    assert stopped(f"{few} --csv {table}", 3)["cases"] == 4
    assert "few_iterations" in table.read_text()
    runs = stopped("lab drift --steps 20 --json", 25)["runs"]
    assert runs
    assert all(one["errors"]["status"] == "finished" for one in runs.values())


@pytest.mark.long
def test_ctrl_c_keeps_the_motion_so_far_and_stops_a_whole_study(monkeypatch):
    from condyn_pin.simulation.run import HybridSimulator

    whole = HybridSimulator.run

    def interrupted(self, *rest):
        self.plan = replace(self.plan, steps=3)
        whole(self, *rest)
        raise KeyboardInterrupt

    monkeypatch.setattr(HybridSimulator, "run", interrupted)
    for line in ("simulate four_bar", "lab problem A01"):
        result = run(line)
        assert result.exit_code == 130
        assert "interrupted after t = " in result.output
    study = cp.Study("four_bar", [cp.dynamics.NullSpace()], states=2, measure="trajectory")
    with pytest.raises(cp.errors.Interrupted):
        study.run()


@pytest.mark.long
@pytest.mark.parametrize("line", ["bench four_bar", "trade four_bar --states 2"])
def test_a_table_goes_to_stdout_as_json_and_to_people_beside(line):
    result = run(f"{line} --quick --solvers soft,nullspace --json -")
    assert result.exit_code == 0, result.output
    assert {row["scene"] for row in json.loads(result.stdout)["rows"]} == {"four_bar loops"}
    assert "four_bar loops" in result.stderr
    assert "…" not in result.stderr


def nothing(*_, **__):
    raise cp.errors.NotReached("nothing meets that")


@pytest.mark.long
def test_a_choice_and_what_no_solver_meets_are_json_too(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    line = "trade four_bar --tune --error 1e-6 --solvers nullspace --json -"
    result = run(line)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["solver"] == "NullSpace"
    assert "solver=tuned(scene, 1e-06)" in result.stderr
    bar = cp.load_robot("four_bar")
    assert isinstance(cp.study.tuned(cp.Scene(bar, bar.loops), 1e-6), cp.dynamics.NullSpace)
    monkeypatch.setattr("condyn_pin.study.study.choose", nothing)
    result = run(line)
    assert result.exit_code == 1
    answer = json.loads(result.stdout)
    assert (answer["solver"], answer["reason"]) == (None, "nothing meets that")


@pytest.mark.long
def test_a_file_that_was_there_is_kept_by_the_check(tmp_path):
    from condyn_pin.cli.output import check_written

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


@pytest.mark.long
@pytest.mark.parametrize("closed", ["stdout", "stderr"])
def test_what_is_closed_is_not_written_to(closed):
    """As jobs of cron are started: the answer is that of the exit code."""
    for asked, code in (("solvers", 0), ("show talo", 2)):
        shell = f"{sys.executable} -m condyn_pin {asked} {1 if closed == 'stdout' else 2}>&-"
        result = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=False)
        assert result.returncode == code
        assert "Traceback" not in result.stderr
        assert (code == 2 and closed == "stdout") == ("talos" in result.stderr)


KEYS = {
    "robots": {"cassie", "talos"},
    "show cassie": {"rows", "rank", "redundant", "frames", "ready_contacts"},
    "assemble cassie": {"q", "joints", "violation", "status", "branch"},
    "solve four_bar": {"a", "lam", "forces", "status", "advice", "machine"},
    "doctor": {"versions", "features", "remedy"},
    "lab problem": {"A01", "A02"},
}


@pytest.mark.parametrize("line", KEYS)
def test_json_is_all_that_is_printed(line):
    result = run(f"{line} --json")
    assert result.exit_code == 0, result.output
    assert KEYS[line] <= json.loads(result.stdout).keys()


@pytest.mark.long
def test_json_of_the_answers_equals_the_library():
    shown = json.loads(run("show cassie --json").stdout)
    cassie = cp.load_robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    assert shown["redundant"] == list(legs.summary().redundant)
    assert json.loads(run("assemble cassie --json").stdout)["q"] == legs.state()[0].tolist()
    listed = json.loads(run("solvers --json").stdout)
    assert {row["name"] for row in listed} == {x.__name__ for x in cp.dynamics.SOLVERS.values()}
    assert json.loads(run("robots --json").stdout)["cassie"]["nv"] == 32


@pytest.mark.long
@pytest.mark.parametrize("at", [main, lab.__main__.main])
def test_nothing_asked_is_help(at, condyn):
    code, page, said = condyn("", at=at)
    assert (code, said) == (0, "")
    assert "--help" in page


@pytest.mark.long
def test_help_is_a_page_of_the_manual():
    page = run("--help").output
    for said in ("First steps", "Exit codes", "interrupted", "--debug", "--install-completion"):
        assert said in page
    listed = page + run("lab --help").output
    for name, function in COMMANDS.items():
        assert name.split()[-1] in listed
        assert function.__doc__.strip().split("\n")[0].rstrip(".")[:20] in listed
        assert "as_json" in function.__annotations__ or name in ("export", "view"), name
        assert run(f"{name} --help").exit_code == 0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("condyn sol", "solvers"),
        ("condyn show cas", "cassie"),
        ("condyn solve x --solver nu", "nullspace"),
        ("condyn bench --solvers soft,nu", "soft,nullspace"),
        ("condyn simulate x --integrator rat", "rattle"),
        ("condyn simulate x --drift bau", "baumgarte"),
        ("condyn trade --measure fo", "forces"),
    ],
)
def test_the_shell_completes(line, said):
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    result = CliRunner().invoke(
        app, [], prog_name="condyn", env={"_CONDYN_COMPLETE": "complete_bash", **words}
    )
    assert said in result.output.split()


@pytest.mark.long
def test_the_laboratory_is_a_command_from_anywhere(tmp_path):
    folder = Path(__file__).parents[1] / "benchmarks" / "lab"
    line = [sys.executable, folder, "stress", "--families", "fast", "--solver", "soft", "four_bar"]
    found = subprocess.run(line, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "8 cases on Pinocchio" in found.stdout


@pytest.mark.long
def test_the_package_is_a_command_too():
    line = [sys.executable, "-m", "condyn_pin", "--version"]
    found = subprocess.run(line, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == f"condyn_pin {cp.__version__}"


@pytest.mark.parametrize("terminal", [True, False])
def test_a_table_of_numbers_is_folded_for_a_narrow_terminal_and_never_cut(terminal):
    from rich.console import Console
    from rich.table import Table

    from condyn_pin._core.show import print_whole

    table = Table("solver", "median of the times [us]", "error, worst of all", "status")
    table.add_row("Proximal(mu=0.0001, max_iterations=1)", "12.5", "2e-04", "20 inaccurate")
    paper = StringIO()
    print_whole(table, Console(file=paper, width=60, force_terminal=terminal, color_system=None))
    text = paper.getvalue()
    assert "…" not in text
    for word in ("max_iterations=1)", "12.5", "2e-04", "20 inaccurate", "median", "worst"):
        assert word in text
    assert (max(map(len, text.splitlines())) <= 60) == terminal
