"""Forces as values: on whom, by whom, where, in which axes; and contacts that pull."""

from __future__ import annotations

import dataclasses
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, axis_of, each_scene, robot, states
from test_traps import two_boxes

import condyn_pin as cp
from condyn_pin.constraints.rows.special import BoundCoupling

GRAVITY = 9.81


def box() -> cp.Robot:
    """A box of 2 kg, turned; its hook is above its centre, its ceiling there in the world."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.addJointFrame(joint)
    model.appendBodyToJoint(
        joint, pin.Inertia(2.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity()
    )
    hook = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.0, 0.0, 0.4]))
    made = cp.Robot("box", model).with_frame("hook", "float", hook.translation, hook.rotation)
    return made.with_frame("ceiling", "world", hook.translation, hook.rotation)


def hung(constraint: cp.constraints.Constraint) -> cp.dynamics.ConstraintForce:
    made = box()
    solution = cp.solve(cp.Scene(made, [constraint]), pin.neutral(made.model), *np.zeros((2, 6)))
    (force,) = solution.forces.values()
    return force


HUNG = {
    "point": (cp.PointContact("hook"), "hook", "world", "hook", 1.0),
    "surface": (cp.SurfaceContact("hook"), "hook", "world", "hook", 1.0),
    "line": (cp.constraints.LineContact("hook"), "hook", "world", "hook", 1.0),
    "ball": (cp.Loop("hook", "ceiling"), "hook", "ceiling", "hook", 1.0),
    "ball, world first": (cp.Loop("ceiling", "hook"), "ceiling", "hook", "hook", -1.0),
    "weld": (cp.Loop("hook", "ceiling", "weld"), "hook", "ceiling", "hook", 1.0),
    "weld, world first": (cp.Loop("ceiling", "hook", "weld"), "ceiling", "hook", "hook", -1.0),
    "hinge": (cp.Loop("hook", "ceiling", "hinge", "z"), "hook", "ceiling", "hook", 1.0),
    "slider": (cp.Loop("ceiling", "hook", "slider", "z"), "ceiling", "hook", "ceiling", None),
    "plane": (cp.constraints.PlanarContact("hook"), "hook", "world", "hook/plane", 1.0),
}


@pytest.mark.parametrize("label", HUNG)
def test_a_hanging_box_says_who_holds_whom_and_where(label):
    constraint, on, by, frame, sign = HUNG[label]
    force = hung(constraint)
    assert (force.on, force.by, force.frame) == (on, by, frame)
    assert force.name == constraint.name
    assert np.allclose(force.at, [0.0, 0.0, 0.4], atol=1e-12)
    other = force.on_other()
    assert (other.on, other.by, other.frame) == (by, on, frame)
    assert np.array_equal(other, -force)
    assert np.array_equal(other.in_world(), -force.in_world())
    assert np.array_equal(other.on_other(), force)
    assert other.on_other().on == on
    if sign is not None:  # a slider lets the box go, along its axis
        up = sign * np.array([0.0, 0.0, 2.0 * GRAVITY])
        assert np.allclose(force.in_world()[:3], up, atol=1e-9)


def test_a_rod_pulls_along_itself():
    """Below its hook, at the length that it has."""
    made = box().with_frame("above", "world", [0.0, 0.0, 1.0])
    rod = cp.Loop("hook", "above", "rod", length=0.6, name="rod")
    force = cp.solve(cp.Scene(made, [rod]), pin.neutral(made.model), *np.zeros((2, 6))).forces[
        "rod"
    ]
    assert np.allclose(force.in_world(), [0.0, 0.0, 2.0 * GRAVITY], atol=1e-9)
    assert (force.on, force.by, force.frame) == ("hook", "above", "hook")


@each_scene
def test_generalised_forces_add_up_to_those_of_lam(label):
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    solution = cp.solve(scene, q, v, tau)
    J = cp.Workspace(scene).jacobian(q)
    total = np.zeros(scene.robot.nv)
    for force in solution.forces.values():
        assert np.array_equal(force.generalized(), force.on_other().generalized())
        total += force.generalized()
    wanted = J.T @ solution.lam
    assert np.abs(total - wanted).max() < 1e-12 * max(
        np.abs(J).max(initial=0.0) * np.abs(solution.lam).sum(), 1.0
    )


@each_scene
def test_force_and_opposite_do_the_work_of_the_rows(label):
    """J^T lam again: each force of the pair at the point where it says that it acts."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    model, data = scene.robot.model, scene.robot.model.createData()
    pin.computeJointJacobians(model, data, q)
    solution = cp.solve(scene, q, v, tau)
    for name, world in solution.world_forces.items():
        assert np.array_equal(world, solution.forces[name].in_world())
    for bound, force in zip(scene.bounds, solution.forces.values(), strict=True):
        work = np.zeros(scene.robot.nv)
        for side in (force, force.on_other()):
            if isinstance(bound, BoundCoupling):
                joint = model.joints[model.getJointId(side.on)]
                work[joint.idx_v] += side[0]
                continue
            joint, _ = scene.robot.frame(side.on)
            if joint == 0:
                continue
            wrench = np.zeros(6)
            wrench[: side.size] = side.in_world()
            there = data.oMi[joint].actInv(pin.SE3(np.eye(3), side.at))
            work += pin.getFrameJacobian(model, data, joint, there, pin.LOCAL).T @ wrench
        wanted = force.generalized()
        assert np.abs(work - wanted).max() < 1e-9 * max(np.abs(wanted).max(), scene.nominal.weight)


