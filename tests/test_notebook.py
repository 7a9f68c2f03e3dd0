"""Values as a notebook shows them: whole, escaped, without anything from outside."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from types import ModuleType

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._core import show

pytestmark = pytest.mark.once

EMPTY = {"br", "hr", "polyline"}


class Page(HTMLParser):
    """What is in a page, and whether each element that begins also ends."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.links: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "onload")]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def cassie_standing():
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    q, v = scene.state("standing")
    return scene, q, v, cassie.passive_torque(q, v)


def falling():
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    return cp.simulate(scene, *scene.state(), duration=0.05)


def swinging():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    cut = cp.Event(name="cut", at=0.02, scene=cp.Scene(bar))
    return cp.simulate(scene, *scene.state(), duration=0.05, events=[cut])


def solved(**more):
    return cp.solve(*cassie_standing(), **more)


def many():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = (np.tile(x, (3, 1)) for x in scene.state())
    return cp.simulate_batch(scene, q, v, np.zeros((3, 3)), duration=0.01, dt=1e-3)


def table():
    return cp.Study("four_bar", [cp.Proximal(), cp.dynamics.NullSpace()]).run()


MADE = {
    "Robot": (lambda: cp.load_robot("cassie"), ("32.94", "left-knee-op", "4 loops", "motor")),
    "Scene": (lambda: cassie_standing()[0], ("Loop (ball)", "4, with 12 rows", "summary()")),
    "Scene of contacts": (lambda: falling().scene, ("FL_FOOT", "FrictionalContact")),
    "Summary": (lambda: cassie_standing()[0].summary(), ("rank 10", "left-plantar-foot-joint.z")),
    "Solution": (solved, ("cassie: ok", "error bound of a", "left-plantar-foot-joint", "fz")),
    "singular Solution": (
        lambda: solved(solver=cp.DenseKKT(), throw=False),
        ("cassie: singular", "the matrix of this method is singular", "nan"),
    ),
    "Table": (table, ("four_bar loops", "Proximal", "median [us]", "measured on")),
    "Trajectory": (swinging, ("four_bar: finished", "energy", "cut", "RungeKutta4")),
    "BatchTrajectory": (many, ("four_bar, 3 motions: 3 finished", "violation", "unexplained")),
    "Trajectory of contacts": (falling, ("solo12: finished", "StewartTrinkle")),
}


@pytest.mark.parametrize("what", MADE)
def test_a_value_is_shown(what):
    make, said = MADE[what]
    html = make()._repr_html_()
    page = Page(html)
    assert not page.open
    assert [text for text in said if text not in page.text] == []
    assert page.tags <= {
        "div", "span", "table", "thead", "tbody", "tr", "th", "td", "details", "summary", "svg",
        "polyline",
    }  # fmt: skip
    assert page.links == []
    assert "url(" not in html
    assert "#000" not in html.replace("#009e73", "")  # no colour that a dark page would hide
    assert "#fff" not in html.lower()


EVIL = '<img src=x onerror="alert(1)">&amp;\'"</td>'


def test_names_from_files_are_escaped():
    bar = cp.model.four_bar()
    (loop,) = bar.loops
    robot = replace(
        bar, name=EVIL, source=EVIL, licence=EVIL, unused=[EVIL], loops=[replace(loop, name=EVIL)],
        postures={EVIL: np.array(next(iter(bar.postures.values())))},
    )  # fmt: skip
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.state()
    values = [
        robot,
        scene,
        scene.summary(),
        cp.solve(scene, q, v, np.zeros(3)),
        cp.simulate(scene, q, v, duration=0.002),
        replace(table(), machine={EVIL: EVIL}),
    ]
    for value in values:
        page = Page(value._repr_html_())
        assert "img" not in page.tags
        assert EVIL in page.text
        assert not page.open


@pytest.mark.long
def test_a_run_that_failed_says_why():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.sample(np.random.default_rng(0), speed=2e4)
    run = cp.simulate(scene, q, v, duration=1.0, dt=0.01, integrator=cp.SemiImplicitEuler())
    assert not run.status.ok
    assert run.reason in Page(run._repr_html_()).text


@dataclass
class Frame:
    """What of a data frame is needed."""

    rows: list
    columns: list
    attrs: dict = field(default_factory=dict)


def test_a_table_becomes_a_data_frame(monkeypatch):
    pandas = ModuleType("pandas")
    pandas.DataFrame = Frame
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    measured = table()
    frame = measured.to_pandas()
    assert [row["solver"] for row in frame.rows] == [row.solver for row in measured.rows]
    assert "error_worst" in frame.columns
    assert frame.attrs["machine"] == measured.machine


