"""Balance along a motion: closed forms, contacts that slide, diagrams, and marks in view."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import matplotlib as mpl
import numpy as np
import pytest
from viewed import drawing, parts

import condyn_pin as cp
from condyn_pin import constraints as c
from condyn_pin.control import balance
from condyn_pin.simulation import motion_balance
from condyn_pin.viewing import plots

mpl.use("Agg")

G, X, Y, HEIGHT = 9.81, 0.1, 0.06, 0.04  # half the size of a box [m]


@cache
def sliding() -> cp.Trajectory:
    """A box that is pushed along the floor at v = 0.3 m/s, and slows down by mu g."""
    scene = scene_of_box()
    q, v = scene.state()
    v[0] = 0.3
    return cp.simulate(scene, q, v, duration=0.02, dt=1e-3)


@cache
def scene_of_box() -> cp.Scene:
    box = cp.model.free_box(size=(2 * X, 2 * Y, 2 * HEIGHT))
    return cp.Scene(
        box, contacts=[c.FrictionalContact("box", c.Box(X, Y, HEIGHT), on=c.Plane(), friction=0.5)]
    )


def test_a_box_that_slides_presses_ahead_of_its_centre():
    """mu h ahead, by the motion and by the forces alike."""
    run = sliding()
    found = motion_balance(run)
    x = run.q[1:, 0]
    solved = 1e-7  # [m]; forces of a step are right to 1e-8
    assert found.zmp[1:, 0] == pytest.approx(x + 0.5 * HEIGHT, abs=solved)
    assert found.cop[1:] == pytest.approx(found.zmp[1:], abs=solved)
    assert found.zmp_margin[1:] == pytest.approx(np.full(len(x), Y), abs=solved)
    assert found.cop_margin[1:] == pytest.approx(found.zmp_margin[1:], abs=solved)
    reach = run.v[1:, 0] * np.sqrt(HEIGHT / G)
    assert found.capture_point[1:, 0] == pytest.approx(x + reach, abs=1e-9)
    assert found.dcm[1:, 2] == pytest.approx(run.q[1:, 2], abs=1e-9)
    assert found.com == pytest.approx(run.q[:, :3], abs=1e-12)
    assert all(len(polygon.corners) == 4 for polygon in found.polygons[1:])


def test_in_flight_there_is_the_centre_of_mass_alone():
    scene = scene_of_box()
    q, v = scene.state()
    q[2] += 0.1
    falling = cp.simulate(scene, q, v, duration=0.01, dt=1e-3)
    found = motion_balance(falling)
    assert set(found.polygons) == {None}
    for nothing in (found.zmp, found.cop, found.dcm, found.capture_point, found.zmp_margin):
        assert np.isnan(nothing).all()
    assert found.com == pytest.approx(falling.q[:, :3])
    free = cp.model.free_box()
    flight = cp.simulate(cp.Scene(free), *cp.Scene(free).state(), duration=0.01, dt=1e-3)
    with pytest.raises(cp.InvalidArgument, match="no contact"):
        motion_balance(flight)


@cache
def held() -> cp.Trajectory:
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    return cp.simulate(scene, *scene.state(), duration=0.02, dt=2e-3)


@pytest.mark.long
def test_contacts_that_are_held_give_the_balance_of_each_sample():
    run = held()
    found = motion_balance(run)
    for k in (0, 7):
        one = balance(run.scene, run.q[k], run.v[k], run.a[k], run.lam[k])
        assert np.array_equal(found.zmp[k], one.zmp)
        assert np.array_equal(found.cop[k], one.cop)
        assert found.capture_margin[k] == one.capture_margin
    assert "solo12" in repr(found)


@pytest.mark.long
def test_a_corner_that_touches_without_a_force_is_an_edge_of_the_support():
    """Which corners of a face carry it is not determined; the face is the support."""
    run = sliding()
    resting = replace(run, contact=_only_one(run.contact))
    assert sum(mode[-1] != "open" for mode in resting.modes.values()) == 1
    assert all(len(polygon.corners) == 4 for polygon in motion_balance(resting).polygons[1:])
    q = run.q.copy()
    q[:, 2] += 1e-3  # [m]: corners that are this high carry nothing, whatever modes say
    lifted = motion_balance(replace(resting, q=q))
    assert all(len(polygon.corners) == 1 for polygon in lifted.polygons[1:])


def _only_one(record):
    """Return a record in which only the second corner touches."""
    columns, modes = record.columns.copy(), -len(record.names)
    columns[:, modes:] = 0.0
    columns[1:, modes + 1] = 2.0
    return replace(record, columns=columns)


def test_margins_and_corners_are_said():
    found = motion_balance(sliding())
    assert f"CoP {np.nanmin(found.cop_margin):.4g} m" in repr(found)
    assert f"capture point {np.nanmin(found.capture_margin):.4g} m" in repr(found)
    assert repr(found.polygons[-1]).startswith("SupportPolygon((")


def test_axes_that_share_x_have_one_title_and_one_word_for_it():
    from matplotlib.figure import Figure

    from condyn_pin.viewing import plots

    run, axes = sliding(), Figure().subplots(3, sharex=True)
    plots = (plots.normal_forces, plots.gaps, plots.modes)
    for draw, ax in zip(plots, axes, strict=True):
        draw(run, ax=ax)
    assert [bool(ax.get_title()) for ax in axes] == [True, False, False]
    assert [ax.get_xlabel() for ax in axes] == ["", "", "t [s]"]


@pytest.mark.long
def test_diagrams_show_what_was_found():
    from matplotlib.figure import Figure

    run, found = sliding(), motion_balance(sliding())
    above, over_time = Figure().subplots(1, 2)
    assert plots.from_above(run, above) is above
    ways = {drawn.get_label(): drawn.get_xydata() for drawn in above.lines}
    assert np.array_equal(ways["ZMP"], found.zmp[:, :2], equal_nan=True)
    assert np.array_equal(ways["capture point"], found.capture_point[:, :2], equal_nan=True)
    assert above.get_aspect() == 1.0
    assert len(above.patches) > 3  # the support moves with the box
    plots.margins(run, over_time, found=found)
    drawn = {each.get_label(): each.get_ydata() for each in over_time.lines}
    assert np.array_equal(drawn["CoP"], found.cop_margin, equal_nan=True)
    assert "[m]" in over_time.get_ylabel()


@pytest.mark.parametrize("draw", [plots.from_above, plots.margins])
@pytest.mark.parametrize("ax", [3, "upper", np.zeros(2)])
def test_what_is_no_axes_is_named(draw, ax):
    with pytest.raises(cp.InvalidArgument, match=r"ax = .*: axes of matplotlib are needed"):
        draw(sliding(), ax)


@pytest.mark.parametrize("draw", [plots.from_above, plots.margins])
def test_the_balance_of_another_motion_is_not_drawn(draw):
    run, found = sliding(), motion_balance(sliding())
    for other in (replace(found, t=found.t[:-1]), 3):
        with pytest.raises(cp.InvalidArgument, match=r"found = .*not of this motion"):
            draw(run, found=other)
    with pytest.raises(cp.InvalidArgument, match=r"trajectory = 'run\.npz'"):
        draw("run.npz")


@pytest.mark.long
def test_view_draws_support_pressure_and_capture_of_a_motion():
    found, run = parts(sliding(), balance=True), sliding()
    assert {f"balance/support/{i}" for i in range(4)} < found.keys()
    instant = drawing(run, balance=True).instants[-1]
    last = motion_balance(run)
    at = {name: found[f"balance/{name}/point"].place(instant)[:3, 3] for name in _MARKED}
    assert at["cop"] == pytest.approx(last.cop[-1])
    assert at["capture_point"] == pytest.approx(last.capture_point[-1])
    assert at["dcm"] == pytest.approx(last.dcm[-1])
    edge = found["balance/support/0"].place(instant)
    corners = last.polygons[-1].in_world
    assert edge[:3, 3] == pytest.approx(corners[0])
    assert edge[:3, 3] + edge[:3, 2] == pytest.approx(corners[1])
    assert not [path for path in parts(run) if path.startswith("balance")]


_MARKED = ("cop", "capture_point", "dcm")


@pytest.mark.long
@pytest.mark.parametrize("name", ["balance", "forces", "light", "cones"])
def test_what_is_drawn_is_chosen_by_true_or_false(name):
    with pytest.raises(cp.InvalidArgument, match=f"{name} = 3: True or False is needed"):
        drawing(sliding(), **{name: 3})
    assert drawing(sliding(), **{name: np.True_}).parts


def test_what_has_no_velocity_has_no_balance_to_be_drawn():
    with pytest.raises(cp.InvalidArgument, match="a Scene does not know v"):
        drawing(scene_of_box(), balance=True)


def test_a_linkage_without_contacts_says_why_it_has_no_marks():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    run = cp.simulate(scene, *scene.state(), duration=0.01)
    notes = drawing(run, balance=True).notes
    assert any(note.startswith("no balance: no contacts press on one plane") for note in notes)
    assert not any("no balance" in note for note in drawing(sliding(), balance=True).notes)
