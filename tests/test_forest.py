"""Memory of a model with many trees: what a `Forest` finds is what Pinocchio's Data has."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin._core import models
from condyn_pin.constraints import Ball, Box, FrictionalContact
from condyn_pin.errors import InvalidModel


def several_trees() -> cp.Robot:
    """Return a chain with armature, two boxes and a ball that nothing holds together."""
    robot = cp.model.together(
        {
            "arm": cp.model.pendulum(),
            "one": cp.model.free_box(mass=2.0, size=(0.2, 0.1, 0.3)),
            "chain": cp.model.chain(4),
            "two": cp.model.free_ball(mass=0.5, radius=0.05),
        }
    )
    robot.model.armature[:] = 0.1 + 0.01 * np.arange(robot.model.nv)
    return cp.Robot("several", robot.model)


MODEL = several_trees().model


def state(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    q = pin.integrate(MODEL, pin.neutral(MODEL), rng.normal(size=MODEL.nv))
    return q, *rng.normal(size=(3, MODEL.nv))


@pytest.mark.parametrize("seed", range(3))
def test_a_forest_is_the_whole_model(seed):
    q, v, a, tau = state(seed)
    whole, forest = MODEL.createData(), models.Forest(MODEL)
    rng = np.random.default_rng(seed)
    wrenches = pin.StdVec_Force([pin.Force(*rng.normal(size=(2, 3))) for _ in MODEL.joints])
    both = (pin, whole), (forest, forest)
    asked = {
        "crba": (q,),
        "nonLinearEffects": (q, v),
        "rnea": (q, v, a, wrenches),
        "aba": (q, v, tau, wrenches),
        "computeGeneralizedGravity": (q,),
        "computeStaticTorque": (q, wrenches),
        "computePotentialEnergy": (q,),
        "computeJointJacobians": (q,),
    }
    for name, arguments in asked.items():
        one, other = (getattr(run, name)(MODEL, data, *arguments) for run, data in both)
        np.testing.assert_allclose(other, one, rtol=1e-13, atol=1e-13, err_msg=name)
    for run, data in both:
        run.forwardKinematics(MODEL, data, q, v, a)
    for joint in range(1, MODEL.njoints):
        assert forest.oMi[joint].isApprox(whole.oMi[joint], 1e-14)
        assert forest.v[joint].isApprox(whole.v[joint], 1e-14)
        assert forest.a[joint].isApprox(whole.a[joint], 1e-14)
    for run, data in both:
        run.computeJointJacobians(MODEL, data)
    np.testing.assert_allclose(forest.J, whole.J, atol=1e-14)
    place = pin.SE3.Random()
    one, other = (
        run.getFrameJacobian(MODEL, data, MODEL.njoints - 1, place, pin.LOCAL_WORLD_ALIGNED)
        for run, data in both
    )
    np.testing.assert_allclose(other, one, atol=1e-14)
    links = pin.Model(MODEL)
    links.armature[:] = 0.0
    one, other = (run.computeKineticEnergy(links, data, q, v) for run, data in both)
    assert other == pytest.approx(one, rel=1e-13)
    one, other = (run.computeCentroidalMomentum(links, data, q, v).vector for run, data in both)
    np.testing.assert_allclose(other, one, atol=1e-12)


def test_arrays_of_another_size_are_refused():
    q, v, a, _ = state(0)
    forest = models.Forest(MODEL)
    for wrong in ((q[:-1], v, a), (q, v[:-1], a), (q, v, np.append(a, 0.0))):
        with pytest.raises(ValueError, match="shape"):
            forest.rnea(MODEL, forest, *wrong)


@pytest.mark.long
def test_what_trees_share_is_no_forest():
    """One tree is none, however large it is, nor are small models."""
    assert not models.is_forest(cp.model.chain(120).model)
    assert not models.is_forest(MODEL)


def scene_of_boxes() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Return two boxes in a stack, beside a pendulum and a ball on the floor."""
    robot = cp.model.together(
        {
            "low": cp.model.free_box(size=(0.2, 0.2, 0.2)),
            "arm": cp.model.pendulum(),
            "high": cp.model.free_box(size=(0.2, 0.2, 0.2)),
            "ball": cp.model.free_ball(mass=1.0, radius=0.1),
        }
    )
    box = Box(0.1, 0.1, 0.1)
    contacts = [
        FrictionalContact("low/box", box, friction=0.5, name="floor"),
        FrictionalContact("high/box", box, on="low/box", on_shape=box, friction=0.5, name="stack"),
        FrictionalContact("ball/ball", Ball(0.1), friction=0.5, name="ball"),
    ]
    scene = cp.Scene(robot, contacts=contacts)
    q, v = scene.state()
    q[2], q[8 + 2], q[15:18] = 0.1, 0.302, (1.0, 0.0, 0.1)
    v[:] = 0.1
    return scene, q, v