@pytest.mark.long
def test_pandas_has_the_numbers():
    if "CI" not in os.environ:
        pytest.importorskip("pandas")
    measured = table()
    frame = measured.to_pandas()
    assert len(frame) == len(measured)
    assert frame["median_us"].tolist() == [row.median_us for row in measured.rows]
    assert frame.sort_values("error_worst").iloc[0]["error_worst"] == min(
        row.error_worst for row in measured.rows
    )


@pytest.mark.long
def test_a_motion_is_a_data_frame_with_its_joints_by_name():
    if "CI" not in os.environ:
        pytest.importorskip("pandas")
    run = swinging()
    frame = run.to_pandas()
    joint = run.scene.robot.model.names[2]
    assert frame.index.name == "t [s]"
    assert frame.index.tolist() == run.t.tolist()
    assert frame[f"v {joint}"].tolist() == run.v[:, 1].tolist()
    assert frame["kinetic [J]"].tolist() == run.energy.kinetic.tolist()
    fall = falling()
    assert fall.to_pandas()["q root_joint[2]"].tolist() == fall.q[:, 2].tolist()
    assert fall.to_pandas()["tau root_joint[5]"].tolist() == fall.tau[:, 5].tolist()


@pytest.mark.long
def test_a_batch_is_a_data_frame_with_a_motion_a_row():
    if "CI" not in os.environ:
        pytest.importorskip("pandas")
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    batch = cp.simulate_batch(scene, [q, q], [v, 1e200 + v], duration=0.01)
    frame = batch.to_pandas()
    assert frame["status"].tolist() == ["finished", "failed"]
    assert frame["reason"].tolist() == batch.reasons.tolist()
    assert frame["q crank"].tolist() == batch.q[:, bar.index_q("crank")].tolist()
    assert frame["energy_error"][0] == batch.energy_error[0]


def test_answers_are_data_frames_with_a_state_a_row():
    if "CI" not in os.environ:
        pandas = pytest.importorskip("pandas")
    else:
        import pandas
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    batch = cp.solve_batch(scene, [q, q], [v, 1e200 + v], np.zeros((2, 3)))
    frame = batch.to_pandas()
    assert frame["status"].tolist() == batch.status_names
    assert frame["a crank"].tolist()[0] == batch.a[0, bar.index_v("crank")]
    assert frame["q crank"].tolist() == batch.q[:, bar.index_q("crank")].tolist()
    assert frame[f"lam {scene.row_names[1]}"].tolist()[0] == batch.lam[0, 1]
    assert frame["error_bound"].tolist()[0] == batch.error_bound[0]
    assert frame["iterations"].tolist() == batch.iterations.tolist()
    ones = pandas.concat([batch[0].to_pandas(), cp.solve(scene, q, v, np.ones(3)).to_pandas()])
    assert ones["status"].tolist() == ["ok", "ok"]
    assert ones["a crank"].tolist()[0] == batch.a[0, 0]
    assert set(ones) ^ set(frame) == {"solve_time", "solve_times"}
    alone = cp.Scene(bar)
    assert cp.solve(alone, q, v, np.zeros(3)).to_pandas()["q crank"].tolist() == [q[0]]


def test_steps_are_a_data_frame_with_their_modes():
    if "CI" not in os.environ:
        pytest.importorskip("pandas")
    fall = falling()
    scene = fall.scene
    batch = cp.stepping.step_batch(scene, fall.q[:3], fall.v[:3], dt=1e-3)
    frame = batch.to_pandas()
    name = scene.contacts[0].name
    assert frame[f"mode {name}"].tolist() == batch.modes[name].tolist()
    assert frame["v root_joint[2]"].tolist() == batch.v[:, 2].tolist()
    assert frame["natural"].tolist() == batch.natural.tolist()


def test_without_pandas_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(cp.errors.MissingExtra, match=r"pip install 'condyn_pin\[pandas\]'"):
        table().to_pandas()
    with pytest.raises(cp.errors.MissingExtra, match=r"pip install 'condyn_pin\[pandas\]'"):
        swinging().to_pandas()


@pytest.mark.long
def test_every_line_of_a_batch_has_a_label_of_its_own():
    """One that fills its column has one space behind it."""
    assert ">unexplained</th>" in many()._repr_html_()


@pytest.mark.long
def test_rounding_is_no_curve():
    t = np.linspace(0, 1, 9)
    assert "polyline" not in show.curve("energy", t, 14.3 + 1e-12 * t, "J")
    assert "polyline" in show.curve("unexplained", t, 1e-12 * t, "J")


@pytest.mark.long
def test_one_thing_is_not_several():
    text = cp.model.four_bar()._repr_html_()
    assert "1 loop<" in text
    assert "3 joints<" in text
    bar = cp.model.four_bar()
    assert "1 redundant row: a is unique" in str(cp.Scene(bar, bar.loops).summary())
