"""A cut joint moves like the joint: every kind of constraint against a closed form or a tree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shared import each_row, relative, robot

import condyn_pin as cp

GRAVITY = 9.81
INERTIA = pin.Inertia(
    2.0,
    np.array([0.1, -0.05, 0.2]),
    np.array([[0.3, 0.02, 0.01], [0.02, 0.25, -0.03], [0.01, -0.03, 0.2]]),
)
AXES = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}


def placement(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    return pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.5, 0.5, 3))


def loose(joint: object, on_world: pin.SE3, on_body: pin.SE3) -> tuple[cp.Robot, cp.Robot]:
    """A body on a joint, and the same body floating, with a frame at each half of the joint."""
    held, free = pin.Model(), pin.Model()
    i = held.addJoint(0, joint, on_world, "joint")
    held.appendBodyToJoint(i, INERTIA, on_body.inverse())
    i = free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    free.appendBodyToJoint(i, INERTIA, pin.SE3.Identity())
    free.addFrame(pin.Frame("on_body", i, 0, on_body, pin.FrameType.OP_FRAME))
    free.addFrame(pin.Frame("on_world", 0, 0, on_world, pin.FrameType.OP_FRAME))
    return cp.Robot("held", held), cp.Robot("free", free)


def same_state(held: cp.Robot, q: np.ndarray, v: np.ndarray, on_body: pin.SE3):
    """The state of the floating body when the held one is at (q, v)."""
    data = held.model.createData()
    pin.forwardKinematics(held.model, data, q, v)
    placed = data.oMi[1] * on_body.inverse()
    twist = on_body.act(data.v[1])
    return pin.SE3ToXYZQUAT(placed), twist.vector


JOINTS = [
    ("hinge", "x", pin.JointModelRX()),
    ("hinge", "y", pin.JointModelRY()),
    ("hinge", "z", pin.JointModelRZ()),
    ("slider", "x", pin.JointModelPX()),
    ("slider", "y", pin.JointModelPY()),
    ("slider", "z", pin.JointModelPZ()),
    ("ball", None, pin.JointModelSpherical()),
]


def motion_of(kind: str, axis: str | None) -> np.ndarray:
    """The motion subspace of the joint, (6, nv)."""
    if kind == "ball":
        return np.vstack([np.zeros((3, 3)), np.eye(3)])
    e = AXES[axis]
    return np.concatenate([0 * e, e] if kind == "hinge" else [e, 0 * e])[:, None]


@pytest.mark.parametrize("world_first", [True, False])
@pytest.mark.parametrize(("kind", "axis", "joint"), JOINTS)
def test_a_cut_joint_moves_like_the_joint(kind, axis, joint, world_first):
    """The same body, once on the joint, once floating with the joint as a loop to the world."""
    on_world, on_body = placement(1), placement(2)
    held, free = loose(joint, on_world, on_body)
    rng = np.random.default_rng(3)
    q = pin.integrate(held.model, pin.neutral(held.model), rng.uniform(-1.5, 1.5, held.nv))
    v, tau = rng.normal(size=(2, held.nv))
    a = cp.solve(cp.Scene(held), q, v, tau).a

    frames = ("on_world", "on_body") if world_first else ("on_body", "on_world")
    scene = cp.Scene(free, [cp.Loop(*frames, kind, axis)])
    q_free, v_free = same_state(held, q, v, on_body)
    of_motor = motion_of(kind, axis) @ tau
    solution = cp.solve(scene, q_free, v_free, on_body.act(pin.Force(of_motor)).vector)
    assert solution.state_error.position < 1e-12
    assert solution.state_error.velocity < 1e-12

    data = held.model.createData()
    pin.rnea(held.model, data, q, v, a)
    pin.forwardKinematics(held.model, data, q, v, a)
    assert relative(solution.a, on_body.act(data.a[1]).vector) < 1e-9
    # what the joint carries on the body: all that Newton-Euler finds there but the motor's part
    R, carried = data.oMi[1].rotation, data.f[1].vector - of_motor
    force, moment = R @ carried[:3], R @ carried[3:]
    if kind == "slider" and not world_first:  # reported at the origin of the world's frame
        moment = moment + np.cross(data.oMi[1].translation - on_world.translation, force)
    wanted = np.concatenate([force, moment])[: 3 if kind == "ball" else 6]
    (found,) = solution.world_forces.values()
    assert np.abs(found - (-wanted if world_first else wanted)).max() < 1e-8


@pytest.mark.long
@pytest.mark.parametrize("kind", ["planar", "rod"])
def test_a_planar_linkage_needs_no_more_than(kind):
    """Two rows close a four-bar as well as three; a weightless coupler is a rod."""
    bar = robot("four_bar")
    q, v = cp.Scene(bar, bar.loops).sample(np.random.default_rng(2))
    tau = np.array([1.0, 0.0, -2.0])
    if kind == "planar":
        whole = cp.solve(cp.Scene(bar, bar.loops), q, v, tau)
        scene = cp.Scene(bar, [cp.Loop("coupler_tip", "rocker_tip", "planar", axis="y")])
        solution = cp.solve(scene, q, v, tau, solver=cp.DenseKKT())  # independent rows
        assert relative(solution.a, whole.a) < 1e-10
        plane = np.delete(solution.world_forces[scene.names[0]], 1)
        assert np.abs(plane - np.delete(whole.world_forces["coupler_rocker"], 1)).max() < 1e-8
        return
    model = pin.Model(bar.model)
    light = pin.Inertia(1e-6, np.array([0.4, 0, 0]), 1e-7 * np.eye(3))
    model.inertias[bar.model.getJointId("coupler")] = light
    airy = cp.Robot("airy", model, loops=bar.loops)
    whole = cp.solve(cp.Scene(airy, airy.loops), q, v, tau, solver=cp.dynamics.Reference())
    scene = cp.Scene(airy, [cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8)])
    solution = cp.solve(scene, q, v, tau)
    assert relative(solution.a[[0, 2]], whole.a[[0, 2]]) < 1e-4


def test_a_rod_is_a_spherical_pendulum():
    """A point mass on a rod, swinging in a circle: the tension is m (g cos + v^2 / L)."""
    length, mass = 0.7, 2.0
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "point")
    model.appendBodyToJoint(i, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    model.addFrame(pin.Frame("mass", i, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("pendulum", model), [cp.Loop("mass", "world", "rod", length=length)])
    angle, speed = 0.6, 1.3
    down, along = (
        np.array([np.sin(angle), 0, -np.cos(angle)]),
        np.array([np.cos(angle), 0, np.sin(angle)]),
    )
    q, v = length * down, speed * along
    solution = cp.solve(scene, q, v, np.zeros(3))
    tension = mass * (GRAVITY * np.cos(angle) + speed**2 / length)
    assert solution.lam[0] == pytest.approx(tension, rel=1e-12)
    assert np.allclose(solution.world_forces["mass~world"], -tension * down, rtol=1e-12)
    assert solution.a @ along == pytest.approx(-GRAVITY * np.sin(angle), rel=1e-12)


def test_a_block_slides_down_a_plane():
    """Without friction, g sin(angle) along it; the plane carries m g cos(angle)."""
    angle, mass = 0.4, 3.0
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(i, pin.Inertia.FromBox(mass, 0.1, 0.1, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("block", i, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    block = cp.Robot("block", model)
    scene = cp.Scene(block, [cp.constraints.PlanarContact("block", normal=normal, height=0.5)])
    q, _ = scene.state()
    assert q[:3] @ normal == pytest.approx(0.5, abs=1e-12)
    solution = cp.solve(scene, q, np.zeros(6), np.zeros(6))
    assert solution.lam[0] == pytest.approx(mass * GRAVITY * np.cos(angle), rel=1e-12)
    R = pin.XYZQUATToSE3(q).rotation
    downhill = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    assert np.allclose(R @ solution.a[:3], GRAVITY * np.sin(angle) * downhill, atol=1e-10)
    assert np.allclose(solution.world_forces["block"], solution.lam[0] * normal, rtol=1e-12)


@given(st.floats(-5, 5).filter(lambda r: abs(r) > 1e-3), st.floats(-1, 1))
def test_geared_flywheels(ratio, offset):
    """(I_a ratio^2 + I_b) q_b'' = tau_b + ratio tau_a."""
    I_a, I_b, tau = 0.3, 0.8, np.array([2.0, -1.0])
    model = pin.Model()
    for name, moment in (("a", I_a), ("b", I_b)):
        i = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        wheel = pin.Inertia(1.0, np.zeros(3), moment * np.eye(3))
        model.appendBodyToJoint(i, wheel, pin.SE3.Identity())
    scene = cp.Scene(cp.Robot("wheels", model), [cp.constraints.Coupling("a", "b", ratio, offset)])
    q, _ = scene.state()
    assert q[0] == pytest.approx(ratio * q[1] + offset, abs=1e-10)
    solution = cp.solve(scene, q, np.zeros(2), tau)
    b = (tau[1] + ratio * tau[0]) / (I_a * ratio**2 + I_b)
    assert solution.a == pytest.approx([ratio * b, b], rel=1e-9, abs=1e-9)
    assert solution.forces["a~b"][0] == pytest.approx(I_a * ratio * b - tau[0], rel=1e-9, abs=1e-8)


@pytest.mark.long
def test_an_edge_is_its_two_ends():
    """5 rows or 6 with one of them redundant: the same motion, the same wrench."""
    talos = robot("talos")
    edge = cp.constraints.LineContact("left_sole_link", "y", half_length=0.06)
    line, ends = cp.Scene(talos, [edge]), cp.Scene(talos, edge.ends())
    q, v = line.sample(np.random.default_rng(4))
    tau = np.zeros(talos.nv)
    one, two = cp.solve(line, q, v, tau, solver=cp.DenseKKT()), cp.solve(ends, q, v, tau)
    assert relative(one.a, two.a) < 1e-9
    front, back = two.forces.values()
    lever = np.array([0.0, 0.06, 0.0])
    wrench = np.concatenate([front + back, np.cross(lever, front - back)])
    assert np.abs(one.forces["left_sole_link"] - wrench).max() < 1e-7
    assert one.forces["left_sole_link"][4] == 0.0  # it can roll about y


@pytest.mark.long
def test_an_axis_that_points_backwards_is_half_a_turn_off():
    """Not closed: the cross product of the axes alone would be zero."""
    _, free = loose(pin.JointModelRZ(), pin.SE3.Identity(), pin.SE3.Identity())
    scene = cp.Scene(free, [cp.Loop("on_body", "on_world", "hinge", axis="z")])
    c = cp.Workspace(scene).violation
    upright = np.array([0, 0, 0, 0, 0, np.sin(0.7), np.cos(0.7)])
    assert np.abs(c(upright)).max() < 1e-15
    for flipped in ([1.0, 0, 0, 0], [0, 1.0, 0, 0]):
        assert np.linalg.norm(c(np.array([0, 0, 0, *flipped]))) == pytest.approx(np.pi)
    for tilt in (1e-9, 1e-3, 1.0, 3.1):
        tilted = np.array([0, 0, 0, np.sin(tilt / 2), 0, 0, np.cos(tilt / 2)])
        assert np.linalg.norm(c(tilted)) == pytest.approx(tilt)
        closed = scene.assemble(tilted).q
        assert np.abs(c(closed)).max() < 1e-12


@pytest.mark.parametrize("other", ["x", "y", "z"])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_backward_axis_shows_beside_another_hinge(axis, other):
    _, free = loose(pin.JointModelRZ(), pin.SE3.Identity(), pin.SE3.Identity())
    hinges = [
        cp.Loop("on_body", "on_world", "hinge", a, name=n) for n, a in (("1", axis), ("2", other))
    ]
    c = cp.Workspace(cp.Scene(free, hinges)).violation
    for flip in np.eye(3):
        q = np.array([0, 0, 0, *flip, 0.0])
        for k, a in enumerate((axis, other)):
            turned = "xyz"[int(np.argmax(flip))] != a
            size = np.linalg.norm(c(q)[5 * k : 5 * k + 5])
            assert size == pytest.approx(np.pi if turned else 0.0, abs=1e-12)


BAD = {
    "a rod without length": lambda: cp.Loop("a", "b", "rod"),
    "a ball with a length": lambda: cp.Loop("a", "b", length=1.0),
    "a negative length": lambda: cp.Loop("a", "b", "rod", length=-1.0),
    "a length of nan": lambda: cp.Loop("a", "b", "rod", length=np.nan),
    **{
        f"a {kind} without an axis": lambda kind=kind: cp.Loop("a", "b", kind)
        for kind in ("hinge", "slider", "cylindrical", "planar", "universal")
    },
    **{
        f"a {kind} with an axis": lambda kind=kind: cp.Loop("a", "b", kind, axis="y")
        for kind in ("ball", "weld", "rod")
    },
    "an axis w": lambda: cp.Loop("a", "b", "hinge", axis="w"),
    "two axes of a hinge": lambda: cp.Loop("a", "b", "hinge", axis="xy"),
    "one axis of a cross": lambda: cp.Loop("a", "b", "universal", axis="x"),
    "one axis of a cross twice": lambda: cp.Loop("a", "b", "universal", axis="xx"),
    "an axis 2": lambda: cp.Loop("a", "b", "hinge", axis=2),
    "a ratio of zero": lambda: cp.constraints.Coupling("a", "b", 0.0),
    "a ratio of nan": lambda: cp.constraints.Coupling("a", "b", np.nan),
    "a ratio of text": lambda: cp.constraints.Coupling("a", "b", "two"),
    "an offset of inf": lambda: cp.constraints.Coupling("a", "b", 1.0, np.inf),
    "a joint without name": lambda: cp.constraints.Coupling("", "b"),
    "an edge along w": lambda: cp.constraints.LineContact("a", "w"),
    "an edge of length 0": lambda: cp.constraints.LineContact("a", half_length=0.0),
    "an edge at a zero quaternion": lambda: cp.constraints.LineContact("a", anchor=(0,) * 7),
    "ends without a length": lambda: cp.constraints.LineContact("a").ends(),
    "a plane without normal": lambda: cp.constraints.PlanarContact("a", normal=(0, 0, 0)),
    "a plane at nan": lambda: cp.constraints.PlanarContact("a", height=np.nan),
    "a point of two numbers": lambda: cp.constraints.PlanarContact("a", offset=(0, 0)),
}


@each_row("what", list(BAD))
def test_constraints_refuse(what):
    with pytest.raises(cp.InvalidArgument, match=r"=|needed|is not set|is zero"):
        BAD[what]()


@each_row(
    ("coupling", "error", "match"),
    [
        (("crank", "parameter"), cp.errors.UnknownName, "no joint named 'parameter'"),
        (("universe", "crank"), cp.errors.UnknownName, "no joint named 'universe'"),
        (("crank", "universe"), cp.errors.UnknownName, "no joint named 'universe'"),
        (("crank", "crank"), cp.errors.InvalidConstraint, "both joints are 'crank'"),
    ],
)
def test_couplings_refuse(coupling, error, match):
    with pytest.raises(error, match=match):
        cp.Scene(robot("four_bar"), [cp.constraints.Coupling(*coupling)])


def test_a_coupling_needs_joints_with_one_number():
    with pytest.raises(cp.errors.InvalidConstraint, match="nq 7, nv 6"):
        cp.Scene(robot("talos"), [cp.constraints.Coupling("root_joint", "torso_1_joint")])


@pytest.mark.long
def test_the_default_solver_takes_the_scene():
    bar, talos = robot("four_bar"), robot("talos")
    rod = cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8)
    assert cp.Workspace(cp.Scene(bar, bar.loops)).solver == cp.Proximal()
    assert cp.Workspace(cp.Scene(bar, [rod])).solver == cp.DenseKKT()
    assert cp.Workspace(cp.Scene(bar, [rod, *bar.loops])).solver == cp.dynamics.NullSpace()
    with pytest.raises(
        cp.errors.UnsupportedConstraint, match=r"crank_tip~rocker_tip.*DenseKKT\(\)"
    ):
        cp.Workspace(cp.Scene(bar, [rod]), cp.Proximal())
    workspace = cp.Workspace(cp.Scene(talos, talos.contacts))
    before = workspace.scene
    with pytest.raises(cp.errors.UnsupportedConstraint, match="gear"):
        workspace.use(
            cp.Scene(
                talos, [cp.constraints.Coupling("torso_1_joint", "torso_2_joint", name="gear")]
            )
        )
    assert workspace.scene is before  # a refused switch leaves everything as it was
    assert workspace.solve(*workspace.scene.state(), np.zeros(talos.nv)).status.ok


@pytest.mark.parametrize(
    "constraint",
    [
        cp.PointContact("tip"),
        cp.SurfaceContact("tip"),
        cp.constraints.LineContact("tip", "x"),
        cp.constraints.PlanarContact("tip", normal=(1.0, 0.0, 0.0)),
        cp.Loop("tip", "beside"),
        cp.Loop("tip", "beside", "weld"),
        cp.Loop("tip", "beside", "slider", axis="x"),
        cp.Loop("tip", "beside", "rod", length=0.8),
    ],
    ids=lambda constraint: getattr(constraint, "kind", type(constraint).__name__),
)
def test_a_robot_of_a_single_joint_takes_every_kind(constraint):
    """Pinocchio gives Jacobians of a single column as vectors."""
    pendulum = cp.model.pendulum().with_frame("beside", "world", (0.6, 0.0, -0.4))
    scene = cp.Scene(replace(pendulum, precision=0.0), [constraint])  # it cannot be closed
    q = np.array([0.3])
    solution = cp.solve(scene, q, [0.0], [0.2], solver=cp.dynamics.Reference())
    derivatives = cp.derivatives(scene, q, [0.0], [0.2], solver=cp.dynamics.Reference())
    assert abs(solution.a[0]) < 1e-10  # the one joint is blocked
    assert derivatives.da_dq.shape == (1, 1)
    assert derivatives.dlam_dtau.shape == (scene.rows, 1)
    assert abs(cp.impact(scene, q, [1.0]).v[0]) < 1e-12
