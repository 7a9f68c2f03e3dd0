"""LCABA where its rounding counts: light rods under a body on its feet, and far from the origin."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from shared import FORCES, HAS_LCABA, SOLVED, all_scenes, each_row, relative, states, truth

import condyn_pin as cp

FAST = [cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])]
each = pytest.mark.parametrize("solver", FAST, ids=lambda s: type(s).__name__)


def biped(rod_mass: float, about_itself: float, on_feet: bool) -> cp.Scene:
    """A biped whose ankles are driven by two cranks each, over rods with a ball at either end."""
    model = pin.Model()

    def add(parent, joint, place, name, mass, sizes, com=(0.0, 0.0, 0.0)):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        made = model.addJoint(parent, joint, at, name)
        inertia = pin.Inertia(mass, np.array(com, dtype=float), mass * np.diag(sizes))
        model.appendBodyToJoint(made, inertia, pin.SE3.Identity())
        return made

    def frame(name, joint, place):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, joint, 0, at, pin.FrameType.OP_FRAME))

    torso = add(0, pin.JointModelFreeFlyer(), (0, 0, 0), "torso", 30.0, (0.5, 0.4, 0.3))
    constraints: list[cp.constraints.Constraint] = []
    small = (2e-3, 2e-3, 2e-3)
    for sign, side in ((1, "left"), (-1, "right")):
        yaw = add(torso, pin.JointModelRZ(), (0, 0.1 * sign, -0.1), f"{side}_yaw", 1.0, small)
        roll = add(yaw, pin.JointModelRX(), (0, 0, 0), f"{side}_roll", 1.0, small)
        long = (0.03, 0.03, 0.005)
        thigh = add(roll, pin.JointModelRY(), (0, 0, 0), f"{side}_hip", 5.0, long, (0, 0, -0.2))
        shin = add(thigh, pin.JointModelRY(), (0, 0, -0.4), f"{side}_knee", 3.0, long, (0, 0, -0.2))
        for k, (y, z) in enumerate(((0.05, -0.12), (-0.05, -0.2))):
            name, length = f"{side}_rod{k}", 0.4 + z
            crank = add(
                shin, pin.JointModelRY(), (-0.02, y, z), f"{side}_crank{k}", 0.2, small,
                (-0.03, 0, 0),
            )  # fmt: skip
            sizes = (length**2 / 12, length**2 / 12, about_itself)
            rod = add(
                crank, pin.JointModelSpherical(), (-0.06, 0, 0), name, rod_mass, sizes,
                (0, 0, -length / 2),
            )  # fmt: skip
            frame(f"{name}_end", rod, (0, 0, -length))
            constraints.append(cp.Loop(f"{name}_end", f"{name}_foot"))
        ankle = add(shin, pin.JointModelRY(), (0, 0, -0.4), f"{side}_ankle", 0.3, small)
        foot = add(ankle, pin.JointModelRX(), (0, 0, 0), f"{side}_foot", 1.0, small, (0, 0, -0.05))
        for k, y in enumerate((0.05, -0.05)):
            frame(f"{side}_rod{k}_foot", foot, (-0.08, y, 0))
        frame(f"{side}_sole", foot, (0.03, 0, -0.08))
        if on_feet:
            constraints.append(cp.SurfaceContact(f"{side}_sole"))
    return cp.Scene(cp.Robot("biped", model), constraints)


@each
@pytest.mark.parametrize("on_feet", [False, True])
@pytest.mark.parametrize(("mass", "about_itself"), [(0.1, 1e-5), (0.03, 3e-6)])
def test_ankles_closed_by_light_rods(solver, on_feet, mass, about_itself):
    """Its weight is chosen at a straight, still posture too, where rods turn about world axes."""
    scene = biped(mass, about_itself, on_feet)
    right, workspace = cp.Workspace(scene, cp.dynamics.Reference()), cp.Workspace(scene, solver)
    rng = np.random.default_rng(0)
    for k in range(40):
        q, v = scene.sample(rng)
        tau = 5.0 * rng.normal(size=len(v)) if k % 4 else np.zeros(len(v))
        wanted, found = right.solve(q, v, tau, throw=False), workspace.solve(q, v, tau)
        assert relative(found.a, wanted.a) < SOLVED
        assert np.array_equal(workspace.acceleration(q, v, tau), found.a)
        J = workspace.jacobian(q)
        assert relative(J.T @ found.lam, J.T @ wanted.lam, floor=scene.nominal.weight) < 1e-7


@pytest.mark.long
@pytest.mark.pairs
@each
@pytest.mark.parametrize("distance", [10.0, 1e3])
@pytest.mark.parametrize("label", ["cassie loops", "talos contacts", "solo12 contacts"])
def test_where_a_robot_is_changes_nothing(solver, label, distance):
    """In lcaba rounding of 1/mu grows with the square of the distance to the world's origin."""
    workspace = cp.Workspace(all_scenes()[label], solver)
    for (q, v, tau), right in zip(states(label), truth(label), strict=True):
        far = q.copy()
        far[:2] += distance * np.array([0.6, -0.8])
        a = workspace.acceleration(far, v, tau)
        assert relative(a, right.a) < SOLVED


@pytest.mark.long
@pytest.mark.parametrize("size", [1, 3, 4, 100])
@each
def test_a_configuration_of_another_size_is_refused(solver, size):
    scene = all_scenes()["talos contacts"]
    _, v, tau = states("talos contacts")[0]
    with pytest.raises(cp.InvalidArgument, match="q"):
        cp.Workspace(scene, solver).acceleration(np.ones(size), v, tau)


