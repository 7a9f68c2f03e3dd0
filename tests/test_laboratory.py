"""The drift laboratory: known figures, areas, pictures, commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from shell import condyn
from typer.testing import CliRunner

import condyn_pin as cp
from lab.cli import app as lab_app
from lab.drift import area, contest, errors, gap_growth, rod_pendulum, stability_map

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
QUICK = (
    "semi-implicit Euler, alpha dt = 0.84",
    "Runge-Kutta 4, alpha dt = 0.1",
    "Runge-Kutta 4, alpha dt = 2",
    "Runge-Kutta 4, alpha dt = 2.7",
    "RATTLE, dt = 0.04 s",
)


@pytest.fixture(scope="module")
def table():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        import drift
    return drift


@pytest.mark.long
@pytest.mark.parametrize("label", QUICK)
def test_rows_of_the_drift_table(table, label):
    case = next(case for case in table.cases() if case.label == label)
    row = table.run(case)
    assert table.agrees(row, case), row


def test_committed_table_is_reproduced_in_every_row(table):
    saved = json.loads((BENCHMARKS / "results" / "drift.json").read_text(encoding="utf-8"))
    cases = table.cases()
    assert [row["label"] for row in saved["rows"]] == [case.label for case in cases]
    assert len(cases) >= 30
    for row, case in zip(saved["rows"], cases, strict=True):
        assert table.agrees(row, case), row
    still = next(r for r in saved["rows"] if r["label"] == "Runge-Kutta 4, alpha dt = 0")
    assert still["violation"] / still["squared"]["violation"] == pytest.approx(0.8, abs=2e-3)
    assert still["constraint_velocity"] / still["squared"]["constraint_velocity"] == pytest.approx(
        0.8, abs=2e-3
    )
    assert saved["stability_limits"]["semi-implicit Euler"] == pytest.approx(0.828, abs=0.01)
    assert saved["growth"]["Runge-Kutta 4"] == pytest.approx(2.0, abs=0.05)
    assert saved["growth"]["explicit Euler"] == pytest.approx(1.0, abs=0.05)
    found = {one["label"]: one for one in saved["contest"]}
    rattle, euler = found["RATTLE"], found["semi-implicit Euler, projection"]
    assert rattle["steps"] >= 10_000
    assert rattle["late"] == pytest.approx(rattle["early"], rel=1e-3)
    assert rattle["violation"] < 1e-13
    assert euler["violation"] < 1e-9
    assert euler["late"] > 1e3


@pytest.mark.long
def test_a_row_that_is_wrong_does_not_agree(table):
    case = next(case for case in table.cases() if case.label == "Runge-Kutta 4, alpha dt = 0.1")
    row = table.run(case)
    for name in ("violation", "constraint_velocity", "energy"):
        assert not table.agrees(row | {name: 1.3 * row[name]}, case)
    assert not table.agrees(row | {"status": "diverged"}, case)


@pytest.mark.long
def test_a_closed_rod_says_nothing_about_energy():
    semi = cp.SemiImplicitEuler()
    projected = errors(semi, cp.simulation.Projection(tolerance=1e-14), dt=1e-2, steps=1000)
    rattle = errors(cp.simulation.Rattle(), cp.simulation.NoDrift(), dt=1e-2, steps=500)
    assert projected.violation < 1e-14
    assert projected.late > 10.0
    assert rattle.energy == pytest.approx(3.61e-3, rel=0.01)  # its bound at this step


@pytest.mark.long
def test_areas_are_kept_by_rattle_alone():
    semi = cp.SemiImplicitEuler()
    assert abs(area(cp.simulation.Rattle(), cp.simulation.NoDrift(), dt=1e-2)) < 1e-12
    for drift in (cp.simulation.Projection(), cp.Baumgarte.critical(30.0)):
        assert abs(area(semi, drift, dt=1e-2)) > 1e-6


@pytest.mark.long
def test_the_map_of_gains_has_its_limit_on_the_diagonal():
    products = np.array([0.5, 0.82, 0.84])
    found = stability_map(cp.SemiImplicitEuler(), products.tolist(), products.tolist())
    assert (found.diagonal() < 1).tolist() == [True, True, False]


@pytest.mark.long
def test_fast_pendulums_are_projected_with_the_rows_of_their_place():
    """A factor of another place let the rod open by hundreds of metres."""
    scene = rod_pendulum()
    found = cp.simulate(
        scene, [1.0, 0.0], [0.0, -60.0], duration=2.0, dt=1e-2, integrator=cp.SemiImplicitEuler(),
        drift=cp.simulation.Projection(),
    )  # fmt: skip
    assert found.violation.max() < 1e-9
    assert found.constraint_velocity.max() < 1e-8


@pytest.mark.once  # a picture
def test_pictures_show_the_numbers(tmp_path):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    from lab import drift as laboratory

    growths = {"RK4": gap_growth(cp.RungeKutta4(), dt=2e-2, steps=200)}
    found = contest(1e-2, 50)
    figure, (one, two, three) = pyplot.subplots(1, 3)
    assert laboratory.draw_growth(growths, one) is one
    assert one.lines[0].get_ydata()[-1] == growths["RK4"].violation[-1]
    assert laboratory.draw_stability(cp.SemiImplicitEuler(), two, points=8) is two
    assert two.get_xlim()[1] > 0.83
    assert laboratory.draw_contest(found, three) is three
    assert len(three.get_legend().texts) == len(found)
    pyplot.close(figure)
    assert one.get_legend() is None  # the lines themselves are labelled
    laboratory.save_laboratory(growths, [cp.SemiImplicitEuler()], found, tmp_path / "lab.png")
    assert (tmp_path / "lab.png").read_bytes().startswith(b"\x89PNG")


def measure(*words: str):
    return CliRunner().invoke(lab_app, list(words))


@pytest.mark.long
@pytest.mark.once  # a command's words
def test_condyn_drift(tmp_path):
    result = measure("drift", "--steps", "60", "--plot", str(tmp_path / "d.png"))
    assert result.exit_code == 0, result.output
    for said in ("0.828", "2.785", "RATTLE", "t^2.00", "60 steps of 10 ms"):
        assert said in result.output
    assert (tmp_path / "d.png").exists()
    assert isinstance(measure("drift", "--plot", "nowhere/d.png").exception, cp.InvalidArgument)


def test_condyn_simulate(tmp_path):
    out, csv = tmp_path / "run.npz", tmp_path / "run.csv"
    words = ("simulate", "four_bar", "--duration", "0.05", "--dt", "1e-3", "--integrator", "rattle")
    result = condyn(*words, "--drift", "nodrift", "--save", str(out), "--csv", str(csv))
    assert result.exit_code == 0, result.output
    assert "Rattle()" in result.output
    assert cp.Trajectory.load(out).t[-1] == pytest.approx(0.05)
    assert len(csv.read_text().splitlines()) == 52
    answer = json.loads(condyn("simulate", "four_bar", "--duration", "0.02", "--json").stdout)
    assert answer["status"] == "finished"
    assert answer["violation"] < 1e-9
    strong = condyn("simulate", "four_bar", "--drift", "baumgarte", "--gain", "1e5")
    assert isinstance(strong.exception, cp.InvalidArgument)
    for wrong in (
        ("--integrator", "eulers"), ("--drift", "none"), ("--save", str(tmp_path / "x.txt")),
        ("--save", "nowhere/run.npz"), ("--dt", "-1"), ("--solver", "magic"),
    ):  # fmt: skip
        assert isinstance(condyn("simulate", "four_bar", *wrong).exception, cp.CondynError), wrong


def test_condyn_simulate_says_when_a_run_breaks_down():
    result = condyn(
        "simulate", "cassie", "--contacts", "pelvis:surface", "--integrator", "expliciteuler",
        "--duration", "0.2", "--dt", "5e-3",
    )  # fmt: skip
    assert result.exit_code == 1, result.output
    assert "diverged" in result.output