@pytest.mark.values
@pytest.mark.parametrize(
    "kind", ["ball", "weld", "hinge", "slider", "cylindrical", "planar", "universal", "rod"]
)
@pytest.mark.parametrize("order", [("one_corner", "two_corner"), ("two_corner", "one_corner")])
def test_newtons_third_law(kind, order):
    """Force and opposite, with their moments about the origin of the world, are nothing."""
    length = 0.8 if kind == "rod" else None
    axis = "xz" if kind == "universal" else axis_of(kind)
    scene = cp.Scene(two_boxes(), [cp.Loop(*order, kind, axis, length, name="it")])
    rng = np.random.default_rng(0)
    q, v = scene.sample(rng, spread=0.5)
    tau = rng.normal(size=12)
    solution = cp.solve(scene, q, v, tau)
    force = solution.forces["it"]
    other = cp.Scene(two_boxes(), [cp.Loop(*order[::-1], kind, axis, length, name="it")])
    if kind in ("ball", "weld"):  # the others have other rows, in other axes, off their loops
        named_otherwise = cp.solve(other, q, v, tau).forces["it"].in_world()
        assert np.allclose(named_otherwise[:3], -force.in_world()[:3], atol=1e-8)
    total, changes = np.zeros(6), np.zeros(6)
    for side in (force, force.on_other()):
        f, m = np.zeros((2, 3))
        f[:] = side.in_world()[:3]
        m[:] = side.in_world()[3:] if side.size == 6 else 0.0
        total += np.concatenate([f, m + np.cross(side.at, f)])
        changes[:3] += np.abs(f)
        assert np.linalg.norm(f) > 1e-3 or np.linalg.norm(m) > 1e-3
    assert np.abs(total).max() < 1e-9
    assert force.on == order[0]
    assert force.by == order[1]
    # and the momentum of both bodies changes by the outer forces alone
    model, data = scene.robot.model, scene.robot.model.createData()
    pin.computeCentroidalMomentumTimeVariation(model, data, q, v, solution.a)
    outer = np.zeros(3)
    for name in ("one", "two"):
        joint = model.getJointId(name)
        R = data.oMi[joint].rotation
        outer += R @ tau[6 * (joint - 1) : 6 * (joint - 1) + 3]
    assert np.allclose(data.dhg.linear, outer, atol=1e-9)


@pytest.mark.long
def test_a_ball_that_is_open_acts_at_each_bodys_own_point():
    made = replace(two_boxes(), precision=0.0)  # wide open: the rows at their word
    scene = cp.Scene(made, [cp.Loop("one_corner", "two_corner", name="it")])
    q = pin.neutral(made.model)
    force = cp.solve(scene, q, *np.random.default_rng(0).normal(size=(2, 12))).forces["it"]
    model, data = made.model, made.model.createData()
    pin.framesForwardKinematics(model, data, q)
    for side, frame in ((force, "one_corner"), (force.on_other(), "two_corner")):
        assert np.allclose(side.at, data.oMf[model.getFrameId(frame)].translation)
    assert np.linalg.norm(force.at - force.on_other().at) > 0.1