@each_row("refinements", [-1, 1.5, True, 101])
def test_a_number_of_corrections_that_is_none_is_refused(refinements):
    with pytest.raises(cp.InvalidArgument, match="refinements = "):
        cp.LCABA(refinements=refinements)


@pytest.mark.long
def test_corrections_make_up_for_a_small_mu():
    """And an mu of one's own is not corrected unless that is asked for."""
    scene = biped(0.1, 1e-5, on_feet=True)
    if not HAS_LCABA:
        with pytest.raises(cp.errors.UnsupportedBackend, match="LCABA needs Pinocchio 4"):
            cp.Workspace(scene, cp.LCABA(refinements=2))
        return
    mu = 1e-8 * scene.nominal.delassus_norm
    q, v = scene.sample(np.random.default_rng(3))
    state = (q, v, np.zeros(len(v)))
    wanted = cp.solve(scene, *state, solver=cp.dynamics.Reference(), throw=False)
    rough = cp.solve(scene, *state, solver=cp.LCABA(mu=mu), throw=False)
    fine = cp.solve(scene, *state, solver=cp.LCABA(mu=mu, refinements=2))
    assert not rough.status.ok
    assert relative(fine.a, wanted.a) < SOLVED


def turned_plate(root: str, lever: float, size: float = 0.8) -> cp.Scene:
    """A body that turns, one that shifts and turns in its plane, and a point held fast on that."""
    model, made = pin.Model(), 0
    for k, joint in enumerate((root, "Planar")):
        place = pin.SE3(np.eye(3), k * np.array([0.2, 0.3, 0.1]))
        made = model.addJoint(made, getattr(pin, f"JointModel{joint}")(), place, f"joint{k}")
        com, moments = size * np.array([0.5, 1.0, 0.25]), size**2 * np.diag([1.0, 1.3, 0.8])
        model.appendBodyToJoint(made, pin.Inertia(1.0, com, moments), pin.SE3.Identity())
    held = pin.SE3(np.eye(3), lever * np.array([1.0, 0.6, 0.4]))
    model.addFrame(pin.Frame("held", made, 0, held, pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("plate", model), [cp.PointContact("held")])


def hung_body(mass: float) -> cp.Scene:
    """A body on one point of the ground, and another that turns on it."""
    model = pin.Model()
    for k, joint in enumerate((pin.JointModelFreeFlyer(), pin.JointModelRY())):
        place = pin.SE3(np.eye(3), k * np.array([0.2, 0.3, 0.4]))
        made = model.addJoint(k, joint, place, f"joint{k}")
        inertia = pin.Inertia(
            mass ** (1 - k), np.array([0.1, 0.2, 0.0]), 0.04 * mass ** (1 - k) * np.eye(3)
        )
        model.appendBodyToJoint(made, inertia, pin.SE3.Identity())
    held = pin.SE3(np.eye(3), np.array([0.3, 0.2, 0.1]))
    model.addFrame(pin.Frame("held", 2, 0, held, pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("hung", model), [cp.PointContact("held")])


def errors(scene, solver, count=6):
    """Yield solutions and the errors of a, and of what the forces do to the joints, relative."""
    right, workspace = cp.Workspace(scene, cp.dynamics.Reference()), cp.Workspace(scene, solver)
    rng = np.random.default_rng(0)
    for _ in range(count):
        q, v = scene.sample(rng)
        terms = right.terms(q, v)
        tau = terms.M @ rng.normal(size=len(v))
        wanted, found = right.solve(q, v, tau), workspace.solve(q, v, tau, throw=False)
        size = max(np.abs(wanted.a).max(), scene.nominal.estimator.gravity)
        torque = (np.abs(terms.M).sum(axis=1) * size + np.abs(terms.h) + np.abs(tau)).max()
        off = terms.J.T @ found.lam - (terms.M @ wanted.a + terms.h - tau)
        yield found, np.abs(found.a - wanted.a).max() / size, np.abs(off).max() / torque


@pytest.mark.parametrize(("root", "lever"), [("RX", 0.1), ("RX", 0.3), ("RY", 0.1), ("RY", 0.3)])
@each
def test_forces_are_right_where_a_is(solver, root, lever):
    """Where mu is small a is right, and lam, which is 1/mu times rounding of J a, is not."""
    for found, of_a, of_forces in errors(turned_plate(root, lever), solver):
        assert found.status.ok
        assert found.iterations < 20
        assert of_a < SOLVED
        assert of_forces < FORCES / 10


@pytest.mark.pairs
@pytest.mark.parametrize("mass", [1e-2, 1.0, 1e2])
@pytest.mark.parametrize("share", [1e-3, 1e-5, 1e-6, 1e-7, 1e-8])
@pytest.mark.parametrize("kind", [type(solver) for solver in FAST])
def test_an_answer_whose_forces_are_wrong_is_not_ok(kind, share, mass):
    """Of a body on a point, a does not show what a mu of one's own does to lam."""
    scene = hung_body(mass)
    for found, of_a, of_forces in errors(scene, kind(mu=share * scene.nominal.delassus_norm)):
        if found.status.ok:
            assert of_a < SOLVED
            assert of_forces < FORCES
        elif of_a < SOLVED / 10:
            assert found.status is cp.Status.INACCURATE
