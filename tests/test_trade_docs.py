"""The page on solvers quotes the committed study, and nothing else."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import pytest

import condyn_pin as cp

pytestmark = pytest.mark.once

ROOT = Path(__file__).parent.parent
PAGE = "docs/how-to-choose-a-solver.md"
sys.path.insert(0, str(ROOT / "benchmarks"))

script, trade = map(import_module, ("script", "trade"))

TABLE = cp.study.Table.from_json(script.result("trade study"))
VERDICTS = trade.verdicts_of_csv()
PAGES = trade.pages(TABLE, VERDICTS)


@pytest.mark.parametrize("path", list(PAGES))
def test_a_page_is_what_the_results_make_of_it(path):
    page = (ROOT / path).read_text(encoding="utf-8")
    assert script.filled(page, PAGES[path]) == page


def test_every_robot_is_measured_and_every_solver_is_in_the_study():
    scenes = {row.scene for row in TABLE.rows}
    for folder in (ROOT / "robots").glob("*/robot.toml"):
        assert any(scene.startswith(f"{folder.parent.name} ") for scene in scenes), folder
    solvers = {row.solver.split("(")[0] for row in TABLE.rows}
    # `condyn bench --native` has what is compiled; MINRES and Reference are there to compare with
    elsewhere = {"ConstrainedABA", "PV", "MinimumResidual", "Reference"}
    all_others = {kind.__name__ for kind in cp.dynamics.SOLVERS.values()} - elsewhere
    differing = (solvers - elsewhere) ^ all_others
    assert not differing, (
        f"the committed study and SOLVERS differ by {differing}: run benchmarks/trade.py "
        "study, or name a solver that is measured otherwise in `elsewhere`, with the place"
    )


def test_every_choice_is_a_row_of_the_study_and_holds_at_1000_fresh_states():
    assert {one.error for one in VERDICTS} == set(trade.LEVELS)
    assert {one.scene for one in VERDICTS} == set(trade.catalogue())
    rows = {(r.scene, r.short): r for r in TABLE.rows}
    for one in VERDICTS:
        row = rows[one.scene, one.solver]
        assert (one.us, one.study) == (row.median_us, row.error_worst)
        assert one.states == 1000
        assert one.holds == (one.worst <= one.error), one
        assert one.holds, one


def test_nothing_in_the_study_says_ok_and_is_wrong():
    wrong = [row for row in TABLE.rows if {"wrong", "raised"} & set(row.statuses)]
    assert not wrong, [(row.scene, row.solver, row.statuses) for row in wrong]


@pytest.mark.long
def test_verdicts_come_back_from_the_file(tmp_path):
    some = [trade.Verdict("s", 3, 1e-3, note="why"), VERDICTS[0]]
    script.write(tmp_path / "c.csv", map(asdict, some), {"processor": "p"})
    assert trade.verdicts_of_csv(tmp_path / "c.csv") == some


@pytest.mark.long
def test_a_choice_that_does_not_hold_is_marked():
    missed = trade.Verdict("s", 3, 1e-3, "P()", 1.0, worst=2e-3, holds=False, states=9)
    none = trade.Verdict("s", 3, 1e-6, note="nothing")
    met = trade.Verdict("s", 3, 1e-9, "Q()", 2.0, worst=1e-10, holds=True, states=9)
    line = trade.choices([missed, none, met]).splitlines()[-1]
    assert line == "| s (3 rows) | `P()` 1.0 us, 2e-03 (missed) | none | `Q()` 2.0 us, 1e-10 |"


def test_code_of_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fewer = (cp.dynamics.NullSpace(), cp.Proximal())  # to choose from: the page takes all
    monkeypatch.setattr("condyn_pin.study.study.default_sweep", lambda *_: fewer)
    page = (ROOT / PAGE).read_text(encoding="utf-8")
    session: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL):
        exec(compile(block, PAGE, "exec"), session)
    assert session["solver"] in fewer
    assert session["solution"].status.ok
    assert math.isfinite(session["solution"].a.max())
