"""Rows of functions: a rod and a blade written by hand, beside those of the library."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, relative

import condyn_pin as cp
from condyn_pin.dynamics.compiled import why_not

OwnRows = cp.constraints.OwnRows
LENGTH, TIP = 0.7, pin.SE3(np.eye(3), np.array([0.3, 0.1, -0.2]))


@pytest.fixture(scope="module")
def body() -> cp.Robot:
    """A floating body with an arm, whose tip is a frame."""
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    inertia = pin.Inertia(2.0, np.array([0.1, 0.0, -0.1]), np.diag([0.2, 0.3, 0.4]))
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    i = model.addJoint(i, pin.JointModelRX(), TIP, "arm")
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", i, 0, TIP, pin.FrameType.OP_FRAME))
    return cp.Robot("body", model)


class Rod:
    """c = |p| - length of the tip, by Pinocchio."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self.data, self.tip = model, model.createData(), model.getFrameId("tip")
        self.row = np.zeros((1, model.nv))

    def c(self, q):
        pin.framesForwardKinematics(self.model, self.data, q)
        return [np.linalg.norm(self.data.oMf[self.tip].translation) - LENGTH]

    def J(self, q):
        axes = pin.LOCAL_WORLD_ALIGNED
        six = pin.computeFrameJacobian(self.model, self.data, q, self.tip, axes)
        p = self.data.oMf[self.tip].translation
        self.row[:] = p / np.linalg.norm(p) @ six[:3]
        return self.row  # overwritten by the next call


@pytest.fixture(scope="module")
def scenes(body):
    """The rod by hand and that of the library, with a state of it and torques."""
    rod = Rod(body.model)
    own = cp.Scene(body, [OwnRows(rod.J, violation=rod.c, name="rod")])
    known = cp.Scene(body, [cp.Loop("tip", "world", "rod", length=LENGTH, name="rod")])
    rng = np.random.default_rng(0)
    return own, known, (*known.sample(rng), rng.normal(size=7))


def test_it_is_solved(scenes):
    own, known, state = scenes
    one, two = cp.solve(own, *state), cp.solve(known, *state)
    assert one.status.ok
    assert relative(one.a, two.a) < 1e-10
    assert one.forces["rod"].generalized() == pytest.approx(two.forces["rod"].generalized())
    assert own.summary().mobility == known.summary().mobility == 6
    assert own.summary().constraints == (("rod", "OwnRows", 1),)


@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
def test_it_is_differentiated(scenes, drift):
    """Where it is open and slips too."""
    own, known, (q, v, tau) = scenes
    rng = np.random.default_rng(1)
    q, v = pin.integrate(own.robot.model, q, 1e-2 * rng.normal(size=7)), rng.normal(size=7)
    one, two = (cp.derivatives(scene, q, v, tau, drift=drift) for scene in (own, known))
    for name in ("da_dq", "da_dv", "da_dtau"):
        assert relative(getattr(one, name), getattr(two, name)) < 1e-8


def test_it_is_closed_simulated_and_stepped(scenes):
    own, known, (q, v, _) = scenes
    moved = pin.integrate(own.robot.model, q, 0.1 * np.ones(7))
    closed = own.assemble(moved)
    assert closed.status.ok
    assert np.linalg.norm(Rod(own.robot.model).c(closed.q)) < 1e-10
    exact = cp.simulation.DormandPrince(1e-11, 1e-11)
    ends = [cp.simulate(scene, q, v, duration=0.2, integrator=exact) for scene in (own, known)]
    assert ends[0].violation.max() < 1e-9
    assert np.abs(ends[0].q[-1] - ends[1].q[-1]).max() < 1e-9
    steps = [cp.step(scene, q, v, dt=1e-3) for scene in (own, known)]
    assert np.abs(steps[0].v - steps[1].v).max() < 1e-10


def test_it_follows_a_path(scenes):
    """A hydraulic cylinder by hand; the one of the library has its rows with the other sign."""
    own, known, state = scenes
    path = cp.constraints.Sine(0.1, 0.4, 0.2)
    q, v, tau = state
    one, two = (
        cp.solve(
            cp.Scene(scene.robot, [cp.constraints.Driven(scene.constraints[0], along)]).at(0.3),
            q, v, tau, throw=False,
        )
        for scene, along in ((own, path), (known, lambda t: tuple(-np.array(path(t)))))
    )  # fmt: skip
    assert relative(one.a, two.a) < 1e-10


# A blade in the plane: A(q) v = 0 with q = (x, y, cos, sin) and v along the body.


def blade(q):
    return [[0.0, 1.0, 0.3]]


