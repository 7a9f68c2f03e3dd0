"""The README runs: its Python in one session, its commands one by one."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA
from condyn_pin.cli.main import app

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
LINKAGES = ("four_bar", "cassie")  # of the simulation beside MuJoCo


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[str]:
    lines = [
        line.split("#")[0].strip() for block in blocks("console") for line in block.splitlines()
    ]
    return [line for line in dict.fromkeys(lines) if line]


def test_python_blocks_run_in_one_session(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    session: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), session)
    printed = capsys.readouterr().out
    assert "rank 10" in printed
    assert session["sol"].status.ok
    assert session["a"] == pytest.approx(session["sol"].a, rel=1e-9, abs=1e-9)
    assert session["fall"].violation.max() < 1e-6
    assert (tmp_path / "fall.html").is_file()


def test_it_stays_one_page():
    """A screen that says what it is, one that starts, two tables, and links."""
    assert len(README.encode()) <= 9000
    assert README.count("![") <= 3
    assert len(re.findall(r"^\|---", README, flags=re.MULTILINE)) == 2


def marked(line: str) -> object:
    """A line of the README; one that draws a PNG needs a browser."""
    return pytest.param(line, marks=pytest.mark.chromium if "--png" in line else (), id=line)


@pytest.mark.parametrize("line", [marked(line) for line in commands() if line[:7] == "condyn "])
def test_condyn_commands_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, shlex.split(line)[1:])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("line", [line for line in commands() if line.startswith("make ")])
def test_make_targets_exist_and_are_run_by_ci(line):
    target = line.split()[1]
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert line in (ROOT / ".ci" / "run").read_text()


def test_every_command_is_of_a_kind_that_is_tested():
    kinds = {line.split()[0] for line in commands()}
    assert kinds <= {"condyn", "make", "pip"}


def anchors(page: Path) -> list[str]:
    """The headings of a page as links name them."""
    titles = re.findall(r"^#+ (.*)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


def test_every_solver_is_in_the_table_of_solvers():
    page = (ROOT / "docs" / "how-to-choose-a-solver.md").read_text(encoding="utf-8")
    for solver in cp.dynamics.SOLVERS.values():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{solver.__name__}` "))
        assert row.endswith(f"| {solver.cost} |")


def test_every_local_link_is_there():
    for link in re.findall(r"\]\(([^)]+)\)", README):
        path, _, anchor = link.partition("#")
        path = path or "README.md"
        assert link.startswith("https://") or (ROOT / path).is_file(), link
        assert not anchor or anchor in anchors(ROOT / path), link
    for path in re.findall(r"`((?:condyn_pin|benchmarks)/[\w/.]+)`", README):
        assert (ROOT / path).exists(), path


def assert_written(pages) -> None:
    """Assert that pages are what their committed results make of them."""
    from marks import filled

    for path, blocks in pages.items():
        page = (ROOT / path).read_text(encoding="utf-8")
        assert filled(page, blocks) == page, path


def test_table_is_the_one_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import results

    table = results.BenchTable.from_json(ROOT / "benchmarks" / "results" / "bench.json")
    assert_written(results.pages(table))


@pytest.mark.skipif(not HAS_LCABA, reason="puts its questions to Pinocchio 4")
def test_what_others_answer_without_a_warning_is_what_they_answer_today(monkeypatch):
    """Asked again: Pinocchio is as wrong as the README says, and condyn_pin as right."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import truth

    assert_written(truth.pages(*truth.load()))
    saved, found = truth.load()[0]["cases"], truth.measure()
    assert found.keys() == saved.keys()
    for name, case in found.items():
        assert case.get("ours", 0.0) < 1e-10, name
        if name not in ("defaults", "small_mu"):
            assert case["theirs"] == pytest.approx(saved[name]["theirs"], rel=0.1), name
    assert found["defaults"]["nan"] == truth.STATES
    assert found["small_mu"]["theirs"] > 0.01  # rounding, magnified: other processors, other sizes
    assert found["small_mu"]["slack"] < 1e-12
    assert found["small_mu"]["said"] == ["inaccurate"]
    assert found["long_quaternion"]["refused"] == truth.STATES


def test_x_dense_is_against_the_fastest_of_the_dense():
    """Of the committed results; and DenseKKT is no straw man beside what is by hand."""
    saved = json.loads((ROOT / "benchmarks" / "results" / "bench.json").read_text())["rows"]
    rows = [row for row in saved if row["origin"] == "python" and row["to_dense"]]
    for scene in {row["scene"] for row in rows}:
        here = [row for row in rows if row["scene"] == scene]
        by_hand = [row for row in here if row["status"] == "by hand"]
        ours = [row for row in here if row["method"].startswith("Dense KKT")]
        assert len(by_hand) == 3
        assert max(row["to_dense"] for row in by_hand + ours) == pytest.approx(1.0, abs=0.02)
        # its guard, scaling and condition cost 4 us, which is much beside the 9 of a four-bar
        least = min(row["acceleration_us"] for row in by_hand)
        assert all(row["acceleration_us"] < 1.15 * least + 4.0 for row in ours)
    native = [row for row in saved if row["origin"] == "C++"]
    assert {row["to_dense"] for row in native if row["method"].startswith("dense")} == {1.0}
    assert any(row["to_dense"] > 1.5 for row in native if "constrainedABA" in row["method"])


def test_ladders_are_those_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import ladder

    tables = ladder.load(ROOT / "benchmarks" / "results" / "ladder.json")
    assert_written(ladder.pages(tables))


