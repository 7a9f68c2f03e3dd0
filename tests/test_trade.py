"""Tables of a study: the front, the cheapest, files, comparisons and pictures."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import pickle
from contextlib import contextmanager
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from shared import all_scenes, each_row
from shell import condyn

import condyn_pin as cp
from condyn_pin.study import NominalStates, Row, SampledStates, Table
from condyn_pin.study.case import parameters_of
from condyn_pin.study.fresh import Fresh, FreshErrors, measure_of, solver_of
from condyn_pin.study.states import LOADS
from condyn_pin.study.tables import ALONE

pytestmark = pytest.mark.once


def row(
    solver: cp.dynamics.Solver, us: float | None, error: float, scene: str = "s", **other
) -> Row:
    """Return a row of invented figures."""
    values = {
        "scene": scene,
        "rows": 3,
        "nv": 3,
        "method": solver.title,
        "solver": repr(solver),
        "parameters": parameters_of(solver),
        "measure": "acceleration",
        "states": "20 sampled under all loads, seed 0",
        "n": 20,
        "error_median": error / 10,
        "error_worst": error,
        "dynamics_error": error,
        "constraint_error": error,
        "iterations": 1,
        "statuses": {"ok": 20},
        "median_us": us,
        "p95_us": None if us is None else 1.05 * us,
        "timed": ALONE if us else "not timed: 2 processes shared the machine",
    }
    return Row(**values | other)


COARSE = row(cp.Proximal(mu=1e-2, max_iterations=1), 2.0, 1e-3, statuses={"inaccurate": 20})
FINE = row(cp.Proximal(mu=1e-8), 3.0, 1e-9)
SLOW = row(cp.dynamics.NullSpace(), 30.0, 1e-14)
BEATEN = row(cp.dynamics.GaussPrinciple(), 40.0, 1e-13)
BROKEN = row(cp.DenseKKT(), 1.0, 1e-15, statuses={"ok": 19, "singular": 1})
UNTIMED = row(cp.Proximal(mu=1e-9), None, 1e-15)
ROWS = (SLOW, BROKEN, FINE, BEATEN, COARSE, UNTIMED)
MACHINE = {"processor": "p", "pinocchio": "4"}


def table(rows=ROWS, **other) -> Table:
    return Table(tuple(rows), MACHINE, {"s": 3e-14}, **other)


# the front


def test_the_front_is_what_no_row_beats_fastest_first_in_any_order():
    rng = np.random.default_rng(0)
    for order in (range(len(ROWS)), *(rng.permutation(len(ROWS)) for _ in range(20))):
        assert table([ROWS[i] for i in order]).pareto().rows == (COARSE, FINE, SLOW)


def test_the_front_of_random_rows_against_its_definition():
    rng = np.random.default_rng(1)
    rows = [
        row(cp.Proximal(mu=float(i + 1)), *rng.integers(1, 9, 2).astype(float)) for i in range(60)
    ]
    kept = table(rows).pareto().rows
    for one in rows:
        beaten = any(
            (other.median_us <= one.median_us and other.error_worst < one.error_worst)
            or (other.median_us < one.median_us and other.error_worst <= one.error_worst)
            for other in rows
        )
        same = any((k.median_us, k.error_worst) == (one.median_us, one.error_worst) for k in kept)
        assert same != beaten


@pytest.mark.long
def test_scenes_and_measures_have_fronts_of_their_own():
    other = dataclasses.replace(BEATEN, scene="t")
    forces = dataclasses.replace(BEATEN, measure="forces")
    assert table((*ROWS, other, forces)).pareto().rows == (COARSE, FINE, SLOW, other, forces)


@pytest.mark.long
def test_a_solver_that_failed_once_is_on_no_front():
    assert table((BROKEN,)).pareto().rows == ()


# the cheapest


LABEL = "four_bar loops"


def measured(*rows: Row) -> Table:
    return table([dataclasses.replace(r, scene=LABEL) for r in rows]).with_scenes(
        {LABEL: all_scenes()[LABEL]}
    )


def test_cheapest_is_checked_at_fresh_states_and_says_so():
    choice = measured(FINE, SLOW).cheapest(1e-8, states=20)
    assert choice.solver == cp.Proximal(mu=1e-8)
    assert choice.row.solver == FINE.solver
    assert choice.fresh.states == 20
    assert 0 < choice.fresh.error <= choice.fresh.expected <= 1e-8
    assert choice.rejected == ()
    assert "20 fresh states" in str(choice)


@pytest.mark.long
def test_what_only_looked_good_in_the_study_is_rejected():
    lucky = row(cp.Proximal(mu=1.0, max_iterations=1), 1.0, 1e-12)  # it has 1e-1, not 1e-12
    choice = measured(lucky, FINE, SLOW).cheapest(1e-8, states=20)
    assert choice.solver == cp.Proximal(mu=1e-8)
    ((rejected, fresh),) = choice.rejected
    assert rejected.solver == lucky.solver
    assert fresh.error > 1e-8
    assert f"not {lucky.short}" in str(choice)


def test_when_fresh_states_reject_everything_the_error_says_what_was_found_there():
    lucky = row(cp.Proximal(mu=1.0, max_iterations=1), 1.0, 1e-12)
    with pytest.raises(
        cp.errors.NotReached, match=r"at fresh states too; the best there is Proximal"
    ):
        measured(lucky).cheapest(1e-8, states=20)


def test_a_table_is_printed_as_one():
    found = table(ROWS)
    assert str(found) == found.to_markdown()
    assert len(found) == len(ROWS)
    with pytest.raises(cp.InvalidArgument, match="a Table is needed"):
        found.compare(None)


@each_row(("rows", "error", "said", "best"), [
        ((BROKEN,), 1.0, "no solver answers every state", None),
        (
            (SLOW, row(cp.Proximal(), None, 2e-15)), 1e-15,
            r"1e-15 on 's'; the best is Proximal\(\) with 2", repr(cp.Proximal()),
        ),
        (
            (row(cp.Proximal(mu=1e-8), None, 1e-12),), 1e-8,
            r"meets acceleration to 1e-08 .* but has no time", repr(cp.Proximal(mu=1e-8)),
        ),
    ])  # fmt: skip
def test_when_nothing_meets_the_error_the_best_is_named(rows, error, said, best):
    with pytest.raises(cp.errors.NotReached, match=said) as caught:
        table(rows).cheapest(error)
    assert (caught.value.row and caught.value.row.solver) == best
    assert pickle.loads(pickle.dumps(caught.value)).row == caught.value.row


@pytest.mark.long
def test_a_solver_that_fails_at_a_fresh_state_is_rejected():
    dense = row(cp.DenseKKT(), 1.0, 1e-12)  # singular on the four-bar
    choice = measured(dense, FINE).cheapest(1e-8, states=20)
    assert math.isinf(choice.rejected[0][1].error)
    assert choice.solver == cp.Proximal(mu=1e-8)


@pytest.mark.long
def test_fresh_states_are_the_same_for_one_seed_and_others_for_another():
    sets = [20, 20, SampledStates(20, seed=1)]
    found = [measured(FINE).cheapest(1e-8, states=each).fresh for each in sets]
    assert found[0] == found[1] != found[2]


@each_row("count", [20, 21, 200])
def test_the_states_of_the_study_are_not_fresh(count):
    """Two sets of one seed begin with the same states."""
    text = f"{count} sampled under all loads, seed 0 are not fresh, the study looked at 20 sampled"
    with pytest.raises(cp.InvalidArgument, match=text):
        measured(FINE).cheapest(1e-8, states=SampledStates(count, seed=0))


@pytest.mark.long
def test_states_are_sampled_under_every_load():
    scene = all_scenes()["four_bar loops"]
    states = SampledStates(8).of(scene)
    alone = [SampledStates(8, loads=load).of(scene) for load in LOADS]
    for i, (q, v, tau) in enumerate(states):
        assert all(map(np.array_equal, (q, v, tau), alone[i % 4][i]))
        assert (np.abs(v).max() > 0) == (i % 4 < 2)
        assert (np.abs(tau).max() > 0) == (i % 4 in (0, 2))
    q, v, tau = states[2]
    assert np.abs(cp.solve(scene, q, v, tau).a).max() < 1e-10  # the crank's motor carries it


@pytest.mark.long
def test_without_motors_nothing_is_compensated():
    sleigh = cp.load_robot("sleigh")
    scene = cp.Scene(sleigh, sleigh.contacts)
    assert not any(np.abs(tau).max() for _, _, tau in SampledStates(4).of(scene))


@each_row(("loads", "text"), [("none", "load"), ([], "loads"), (["rest", 3], "load")])
def test_loads_that_are_none(loads, text):
    with pytest.raises((cp.InvalidArgument, cp.errors.UnknownName), match=text):
        SampledStates(3, loads=loads)


def test_what_random_torques_hide_is_not_chosen():
    """A damped answer is a thousand times less accurate where Talos carries its weight."""
    damped, good = cp.DenseKKT(mu=1e-7), cp.Proximal()
    scene = all_scenes()["talos contacts"]
    errors = {
        load: FreshErrors(scene, cp.study.AccelerationMeasure(), SampledStates(20, 5, loads=load))(
            damped
        )
        for load in LOADS
    }
    assert errors["random"].error < 1e-7 < 1e-5 < errors["compensated"].error
    table = cp.Study({"talos": scene}, [damped, good]).run(timed=False)
    us = {damped: 1.0, good: 2.0}
    rows = tuple(dataclasses.replace(row, median_us=us[solver_of(row)]) for row in table.rows)
    assert dataclasses.replace(table, rows=rows).cheapest(1e-6).solver.mu == good.mu
    assert table.rows[0].error_worst > 1e-5


@pytest.mark.long
@each_row(
    ("other", "shared"),
    [
        ({"count": 3}, True),
        ({"loads": "random"}, True),
        ({"seed": 1}, False),
        ({"spread": 0.3}, False),
        ({"speed": 0.5}, False),
    ],
)
def test_sets_overlap_if_they_have_states_in_common(other, shared):
    scene, some = all_scenes()["four_bar loops"], SampledStates(5)
    others = dataclasses.replace(some, **other)
    assert some.overlaps(others.name) == others.overlaps(some.name) == shared
    firsts = [np.concatenate(states.of(scene)[0]) for states in (some, others)]
    assert np.array_equal(*firsts) == shared
    assert not some.overlaps(NominalStates().name)


@each_row(
    ("asked", "arguments", "said"),
    [
        (measured(FINE), {"error": 0.0}, "error = 0.0"),
        (measured(FINE), {"error": math.nan}, "error = nan"),
        (measured(FINE), {"states": 3}, "states = 3"),
        (measured(FINE), {"states": NominalStates()}, "2, and at least 20 are needed"),
        (measured(FINE), {"measure": "force"}, "acceleration"),
        (measured(FINE), {"scene": "cassie"}, LABEL),
        (table(), {}, "with_scenes"),
        (table((FINE, dataclasses.replace(FINE, scene="t"))), {}, "name one"),
    ],
)
def test_questions_without_an_answer(asked, arguments, said):
    with pytest.raises(cp.CondynError, match=said):
        asked.cheapest(**arguments)


@pytest.mark.long
@each_row(
    "solver",
    [
        cp.Proximal(),
        cp.LCABA(mu=1e-5),
        cp.dynamics.NullSpace(),
        cp.DenseKKT(mu=1e-11),
        cp.dynamics.Soft(),
    ],
)
def test_a_row_gives_its_solver_back(solver):
    assert solver_of(row(solver, 1.0, 1e-9)) == solver


def test_a_row_whose_knobs_do_not_make_its_solver_is_refused():
    with pytest.raises(cp.InvalidArgument, match="run the study again"):
        solver_of(dataclasses.replace(FINE, solver="Proximal(mu=1)"))
    with pytest.raises(cp.errors.UnknownName, match="Proximal"):
        solver_of(dataclasses.replace(FINE, solver="Proximale(mu=1)"))


def test_a_label_gives_its_measure_back():
    from condyn_pin.study import MEASURES

    changed = MEASURES["derivatives"](method="differences")
    for measure in (*(kind() for kind in MEASURES.values()), changed):
        assert measure_of(measure.label) == measure
    for label in ("nothing", "forces(", "forces(x=1)", "forces.a", "__import__('os')"):
        with pytest.raises(cp.errors.UnknownName, match="no measure named"):
            measure_of(label)


def test_a_measure_that_a_row_cannot_make_again_is_refused():
    with pytest.raises(cp.InvalidArgument, match="dt"):
        measured(dataclasses.replace(FINE, how={"dt": 1e-3})).cheapest(1e-8, states=20)
    assert dataclasses.replace(FINE, how={"dt": 1e-3}).short == "Proximal(mu=1e-08), dt=0.001"


@pytest.mark.long
def test_the_tail_is_continued_as_it_is():
    # a power: the k-th largest of n is (n / k)^(1/2); a hundred times as many give ten times more,
    # and ten errors leave two thirds of the exponent open
    errors = [math.sqrt(1000 / k) for k in range(1, 1001)]
    fresh = Fresh.of(errors)
    assert fresh.error == math.sqrt(1000)
    assert fresh.expected == pytest.approx(math.sqrt(1000) * 10 ** (1 + 2 / math.sqrt(10)))
    assert Fresh.of([1.0, math.nan] + [1.0] * 30).expected == math.inf
    assert Fresh.of([0.0] * 30) == Fresh(30, 0.0, 0.0)
    assert Fresh.of([1e-3] + [0.0] * 199).expected > 1.0  # the rest of the tail cannot be seen
    assert Fresh.of([1e-16] * 3 + [0.0] * 197).expected == 1e-16  # rounding


@pytest.mark.long
def test_a_tail_that_ten_errors_underrate_is_not_taken_for_short():
    """As of an early stop where a quarter of the states are at rest: 1.6 times the worst of 200."""
    errors = [7e-7, *[6.5e-7] * 8, 5.83e-7, *[1e-7] * 190]
    assert Fresh.of(errors).expected > 1.11e-6


# files


def test_json_comes_back_equal(tmp_path):
    rows = (
        *ROWS,
        row(cp.dynamics.Reference(), None, math.inf, statuses={"refused": 20}, note="why"),
    )
    table(rows).to_json(tmp_path / "t.json")
    text = (tmp_path / "t.json").read_text()
    assert "Infinity" not in text
    assert "NaN" not in text
    names = frozenset(field.name for field in dataclasses.fields(Row))
    assert {frozenset(saved) for saved in json.loads(text)["rows"]} == {names}
    assert Table.from_json(tmp_path / "t.json") == table(rows)
    scenes = {"s": all_scenes()[LABEL]}
    assert Table.from_json(tmp_path / "t.json", scenes).scenes == scenes


@each_row(
    "text",
    [None, "half", "", "[]", "{}", '{"format": 0}', '{"format": 1, "rows": [{}], "machine": {}}'],
)
def test_a_file_that_is_no_table_is_refused(tmp_path, text):
    path = tmp_path / "t.json"
    if text == "half":
        table().to_json(path)
        text = path.read_text()[: path.stat().st_size // 2]
    if text is not None:
        path.write_text(text)
    with pytest.raises(cp.InvalidArgument, match=r"t\.json: not a table .*; measure it again"):
        Table.from_json(path)


@pytest.mark.long
def test_csv_has_the_machine_and_every_row(tmp_path):
    table().to_csv(tmp_path / "t.csv")
    lines = (tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == "# processor: p"
    read = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(read) == len(ROWS)
    assert float(read[0]["median_us"]) == SLOW.median_us
    assert read[1]["statuses"] == "19 ok, 1 singular"
    assert read[5]["median_us"] == ""


@pytest.mark.long
def test_markdown_has_a_line_a_row_and_shows_failures():
    lines = table().to_markdown().splitlines()
    assert len(lines) == 2 + len(ROWS)
    assert len({line.count("|") for line in lines}) == 1
    assert "| 19 ok, 1 singular |" in lines[3]
    assert "Proximal(mu=0.01, max_iterations=1)" in lines[6]


# comparisons


def changed(one: Row, *, slower: float = 1.0, **values) -> Table:
    """The table on a slower machine, with one row changed."""
    rows = [dataclasses.replace(r, **values) if r is one else r for r in ROWS]
    return table(
        dataclasses.replace(r, median_us=slower * r.median_us, p95_us=slower * r.p95_us)
        if r.median_us
        else r
        for r in rows
    )


SLOWER = {"median_us": 1.5 * FINE.median_us, "p95_us": 1.5 * FINE.p95_us}


@pytest.mark.long
@each_row(
    ("new", "old", "common"),
    [
        (table(), table(), 1.0),
        (changed(FINE, slower=2.0), table(), 2.0),  # the machine, and no row
        (changed(SLOW, error_worst=9e-14), table(), 1.0),  # rounding
        (  # within the spread
            changed(FINE, median_us=1.5 * FINE.median_us),
            changed(FINE, p95_us=2 * FINE.median_us),
            1.0,
        ),
    ],
)
def test_what_is_no_worse(new, old, common):
    found = new.compare(old)
    assert found.ok
    assert found.common == common
    assert len(found.changes) == len(ROWS)
    assert f"0 worse, 0 missing, 0 new; all together take {common:.2f} of the time" in str(found)


@each_row(
    ("change", "said"),
    [
        ({"slower": 2.0} | SLOWER, "1.50 times slower"),
        ({"error_worst": 3e-9}, "3 times that of before"),
        ({"error_worst": math.inf}, "inf times"),
        ({"statuses": {"ok": 19, "not_finite": 1}}, "not_finite"),
        ({"statuses": {"ok": 10, "inaccurate": 10}}, "fewer say ok"),
    ],
)
def test_what_became_worse_is_named(change, said):
    found = changed(FINE, **change).compare(table())
    (worse,) = found.worse
    assert worse.new.solver == FINE.solver
    assert said in str(worse)
    assert said in str(found)
    assert not found.ok
    assert table().compare(changed(FINE, **change)).ok  # the other way round it became better


def test_missing_and_new_rows_and_other_machines_are_named():
    other = Table(ROWS[1:], MACHINE | {"pinocchio": "5", "date": "now"})
    found = other.compare(table(ROWS[:-1]))
    assert found.missing == (SLOW,)
    assert found.added == (UNTIMED,)
    assert found.machines == ("pinocchio: 5, before 4",)
    assert not found.ok
    assert "missing: s, NullSpace()" in str(found)


# pictures


def drawn(t: Table, **which):
    import matplotlib

    matplotlib.use("agg")
    ax = t.plot(**which)
    return ax, {line.get_label(): line for line in ax.get_lines()}


@pytest.mark.long
def test_the_picture_has_a_line_a_method_the_front_and_both_floors():
    ax, lines = drawn(table())
    assert list(lines["Pareto front"].get_xdata()) == [2.0, 3.0, 30.0]
    assert list(lines["Pareto front"].get_ydata()) == [1e-3, 1e-9, 1e-14]
    assert list(lines["Proximal"].get_xdata()) == [2.0, 3.0]
    assert lines["rounding"].get_ydata()[0] == np.finfo(float).eps
    assert lines["error of Reference"].get_ydata()[0] == 3e-14
    assert "Dense KKT: singular" in lines
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert table().plot(ax=ax) is ax


@pytest.mark.long
def test_no_two_methods_look_the_same_and_none_by_colour_alone():
    from condyn_pin.study.plots import style

    looks = [style(name) for name in cp.dynamics.SOLVERS]
    assert len({look["marker"] for look in looks}) == len(looks)


def test_a_picture_of_several_scenes_wants_one_named_or_draws_them_all(tmp_path):
    from condyn_pin.study.plots import save_trade

    both = table((*ROWS, dataclasses.replace(FINE, scene="t")))
    with pytest.raises(cp.InvalidArgument, match="name one"):
        drawn(both)
    assert drawn(both, scene="t")[0].get_title() == "t: 3 rows"
    with pytest.raises(cp.InvalidArgument, match="nothing to draw"):
        drawn(table(()))
    save_trade(both, tmp_path / "t.png")
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")


# on the command line


def test_condyn_trade_prints_the_front_chooses_and_writes_everything(tmp_path):
    files = {name: str(tmp_path / f"t.{name}") for name in ("csv", "json", "markdown")}
    words = [word for name, path in files.items() for word in (f"--{name}", path)]
    result = condyn(
        "trade", "four_bar", "--quick", "--solvers", "nullspace", "--error", "1e-8", *words
    )
    assert result.exit_code == 0, result.output
    for said in ("four_bar loops, acceleration: ", "NullSpace()", "200 fresh states"):
        assert said in result.output
    read = Table.from_json(files["json"])
    assert {r.scene for r in read.rows} == {LABEL}
    assert (tmp_path / "t.markdown").read_text() == read.to_markdown() + "\n"
    assert (tmp_path / "t.csv").read_text().startswith("# processor")


def test_condyn_trade_fails_where_nothing_is_good_enough():
    result = condyn("trade", "four_bar", "--quick", "--solvers", "densekkt", "--error", "1e-20")
    assert result.exit_code == 1
    assert "DenseKKT(): 20 singular" in result.output
    assert "nothing in this table meets acceleration to 1e-20" in result.output


@pytest.mark.long
def test_condyn_trade_takes_other_measures():
    words = ("--quick", "--solvers", "nullspace", "--states", "3")
    result = condyn("trade", "four_bar", "--measure", "forces", *words)
    assert result.exit_code == 0, result.output
    assert "four_bar loops, forces: " in result.output
    wrong = condyn("trade", "four_bar", "--measure", "force", *words)
    assert isinstance(wrong.exception, cp.errors.UnknownName)
    assert "forces" in str(wrong.exception)


def test_ctrl_c_keeps_what_was_measured(tmp_path, monkeypatch):
    @contextmanager
    def stopping():
        def progress(what: str, done: int, total: int) -> None:
            if "times" in what:
                raise KeyboardInterrupt

        yield progress

    monkeypatch.setattr("condyn_pin.cli.output.progress_bar", stopping)
    path = tmp_path / "t.json"
    words = ("--quick", "--solvers", "nullspace", "--states", "3", "--json", str(path))
    result = condyn("trade", "four_bar", *words)
    assert result.exit_code == 130
    assert "rows were measured" in result.output
    rows = Table.from_json(path).rows
    assert rows
    assert all(r.median_us is None and math.isfinite(r.error_worst) for r in rows)


@pytest.mark.long
def test_what_cannot_be_is_refused_before_the_run(tmp_path):
    for option in ("--csv", "--json", "--markdown", "--plot"):
        result = condyn("trade", "four_bar", option, str(tmp_path / "no" / "t.png"))
        assert isinstance(result.exception, cp.InvalidArgument), option
        assert "make it first" in str(result.exception)
    result = condyn("trade", "four_bar", "--error", "0")
    assert isinstance(result.exception, cp.InvalidArgument)
    assert result.output == ""


@pytest.mark.long
def test_the_bar_knows_how_much_time_is_left(monkeypatch):
    from condyn_pin.cli import output

    screen, now = StringIO(), [0.0]
    console = Console(file=screen, force_terminal=True, width=80, get_time=lambda: now[0])
    monkeypatch.setattr(output, "_Screen", lambda **_: console)
    monkeypatch.setattr(output, "monotonic", lambda: now[0])
    with output.progress_bar() as progress:
        for done in range(3):
            now[0] += 10.0  # [s] a step
            progress("some: times", done, 4)
    drawn = screen.getvalue()
    assert "some: times" in drawn
    assert "0:00:20" in drawn  # two steps are left