def test_a_coupling_acts_along_joints():
    scene = all_scenes()["four_bar geared"]
    solution = cp.solve(scene, *states("four_bar geared")[0])
    (force,) = solution.forces.values()
    assert (force.on, force.by, force.frame, force.shape) == ("rocker", "crank", "", (1,))
    other = force.on_other()
    assert other.on == "crank"
    assert other[0] == pytest.approx(0.5 * force[0])  # minus the ratio, -0.5
    assert np.allclose(other.on_other(), force)
    work = force.generalized()
    assert np.allclose(work, [other[0], 0.0, force[0]])
    for call in (lambda: force.at, force.in_world):
        with pytest.raises(cp.InvalidArgument, match="at no point"):
            call()
    assert solution.world_forces == {}


@pytest.mark.long
def test_a_force_works_as_the_array_of_its_numbers():
    force = hung(cp.SurfaceContact("hook"))
    numbers = np.asarray(force)
    assert isinstance(numbers, np.ndarray)
    assert (len(force), force.size, force.shape) == (6, 6, (6,))
    assert force.tolist() == numbers.tolist() == list(force)
    assert np.array_equal(force[:3], numbers[:3])
    assert np.array_equal(force + force, 2 * numbers)
    assert np.array_equal(1.0 - force, 1.0 - numbers)
    assert np.array_equal(-force, -numbers)
    assert np.array_equal(np.abs(force), np.abs(numbers))
    assert np.array_equal(sum([force, force]), 2 * numbers)
    assert np.array_equal(np.eye(6) @ force, numbers)
    assert force @ force == pytest.approx(numbers @ numbers)
    assert np.array_equal(np.concatenate([force, force]), np.concatenate([numbers, numbers]))
    assert np.array_equal(np.array([force]), np.array([numbers]))
    assert np.array_equal(force.round(3), numbers.round(3))
    assert np.array_equal(np.round(force, 3), numbers.round(3))
    assert np.asarray(force, dtype=np.float32).dtype == np.float32
    assert type(force * 2.0) is np.ndarray
    assert (force == numbers).all()
    assert np.linalg.norm(force) == np.linalg.norm(numbers)


def test_a_force_is_a_value():
    force = hung(cp.SurfaceContact("hook"))
    with pytest.raises(dataclasses.FrozenInstanceError):
        force.on = "someone"
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(force)[0] = 1.0
    own = force.copy()
    own[0] = 1e3
    assert force[0] != 1e3
    copy = pickle.loads(pickle.dumps(force))
    assert np.array_equal(copy, force)
    assert np.array_equal(copy.in_world(), force.in_world())
    assert copy.on == force.on
    assert repr(force).startswith("ConstraintForce(hook: [")
    assert repr(force).endswith("on hook by world, axes of hook)")


def test_a_contact_that_pulls_is_noticed():
    """The pelvis pulled down faster than it falls; standing, there is none."""
    talos = robot("talos")
    stance = cp.Scene(talos, talos.contacts)
    q, v = stance.state()
    standing = cp.control.gravity_compensation(stance, q)
    assert cp.solve(stance, q, v, standing.tau).notices == ()
    down = np.zeros(talos.nv)
    down[2] = -3 * GRAVITY
    tau = cp.inverse_dynamics(stance, q, v, down).tau
    lifted = cp.solve(stance, q, v, tau)
    names = [contact.name for contact in talos.contacts]
    assert len(lifted.notices) == 2
    for name, notice in zip(names, lifted.notices, strict=True):
        pull = -lifted.forces[name][2]
        assert pull > 100.0
        assert notice.startswith(f"{name}: the contact pulls with {pull:.4g} N;")
    assert lifted.notices[0] in str(lifted)
    corners = cp.Scene(talos, [c for contact in talos.contacts for c in contact.corners()])
    pulled = cp.solve(corners, q, v, tau).notices
    (said,) = pulled  # eight corners share it, and none of their shares is determined
    assert all(name in said for name in corners.names)
    assert "one of them pulls with " in said


