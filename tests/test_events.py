"""Events of a simulation: found to the instant, as often as they happen, told if they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from motions import G, bar, body, falling
from shared import robot

import condyn_pin as cp

RunStatus = cp.simulation.RunStatus


def height(moment: cp.simulation.Snapshot) -> float:
    return moment.position("origin")[2]


def names(found: cp.Trajectory) -> list[str]:
    return [event.name for event in found.run.happened]


def test_landing_is_found_and_stays():
    air, floor = falling()
    land = cp.Event(name="land", when=height, scene=floor)
    found = cp.simulate(air, [1.0], [0.0], duration=1.0, dt=7e-3, events=[land])
    (landed,) = found.run.happened
    assert landed.t == pytest.approx(np.sqrt(2 / G), abs=1e-11)
    assert landed.energy_lost == pytest.approx(G)
    assert landed.added == ("origin",)
    assert found.t[landed.sample - 1] == found.t[landed.sample] == landed.t
    assert np.abs(found.q[landed.sample :]).max() < 1e-10
    assert found.forces["origin"][-1] == pytest.approx([0.0, 0.0, G])
    assert not found.forces["origin"][: landed.sample].any()
    assert np.abs(found.energy.error).max() < 1e-9
    assert found.row_names == ("origin.z",)
    assert found.t[-1] == 1.0
    # the first scene has nothing to close, that of the event has; each has a solver of its own
    assert found.run.drift == cp.simulation.PostStabilization()
    assert cp.simulate(air, [1.0], [0.0], duration=0.1).run.drift == cp.simulation.NoDrift()
    assert found.notices == ()
    lifted = [land, cp.Event(name="lift", at=0.5, scene=air)]
    assert cp.simulate(air, [1.0], [0.0], duration=0.55, events=lifted).notices == ()


@pytest.mark.parametrize("written_out", ["no scene", "the scene", "another like it"])
def test_rebounds_until_they_pile_up(written_out):
    air, floor = falling()
    scenes = {"no scene": None, "the scene": air, "another like it": cp.Scene(air.robot)}
    bounce = cp.Event(
        name="bounce", when=height, met=floor, scene=scenes[written_out], restitution=0.5
    )
    found = cp.simulate(air, [1.0], [0.0], duration=5.0, dt=1e-2, events=[bounce])
    first = np.sqrt(2 / G)
    times = [first * (1 + 2 * sum(0.5**i for i in range(1, k + 1))) for k in range(4)]
    assert [event.t for event in found.run.happened[:4]] == pytest.approx(times, abs=1e-10)
    assert found.status is RunStatus.PILED_UP
    assert "shorter than a step" in found.reason
    assert found.q.min() > -1e-9
    assert found.t[-1] < 3 * first
    once = cp.simulate(air, [1.0], [0.0], duration=0.7, dt=1e-2, events=[bounce])
    assert names(once) == ["bounce"]
    assert once.status is RunStatus.FINISHED


# the last is behind the end of a step, by less than is worth one
@pytest.mark.parametrize("at", [0.05, 0.055, 0.06, 0.01 + 0.05])
@pytest.mark.parametrize("goes_on", [False, True])
def test_a_blow_at_a_time_happens_once(at, goes_on):
    air, _ = falling()
    wall = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    blow = cp.Event(name="blow", at=at, met=wall, scene=air if goes_on else None, restitution=0.5)
    found = cp.simulate(air, [1.0], [-1.0], duration=0.2, dt=1e-2, events=[blow])
    assert found.status is RunStatus.FINISHED
    assert [(e.name, e.t) for e in found.run.happened] == [("blow", pytest.approx(at))]
    assert found.v[-1, 0] == pytest.approx(0.5 * (1.0 + G * at) - G * (0.2 - at))
    lost = 0.5 * (1.0 + G * at) ** 2 * (1 - 0.5**2)
    assert found.run.happened[0].energy_lost == pytest.approx(lost)


@pytest.mark.long
def test_lift_off_when_the_force_ends():
    """Pulled up harder and harder: the ground lets go at its weight."""
    air, floor = falling()
    off = cp.Event(name="off", when=lambda m: m.forces["origin"][2], scene=air)
    found = cp.simulate(
        floor, [0.0], [0.0], lambda t, q, v: np.array([20.0 * t]), duration=1.0, dt=1e-2,
        events=[off],
    )  # fmt: skip
    (event,) = found.run.happened
    assert event.t == pytest.approx(G / 20.0, abs=1e-10)
    assert (event.energy_lost, event.dropped) == (0.0, ("origin",))
    assert found.q[-1, 0] == pytest.approx(20.0 * (1.0 - event.t) ** 3 / 6, abs=1e-9)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (cp.constraints.PlanarContact("origin"), ""),
        (cp.PointContact("origin"), " (the vertical is its normal)"),
    ],
)
def test_a_contact_that_pulls_is_told(contact, words):
    """Pulled up harder and harder, and nothing lets go; a contact that is gone pulls no more."""
    ball = body(pin.JointModelTranslation())
    start = cp.Scene(ball, [contact]), [0.0, 0.0, 1.0], np.zeros(3)
    run = {"tau": lambda t, q, v: np.array([0.0, 0.0, 20.0 * t]), "duration": 1.0, "dt": 1e-2}
    assert cp.simulate(*start, **run).notices == (
        f"origin: the contact pulls with {20.0 - G:.4g} N at t = 1 s{words}; on real ground it "
        "would open; an Event takes it off",
    )
    off = cp.Event(
        name="off", when=lambda m: m.forces["origin"].in_world()[2], scene=cp.Scene(ball)
    )
    assert cp.simulate(*start, **run, events=[off]).notices == ()


@pytest.mark.long
@pytest.mark.parametrize("floor_at", np.linspace(0.1, 1.3, 5))  # rounded up, or down
def test_what_lets_go_of_the_ground_lands_again(floor_at):
    """The floor lets a ball go that has no way but down: it is on the floor at once."""
    air, _ = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin", height=floor_at)])
    events = [
        cp.Event(name="off", at=0.1, scene=air),
        cp.Event(name="on", when=lambda m: m.q[0] - floor_at, scene=floor),
    ]
    start = floor.assemble([floor_at], fixed=[]).q
    found = cp.simulate(floor, start, [0.0], duration=0.3, dt=1e-2, events=events)
    assert names(found) == ["off", "on"]
    assert np.abs(found.q[:, 0] - floor_at).max() < 1e-8


@pytest.mark.long
def test_scenes_with_the_same_constraints_are_one():
    """Neither the start nor an event has to be the same object: a foot that is off has no force."""
    air, floor = falling()
    touch = cp.Event(name="touch", when=lambda m: m.q[0], scene=floor)
    lift = cp.Event(name="lift", when=lambda m: m.forces["origin"][2], scene=cp.Scene(air.robot))
    assert names(cp.simulate(air, [0.1], [0.0], duration=0.3, events=[touch, lift])) == ["touch"]


@pytest.mark.long
def test_events_at_a_time_and_the_end():
    air, _ = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    events = [cp.Event(name="stop", at=0.25, scene=floor), cp.Event(name="end", at=0.5)]
    found = cp.simulate(air, [0.0], [0.0], duration=1.0, dt=4e-3, events=events)
    assert [(e.name, e.t) for e in found.run.happened] == [("stop", 0.25), ("end", 0.5)]
    assert found.status is RunStatus.ENDED
    assert found.status.ok
    assert found.t[-1] == 0.5
    held = -G * 0.25**2 / 2
    assert found.q[-1, 0] == pytest.approx(held)
    assert found.phases[1].scene.constraints[0].height == pytest.approx(held)
    assert len(found.phases) == 2


@pytest.mark.parametrize("at", [0.05, 0.0503])
@pytest.mark.parametrize("integrator", [cp.RungeKutta4(), cp.simulation.GeneralisedAlpha()])
def test_events_of_one_instant_all_happen(integrator, at):
    scene, q, v = bar()
    events = [
        cp.Event(name="let go", at=at, scene=cp.Scene(scene.robot)), cp.Event(name="end", at=at)
    ]  # fmt: skip
    found = cp.simulate(scene, q, v, duration=0.1, events=events, integrator=integrator)
    assert names(found) == ["let go", "end"]
    assert found.status is RunStatus.ENDED
    assert found.t[-1] == at


@pytest.mark.long
def test_two_feet_that_land_together_both_stay():
    """Two balls fall side by side, each with an event of its own; none takes the other's off."""
    model = pin.Model(body(pin.JointModelPZ()).model)
    j = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "second")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(2.0, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("other", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    balls = cp.Robot("balls", model)
    one, other = (cp.constraints.PlanarContact(name, height=0.0) for name in ("origin", "other"))
    events = [
        cp.Event(name="one", when=lambda m: m.q[0], scene=cp.Scene(balls, [one])),
        cp.Event(name="both", when=lambda m: m.q[1], scene=cp.Scene(balls, [one, other])),
    ]
    for start in np.linspace(0.5, 1.0, 6):  # the root is found above zero, or below
        found = cp.simulate(
            cp.Scene(balls), [start, start], [0.0, 0.0], duration=0.6, events=events
        )
        assert names(found) == ["one", "both"]
        assert found.run.happened[1].t == pytest.approx(np.sqrt(2 * start / G))
        assert np.abs(found.q[-1]).max() < 1e-9


@pytest.mark.long
def test_contacts_that_stay_keep_their_place():
    solo = robot("solo12")
    feet = solo.contacts
    four, three = cp.Scene(solo, feet), cp.Scene(solo, feet[1:])
    lift = cp.Event(name="lift", at=0.05, scene=three)
    found = cp.simulate(four, *four.state(), duration=0.1, dt=1e-3, events=[lift])
    before, after = (phase.scene.constraints for phase in found.phases)
    assert before[1:] == after
    assert found.lam.shape == (len(found.t), 12)
    assert not found.forces[feet[0].name][found.run.happened[0].sample :].any()
    assert found.violation.max() < 1e-6


@pytest.mark.long
def test_a_contact_that_lands_again_has_another_place():
    """A ball is let go, falls by 12 mm, and is held again where it is then."""
    ball = body(pin.JointModelTranslation())
    free, held = cp.Scene(ball), cp.Scene(ball, [cp.PointContact("origin")])
    events = [
        cp.Event(name="let go", at=0.05, scene=free), cp.Event(name="hold", at=0.1, scene=held)
    ]  # fmt: skip
    found = cp.simulate(held, [0.0, 0.0, 1.0], np.zeros(3), duration=0.2, events=events)
    assert found.status is RunStatus.FINISHED
    assert found.q[-1] == pytest.approx([0.0, 0.0, 1.0 - 0.5 * G * 0.05**2], abs=1e-9)


def test_a_moment_knows_where_frames_are_and_how_fast():
    seen = []

    def look(m):
        seen.append((m.q[0], m.v[0], m.a[0], *m.position("tip"), *m.velocity("tip")))
        return 1.0

    scene = cp.Scene(cp.model.pendulum(length=2.0))
    cp.simulate(scene, [0.4], [0.7], duration=0.01, events=[cp.Event(name="look", when=look)])
    assert len(seen) == 11
    for theta, speed, a, x, y, z, vx, vy, vz in seen:
        s, c = np.sin(theta), np.cos(theta)
        assert (x, y, z) == pytest.approx((-2 * s, 0, -2 * c))
        assert (vx, vy, vz) == pytest.approx((-2 * c * speed, 0, 2 * s * speed))
        assert a == pytest.approx(-G / 2 * s)


@pytest.mark.long
@pytest.mark.parametrize("turned", [False, True])
def test_a_contact_of_another_kind_may_keep_its_name(turned):
    """A heel, and then the whole foot: the force is as wide as the widest."""
    ball = body(pin.JointModelFreeFlyer())
    kinds = [cp.PointContact("origin"), cp.SurfaceContact("origin")]
    heel, flat = (cp.Scene(ball, [kind]) for kind in (kinds[::-1] if turned else kinds))
    event = cp.Event(name="flat", at=0.02, scene=flat)
    found = cp.simulate(heel, *heel.state(), duration=0.04, dt=1e-2, events=[event])
    weight = G * ball.mass * np.eye(6)[2]
    assert np.abs(found.forces["origin"] - weight).max() < 1e-9


def test_an_event_that_another_of_its_instant_undoes_is_told():
    air, _ = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    events = [cp.Event(name="on", at=0.1, scene=floor), cp.Event(name="off", at=0.1, scene=air)]
    found = cp.simulate(air, [0.0], [0.0], duration=0.2, dt=1e-2, events=events)
    assert names(found) == ["on"]
    (said,) = found.run.missed
    assert "off did not happen: its scene went on at t = 0.1 s" in said


@pytest.mark.long
def test_events_that_do_not_happen_are_told(tmp_path):
    scene, q, v = bar()
    events = [
        cp.Event(name="late", at=3.0),
        cp.Event(name="floor", when=lambda moment: 1.0 + moment.t),
        cp.Event(name="below", when=lambda moment: -1.0),
        cp.Event(name="on time", at=0.01, scene=cp.Scene(scene.robot, scene.constraints[:0])),
    ]
    found = cp.simulate(scene, q, v, duration=0.02, events=events)
    late, floor, below = found.run.missed
    assert late == "late did not happen: the run ends before t = 3 s"
    assert floor.startswith("floor did not happen: its condition is 1.02 at the end")
    assert "below did not happen: its condition is -1 at the end, and has not been above" in below
    assert all(text in str(found) for text in found.run.missed)
    found.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").run.missed == found.run.missed


@pytest.mark.long
def test_what_an_event_with_the_scene_of_another_does():
    """Nothing while its scene goes on, which is told, and its part once it does not."""
    air, floor = falling()
    events = [
        cp.Event(name="land", when=height, scene=floor),
        cp.Event(name="late", at=0.6, scene=cp.Scene(air.robot, floor.constraints)),
        cp.Event(name="up", at=0.7, scene=air),
        cp.Event(
            name="down",
            at=0.75,
            scene=cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")]),
        ),
    ]
    start = air, [1.0], [0.0], lambda t, q, v: np.array([2 * G * (t > 0.65)])
    found = cp.simulate(*start, duration=0.8, dt=1e-2, events=events)
    assert names(found) == ["land", "up", "down"]
    (said,) = found.run.missed
    assert said.startswith("late did not happen: its scene went on at t = 0.6 s")
    short = cp.simulate(*start[:3], duration=0.65, dt=1e-2, events=events[:2])
    assert short.run.missed == (
        "late did not happen: its scene is on already, and it brings no impact",
    )


# What ends a run, and what is refused.


@pytest.mark.long
def test_a_scene_that_does_not_fit_ends_the_run():
    air, floor = falling()
    early = cp.Event(name="floor", at=0.1, scene=floor)
    found = cp.simulate(air, [1.0], [0.0], duration=1.0, events=[early])
    assert found.status is RunStatus.FAILED
    said = "event 'floor': its scene does not fit the state: origin is open by 951 mm"
    assert said in found.reason
    assert found.t[-1] == pytest.approx(0.1)


@pytest.mark.long
def test_an_impact_that_tears_apart_what_goes_on_is_refused():
    """A bob on a hinge, struck by a floor that does not know of its loop."""
    scene, q, v = bar()
    floor = cp.Scene(scene.robot, [cp.PointContact("crank_tip")])
    event = cp.Event(name="struck", at=0.05, met=floor)
    found = cp.simulate(scene, q, v, duration=0.1, events=[event])
    assert found.status is RunStatus.FAILED
    assert "'struck': its impact tears apart" in found.reason
    whole = cp.Scene(scene.robot, (*scene.constraints, cp.PointContact("crank_tip")))
    found = cp.simulate(scene, q, v, duration=0.1, events=[replace(event, met=whole)])
    assert found.status is RunStatus.FINISHED


def test_a_condition_on_a_contact_that_is_off_is_named():
    air, _ = falling()
    other = cp.Scene(
        air.robot, [cp.constraints.PlanarContact("origin", height=-1.0, name="cellar")]
    )
    event = cp.Event(name="lift", when=lambda m: m.forces["origin"][2], scene=other)
    with pytest.raises(cp.InvalidArgument, match=r"'lift'.*asks for 'origin'.*has no constraint"):
        cp.simulate(air, [0.1], [0.0], duration=0.3, events=[event])
    misspelt = replace(event, when=lambda m: m.position("orgin")[2])
    with pytest.raises(cp.errors.UnknownName, match="orgin"):
        cp.simulate(air, [0.1], [0.0], duration=0.3, events=[misspelt])


@pytest.mark.long
def test_a_condition_cannot_write_to_the_state():
    def moves(moment):
        moment.q[0] = 5.0
        return 1.0

    event = cp.Event(name="push", when=moves)
    with pytest.raises(ValueError, match="read-only"):
        cp.simulate(falling()[0], [0.0], [0.0], duration=0.01, events=[event])


def test_scenes_of_events_go_with_that_simulated():
    scene, q, v = bar()
    rod = cp.Loop("crank_tip", "rocker_tip", "rod", length=0.5, name=scene.names[0])
    # the energy of the springs is that of one robot
    sprung = replace(scene.robot, springs=[cp.model.Spring(scene.robot.joints[0], 50.0, 0.3)])
    for other, words in (
        (cp.Scene(scene.robot, [rod]), "'other': .* by its rows in one scene, and by axes"),
        (cp.Scene(sprung, scene.constraints), "'other': its scene has other springs"),
        (cp.Scene(robot("solo12")), "another model"),
    ):
        event = cp.Event(name="other", at=0.02, scene=other)
        with pytest.raises(cp.InvalidArgument, match=words):
            cp.simulate(scene, q, v, duration=0.04, events=[event])


def test_events_are_refused():
    air, floor = falling()
    good = cp.Event(name="a", at=0.1, scene=floor)
    for events, words in (
        ([good, good], "two events are named 'a'"),
        (good, "a list is needed"),
        (None, "a list is needed"),
        ([cp.Event(name="a", when=lambda m: None)], "event 'a': its condition returns None"),
        ([cp.Event(name="a", when=lambda m: m.q[[0, 0]])], "event 'a': its condition returns"),
        ([3], "is not an Event"),
        ([cp.Event(name="a", at=-1.0)], "after the start"),
    ):
        with pytest.raises(cp.InvalidArgument, match=words):
            cp.simulate(air, [1.0], [0.0], duration=1.0, events=events)
    for arguments in (
        {"name": "a"}, {"name": "", "at": 1.0}, {"name": "a", "at": np.nan},
        {"name": "a", "when": 3.0}, {"name": "a", "at": 1.0, "scene": 3},
        {"name": "a", "at": 1.0, "scene": floor, "restitution": 3.0},
        {"name": "a", "at": 1.0, "scene": floor, "restitution": "hard"},
    ):  # fmt: skip
        with pytest.raises(cp.InvalidArgument):
            cp.Event(**arguments)
    with pytest.raises(cp.errors.UnknownName, match="no constraint named 'ceiling'"):
        cp.Event(name="a", at=1.0, scene=floor, restitution={"ceiling": 0.5})
