"""Diagrams, by the data that they show."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._core import plot_style
from condyn_pin.viewing import plots_motion, plots_scene

mpl.use("Agg")


@pytest.fixture
def ax():
    from matplotlib.figure import Figure  # of no backend, so that nothing is left open

    return Figure().subplots()


@pytest.fixture(scope="module")
def swinging():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    return cp.simulate(scene, *scene.state(), duration=0.1, dt=0.002)


def lines(ax):
    return {line.get_label(): line.get_ydata() for line in ax.lines}


def test_no_two_lines_are_alike():
    looks = {(style["color"], style["ls"]) for style in map(plot_style.line, range(32))}
    assert len(looks) == 32


def test_violation_is_that_of_the_motion(swinging, ax):
    assert plots_motion.violation(swinging, ax) is ax
    drawn = lines(ax)
    assert np.array_equal(drawn["max |c(q)| [m, rad]"], np.maximum(swinging.violation, 1e-17))
    assert np.array_equal(
        drawn["max |J v| [m/s, rad/s]"], np.maximum(swinging.constraint_velocity, 1e-17)
    )
    assert ax.get_yscale() == "log"
    assert "[s]" in ax.get_xlabel()


def test_energies_add_up(swinging, ax):
    plots_motion.energy(swinging, ax)
    drawn = lines(ax)
    total = drawn["kinetic"] + drawn["potential, from the start"]
    assert np.allclose(total - total[0], drawn["total, from the start"])
    assert np.abs(drawn["unexplained"]).max() < 1e-6 * np.ptp(drawn["kinetic"])
    assert "impacts" not in drawn  # there were none


def test_forces_have_their_size(swinging, ax):
    plots_motion.forces(swinging, ax=ax)
    (name,) = swinging.forces
    norm = np.linalg.norm(swinging.forces[name][:, :3], axis=1)
    assert np.array_equal(lines(ax)[name], norm)
    with pytest.raises(cp.errors.UnknownName, match="nothing"):
        plots_motion.forces(swinging, ["nothing"])


def test_singular_values_dip_at_a_dead_point(ax):
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, _ = scene.state()
    path = np.array([q, scene.assemble(q + 0.05).q])
    plots_scene.singular_values(scene, path, along=[0.0, 1.0], ax=ax)
    drawn = np.array([line.get_ydata() for line in ax.lines])
    assert drawn.shape == (3, 2)  # a row out of the plane of the bars is redundant
    assert np.array_equal(drawn[:, 0], np.maximum(scene.rank(q).singular_values, 1e-17))
    assert drawn[-1].max() < 1e-7 < drawn[1].min()
    with pytest.raises(cp.InvalidArgument, match="no rows"):
        plots_scene.singular_values(cp.Scene(bar), path)
    with pytest.raises(cp.InvalidArgument, match="one number a configuration"):
        plots_scene.singular_values(scene, path, along=[0.0])


def test_sparsity_shows_what_is_not_zero(ax):
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, [cp.SurfaceContact("left_sole_link")])
    q, v = scene.state()
    d = cp.derivatives(scene, q, v, np.zeros(talos.nv))
    plots_scene.sparsity(d, ax)
    (marks,) = (line for line in ax.lines if len(line.get_xdata()) > 2)
    columns, rows = marks.get_xdata(), marks.get_ydata()
    seen = np.zeros((scene.rows + talos.nv, 3 * talos.nv), dtype=bool)
    seen[np.asarray(rows, int), np.asarray(columns, int)] = True
    n, largest = talos.nv, max(np.abs(x).max() for x in (d.da_dq, d.da_dv, d.da_dtau))
    assert np.array_equal(seen[:n, 2 * n :], np.abs(d.da_dtau) > 1e-12 * largest)
    assert not seen[:n, n : 2 * n].any()  # at rest, and without damping, nothing depends on v
    assert seen.any(axis=1).all()
