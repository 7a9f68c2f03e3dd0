"""Cables that pull, struts that push: closed forms, differences, MuJoCo and what refuses them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import relative
from viewed import parts

import condyn_pin as cp
from condyn_pin.constraints import Cable, Driven, HeldJoint, Polynomial, TautCable
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.compiled import why_not_contacts
from condyn_pin.simulation import DormandPrince
from condyn_pin.stepping import EventDriven

G = 9.81


def weights(*masses: float, floating: bool = False) -> cp.Robot:
    """Bodies that fall along z, or freely, named "a", "b", ..."""
    model = pin.Model()
    for name, mass in zip("abcdefg", masses, strict=False):
        kind = pin.JointModelFreeFlyer() if floating else pin.JointModelPZ()
        j = model.addJoint(0, kind, pin.SE3.Identity(), name)
        model.appendBodyToJoint(j, pin.Inertia.FromSphere(mass, 0.1), pin.SE3.Identity())
    return cp.Robot("weights", model)


@pytest.fixture(scope="module")
def machine() -> cp.Robot:
    """A floating body with an arm of two hinges, and a winch on the world."""
    rng, model = np.random.default_rng(0), pin.Model()
    inertia = pin.Inertia(2.0, np.array([0.1, 0.0, -0.1]), np.diag([0.2, 0.3, 0.4]))
    parent = 0
    for name, kind in (("base", pin.JointModelFreeFlyer()), ("one", pin.JointModelRX()),
                       ("two", pin.JointModelRevoluteUnaligned(0.0, 0.6, 0.8))):  # fmt: skip
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, place, name)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    winch = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "winch")
    model.appendBodyToJoint(winch, inertia, pin.SE3.Identity())
    return cp.Robot("machine", model)


OVER = ("world + [1 2 3]", "base + [0.1 0 0]", "two + [0 0.3 0.2]", "world", "one + [0.2 0 0]")
TAUT = [
    TautCable(OVER, 7.0, {"winch": 0.2, "two": -0.1}, name="over"),
    TautCable(("two + [0 0 0.4]", "base"), 1.8, name="inner"),
]


def test_the_rows_are_those_of_the_length(machine):
    """By frames, and by differences: J of c, gamma of J v, and derivatives."""
    scene, rng = cp.Scene(machine, TAUT), np.random.default_rng(1)
    q = pin.integrate(machine.model, pin.neutral(machine.model), rng.normal(size=machine.nv))
    v, tau = rng.normal(size=(2, machine.nv))
    ws = cp.Workspace(scene)

    def c(q: np.ndarray) -> np.ndarray:
        data = machine.model.createData()
        pin.forwardKinematics(machine.model, data, q)
        found = []
        for cable in TAUT:
            placed = (machine.frame(frame) for frame in cable.through)
            x = np.array([data.oMi[j].act(at.translation) for j, at in placed])
            wound = sum(r * q[machine.index_q(joint)] for joint, r in cable.reels)
            found.append(cable.length + wound - np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
        return np.array(found)

    gaps = scene.check(q).violation
    assert [gaps[cable.name].length for cable in TAUT] == pytest.approx(np.abs(c(q)), abs=1e-12)

    def along(f, move):
        h = 1e-4
        return (f(pin.integrate(machine.model, q, h * move)) -
                f(pin.integrate(machine.model, q, -h * move))) / (2 * h)  # fmt: skip

    terms = ws.terms(q, v)
    J = np.stack([along(c, e) for e in np.eye(machine.nv)], axis=1)
    assert relative(terms.J, J) < 1e-8
    assert relative(terms.gamma, along(lambda at: ws.terms(at, v).J @ v, v)) < 1e-7
    for drift in (None, cp.Baumgarte(3.0, 5.0)):
        cp.derivatives(scene, q, v, tau, drift=drift, check=True)


def test_a_cable_of_two_frames_is_a_rod(machine):
    rng = np.random.default_rng(2)
    cable = cp.Scene(machine, [TAUT[1]])
    rod = cp.Scene(machine, [cp.Loop("two + [0 0 0.4]", "base", "rod", length=1.8)])
    q, v = rod.sample(rng)
    one, two = (cp.solve(scene, q, v, np.ones(machine.nv)) for scene in (cable, rod))
    assert one.status.ok
    assert relative(one.a, two.a) < 1e-9
    assert abs(one.lam[0]) == pytest.approx(abs(two.lam[0]), rel=1e-9)


def test_atwoods_machine():
    """a = (m1 - m2) g / (m1 + m2), T = 2 m1 m2 g / (m1 + m2); with one that stays taut too."""
    m1, m2 = 3.0, 2.0
    over = ("a", "world + [0 0 2]", "b")
    a, T = (m1 - m2) * G / (m1 + m2), 2 * m1 * m2 * G / (m1 + m2)
    for scene in (
        cp.Scene(weights(m1, m2), [TautCable(over, 4.0, name="rope")]),
        cp.Scene(weights(m1, m2), contacts=[Cable(over, 4.0, name="rope")]),
    ):
        if not scene.contacts:
            found = cp.solve(scene, np.zeros(2), np.zeros(2), np.zeros(2))
            assert found.a == pytest.approx([-a, a], rel=1e-12)
            assert found.forces["rope"].components == pytest.approx([T], rel=1e-12)
            continue
        step = cp.step(scene, np.zeros(2), np.zeros(2), dt=1e-3)
        assert step.status.ok
        assert step.v == pytest.approx([-1e-3 * a, 1e-3 * a], rel=1e-10)
        assert step.forces["rope"] == pytest.approx([T], rel=1e-10)


def test_a_rope_goes_taut_without_a_rebound():
    """The momentum along the rope stays, and mu rate^2 / 2 is lost."""
    m1, m2, rate = 3.0, 2.0, 1.5
    model = weights(m1, m2).model
    model.gravity.linear = np.zeros(3)
    rope = Cable(("a", "world + [0 0 2]", "b"), 4.0, name="rope")
    scene = cp.Scene(cp.Robot("without gravity", model), contacts=[rope])
    run = cp.simulate(
        scene, [0.3, 0.0], [-rate, 0.0], duration=0.5, dt=1e-2, integrator=EventDriven()
    )
    assert run.run.happened[0].t == pytest.approx(0.3 / rate, abs=1e-9)
    shared = m1 * rate / (m1 + m2)
    assert run.v[-1] == pytest.approx([-shared, shared], rel=1e-9)
    lost = 0.5 * m1 * m2 / (m1 + m2) * rate**2
    assert run.energy.contact[-1] == pytest.approx(-lost, rel=1e-9)


@pytest.mark.parametrize("speed", [3.3, 3.8])
def test_a_ball_on_a_string_lets_it_go_slack(speed):
    """Where v^2 = g l sin(elevation): at the height (v0^2 - 2 g l) / 3 g above the pivot."""
    length = 0.5
    ball = weights(1.0, floating=True)
    scene = cp.Scene(ball, contacts=[Cable(("world", "a"), length, name="string")])
    q, v = np.array([0.0, 0, -length, 0, 0, 0, 1]), np.array([speed, 0, 0, 0, 0, 0])
    run = cp.simulate(scene, q, v, duration=0.45, dt=2e-3, integrator=EventDriven())
    height = (speed**2 - 2 * G * length) / (3 * G)
    (lets_go,) = (event for event in run.run.happened if event.name == "lift-off of string")
    assert run.q[lets_go.sample, 2] == pytest.approx(height, abs=1e-8)
    assert np.abs(run.energy.error).max() < 1e-7


def test_steps_keep_a_pendulum_on_its_string():
    """Paths bend, and what a step leaves open is a part of dt^2; of order 1 against the rod."""
    ball = weights(1.0, floating=True)
    q, v = np.array([0.4, 0, -0.3, 0, 0, 0, 1.0]), np.zeros(6)
    rod = cp.Scene(ball, [cp.Loop("a", "world", "rod", length=0.5)])
    exact = cp.simulate(rod, q, v, duration=0.5, integrator=DormandPrince(1e-10, 1e-10))
    hung = cp.Scene(ball, contacts=[Cable(("world", "a"), 0.5, name="string")])
    for scheme in (cp.StewartTrinkle(), cp.Moreau()):
        off = []
        for dt in (4e-3, 2e-3):
            run = cp.simulate(hung, q, v, duration=0.5, dt=dt, integrator=scheme)
            assert run.gaps["string"].min() > -1e-4
            off.append(np.abs(run.q[-1, :3] - exact.q[-1, :3]).max())
        assert off[1] < 0.6 * off[0] < 2e-3


def test_a_strut_pushes_and_does_not_pull():
    body = weights(2.0)
    scene = cp.Scene(body, contacts=[Cable(("world", "a"), at_least=0.5, at_most=0.8, name="leg")])
    at = {0.5: ("leg/at least", 0.0), 0.6: ("", 0.0), 0.8: ("leg/at most", 60.0)}
    for z, (name, up) in at.items():
        step = cp.step(scene, [z], [0.0], [up], dt=1e-3)
        weight = {"leg/at least": 2.0 * G, "leg/at most": 60.0 - 2.0 * G}
        for each, force in step.forces.items():
            assert force == pytest.approx([weight[each] if each == name else 0.0], rel=1e-9)


# A platform on cables.


def platform(count: int) -> cp.Scene:
    """A plate of 10 kg below the corners of a square, on four cables, or with four more below."""
    plate = weights(10.0, floating=True)
    corners = [(x, y) for x in (-1, 1) for y in (-1, 1)]
    ends = [(f"world + [{2 * x} {2 * y} 3]", f"a + [{0.2 * x} {0.2 * y} 0]") for x, y in corners]
    ends += [(f"world + [{2 * x} {2 * y} 0]", f"a + [{0.2 * y} {0.2 * x} 0.1]") for x, y in corners]
    away = [float(np.sqrt(2 * 1.8**2 + 4.0))] * 4 + [3.5] * 4
    cables = [Cable(e, x, name=f"c{i}") for i, (e, x) in enumerate(zip(ends, away, strict=True))]
    return cp.Scene(plate, contacts=cables[:count])


def test_a_platform_hangs_on_its_upper_cables():
    """Each of four bears m g / 4 over the cosine; the slack ones below have no tension."""
    scene = platform(8)
    q = pin.neutral(scene.robot.model)
    q[2] = 1.0
    step = cp.step(scene, q, np.zeros(6), dt=1e-3)
    cosine = 2.0 / np.sqrt(2 * 1.8**2 + 4.0)
    tensions = [step.forces[f"c{i}"][0] for i in range(8)]
    assert tensions[:4] == pytest.approx([10.0 * G / 4 / cosine] * 4, rel=1e-6)
    assert tensions[4:] == [0.0] * 4
    assert step.status.ok
    run = cp.simulate(scene, q, np.zeros(6), duration=0.1)
    assert run.status.ok
    assert np.abs(run.q[-1] - q).max() < 1e-9
    held = scene.closed({f"c{i}": "stick" for i in range(4)})
    assert cp.solve(held, q, np.zeros(6), np.zeros(6)).lam.sum() == pytest.approx(10 * G / cosine)


def test_a_plate_off_its_middle_hangs_on_some_of_them():
    """Tensions of a planar plate with two of four cables taut: by the balance of forces."""
    ends = np.array([[-1.0, 2.0], [1.0, 2.0], [-1.0, -2.0], [1.0, -2.0]])
    x, mass = np.array([0.3, 0.0]), 5.0
    body = weights(mass, floating=True)
    cables = [
        Cable((f"world + [{e[0]} 0 {e[1]}]", "a"), float(np.linalg.norm(e - x)) + (i > 1) * 0.1,
                 name=f"c{i}")
        for i, e in enumerate(ends)
    ]  # fmt: skip
    q = np.array([x[0], 0.0, x[1], 0, 0, 0, 1.0])
    step = cp.step(cp.Scene(body, contacts=cables), q, np.zeros(6), dt=1e-4)
    pulls = (ends[:2] - x) / np.linalg.norm(ends[:2] - x, axis=1)[:, None]
    T = np.linalg.solve(pulls.T, [0.0, mass * G])
    assert [step.forces[f"c{i}"][0] for i in range(4)] == pytest.approx([*T, 0, 0], rel=1e-6)


# Winches.


@pytest.fixture(scope="module")
def hoist() -> cp.Scene:
    """A weight of 3 kg on the rope of a winch with a drum of 0.1 m."""
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "weight")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(3.0, 0.1), pin.SE3.Identity())
    j = model.addJoint(0, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0, 0, 2.0])), "winch")
    drum = pin.Inertia.FromCylinder(2.0, 0.1, 0.1)
    model.appendBodyToJoint(j, drum, pin.SE3.Identity())
    rope = Cable(("weight", "winch"), 2.0, reels={"winch": 0.1}, name="rope")
    return cp.Scene(cp.Robot("hoist", model), contacts=[rope])


def test_a_winch_lifts_a_weight_along_a_path(hoist):
    """z = -r s(t), T = m (g + z''), the torque of the winch -r T - I s''."""
    path = Polynomial((0.0, 0.0, -1.0))  # s'' = -2 rad/s^2: it winds up
    scene = replace(hoist, constraints=[Driven(HeldJoint("winch"), path)])
    run = cp.simulate(scene, *scene.state(), duration=0.5, dt=1e-2, integrator=EventDriven())
    assert run.q[-1] == pytest.approx([0.1 * 0.25, -0.25], abs=1e-9)
    T = 3.0 * (G + 0.2)
    assert run.forces["rope"][-1] == pytest.approx([T], rel=1e-9)
    drum = hoist.robot.model.inertias[2].inertia[0, 0]
    assert run.forces["winch"][-1] == pytest.approx([-0.1 * T - 2.0 * drum], rel=1e-9)
    stepped = cp.simulate(scene, *scene.state(), duration=0.5, dt=1e-3)
    assert np.abs(stepped.q[-1] - run.q[-1]).max() < 1e-3


def test_a_torque_of_the_winch_is_a_tension(hoist):
    """In balance at -r m g; unwound faster than the weight falls it goes slack."""
    q, v = np.zeros(2), np.zeros(2)
    step = cp.step(hoist, q, v, [0.0, -0.1 * 3.0 * G], dt=1e-3)
    assert np.abs(step.v).max() < 1e-12
    assert step.forces["rope"] == pytest.approx([3.0 * G])
    slack = cp.step(hoist, q, v, [0.0, 5.0], dt=1e-3)
    assert slack.forces["rope"] == pytest.approx([0.0])
    assert slack.v[0] == pytest.approx(-1e-3 * G)


def test_a_winch_that_is_locked_keeps_its_rope(hoist):
    q = np.array([0.05, -0.5])
    taut = cp.Scene(hoist.robot, [TautCable(("weight", "winch"), 2.0, {"winch": 0.1}, name="rope")])
    for scene in (hoist, taut):
        locked = scene.lock(["winch"], q)
        (rope,) = (*locked.constraints, *locked.contacts)
        assert (rope.length if scene is taut else rope.at_most) == pytest.approx(1.95)
        assert rope.reels == ()
    found = cp.solve(taut.lock(["winch"], q), [0.05], [0.0], [0.0])
    assert found.lam == pytest.approx([3.0 * G])


def test_a_driven_taut_cable_is_a_winch():
    scene = cp.Scene(
        weights(3.0),
        [Driven(TautCable(("a", "world + [0 0 2]"), 2.0, name="rope"), Polynomial((0, 0, 0.1)))],
    )
    q, v = scene.at(1.0).assemble([0.0]).q, np.array([0.2])
    assert q == pytest.approx([0.1])
    found = cp.solve(scene.at(1.0), q, v, [0.0])
    assert found.a == pytest.approx([0.2])
    assert found.forces["rope"].components == pytest.approx([3.0 * (G + 0.2)])


# What takes them, and what does not.


@pytest.mark.parametrize("c", TAUT, ids=lambda c: c.name)
def test_a_step_is_differentiated(machine, c):
    """It goes taut within the step, over moving bodies and a reel: by differences."""
    cable = Cable(c.through, c.length + 1e-4, reels=c.reels, name=c.name)
    rng = np.random.default_rng(5)
    taut = cp.Scene(machine, [c])
    q, v = taut.sample(rng)
    v -= np.linalg.pinv(cp.Workspace(taut).terms(q, v).J) @ np.ones(1)  # [m/s]
    scene = cp.Scene(machine, contacts=[cable])
    tau = 20.0 * rng.normal(size=machine.nv)

    def end(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        step = cp.step(scene, q, v, tau, dt=1e-3)
        return np.concatenate((pin.difference(machine.model, before.q, step.q), step.v))

    before = cp.step(scene, q, v, tau, dt=1e-3)
    assert before.forces[c.name][0] > 0
    found, h, n = before.derivatives(), 1e-6, machine.nv
    for i, e in enumerate(np.eye(n)):
        moved = [pin.integrate(machine.model, q, s * h * e) for s in (1, -1)]
        by_q = (end(moved[0], v, tau) - end(moved[1], v, tau)) / (2 * h)
        by_v = (end(q, v + h * e, tau) - end(q, v - h * e, tau)) / (2 * h)
        assert found.dv_dq[:, i] == pytest.approx(by_q[n:], abs=1e-4 * np.abs(by_q).max())
        assert found.dv_dv[:, i] == pytest.approx(by_v[n:], abs=1e-5 * np.abs(by_v).max())


def test_a_run_is_written_read_and_drawn(hoist, tmp_path):
    run = cp.simulate(hoist, np.zeros(2), np.zeros(2), duration=0.02)
    run.save(tmp_path / "run.npz")
    read = cp.Trajectory.load(tmp_path / "run.npz")
    assert read.scene.contacts == hoist.contacts
    assert read.forces["rope"] == pytest.approx(run.forces["rope"])
    drawn = parts(hoist, np.zeros(2))
    assert "cables/rope/span 0" in drawn
    page = tmp_path / "run.html"
    cp.view(run, html=page)
    assert "cable, taut" in page.read_text(encoding="utf-8")


def test_mujoco_has_the_same_length_and_rows():
    mujoco = pytest.importorskip("mujoco")
    scene = platform(4)
    mj = mujoco.MjModel.from_xml_string(scene.robot.to_mjcf(contacts=scene.contacts))
    data = mujoco.MjData(mj)
    rng = np.random.default_rng(7)
    q = pin.integrate(scene.robot.model, pin.neutral(scene.robot.model), rng.normal(size=6))
    data.qpos[:] = [*q[:3], q[6], *q[3:6]]
    mujoco.mj_forward(mj, data)
    model = scene.robot.model
    own, its = Candidates(model, scene.contact_bounds), model.createData()
    pin.computeJointJacobians(model, its, q)
    gaps, J = own.evaluate(its, q)
    assert mj.tendon_range[:, 1] - data.ten_length == pytest.approx(gaps, abs=1e-9)
    v = rng.normal(size=6)
    R = pin.Quaternion(q[3:]).matrix()  # MuJoCo's linear velocity is in the world
    data.qvel[:] = [*(R @ v[:3]), *v[3:]]
    mujoco.mj_fwdVelocity(mj, data)
    assert -data.ten_velocity == pytest.approx(J @ v, abs=1e-9)


def test_what_refuses_them_says_their_name(hoist):
    assert any("rope: cables" in why for why in why_not_contacts(hoist))
    with pytest.raises(cp.CondynError, match=r"rope.*has reels"):
        hoist.robot.to_mjcf(contacts=hoist.contacts)
    with pytest.raises(cp.CondynError, match="leg: it has two lengths"):
        cp.Scene(weights(1.0), contacts=[Cable(("world", "a"), 1.0, 0.5, name="leg")]).closed()
    with pytest.raises(cp.CondynError, match="one body"):
        cp.Scene(weights(1.0), contacts=[Cable(("a", "a + [0 0 1]"), 1.0)])


BAD = {
    "through = 'a'": lambda: Cable("a", 1.0),
    "at_most, at_least: one of them": lambda: Cable(("a", "b")),
    r"at_most = -1.0: a positive length": lambda: Cable(("a", "b"), -1.0),
    "at_least = 2: it is above at_most = 1": lambda: Cable(("a", "b"), 1.0, 2.0),
    r"a length that changes in time.*reels=.*Driven": lambda: Cable(
        ("a", "b"), Polynomial((1.0, 0.1))
    ),
    "reels = 3": lambda: Cable(("a", "b"), 1.0, reels=3),
    "reels .*nan": lambda: Cable(("a", "b"), 1.0, reels={"w": float("nan")}),
}


@pytest.mark.parametrize("message", BAD)
def test_a_mistake_is_named(message):
    with pytest.raises(cp.InvalidArgument, match=message):
        BAD[message]()


def test_a_cable_that_pushes_is_told(machine):
    scene = cp.Scene(weights(2.0), [TautCable(("a", "world + [0 0 -1]"), 1.0, name="rope")])
    found = cp.solve(scene, [0.0], [0.0], [0.0])
    assert found.lam == pytest.approx([-2.0 * G])
    assert any("rope: the cable pushes with 19.62 N" in each for each in found.notices)


def test_winches_are_controlled_with_tensions_that_pull():
    """A load on three winches is nearly all on one: no tension is negative."""
    model = pin.Model()
    parent = 0
    for name, kind in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ())):
        parent = model.addJoint(parent, kind, pin.SE3.Identity(), name)
    model.appendBodyToJoint(parent, pin.Inertia.FromSphere(4.0, 0.1), pin.SE3.Identity())
    for k, x in enumerate((-1.0, 0.0, 1.0)):
        at = pin.SE3(np.eye(3), np.array([x, 0, 1.0]))
        j = model.addJoint(0, pin.JointModelRY(), at, f"w{k}")
        model.appendBodyToJoint(j, pin.Inertia.FromSphere(0.5, 0.1), pin.SE3.Identity())
    winches = [f"w{k}" for k in range(3)]
    robot = cp.Robot("crane", model, actuated=winches)
    ropes = [
        TautCable(("z", w), float(np.hypot(k - 1.0, 1.0)), {w: 0.1}, name=f"rope{k}")
        for k, w in enumerate(winches)
    ]
    scene = cp.Scene(robot, ropes)
    task = [
        cp.control.JointTask(joint, a=[a], weight=np.inf) for joint, a in (("x", 9.0), ("z", 0.0))
    ]
    answer = cp.Controller(scene, task, cones={}).solve(np.zeros(5), np.zeros(5))
    assert answer.a[:2] == pytest.approx([9.0, 0.0], abs=1e-6)
    T = answer.lam
    assert T.min() >= -1e-7
    d = np.array([[-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
    pull = T @ (d / np.linalg.norm(d, axis=1)[:, None])
    assert pull == pytest.approx([36.0, 4.0 * G], abs=1e-5)