@pytest.mark.long
def test_a_loop_may_pull_and_a_wall_may_push_sideways():
    """Loops are no contacts; a plane knows its normal; without gravity a point has none."""
    made = box()
    assert hung(cp.Loop("ceiling", "hook"))[2] < 0.0
    q = pin.neutral(made.model)
    hanging = cp.Scene(made, [cp.Loop("ceiling", "hook")])
    assert cp.solve(hanging, q, *np.zeros((2, 6))).notices == ()
    wall = cp.Scene(
        made, [cp.constraints.PlanarContact("float", normal=(1.0, 0.0, 0.0), name="wall")]
    )
    for push, pulls in ((-5.0, False), (5.0, True)):
        tau = np.array([push, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert bool(cp.solve(wall, q, np.zeros(6), tau).notices) == pulls
    weightless = pin.Model(made.model)
    weightless.gravity = pin.Motion.Zero()
    for model, noticed in ((made.model, True), (weightless, False)):
        held = cp.Scene(cp.Robot("held", model), [cp.PointContact("hook")])
        solution = cp.solve(held, q, np.zeros(6), np.array([1.0, 0.0, 90.0, 0.0, 0.0, 0.0]))
        assert bool(solution.notices) == noticed


@pytest.mark.long
def test_the_solve_itself_computes_no_force():
    """They are found when asked for."""
    scene, state = all_scenes()["talos contacts"], states("talos contacts")[0]
    solution = cp.solve(scene, *state)
    assert "_sites" not in vars(solution)
    force = solution.forces["left_sole_link"]
    assert not {"placements", "jacobian"} & set(vars(force._sites))
    force.in_world()
    assert "placements" in vars(force._sites)
    assert "jacobian" not in vars(force._sites)


# Pulls that redundant contacts need not exert -----------------------------------------------------


def table(x: float, y: float) -> cp.Scene:
    """4 kg on legs at (+-1, +-1) m, the centre of mass over (x, y)."""
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    body = pin.Inertia(4.0, np.array([x, y, 0.6]), 0.3 * np.eye(3))
    model.appendBodyToJoint(i, body, pin.SE3.Identity())
    for k, corner in enumerate([(1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0)]):
        at = pin.SE3(np.eye(3), np.array(corner, dtype=float))
        model.addFrame(pin.Frame(f"leg{k}", i, 0, at, pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("table", model), [cp.PointContact(f"leg{k}") for k in range(4)])


def test_a_leg_that_pulls_in_the_smallest_forces_alone_is_no_news():
    """Its share is W (1 - x - y) / 4 there, but three legs carry what is between them."""
    scene = table(0.7, 0.7)
    q, v = scene.state()
    solution = cp.solve(scene, q, v, np.zeros(6))
    assert solution.forces["leg3"][2] == pytest.approx(4 * 9.81 * (1 - 1.4) / 4)
    assert not [said for said in solution.notices if "pull" in said]
    run = cp.simulate(scene, q, v, duration=2e-3)
    assert not [said for said in run.notices if "pull" in said]


def test_a_load_outside_of_the_legs_pulls_however_it_is_shared():
    """Both legs on the left share W (1 - x) / 2 < 0."""
    scene = table(1.2, 0.3)
    q, v = scene.state()
    least = 4 * 9.81 * 0.2 / 4
    (said,) = [n for n in cp.solve(scene, q, v, np.zeros(6)).notices if "pull" in n]
    assert said.startswith("leg0, leg1, leg2, leg3: one of them pulls with ")
    assert f"{least:.4g} N or more" in said
    (said,) = [n for n in cp.simulate(scene, q, v, duration=2e-3).notices if "pull" in n]
    assert f"{least:.4g} N at t = 0 s or more" in said


@pytest.mark.long
def test_three_legs_are_determined():
    scene = table(0.9, 0.9)
    three = cp.Scene(scene.robot, scene.constraints[1:])
    q, v = three.state()
    (said,) = [n for n in cp.solve(three, q, v, np.zeros(6)).notices if "pull" in n]
    assert said.startswith(f"leg3: the contact pulls with {0.9 * 4 * 9.81:.4g} N")