@pytest.mark.parametrize("integrator", [cp.StewartTrinkle(), cp.Moreau()])
def test_steps_of_a_forest_are_those_of_the_whole(integrator, monkeypatch):
    found = []
    for small in (2**25, 0):
        monkeypatch.setattr(models, "_SMALL", small)
        scene, q, v = scene_of_boxes()
        assert models.is_forest(scene.robot.model) == (small == 0)
        force = cp.AppliedForce("ball/ball", force=(1.0, 0.0, 0.0))
        step = cp.step(scene, q, v, dt=2e-3, integrator=integrator, forces=[force])
        run = cp.simulate(scene, q, v, duration=0.02, dt=2e-3, integrator=integrator)
        free = cp.Scene(scene.robot)
        solved = cp.solve(free, q, v, np.ones(len(v)))
        flight = cp.simulate(free, q, v, duration=0.02, dt=2e-3)
        found.append(
            [step.q, step.v, step.dynamics_error, run.q[-1], run.energy.total, solved.a,
             flight.q[-1], flight.energy.total, [*run.gaps.values()]]
        )  # fmt: skip
        assert solved.status.ok
        assert step.status.ok
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-11)


BALLS = """
import pathlib, condyn_pin as cp
from condyn_pin.constraints import Ball, FrictionalContact
names = [f"b{i}" for i in range(60)]
robot = cp.model.together({name: cp.model.free_ball(mass=1.0, radius=0.05) for name in names})
contacts = [FrictionalContact(f"{n}/ball", Ball(0.05), friction=0.5, name=n) for n in names]
scene = cp.Scene(robot, contacts=contacts)
q, v = scene.state()
for i in range(60):
    q[7 * i], q[7 * i + 2] = 0.3 * i, 0.05
after = cp.step(scene, q, v, dt=1e-3)
assert after.status.ok and abs(after.v).max() < 1e-9
status = pathlib.Path("/proc/self/status").read_text()  # getrusage has that of the parent too
print(int(status.partition("VmHWM:")[2].split()[0]) / 1024)
"""


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_free_bodies_take_no_memory_by_the_cube():
    """Sixty balls: a pin.Data alone would take 1.5 GB."""
    answer = subprocess.run([sys.executable, "-c", BALLS], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert float(answer.stdout) < 400  # [MB], with the interpreter


@pytest.mark.long
def test_a_whole_model_that_is_too_large_is_refused_before(monkeypatch):
    monkeypatch.setattr(models, "available_memory", lambda: 1e8)
    with pytest.raises(InvalidModel, match=r"take 0.34 GB, more than .* \(0.1 GB\)"):
        cp.Robot("chain", chain_of(220))


def chain_of(n: int) -> pin.Model:
    """Return n hinges, one on the other."""
    model, joint = pin.Model(), 0
    for i in range(n):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1 if i else 0.0]))
        joint = model.addJoint(joint, pin.JointModelRY(), place, f"j{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def test_constraints_of_a_forest_take_the_whole_model_or_are_refused(monkeypatch):
    names = [f"b{i}" for i in range(36)]
    robot = cp.model.together({n: cp.model.free_ball(mass=1.0, radius=0.05) for n in names})
    rods = [
        cp.Loop(f"{one}/ball", f"{two}/ball", "rod", length=1.0, name=one)
        for one, two in pairwise(names)
    ]
    monkeypatch.setattr(models, "available_memory", lambda: 1e8)
    scene = cp.Scene(robot, rods)
    with pytest.raises(InvalidModel, match="216 degrees of freedom"):
        cp.Workspace(scene)
