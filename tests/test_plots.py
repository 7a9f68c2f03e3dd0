"""Diagrams, by the data that they show."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin._core import show
from condyn_pin.viewing import plots

pytestmark = pytest.mark.once

mpl.use("Agg")


@pytest.fixture
def ax():
    from matplotlib.figure import Figure

    return Figure().subplots()


@pytest.fixture(scope="module")
def swinging():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    return cp.simulate(scene, *scene.state(), duration=0.1, dt=0.002)


def lines(ax):
    return {line.get_label(): line.get_ydata() for line in ax.lines}


def test_a_figure_for_a_paper_is_as_wide_as_a_column(swinging, tmp_path):
    path = tmp_path / "energy.pdf"
    with plots.style("paper"):
        ax = plots.energy(swinging)
        ax.figure.savefig(path)
    assert ax.figure.get_figwidth() == pytest.approx(show.COLUMN)
    assert ax.xaxis.label.get_fontsize() == 8.0
    assert path.read_bytes().startswith(b"%PDF")
    with pytest.raises(cp.InvalidArgument, match=r"style = 'poster': one of screen, paper"):
        plots.style("poster").__enter__()


@pytest.mark.long
def test_no_two_lines_are_alike():
    looks = {(style["color"], style["ls"]) for style in map(show.line, range(32))}
    assert len(looks) == 32


@pytest.mark.long
def test_violation_is_that_of_the_motion(swinging, ax):
    assert plots.violation(swinging, ax) is ax
    drawn = lines(ax)
    assert np.array_equal(drawn["max |c(q)| [m, rad]"], np.maximum(swinging.violation, 1e-17))
    assert np.array_equal(
        drawn["max |J v| [m/s, rad/s]"], np.maximum(swinging.constraint_velocity, 1e-17)
    )
    assert ax.get_yscale() == "log"
    assert "[s]" in ax.get_xlabel()


@pytest.mark.long
def test_energies_add_up(swinging, ax):
    plots.energy(swinging, ax)
    drawn = lines(ax)
    total = drawn["kinetic"] + drawn["potential, from the start"]
    assert np.allclose(total - total[0], drawn["total, from the start"])
    assert np.abs(drawn["unexplained"]).max() < 1e-6 * np.ptp(drawn["kinetic"])
    assert "impacts" not in drawn  # there were none


def test_forces_have_their_size(swinging, ax):
    plots.forces(swinging, ax=ax)
    (name,) = swinging.forces
    norm = np.linalg.norm(swinging.forces[name][:, :3], axis=1)
    assert np.array_equal(lines(ax)[name], norm)
    with pytest.raises(cp.errors.UnknownName, match="nothing"):
        plots.forces(swinging, ["nothing"])


@pytest.fixture(scope="module")
def standing():
    solo = cp.load_robot("solo12")
    floor = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    q, v = floor.state()
    return cp.simulate(floor, cp.mechanism.place_on_ground(floor, q), v, duration=0.01, dt=1e-3)


@pytest.mark.long
def test_panels_above_one_another_have_a_legend_once(standing):
    from matplotlib.figure import Figure

    gaps, forces = Figure().subplots(2, sharex=True)
    plots.gaps(standing, ax=gaps)
    plots.normal_forces(standing, ax=forces)
    assert len(gaps.get_legend().get_texts()) == 4
    assert forces.get_legend() is None
    assert plots.normal_forces(standing, ax=Figure().subplots()).get_legend()


@pytest.mark.long
def test_names_of_contacts_are_within_the_picture():
    talos = cp.load_robot("talos")
    floor = cp.Scene(talos, contacts=talos.frictional_contacts(friction=0.7))
    q, v = floor.state()
    run = cp.simulate(floor, cp.mechanism.place_on_ground(floor, q), v, duration=0.002, dt=1e-3)
    ax = plots.modes(run)
    ax.figure.canvas.draw()
    assert min(label.get_window_extent().x0 for label in ax.get_yticklabels()) >= 0.0
    assert ax.get_axisbelow() is True  # no grid over the bars


def test_singular_values_dip_at_a_dead_point(ax):
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, _ = scene.state()
    path = np.array([q, scene.assemble(q + 0.05).q])
    plots.singular_values(scene, path, along=[0.0, 1.0], ax=ax)
    drawn = np.array([line.get_ydata() for line in ax.lines])
    assert drawn.shape == (3, 2)  # a row out of the plane of the bars is redundant
    assert np.array_equal(drawn[:, 0], np.maximum(scene.rank(q).singular_values, 1e-17))
    assert drawn[-1].max() < 1e-7 < drawn[1].min()
    with pytest.raises(cp.InvalidArgument, match="no rows"):
        plots.singular_values(cp.Scene(bar), path)
    with pytest.raises(cp.InvalidArgument, match="one number a configuration"):
        plots.singular_values(scene, path, along=[0.0])


def test_sparsity_shows_what_is_not_zero(ax):
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, [cp.SurfaceContact("left_sole_link")])
    q, v = scene.state()
    d = cp.derivatives(scene, q, v, np.zeros(talos.nv))
    plots.sparsity(d, ax)
    (marks,) = (line for line in ax.lines if len(line.get_xdata()) > 2)
    columns, rows = marks.get_xdata(), marks.get_ydata()
    seen = np.zeros((scene.rows + talos.nv, 3 * talos.nv), dtype=bool)
    seen[np.asarray(rows, int), np.asarray(columns, int)] = True
    n, largest = talos.nv, max(np.abs(x).max() for x in (d.da_dq, d.da_dv, d.da_dtau))
    assert np.array_equal(seen[:n, 2 * n :], np.abs(d.da_dtau) > 1e-12 * largest)
    assert not seen[:n, n : 2 * n].any()  # at rest, and without damping, nothing depends on v
    assert seen.any(axis=1).all()


# Linear RGB as three kinds of colour-blind eyes see it (Machado, Oliveira and Fernandes 2009).
EYES = {
    "all": np.eye(3),
    "no green": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "no red": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "no blue": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def lab(colour: str, eyes: str) -> np.ndarray:
    """A colour in CIELAB, in which distances are what eyes tell apart."""
    x = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(EYES[eyes]) @ linear, 0.0, 1.0)
    to_xyz = [[0.4125, 0.3576, 0.1804], [0.2127, 0.7152, 0.0722], [0.0193, 0.1192, 0.9503]]
    xyz = np.array(to_xyz) @ seen / [0.9505, 1.0, 1.0888]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@each_row("eyes", EYES)
def test_colours_of_methods_are_told_apart_by_all_eyes(eyes):
    from condyn_pin.study.plots import style

    colours = [style(name)["color"] for name in cp.dynamics.SOLVERS]
    assert len(set(colours)) == len(colours) >= 10
    seen = [lab(colour, eyes) for colour in colours]
    apart = [np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]]
    assert min(apart) > 15.0  # 2.3 is what can just be told apart, side by side


def test_a_picture_of_several_scenes_has_one_legend(tmp_path, monkeypatch):
    from condyn_pin.study import plots

    table = cp.Study(["four_bar", "pendulum"], [cp.DenseKKT(), cp.dynamics.NullSpace()]).run()
    drawn = []
    monkeypatch.setattr(plots, "write_figure", lambda figure, path: drawn.append(figure))
    plots.save_trade(table, tmp_path / "t.png")
    (figure,) = drawn
    (legend,) = figure.legends
    assert all(ax.get_legend() is None for ax in figure.axes)
    words = [text.get_text() for text in legend.get_texts()]
    assert len(set(words)) == len(words)
    assert {"Null space", "Pareto front", "limit of status ok"} <= set(words)


@pytest.mark.long
def test_the_overview_counts_what_the_file_says():
    from pathlib import Path

    from matplotlib.figure import Figure

    from lab.extremes.report import Cell, maps_of_csv, overview, read_csv

    path = Path(__file__).parent.parent / "benchmarks" / "results" / "stress_solvers.csv"
    rows = read_csv(path)
    found = [each for each in maps_of_csv(rows, "4.1.0") if each.robot in ("", "cassie")]
    for each in found:
        for cell in each.cells.values():
            assert str(Cell.parse(str(cell))) == str(cell)
    ax = overview(found, Figure().subplots())
    said = iter(text.get_text() for text in ax.texts)
    for each in found:
        for method in each.methods:
            column = [
                row[method]
                for row in rows
                if (row["pinocchio"], row["family"], row["robot"])
                == ("4.1.0", each.family, each.robot)
            ]
            right = sum(text.startswith("ok ") for text in column)
            assert next(said) == f"{right}/{len(column)}"