def turning(q):
    """The same direction in a frame that turns by x y: its rate is known."""
    x, y = q[:2]
    angle = x * y
    return np.array([[np.sin(angle), np.cos(angle), 0.3]])


@pytest.fixture(scope="module")
def sled():
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "sled")
    inertia = pin.Inertia(2.0, np.array([0.1, 0.0, 0.0]), np.diag([0.2, 0.3, 0.4]))
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0]))
    model.addFrame(pin.Frame("edge", i, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("sled", model)


def test_a_blade_by_hand(sled):
    own = cp.Scene(sled, [OwnRows(blade, name="blade")])
    known = cp.Scene(sled, [cp.constraints.KnifeEdge("edge", name="blade")])
    q, v = known.sample(np.random.default_rng(2))
    assert own.constraints[0].on_velocity
    assert not cp.mechanism.is_integrable(own, q)
    found = [cp.simulate(scene, q, v, duration=0.2) for scene in (own, known)]
    assert np.abs(found[0].q - found[1].q).max() < 1e-12


@pytest.mark.parametrize("by_hand", [False, True])
def test_its_own_rate_is_used(sled, by_hand):
    def rate(q, v):
        x, y, c, s = q
        world = c * v[0] - s * v[1], s * v[0] + c * v[1]
        turn = world[0] * y + x * world[1]
        angle = x * y
        return turn * np.array([[np.cos(angle), -np.sin(angle), 0.0]])

    scene = cp.Scene(sled, [OwnRows(turning, rate=rate if by_hand else None, name="blade")])
    rng = np.random.default_rng(5)
    q = pin.integrate(sled.model, pin.neutral(sled.model), rng.normal(size=3))
    v = cp.mechanism.project_velocity(scene, q, rng.normal(size=3))
    gamma = cp.Workspace(scene).terms(q, v).gamma
    assert gamma == pytest.approx(rate(q, v) @ v, abs=1e-11)
    for drift in (None, cp.Baumgarte(3.0, 5.0)):
        cp.derivatives(scene, q, rng.normal(size=3), rng.normal(size=3), drift=drift, check=True)


WRONG = {
    r"jacobian\(q\) has shape \(3, 1\): an array of shape \(1, 3\)": OwnRows(
        lambda q: np.zeros((3, 1)), name="own"
    ),
    r"jacobian\(q\).*nan": OwnRows(lambda q: np.full((1, 3), np.nan), name="own"),
    r"violation\(q\) has shape \(4,\)": OwnRows(blade, violation=lambda q: q, name="own"),
    "is off the rate of violation": OwnRows(blade, violation=lambda q: q[:1], name="own"),
    "is off the rate of jacobian": OwnRows(blade, rate=lambda q, v: np.ones((1, 3)), name="own"),
}


@each_row("message", WRONG)
def test_a_wrong_function_is_named(sled, message):
    with pytest.raises(cp.InvalidArgument, match=f"own: .*{message}"):
        cp.Scene(sled, [WRONG[message]])


BAD = {
    "jacobian = 3": lambda: OwnRows(3, name="own"),
    "violation = 3": lambda: OwnRows(blade, violation=3, name="own"),
    "rows = 0": lambda: OwnRows(blade, 0, name="own"),
    "name": lambda: OwnRows(blade, name=""),
}


@each_row("message", BAD)
def test_a_mistake_is_named(message):
    with pytest.raises(cp.InvalidArgument, match=message):
        BAD[message]()


def test_what_cannot_have_it_says_its_name(scenes, tmp_path):
    own, _, (q, v, tau) = scenes
    assert any("'rod': it has no such rows" in why for why in why_not(cp.Workspace(own)))
    with pytest.raises(cp.errors.CondynError, match="rod: its functions read all of q"):
        own.lock(["arm"])
    with pytest.raises(cp.errors.CondynError, match="rod: MuJoCo has no rows of functions"):
        cp.solve(own, q, v, tau, solver=cp.dynamics.Soft())
    run = cp.simulate(own, q, v, duration=0.01)
    with pytest.raises(cp.errors.CondynError, match="rod: jacobian is a function"):
        run.save(tmp_path / "run.npz")


# A bead on a wire that turns at W: c = n . x with n = (-sin W t, cos W t), of which time is a part.
# Closed form: r = r_0 cosh W t, and the wire pushes with 2 m W r'.

W, MASS = 1.3, 2.0


def across(t):
    return np.array([-np.sin(W * t), np.cos(W * t)])


WIRES = {
    "c(q, t)": OwnRows(
        lambda q, t: across(t)[None],
        violation=lambda q, t: [across(t) @ q],
        name="wire",
        rheonomic=True,
    ),
    "c(q, t) with its rates": OwnRows(
        lambda q, t: across(t)[None],
        violation=lambda q, t: [across(t) @ q],
        rate=lambda q, v, t: W * across(t + np.pi / 2 / W)[None],
        speed=lambda q, t: [-W * across(t + np.pi / 2 / W) @ q],
        name="wire",
        rheonomic=True,
    ),
    "J v = b(q, t)": OwnRows(
        lambda q, t: across(t)[None],
        speed=lambda q, t: [-W * across(t + np.pi / 2 / W) @ q],
        name="wire",
        rheonomic=True,
    ),
}


@pytest.fixture(scope="module")
def bead():
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    i = model.addJoint(i, pin.JointModelPY(), pin.SE3.Identity(), "y")
    model.appendBodyToJoint(i, pin.Inertia.FromSphere(MASS, 0.1), pin.SE3.Identity())
    return cp.Robot("bead", model)


@pytest.fixture(params=WIRES)
def turning_wire(request, bead):
    return cp.Scene(bead, [WIRES[request.param]])


def test_a_bead_on_a_turning_wire(turning_wire):
    """Position, force and energy of the closed form."""
    r0, T = 0.4, 1.0
    exact = cp.simulation.DormandPrince(1e-11, 1e-11)
    run = cp.simulate(turning_wire, [r0, 0.0], [0.0, r0 * W], duration=T, integrator=exact)
    r, rate = r0 * np.cosh(W * run.t), r0 * W * np.sinh(W * run.t)
    along = np.array([np.cos(W * run.t), np.sin(W * run.t)]).T
    assert np.abs(run.q - r[:, None] * along).max() < 1e-9
    assert run.forces["wire"][:, 0] == pytest.approx(2 * MASS * W * rate, abs=1e-7)
    assert run.status.ok
    assert run.energy.driven[-1] == pytest.approx(MASS * rate[-1] ** 2, rel=1e-5)
    stepped = cp.simulate(turning_wire, [r0, 0.0], [0.0, r0 * W], duration=T, dt=2e-3)
    assert np.abs(stepped.q[-1] - run.q[-1]).max() < 1e-8


def test_time_enters_one_instant(turning_wire):
    """Solve, derivatives, projections, steps and control at a time."""
    t = 0.7
    scene = turning_wire.at(t)
    q, v, tau = np.array([0.3, 0.2]), np.array([0.5, -0.4]), np.array([1.0, 2.0])
    if scene.constraints[0].violation:
        q = scene.assemble(q).q
        assert across(t) @ q == pytest.approx(0.0, abs=1e-12)
    v = cp.mechanism.project_velocity(scene, q, v)
    n, along = across(t), np.array([np.cos(W * t), np.sin(W * t)])
    r, rate = along @ q, along @ v
    assert n @ v == pytest.approx(W * r, abs=1e-10)
    a = cp.solve(scene, q, v, tau).a
    # (n . x)'' = 0,    n' = -W along
    assert a @ n == pytest.approx(2 * W * rate + W**2 * (n @ q), abs=1e-8)
    assert a @ along == pytest.approx(along @ tau / MASS, abs=1e-8)
    cp.derivatives(scene, q, v, tau, check=True)
    cp.derivatives(scene, q, v, tau, drift=cp.Baumgarte(3.0, 5.0), check=True)
    assert cp.dynamics.impact(scene, q, np.zeros(2)).v @ n == pytest.approx(W * r, abs=1e-9)
    after = cp.step(scene, q, v, tau, dt=1e-4, integrator=cp.Moreau())
    assert after.v - v == pytest.approx(1e-4 * a, abs=1e-6)


def test_where_time_is_refused(turning_wire, tmp_path):
    state = [0.4, 0.0], [0.0, 0.4 * W]
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"wire.*scene\.at\(t\)"):
        cp.solve(turning_wire, *state, np.zeros(2))
    with pytest.raises(cp.errors.CondynError, match="wire: time is in its functions"):
        cp.Scene(
            turning_wire.robot,
            [cp.constraints.Driven(turning_wire.constraints[0], cp.constraints.Sine(0.1))],
        )
    run = cp.simulate(turning_wire, *state, duration=0.01, integrator=cp.StewartTrinkle())
    with pytest.raises(cp.errors.CondynError, match="wire: time is in its functions"):
        cp.gradients.trajectory_derivatives(run)
    with pytest.raises(cp.errors.CondynError, match=r"a function.*a kind of your own"):
        run.save(tmp_path / "run.npz")
    with pytest.raises(cp.errors.InvalidArgument, match=r"own: speed and time.*rheonomic=True"):
        OwnRows(blade, speed=lambda q, t: [0.0], name="own")
