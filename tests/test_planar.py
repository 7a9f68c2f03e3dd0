"""Planar pins of linkages in a plane: Pinocchio has them as balls, exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import HAS_LCABA, SOLVED, SOLVERS, axis_of, relative, robot, unsupported_constraints

import condyn_pin as cp
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.dynamics.workspace import default_solver

FAST = [cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])]
SLANTED = pin.rpy.rpyToMatrix(0.4, -0.7, 1.1)


def rod(length: float, rng: np.random.Generator) -> pin.Inertia:
    return pin.Inertia(1.0 + rng.random(), np.array([length / 2, 0.02, 0.03]), 0.05 * np.eye(3))


def legged(axis: str = "z", turns: bool = True) -> cp.Robot:
    """A floating body with two four-bars, slanted; one closes away from its pivots' plane.

    The joints turn about z of their frames. The pin's frames have z, or another axis of theirs,
    along it; c2 is turned about that axis, and shifted along it.
    """
    rng, model = np.random.default_rng(5), pin.Model()
    place = pin.SE3.Identity()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), place, "body")
    model.appendBodyToJoint(body, pin.Inertia(8.0, 0.01 * np.ones(3), 0.4 * np.eye(3)), place)
    to_axis = {"x": [2, 0, 1], "y": [1, 2, 0], "z": [0, 1, 2]}[axis]
    named = np.eye(3)[:, to_axis]  # its column `axis` is z of the joints
    for k, leg in enumerate(("left", "right")):
        hip = pin.SE3(SLANTED if turns else np.eye(3), np.array([0.1, 0.4 * k, -0.2]))
        kind = pin.JointModelRZ
        crank = model.addJoint(body, kind(), hip, f"{leg}_crank")
        coupler = model.addJoint(
            crank, kind(), pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.1])), f"{leg}_coupler"
        )
        base = hip * pin.SE3(np.eye(3), np.array([0.7, 0.0, -0.2]))
        rocker = model.addJoint(body, kind(), base, f"{leg}_rocker")
        for joint, length in ((crank, 0.3), (coupler, 0.8), (rocker, 0.6)):
            model.appendBodyToJoint(joint, rod(length, rng), place)
        turned = pin.exp3(np.array([0.0, 0.0, 0.8])) @ named
        for name, joint, at in (
            (f"{leg}_a", coupler, pin.SE3(named, np.array([0.8, 0.0, 0.25 * k]))),
            (f"{leg}_b", rocker, pin.SE3(turned, np.array([0.6, 0.0, -0.1]))),
        ):
            model.addFrame(pin.Frame(name, joint, 0, at, pin.FrameType.OP_FRAME))
    return cp.Robot("legged", model)


def pins(robot_: cp.Robot, axis: str = "z", swap: bool = False) -> cp.Scene:
    ends = [("left_a", "left_b"), ("right_a", "right_b")]
    loops = [cp.Loop(*(e[::-1] if swap else e), "planar", axis=axis, name=e[0][:-2]) for e in ends]
    return cp.Scene(robot_, loops)


def assembled(scene: cp.Scene, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    bar = cp.model.four_bar().postures["open"]
    q0 = pin.neutral(scene.robot.model)
    q0[7:] = np.tile(bar, 2)
    q = scene.assemble(q0, fixed=[]).q
    v = cp.mechanism.project_velocity(scene, q, rng.normal(size=scene.robot.nv))
    return q, v, 5.0 * rng.normal(size=scene.robot.nv)


@pytest.mark.long
@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("solver", FAST, ids=lambda s: type(s).__name__)
def test_the_fast_methods_take_a_pin_in_a_plane(solver, axis):
    scene = pins(legged(axis), axis)
    assert pinocchio_constraints_of(scene).unsupported == ()
    assert isinstance(default_solver(scene), cp.Proximal)
    state = assembled(scene)
    right = cp.solve(scene, *state, solver=cp.dynamics.Reference())
    found = cp.solve(scene, *state, solver=solver)
    assert relative(found.a, right.a) < SOLVED
    # the rows are independent: lam is unique
    assert relative(found.lam, right.lam) < SOLVED
    forces = zip(found.forces.values(), right.forces.values(), strict=True)
    assert all(relative(one.components, two.components) < SOLVED for one, two in forces)


@pytest.mark.long
@pytest.mark.parametrize("swap", [False, True])
def test_forces_are_those_on_the_first_frame(swap):
    state = assembled(pins(legged()))
    one = cp.solve(pins(legged(), swap=swap), *state)
    two = cp.solve(pins(legged()), *state, solver=cp.dynamics.Reference())
    sign = -1.0 if swap else 1.0
    for name in one.forces:
        assert relative(sign * one.forces[name].in_world(), two.forces[name].in_world()) < 1e-7


@pytest.mark.values
@pytest.mark.parametrize("gap", [1e-12, 1e-9, 1e-7, 1e-5, 1e-3, 0.3])
@pytest.mark.parametrize("kind", ["planar", "hinge"])
def test_open_loops_are_solved_as_they_are(kind, gap):
    """A ball, or two, moves at c1 where the pin moves at c2: there they are not the same."""
    bar = replace(robot("four_bar"), precision=0.0)
    scene = cp.Scene(bar, [cp.Loop("coupler_tip", "rocker_tip", kind, axis=axis_of(kind, "y"))])
    rng = np.random.default_rng(1)
    q, _ = scene.sample(rng)
    q = pin.integrate(bar.model, q, gap * rng.normal(size=3))
    v, tau = rng.normal(size=(2, 3))  # slips too
    for drift in (None, cp.Baumgarte(10.0, 30.0)):
        right = cp.Workspace(scene, cp.dynamics.Reference(), drift=drift).solve(q, v, tau)
        workspace = cp.Workspace(scene, cp.Proximal(), drift=drift)
        found = workspace.solve(q, v, tau)
        assert relative(found.a, right.a) < SOLVED
        assert np.array_equal(workspace.acceleration(q, v, tau), found.a)
        J = workspace.jacobian(q)
        assert relative(J.T @ found.lam, J.T @ right.lam) < 1e-7


def test_closed_loops_are_solved_by_pinocchio():
    scene = pins(legged())
    state = assembled(scene)
    workspace = cp.Workspace(scene)
    workspace.solve(*state)
    without = cp.Workspace(scene, cp.Proximal(refinements=0))
    assert np.array_equal(workspace.acceleration(*state), without.acceleration(*state))
    assert workspace.solve(*state).iterations <= 4


@pytest.mark.long
def test_derivatives_are_those_of_the_pin():
    scene = pins(legged("x"), "x")
    cp.derivatives(scene, *assembled(scene), check=True)
    drifting = cp.Workspace(scene, drift=cp.Baumgarte(5.0, 20.0))
    drifting.derivatives(*assembled(scene), check=True)


@pytest.mark.long
def test_a_pin_in_space_has_no_equivalent():
    """Bodies that leave the plane, or shift across it, are free along the axis."""
    model = pin.Model()
    place = pin.SE3.Identity()
    for name, kind in (
        ("ball", pin.JointModelSpherical()),
        ("across", pin.JointModelPZ()),
        ("screw", pin.JointModelHZ(0.1)),
        ("two", pin.JointModelSphericalZYX()),
        ("slanted", pin.JointModelRevoluteUnaligned(np.array([0.0, 1e-6, 1.0]))),
        ("in_plane", pin.JointModelPlanar()),
        ("along", pin.JointModelPrismaticUnaligned(np.array([0.6, 0.8, 0.0]))),
        ("wheel", pin.JointModelRUBZ()),
    ):
        i = model.addJoint(0, kind, place, name)
        model.appendBodyToJoint(i, rod(0.4, np.random.default_rng(0)), place)
        model.addFrame(
            pin.Frame(f"{name}_tip", i, 0, pin.SE3(np.eye(3), np.ones(3)), pin.FrameType.OP_FRAME)
        )
    robot_ = cp.Robot("joints", model)
    ends = [name for name in model.names if name != "universe"]
    loops = [cp.Loop(f"{name}_tip", "universe", "planar", "z", name=name) for name in ends]
    natives = pinocchio_constraints_of(cp.Scene(robot_, loops))
    assert natives.unsupported == ("ball", "across", "screw", "two", "slanted")
    assert natives.approximated == ("in_plane", "along", "wheel")


def test_the_world_may_come_first():
    """The force is in its axes, which turn past the body: LCABA says what to do instead."""
    bar = robot("four_bar").with_frame(
        "hook", "world", [0.35, 0.0, 0.4], pin.rpy.rpyToMatrix(0, 1, 0)
    )
    free = cp.Scene(bar, [cp.Loop("hook", "coupler_tip", "planar", axis="y", name="held")])
    rng = np.random.default_rng(2)
    q, v = free.sample(rng)
    tau = rng.normal(size=3)
    for gap in (0.0, 1e-4):
        at = pin.integrate(bar.model, q, gap * rng.normal(size=3))
        right = cp.solve(free, at, v, tau, solver=cp.dynamics.Reference())
        found = cp.solve(free, at, v, tau, solver=cp.Proximal())
        assert relative(found.a, right.a) < SOLVED
        assert relative(found.lam, right.lam) < SOLVED
    if HAS_LCABA:
        with pytest.raises(
            cp.errors.UnsupportedConstraint, match=r"world comes first.*held.*exchange"
        ):
            cp.Workspace(free, cp.LCABA())
        other = cp.Scene(bar, [cp.Loop("coupler_tip", "hook", "planar", axis="y", name="held")])
        found = cp.solve(other, q, v, tau, solver=cp.LCABA())
        assert relative(found.a, cp.solve(free, q, v, tau).a) < SOLVED


def test_every_method_agrees():
    scene = pins(legged())
    state = assembled(scene)
    right = cp.solve(scene, *state, solver=cp.dynamics.Reference())
    for kind in SOLVERS.values():
        if kind.exact and not unsupported_constraints(scene, kind()):
            assert relative(cp.solve(scene, *state, solver=kind()).a, right.a) < SOLVED
