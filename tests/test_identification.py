"""Parameters from logs: estimates beside what made the log, their bounds, and what is left open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.errors import UnknownName
from condyn_pin.gradients import Fit, FitStatus, PoseLog, TorqueLog, fit

SEEDS = range(100, 120)


def damped(its: cp.Robot, damping: dict[str, float]) -> cp.Robot:
    """The robot with damping in some joints."""
    model = pin.Model(its.model)
    model.damping = its.joint_vector(damping)
    return replace(its, model=model)


def moved(scene: cp.Scene, ends: dict[str, np.ndarray]) -> cp.Scene:
    """The scene with the second ends of loops elsewhere on their bodies."""
    loops = []
    for loop in scene.constraints:
        joint, placement = scene.robot.frame(loop.frame_b)
        at = pin.SE3(placement.rotation, placement.translation + ends[loop.name])
        loops.append(replace(loop, frame_b=(joint, at)))
    return cp.Scene(scene.robot, loops)


def motion(scene: cp.Scene, torque, count: int, *, spread: float, speed: float) -> list[np.ndarray]:
    """States of a scene with closed loops under random torques, with the answers of `solve`."""
    rng, its = np.random.default_rng(5), scene.robot
    found = []
    for _ in range(count):
        q, v = scene.sample(rng, spread=spread, speed=speed)
        tau = torque(rng)
        passive = its.passive_torque(q, v)
        for friction in scene.contacts:
            i = its.index_v(friction.joint)
            passive[i] -= friction.torque * np.sign(v[i])
        found.append((q, v, cp.solve(scene.bilateral, q, v, tau + passive).a, tau))
    return [np.array(each) for each in zip(*found, strict=True)]


# Problems: a scene to start from, names, true values, a log without noise, and one with it.

Problem = tuple[cp.Scene, dict[str, float], Callable[[np.random.Generator | None], object]]


def four_bar() -> Problem:
    """Mass, spring and damping of a four-bar linkage, by the torque of its motor."""
    start = robot("four_bar")
    spring = cp.model.Spring("rocker", 20.0, 1.0)
    start = replace(start, springs=[spring])
    true = replace(
        damped(start, {"crank": 0.2}).with_masses({"coupler": 2.5}),
        springs=[replace(spring, stiffness=35.0)],
    )
    q, v, a, tau = motion(
        cp.Scene(true, true.loops), lambda rng: true.joint_vector({"crank": 5.0 * rng.normal()}),
        30, spread=0.5, speed=3.0,
    )  # fmt: skip

    def log(rng):
        noise = 0.0 if rng is None else 0.05 * rng.normal(size=tau.shape)
        return TorqueLog(q, v, a, tau + noise, sigma=0.1)

    wanted = {"coupler/mass": 2.5, "crank/damping": 0.2, "rocker/stiffness": 35.0}
    return cp.Scene(start, start.loops), wanted, log


def solo() -> Problem:
    """Mass, damping and dry friction of a robot that stands on four feet and moves its trunk."""
    start = robot("solo12")
    knee, hip = "FL_KFE", "HR_HFE"
    true = damped(start, {knee: 0.05}).with_masses({"root_joint": 1.9})
    friction = cp.constraints.JointFriction(hip, 0.08)
    motors = true.joint_vector(dict.fromkeys(true.actuated, 1.0))
    q, v, a, tau = motion(
        cp.Scene(true, true.contacts, [friction]), lambda rng: motors * rng.normal(size=true.nv),
        30, spread=0.3, speed=1.0,
    )  # fmt: skip

    def log(rng):
        noise = 0.0 if rng is None else 0.02 * rng.normal(size=tau.shape)
        return TorqueLog(q, v, a, tau + noise)

    wanted = {"root_joint/mass": 1.9, f"{knee}/damping": 0.05, f"{friction.name}/torque": 0.08}
    return cp.Scene(start, start.contacts, [replace(friction, torque=0.02)]), wanted, log


def stewart() -> Problem:
    """Balls on the platform, by the lengths of the legs and the pose of the platform."""
    its = robot("stewart")
    scene = cp.Scene(its, its.loops)
    rng = np.random.default_rng(3)
    shifts = {loop.name: 2e-3 * rng.normal(size=3) for loop in its.loops}
    true = moved(scene, shifts)
    legs = [f"leg{k}" for k in range(1, 7)]
    Q = [true.sample(rng, spread=0.15)[0] for _ in range(12)]
    lengths = {leg: np.array([q[its.index_q(leg)] for q in Q]) for leg in legs}
    poses = np.array([pin.SE3ToXYZQUAT(its.frame_pose(q, "platform_centre")) for q in Q])

    def log(rng):
        if rng is None:
            return PoseLog(lengths, {"platform_centre": poses})
        measured = {leg: y + 1e-4 * rng.normal(size=y.shape) for leg, y in lengths.items()}
        seen = []
        for pose in poses:
            error = pin.SE3(pin.exp3(5e-4 * rng.normal(size=3)), np.zeros(3))
            at = pin.XYZQUATToSE3(pose) * error
            seen.append(pin.SE3ToXYZQUAT(at) + np.r_[2e-4 * rng.normal(size=3), np.zeros(4)])
        sigma = {**dict.fromkeys(legs, 1e-4), "platform_centre": (2e-4, 5e-4)}
        return PoseLog(measured, {"platform_centre": np.array(seen)}, sigma)

    wanted = {}
    for loop in true.constraints:
        at = its.frame(loop.frame_b)[1].translation
        wanted |= {f"{loop.name}/frame_b.{axis}": x for axis, x in zip("xyz", at, strict=True)}
    return scene, wanted, log


PROBLEMS = [four_bar, solo, stewart]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_without_noise_the_parameters_are_those_of_the_log(problem):
    scene, wanted, log = problem()
    found = fit(scene, log(None), list(wanted))
    assert found.status is FitStatus.CONVERGED
    np.testing.assert_allclose(found.estimate, list(wanted.values()), rtol=1e-8, atol=1e-8)
    again = fit(found.scene, log(None), list(wanted))
    np.testing.assert_allclose(again.estimate, found.estimate, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_with_noise_standard_errors_and_intervals_are_as_large_as_the_errors(problem):
    scene, wanted, log = problem()
    fits = [fit(scene, log(np.random.default_rng(seed)), list(wanted)) for seed in SEEDS]
    assert all(each.status.ok for each in fits)
    true = np.array(list(wanted.values()))
    scores = np.array([(each.estimate - true) / each.standard_error for each in fits])
    inside = [(lo <= true) & (true <= hi) for lo, hi in (each.interval().T for each in fits)]
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.mean(np.abs(scores) > 3.0) <= 0.01, scores  # of 60 none, of 300 three
    assert 0.7 < scores.std() < 1.3