def test_simulation_beside_mujoco_is_that_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import simulation_vs_mujoco as versus

    rows, about = versus.load(ROOT / "benchmarks" / "results" / "simulation_vs_mujoco.json")
    assert_written(versus.pages(rows, about))
    assert {row.problem for row in rows} == set(LINKAGES)
    # the estimator is the same: both start closed, and no answer is less accurate than asked for
    for row in rows:
        if row.engine == "MuJoCo" and (found := versus.answer(rows, row)):
            assert found.violation <= row.violation
            assert found.energy <= row.energy
    theirs = {name: [r for r in versus._theirs(rows) if r.problem == name] for name in LINKAGES}
    ahead = {name: sum(versus._ratio(rows, r) < 1 for r in theirs[name]) for name in LINKAGES}
    said = (
        f"faster at {ahead['four_bar']} of its {len(theirs['four_bar'])} settings on the four-bar, "
        f"{ahead['cassie']} of {len(theirs['cassie'])} on Cassie"
    )
    assert said in " ".join(README.split())


def test_batches_are_those_of_the_committed_results(monkeypatch):
    """All answers are ok and the same; beside MuJoCo, none is less accurate than asked for."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import batch

    saved = json.loads(batch.JSON.read_text(encoding="utf-8"))
    assert_written(batch.pages(saved))
    for row in saved["answers"]:
        assert row["difference"] == 0.0
        assert row["counts"] == {"ok": row["states"]}
    smallest = min(row["error"] for row in saved["motions"])
    assert saved["error"] < smallest / 10
    for theirs, mine in batch.pairs(saved):
        assert mine is not None
        assert mine.violation <= theirs.violation
        assert mine.error <= theirs.error
        assert mine.simulated > theirs.simulated


def test_extremes_are_those_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import stress

    runs = stress.load(ROOT / "benchmarks" / "results" / "stress.json")
    assert_written(stress.pages(runs))


def test_the_campaign_is_that_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import campaign_report

    found = campaign_report.load(ROOT / "benchmarks" / "results" / "campaign.json")
    assert_written(campaign_report.pages(found))


def test_conjugate_gradients_are_those_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import conjugate_gradient

    rows, about = conjugate_gradient.load()
    assert_written(conjugate_gradient.pages(rows, about))
    assert {row.joints for row in rows} >= {10, 400}
    # what Reference itself knows of 400 links: eps times the condition of M, which is 1e10
    assert all(row.error < 1e-6 for row in rows if row.method == "ConjugateGradient")


def test_weights_are_those_of_the_committed_results(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import auto_mu

    found, machine = auto_mu.load(ROOT / "benchmarks" / "results" / "auto_mu.json")
    assert_written(auto_mu.pages(found, machine))
    table = (ROOT / "benchmarks" / "results" / "auto_mu.md").read_text(encoding="utf-8")
    assert auto_mu.markdown(found, machine) == table
    assert {c.task.family for c in found} <= set(cp.lab.EXTREMES)


def test_sentences_say_what_the_committed_results_say():
    """Numbers that stand in a sentence, outside the blocks that a script writes."""
    text, solvers, simulators = (
        " ".join((ROOT / page).read_text(encoding="utf-8").split())
        for page in ("README.md", "docs/how-to-choose-a-solver.md", "docs/simulators.md")
    )
    results = ROOT / "benchmarks" / "results"

    times: dict[str, dict[str, float]] = {}
    bench = json.loads((results / "bench.json").read_text())["rows"]
    for row in bench:
        times.setdefault(row["scene"], {})[row["method"]] = row["acceleration_us"]
    slowest = max(each["Proximal"] / each["LCABA"] for each in times.values())
    assert f"at worst {slowest:.1f} times as slow as `LCABA`" in solvers
    legs = [row for row in bench if row["scene"] == "cassie loops"]
    one = next(row for row in legs if row["method"] == "Proximal")
    by_hand = min(row["acceleration_us"] for row in legs if row["status"] == "by hand")
    assert (
        f"legs take {one['acceleration_us']:.0f} us in a hot loop, {one['to_bare']:.2f} times "
        f"Pinocchio's bare call; the best dense solve by hand takes {by_hand:.0f} us. With the "
        f"proof it is {one['solve_us']:.0f} us"
    ) in text

    rows = json.loads((results / "peers.json").read_text())["rows"]

    def least(field, scene, quantity, peer):
        asked = (scene, quantity, peer)
        return min(
            row[field] for row in rows if (row["scene"], row["quantity"], row["peer"]) == asked
        )

    soft = (
        least("error_worst", scene, "acceleration", peer)
        for peer in ("MuJoCo", "Drake")
        for scene in ("talos, two feet", "cassie, loops")
    )
    said = "give a to {:.0e} on Talos and to {:.0e} on Cassie, Drake's to {:.0e} and {:.0e}"
    assert said.format(*soft).replace("e-0", "e-") in simulators
    ours, theirs = (
        least("ratio", "talos, two feet", "derivatives", peer) for peer in ("condyn_pin", "MuJoCo")
    )
    assert round(theirs / ours) == 8
    assert "take eight times as long as our exact derivatives" in simulators
    assert round(least("ratio", "cassie, loops", "derivatives", "condyn_pin")) == 4
    assert "take four times as long as Pinocchio's on Cassie" in text
    assert "take four times as long as Pinocchio's on Cassie" in simulators


def test_changelog_has_this_version_and_a_line_an_entry():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(cp.__version__)}\] - \d{{4}}-\d\d-\d\d$", text, re.M)
    assert text.index("## [Unreleased]") < text.index(f"## [{cp.__version__}]")
    assert set(re.findall(r"^### (.*)$", text, re.M)) <= {"Added", "Changed", "Fixed"}
    entries = text.partition("## [Unreleased]")[2].splitlines()
    assert all(line[:2] in ("- ", "##", "") for line in entries if line[:3] != "###")
    long = [line for line in entries if line[:2] == "- " and len(line[2:].split()) > 12]
    assert not long
