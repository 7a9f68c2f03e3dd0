"""Pictures and diagrams of contacts that may open."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from shared import each_row
from viewed import drawing, parts

import condyn_pin as cp
from condyn_pin import constraints as c
from condyn_pin.viewing import part as palette
from condyn_pin.viewing import plots
from condyn_pin.viewing.motion import tracks

mpl.use("Agg")

FLOOR = c.Plane()
HALF = (0.1, 0.06, 0.04)
CORNERS = [f"box/corner {i}" for i in range(1, 9)]
BELOW = CORNERS[1::2]


def box_on(plane=FLOOR, **options):
    """A scene with a box over a plane."""
    box = cp.model.free_box(size=tuple(2 * x for x in HALF))
    shape = c.Box(*HALF)
    return cp.Scene(box, contacts=[c.FrictionalContact("box", shape, on=plane, **options)])


@cache
def sliding():
    """A box that comes to rest on a floor after 41 ms."""
    scene = box_on(friction=0.5)
    q, v = scene.state()
    v[0] = 0.2
    return cp.simulate(scene, q, v, duration=0.06, dt=1e-3)


@cache
def dropped():
    """A box that falls from 5 mm, turned so that it lands on an edge."""
    scene = box_on(friction=0.5)
    q, v = scene.state()
    q[2] += 0.005
    return cp.simulate(scene, q, v, duration=0.05, dt=1e-3)


def tints(part, found):
    return [part.tint(at) for at in found.instants]


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        (c.Ball(0.1), (0.2, 0.2, 0.2)),
        (c.Capsule(0.1, 0.2), (0.2, 0.2, 0.6)),
        (c.Box(0.1, 0.2, 0.3), (0.2, 0.4, 0.6)),
    ],
)
def test_a_shape_has_its_size_and_its_place(shape, size):
    box = cp.model.free_box()
    contact = c.FrictionalContact("box", shape, (0.0, 0.0, 0.5), friction=0.5)
    scene = cp.Scene(box, contacts=[contact])
    found = drawing(scene, scene.state(on_ground=False)[0])
    (part,) = (p for p in found.parts if p.path == "candidates/box/shape 0")
    mesh, _ = part.meshes[0]
    world = mesh.moved(part.place(found.instants[0])).vertices
    assert np.allclose(np.ptp(world, axis=0), size, rtol=0.06)
    assert np.allclose((world.min(axis=0) + world.max(axis=0)) / 2, (0.0, 0.0, 0.6), atol=1e-12)


@pytest.mark.long
def test_a_point_has_no_shape_and_is_seen_where_it_is():
    found = drawing(cp.Scene(cp.model.free_box(), contacts=[
        c.FrictionalContact("box", offset=(0.1, 0.0, -0.1), friction=0.0)
    ]))  # fmt: skip
    mine = {p.path: p for p in found.parts if p.path.startswith("candidates/")}
    assert list(mine) == ["candidates/box/point"]
    place = mine["candidates/box/point"].place(found.instants[0])
    assert np.allclose(place[:3, 3], (0.1, 0.0, 0.0))


@pytest.mark.long
def test_the_lowest_point_of_a_ball_is_on_it_whichever_way_it_turns():
    scene = cp.Scene(cp.model.free_ball(radius=0.1),
                     contacts=[c.FrictionalContact("ball", c.Ball(0.1), friction=0.5)])  # fmt: skip
    q = scene.state()[0]
    q[2:] = 0.3, 0.6, 0.0, 0.8, 0.0
    found = drawing(scene, q)
    (point,) = (p for p in found.parts if p.path.endswith("/point"))
    assert np.allclose(point.place(found.instants[0])[:3, 3], (0.0, 0.0, 0.2))


@pytest.mark.long
def test_a_plane_is_a_square_below_every_point_of_the_motion():
    slope = c.Plane((0.3, 0.0, 1.0), 0.2)
    scene = box_on(slope, friction=0.1)
    q, v = scene.state()
    q[2] += 0.5
    motion = cp.simulate(scene, q, v, duration=0.4, dt=2e-3)
    found = drawing(motion)
    (ground,) = (p for p in found.parts if p.path.startswith("grounds/"))
    corners = ground.meshes[0][0].moved(ground.place(found.instants[0])).vertices
    R, n = slope.placement.rotation, np.array(slope.normal)
    assert np.allclose(corners @ n, corners[0] @ n)
    assert 0.0 < slope.height - corners[0] @ n < 5e-3 * found.size  # no more than cannot be seen
    flat, points = (corners @ R)[:, :2], np.array([
        each.at @ R for at in found.instants for each in at.touching.values()
    ])[:, :2]  # fmt: skip
    assert (flat.min(axis=0) < points.min(axis=0)).all()
    assert (flat.max(axis=0) > points.max(axis=0)).all()
    assert ground.opacity == 1.0  # from above; from below it is not seen
    assert ground.sheet


@pytest.mark.long
def test_a_fall_is_seen_with_its_ground():
    scene = box_on(friction=0.5)
    q = scene.state()[0]
    q[2] += 2.0
    found = drawing(scene, q)
    assert found.size > 2.0
    assert found.middle[2] == pytest.approx(1.0, abs=0.1)


def test_what_touches_between_bodies_is_drawn_on_both():
    two = cp.model.together({"low": cp.model.free_box(), "high": cp.model.free_ball(radius=0.1)})
    on_top = c.FrictionalContact(
        "high/ball", c.Ball(0.1), on="low/box", on_shape=c.Plane(height=0.1), friction=0.5
    )
    floor = c.FrictionalContact("low/box", c.Box(0.1, 0.1, 0.1), friction=0.5)
    scene = cp.Scene(two, contacts=[on_top, floor])
    q, v = scene.state()
    q[two.model.joints[2].idx_q + 2] = 0.3
    step = cp.step(scene, q, v, dt=1e-3)
    found = drawing(step)
    picture = {p.path: p for p in found.parts}
    at = found.instants[0]
    pair = [p for p in picture if p.startswith("forces/high/ball/on") and "label" not in p]
    assert len(pair) == 2
    one, other = (picture[p].place(at)[:3, 2] for p in pair)
    assert np.allclose(one, -other)
    (top,) = (p for p in picture.values() if p.path == "grounds/of high/ball")
    corners = top.meshes[0][0].moved(top.place(at)).vertices
    assert np.allclose(corners[:, 2], 0.2, atol=5e-3 * found.size)


@pytest.mark.long
def test_two_bodies_that_meet_are_both_drawn():
    two = cp.model.together({"low": cp.model.free_box(), "high": cp.model.free_ball(radius=0.1)})
    pair = c.FrictionalContact(
        "high/ball", c.Ball(0.1), on="low/box", on_shape=c.Box(0.1, 0.1, 0.1), friction=0.5
    )
    scene = cp.Scene(two, contacts=[pair])
    q, v = scene.state()
    q[two.model.joints[2].idx_q + 2] = 0.3
    found = drawing(cp.step(scene, q, v, dt=1e-3))
    picture = {p.path: p for p in found.parts}
    at = found.instants[0]
    heights = [picture[f"touching/high/ball/shape {i}"].place(at)[2, 3] for i in (0, 1)]
    assert heights[0] - heights[1] == pytest.approx(0.2, abs=1e-3)
    assert not [path for path in picture if path.startswith("grounds/")]


# Modes


def test_colours_tell_open_stick_and_slide_apart():
    found = drawing(sliding())
    picture = {p.path: p for p in found.parts}
    colours = tints(picture[f"touching/{BELOW[0]}/point"], found)
    assert colours[0] == palette.SLIDES
    assert colours[-1] == palette.STICKS
    assert tints(picture["touching/box/shape 0"], found) == colours
    assert set(tints(picture[f"touching/{CORNERS[0]}/point"], found)) == {palette.AWAY}
    assert len({palette.SLIDES, palette.STICKS, palette.AWAY}) == 3


@pytest.mark.long
def test_a_page_plays_the_colours():
    found = drawing(sliding())
    played = tracks(found.parts, found.instants, found.frames)
    assert f"touching/{BELOW[0]}/point/0/<object>" in played
    assert f"touching/{CORNERS[0]}/point/0/<object>" not in played  # open from end to end
    assert "contact, sliding" in found.html()
    assert "contact that may open" not in found.html()


@pytest.mark.long
def test_where_nobody_asked_there_is_no_mode():
    found = drawing(box_on(friction=0.5))
    assert not [p for p in found.parts if p.path.startswith("touching/")]
    assert "contact that may open" in found.html()
    assert "contact, sliding" not in found.html()


def test_cones_are_as_wide_as_friction_and_not_there_while_open():
    motion = dropped()
    assert not [p for p in parts(motion) if p.startswith("cones/")]
    found = drawing(motion, cones=True)
    (cone,) = (p for p in found.parts if p.path == f"cones/{BELOW[0]}")
    first, last = found.instants[0], found.instants[-1]
    x, y, z = np.linalg.norm(cone.pose(last)[:3, :3], axis=0)
    assert (x / z, y / z) == pytest.approx((0.5, 0.5))
    assert cone.pose(first) is None
    assert np.allclose(cone.pose(last)[:3, 3], last.touching[BELOW[0]].at)


# Forces


def test_arrows_are_the_forces_of_contacts_in_the_world():
    slope = c.Plane((0.3, 0.0, 1.0))
    scene = box_on(slope, friction=0.8)
    q, v = scene.state()
    q[:3], q[3:] = slope.placement.rotation[:, 2] * HALF[2], quaternion(slope.placement.rotation)
    step = cp.step(scene, q, v, dt=1e-3)
    assert set(step.modes.values()) == {"open", "stick"}
    found = drawing(step)
    at = found.instants[0]
    arrows = [p for p in found.parts if p.path.startswith("forces/") and not p.picture]
    arrows = [p for p in arrows if "label" not in p.path]
    assert len(arrows) == 4
    ends = np.array([p.place(at)[:3, 2] for p in arrows])
    assert np.allclose(ends[:, :2].sum(axis=0), 0.0, atol=1e-6)  # against gravity, all together
    assert (ends[:, 2] > 0.0).all()
    scales = [np.linalg.norm(step.forces[name]) for name in BELOW]
    assert np.allclose(np.linalg.norm(ends, axis=1) / scales, np.linalg.norm(ends[0]) / scales[0])
    assert not [p for p in parts(step, forces=False) if p.startswith("forces/")]
    assert "a step of 0.001 s, ok" in found.title


@pytest.mark.long
def test_what_flies_has_no_arrows_of_rounding():
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    q, v = scene.state()
    flies = cp.solve(scene, q, v, np.zeros(cassie.nv))  # without springs: it falls as one
    assert 0.0 < np.abs(flies.lam).max() < 1e-9 * 9.81 * cassie.mass
    assert not [p for p in parts(flies) if p.startswith(("forces/", "moments/"))]
    pulled = cp.solve(scene, q, v, cassie.joint_vector({"left-knee-op": 1.0}))
    assert [p for p in parts(pulled) if p.startswith("forces/")]


@pytest.mark.long
def test_an_arrow_says_the_largest_force_of_the_fall():
    motion = dropped()
    found = drawing(motion)
    most = np.linalg.norm(motion.forces[BELOW[0]], axis=1).max()
    at = max(found.instants, key=lambda at: np.linalg.norm(at.touching[BELOW[0]].force))
    assert most > np.linalg.norm(at.touching[BELOW[0]].force)  # between two pictures
    (arrow,) = (
        p for p in found.parts if p.path == f"forces/{BELOW[0]}/on {BELOW[0].replace('/', ' ')}"
    )
    assert arrow.pose(found.instants[0]) is None
    assert arrow.pose(at) is not None


def quaternion(R):
    import pinocchio as pin

    return pin.Quaternion(R).coeffs()


# Diagrams


@pytest.fixture
def ax():
    from matplotlib.figure import Figure  # of no backend, so that nothing is left open

    return Figure().subplots()


def lines(ax):
    return {line.get_label(): line.get_ydata() for line in ax.lines}


@pytest.mark.long
def test_gaps_are_those_of_the_motion(ax):
    assert plots.gaps(dropped(), ax=ax) is ax
    drawn = lines(ax)
    for name in CORNERS:
        assert np.array_equal(drawn[name], dropped().gaps[name])
    assert "gap" in ax.get_ylabel()


@pytest.mark.long
def test_normal_forces_carry_the_weight(ax):
    plots.normal_forces(sliding(), BELOW, ax)
    drawn = lines(ax)
    assert list(drawn) == BELOW
    assert np.allclose(sum(drawn.values())[1:], 9.81, rtol=1e-6)


@pytest.mark.long
def test_a_stop_has_a_normal_force(ax):
    arm = cp.model.pendulum()
    arm.model.lowerPositionLimit[:] = -0.1
    arm = cp.Robot("arm", arm.model)
    joint = arm.joints[0]
    scene = cp.Scene(arm, contacts=[c.JointLimit(joint)])
    motion = cp.simulate(scene, np.zeros(1), np.full(1, -3.0), duration=0.1, dt=1e-3)
    plots.normal_forces(motion, [f"{joint}/lower"], ax)
    assert lines(ax)[f"{joint}/lower"].max() > 0.0


@pytest.mark.long
def test_bars_cover_the_time_without_overlap(ax):
    motion = sliding()
    plots.modes(motion, BELOW[:1], ax)
    spans = sorted(
        (path.vertices[:, 0].min(), path.vertices[:, 0].max())
        for bars in ax.collections for path in bars.get_paths()
    )  # fmt: skip
    assert spans[0][0] == motion.t[0]
    assert spans[-1][1] == motion.t[-1]
    assert all(a[1] == pytest.approx(b[0]) for a, b in pairwise(spans))
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == ["stick", "slide"]  # it is never open
    assert [label.get_text() for label in ax.get_yticklabels()] == BELOW[:1]


@each_row("plot", [plots.gaps, plots.normal_forces,
                                  plots.modes])  # fmt: skip
def test_diagrams_say_what_they_cannot_draw(plot, ax):
    with pytest.raises(cp.errors.UnknownName, match="nothing"):
        plot(sliding(), ["nothing"], ax)
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    still = cp.simulate(scene, *scene.state(), duration=0.01, dt=0.005)
    with pytest.raises(cp.InvalidArgument, match="no contacts that may open"):
        plot(still, ax=ax)


@pytest.mark.long
def test_energies_of_a_slide_have_the_work_of_friction(ax):
    plots.energy(sliding(), ax)
    assert lines(ax)["contacts"][-1] == pytest.approx(-0.5 * 0.2**2, rel=1e-2)


# In a browser


@pytest.mark.long
@pytest.mark.chromium
def test_a_picture_shows_what_slides_on_what(tmp_path):
    from PIL import Image

    path = tmp_path / "slide.png"
    cp.view(sliding(), png=path, cones=True)
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=float) / 255.0

    def seen(colour):
        return int((np.abs(pixels - colour).max(axis=2) < 0.06).sum())

    assert seen(palette.FORCE) > 100
    assert seen(0.88 * np.array(palette.GROUND)) > 10_000  # as the lamp lights it
    assert seen(0.5 * np.array(palette.STICKS) + 0.5) < 100  # nothing sticks yet
