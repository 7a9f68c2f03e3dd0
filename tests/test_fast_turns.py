"""Bodies that turn far within one step: another chart, a smaller step, or a status that says so."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from motions import body

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box

Array = np.ndarray

DT = 0.4  # [s]

# joints whose coordinates of a step end at pi, with velocities that turn by 4 rad in it
CURVED = {
    "FreeFlyer": [0.2, 0.1, 0.3, 0.5, 10.0, 0.3],
    "Spherical": [0.5, 10.0, 0.3],
    "Planar": [0.2, 0.1, 10.0],
}
FIXED = [kind for kind in cp.simulation.INTEGRATORS.values() if not kind.is_adaptive]


def spinning(kind: str) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A body on a joint of one kind, with an arm, so that its rotation matters."""
    model = pin.Model()
    joint = model.addJoint(0, getattr(pin, f"JointModel{kind}")(), pin.SE3.Identity(), "body")
    off = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.05]))
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.5), off)
    arm = model.addJoint(joint, pin.JointModelRX(), off, "arm")
    model.appendBodyToJoint(arm, pin.Inertia.FromBox(0.3, 0.2, 0.1, 0.1), off)
    scene = cp.Scene(cp.Robot("spinning", model))
    return scene, pin.neutral(model), np.array([*CURVED[kind], 0.4])


@pytest.mark.parametrize("method", [5, 8])
@pytest.mark.parametrize("kind", list(CURVED))
def test_adaptive_steps_change_charts(kind, method):
    """As right in one step of 4 rad as in forty."""
    scene, q, v = spinning(kind)
    tight = cp.simulation.DormandPrince(1e-11, 1e-12, method)
    one, many = (
        cp.simulate(scene, q, v, duration=2 * DT, dt=dt, integrator=tight) for dt in (DT, DT / 40)
    )
    assert one.status is many.status is cp.simulation.RunStatus.FINISHED
    assert np.abs(pin.difference(scene.robot.model, one.q[-1], many.q[-1])).max() < 1e-8
    assert np.abs(one.v[-1] - many.v[-1]).max() < 1e-8


@pytest.mark.values
@pytest.mark.parametrize("kind", list(CURVED))
@pytest.mark.parametrize("integrator", FIXED)
def test_fixed_steps_say_where_they_end(integrator, kind):
    found = cp.simulate(*spinning(kind), duration=2 * DT, dt=DT, integrator=integrator())
    assert found.status is cp.simulation.RunStatus.FAILED
    assert "joint 'body' turns by 4" in found.reason
    assert "take dt below 0.3" in found.reason
    assert found.t[-1] == 0.0


def test_a_body_that_comes_to_turn_too_fast_ends_the_run_there():
    scene, q, v = spinning("Spherical")
    spun_up = np.array([0.0, 0.0, 4.0, 0.0])
    found = cp.simulate(scene, q, 0.0 * v, spun_up, duration=2.0, dt=0.05, gravity=False)
    assert found.status is cp.simulation.RunStatus.FAILED
    assert "joint 'body' turns by" in found.reason
    assert 0.0 < found.t[-1] < 2.0
    assert np.linalg.norm(found.v[-1][:3]) * 0.05 < np.pi


@pytest.mark.parametrize("kind", ["RY", "RUBY"])
def test_a_hinge_that_turns_far_in_a_step_is_told(kind):
    """Its angle has no chart to leave, but what it does to others is not resolved."""
    wheel = cp.Scene(body(getattr(pin, f"JointModel{kind}")()))
    start = wheel, pin.neutral(wheel.robot.model), [40.0]
    fast = cp.simulate(*start, duration=1.0, dt=0.1)
    assert "joint 'joint' turns by 4 rad in a step of 0.1 s" in "".join(fast.notices)
    assert not cp.simulate(*start, duration=1.0, dt=0.05).notices
    adaptive = cp.simulate(*start, duration=1.0, dt=0.1, integrator=cp.simulation.DormandPrince())
    assert not adaptive.notices


def in_the_air(spin, *, ball: bool = False, contact=None) -> tuple[cp.Scene, Array, Array]:
    """A box or a ball high over a floor, with an angular velocity [rad/s]."""
    robot = cp.model.free_ball() if ball else cp.model.free_box(size=(0.2, 0.12, 0.08))
    frame, shape = ("ball", Ball(0.05)) if ball else ("box", Box(0.1, 0.06, 0.04))
    contacts = [contact or cp.FrictionalContact(frame, shape, friction=0.5)]
    scene = cp.Scene(robot, contacts=contacts)
    q, v = scene.state()
    q[2], v[3:] = 5.0, spin
    return scene, q, v


SCHEMES = [cp.StewartTrinkle(), cp.Moreau()]
TUMBLES = np.array([833.0, 8.0, 417.0])  # 9.3 rad in 10 ms


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda each: each.title)
@pytest.mark.parametrize("spin", [TUMBLES, 0.4 * TUMBLES])
def test_every_verb_of_steps_refuses_what_simulate_refuses(scheme, spin):
    scene, q, v = in_the_air(spin)
    run = cp.simulate(scene, q, v, duration=0.02, dt=0.01, integrator=scheme)
    assert not run.status.ok
    said = run.reason[run.reason.index("joint") :]
    asked = {"dt": 0.01, "integrator": scheme}
    taken = cp.step(scene, q, v, **asked, throw=False)
    assert taken.status is cp.contact.ContactStatus.INACCURATE
    assert taken.notices[0] == said
    with pytest.raises(cp.SolveFailed, match="turns by"):
        cp.step(scene, q, v, **asked)
    routes = [cp.gradients.ActiveSet(), cp.gradients.Kappa(), cp.gradients.EventLocated()]
    for route in routes:
        with pytest.raises(cp.errors.StepFailed, match="turns by"):
            taken.derivatives(route=route)
        action = cp.layers.Action(scene, 0.01, scheme, route, motors=["floating"])
        for verb in (action.step, action.derivatives):
            with pytest.raises(cp.errors.StepFailed, match="turns by"):
                verb(np.concatenate([q, v]), np.zeros(6))
    calm = np.zeros_like(v)
    batch = cp.stepping.step_batch(scene, np.array([q, q]), np.array([v, calm]), **asked)
    assert list(batch.failed) == [0]
    many = cp.gradients.step_derivatives_batch(
        scene, np.array([q, q]), np.array([v, calm]), **asked
    )
    assert list(many.failed) == [0]
    assert "turns by" in many.reasons[0]


@pytest.mark.long
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda each: each.title)
def test_a_ball_alone_may_turn_by_nearly_a_turn(scheme):
    """It flies on, and so do its derivatives; from 1.9 pi on it is refused as others are."""
    scene, q, v = in_the_air([0.0, 450.0, 30.0], ball=True)
    taken = cp.step(scene, q, v, dt=0.01, integrator=scheme)
    assert np.abs(taken.v[3:] - v[3:]).max() < 1e-12
    wanted = pin.integrate(scene.robot.model, q, np.concatenate([np.zeros(3), 0.01 * v[3:]]))
    assert abs(wanted[3:] @ taken.q[3:]) == pytest.approx(1.0, abs=1e-12)
    found, model, h = taken.derivatives(), scene.robot.model, 1e-6
    for column in np.eye(12):
        first, second = (
            cp.step(
                scene, pin.integrate(model, q, s * h * column[:6]), v + s * h * column[6:],
                dt=0.01, integrator=scheme,
            )
            for s in (-1, 1)
        )  # fmt: skip
        dq = pin.difference(model, first.q, second.q) / (2 * h)
        dv = (second.v - first.v) / (2 * h)
        matrix = np.vstack(found.matrices)[:, :12]
        assert np.abs(matrix @ column - np.concatenate([dq, dv])).max() < 1e-5
    too_fast = cp.step(*in_the_air([0.0, 650.0, 0.0], ball=True), dt=0.01, throw=False)
    assert not too_fast.status.ok
    assert "up to 1.9 pi" in too_fast.notices[0]


def thrown(armature: list[float]) -> cp.Trajectory:
    """A body in a vertical plane, thrown at (1, 0.5) m/s with 5.5 rad/s, after one step of 1 s."""
    model = pin.Model()
    upright = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0), np.zeros(3))  # y is up
    joint = model.addJoint(0, pin.JointModelPlanar(), upright, "body")
    beside = np.array([0.0, 0.0, 0.3])  # the plane: how it would turn about x and y is no matter
    model.appendBodyToJoint(
        joint, pin.Inertia(2.0, beside, np.diag([0.1, 0.2, 0.25])), pin.SE3.Identity()
    )
    model.armature = np.array(armature)
    scene, q, v = cp.Scene(cp.Robot("thrown", model)), pin.neutral(model), [1.0, 0.5, 5.5]
    return cp.simulate(
        scene, q, v, duration=1.0, dt=1.0, integrator=cp.simulation.RungeKutta4()
    )  # fmt: skip


def test_a_planar_body_is_a_ball_unless_an_armature_turns_with_it():
    """x = v t + g t^2 / 2; with armature along its axes, m (v' + w x v) + A v' = f, it is none."""
    for about in (0.0, 0.7):
        end = thrown([0.0, 0.0, about]).q[-1]
        assert np.allclose(end[:2], [1.0, 0.5 - 9.81 / 2], rtol=0, atol=1e-12)
        assert np.allclose(end[2:], [np.cos(5.5), np.sin(5.5)], rtol=0, atol=1e-12)
    geared = thrown([0.4, 0.4, 0.0])
    assert geared.status is cp.simulation.RunStatus.FAILED
    assert "joint 'body' turns by 5.5 rad" in geared.reason


@pytest.mark.long
@pytest.mark.parametrize(
    "contact",
    [
        cp.FrictionalContact("ball", Ball(0.05), offset=(0.01, 0.0, 0.0), friction=0.5),
        cp.FrictionalContact("ball", Box(0.05, 0.05, 0.05), friction=0.5),
    ],
)
def test_a_ball_with_a_contact_off_its_centre_is_as_other_bodies(contact):
    scene, q, v = in_the_air([0.0, 450.0, 0.0], ball=True, contact=contact)
    assert "turns by 4.5 rad" in cp.step(scene, q, v, dt=0.01, throw=False).notices[0]


@pytest.mark.long
def test_a_ball_on_a_point_is_as_other_bodies():
    scene = cp.Scene(cp.model.free_ball(), [cp.PointContact("ball")])
    q, v = scene.state()
    v[3:] = 0.0, 450.0, 0.0
    found = cp.simulate(scene, q, v, duration=0.02, dt=0.01)
    assert "turns by 4.5 rad" in found.reason


def slider(mass: float = 1.0) -> cp.Scene:
    return cp.Scene(body(pin.JointModelPX(), mass=mass))


@pytest.mark.parametrize("method", [5, 8])
def test_a_substep_that_leads_to_no_number_is_tried_smaller(method):
    """Beyond a centimetre the torque is no number; the motion never goes there."""

    def guarded(t, q, v):
        return np.array([-1e4 * q[0] if abs(q[0]) < 0.01 else np.nan])

    found = cp.simulate(
        slider(), [0.0], [0.9], guarded, duration=1.0, dt=1.0,
        integrator=cp.simulation.DormandPrince(method=method),
    )  # fmt: skip
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert found.q[-1, 0] == pytest.approx(9e-3 * np.sin(100.0), abs=1e-7)


@pytest.mark.long
def test_where_no_substep_is_small_enough_the_text_says_what_it_met():
    def ends(t, q, v):
        return np.array([1.0 if t < 0.5 else np.inf])

    found = cp.simulate(
        slider(), [0.0], [0.0], ends, duration=1.0, integrator=cp.simulation.DormandPrince()
    )
    assert found.status is cp.simulation.RunStatus.FAILED
    assert found.t[-1] == pytest.approx(0.5, abs=2e-3)
    assert "no step from t = 0.49" in found.reason or "no step from t = 0.5" in found.reason
    assert "at t = 0.5 s: tau(0.5, q, v)[0] = inf" in found.reason


@pytest.mark.long
def test_advice_fits_a_scene_without_rows():
    with pytest.raises(cp.SolveFailed, match="there are no constraints") as caught:
        cp.solve(slider(1e-10), [0.0], [0.0], [1e300])
    assert "mu" not in str(caught.value).split(")", 1)[1]
