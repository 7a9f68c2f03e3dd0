"""Parameters from logs: estimates beside what made the log, their bounds, and what is left open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.errors import InvalidArgument, UnknownName
from condyn_pin.gradients import FitStatus, PoseLog, TorqueLog, fit


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
    Q = [true.sample(rng, spread=0.15)[0] for _ in range(9)]
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


@each_row("problem", PROBLEMS)
def test_with_noise_the_covariance_is_that_of_the_errors(problem):
    scene, wanted, log = problem()
    fits = [fit(scene, log(np.random.default_rng(seed)), list(wanted)) for seed in range(10)]
    assert all(each.status.ok for each in fits)
    true = np.array(list(wanted.values()))
    errors = [each.estimate - true for each in fits]
    # sum of e^T C^-1 e has the distribution of chi squared; one log in 5000 is beyond these
    squares = sum(
        e @ np.linalg.solve(each.covariance, e) for e, each in zip(errors, fits, strict=True)
    )
    least, most = chi2.interval(1.0 - 2e-4, len(fits) * len(true))
    assert least < squares < most


# What slides and what sticks.


def pushed_box(count: int = 12) -> tuple[cp.Scene, TorqueLog, np.ndarray]:
    """A box of 2 kg that slides on a floor of friction 0.35, by hand: m a = F - mu m g v / |v|."""
    its, m, mu, g = cp.model.free_box(), 2.0, 0.35, 9.81
    rng = np.random.default_rng(1)
    v, a, tau = np.zeros((3, count, 6))
    v[:, :2] = rng.uniform(0.3, 1.0, (count, 2))
    tau[:, :2] = rng.normal(size=(count, 2))
    slip = v[:, :2] / np.linalg.norm(v[:, :2], axis=1)[:, None]
    a[:, :2] = tau[:, :2] / m - mu * g * slip
    q = np.tile(its.configuration({"floating": [0, 0, 0.1, 0, 0, 0, 1]}), (count, 1))
    floor = cp.FrictionalContact("box", cp.constraints.Box(0.1, 0.1, 0.1), friction=0.6)
    return cp.Scene(its, contacts=[floor]), TorqueLog(q, v, a, tau), np.array([mu, m])


def test_a_sliding_contact_has_the_friction_that_stops_it():
    scene, log, wanted = pushed_box()
    found = fit(scene, log, ["box/friction", "floating/mass"])
    np.testing.assert_allclose(found.estimate, wanted, rtol=1e-8)
    assert found.scene.contacts[0].friction == found.estimate[0]
    assert found.scene.robot.mass == found.estimate[1]


def test_a_contact_that_sticks_says_nothing_of_its_friction():
    scene, log, _ = pushed_box()
    still = replace(log, v=np.zeros((12, 6)), a=np.zeros((12, 6)))
    found = fit(scene, still, ["box/friction"])
    assert found.status is FitStatus.NOT_IDENTIFIABLE
    assert found.undetermined == ("box/friction",)
    assert found.estimate[0] == 0.6
    assert found.standard_error[0] == np.inf


def test_a_joint_that_sticks_has_an_unknown_friction():
    """Samples at rest, with any torque below the friction, change nothing."""
    scene, wanted, log = solo()
    its, friction = scene.robot, scene.contacts[0]
    moving = log(None)
    still, held = moving.v.copy(), moving.tau.copy()
    i = its.index_v(friction.joint)
    still[:10] = 0.0
    for k in range(10):
        held[k] = 0.0
        held[k, i] = 0.05
    a = moving.a.copy()
    heavy = fit(scene, moving, list(wanted)).scene
    for k in range(10):
        free = cp.solve(heavy.bilateral, moving.q[k], still[k], np.zeros(its.nv))
        a[k] = free.a
    found = fit(scene, TorqueLog(moving.q, still, a, held), list(wanted))
    np.testing.assert_allclose(found.estimate, list(wanted.values()), rtol=1e-8)


# What a log leaves open.


def test_dampings_of_joints_that_turn_together_are_a_combination():
    its = cp.model.parallelogram()
    true = damped(its, {"crank_pivot": 0.1, "rocker_pivot": 0.2})
    q, v, a, tau = motion(
        cp.Scene(true, true.loops), lambda rng: rng.normal(size=3), 20, spread=0.3, speed=2.0
    )
    names = ["crank_pivot/damping", "coupler_pivot/damping", "rocker_pivot/damping"]
    found = fit(cp.Scene(its, its.loops), TorqueLog(q, v, a, tau), names)
    assert found.status is FitStatus.NOT_IDENTIFIABLE
    assert not found.status.ok
    assert len(found.undetermined) == 2  # the coupler only shifts: its pivot turns with the crank
    assert all("damping - 1 " in each or "damping + 1 " in each for each in found.undetermined)
    assert (found.standard_error == np.inf).all()
    assert found.estimate.sum() == pytest.approx(0.3, abs=1e-8)
    assert "not determined: " in str(found)
    alone = fit(cp.Scene(its, its.loops), TorqueLog(q, v, a, tau), names[:1])
    assert alone.status.ok
    assert alone.estimate == pytest.approx([0.3], abs=1e-8)


# Bounds, losses, and where joints are.


@pytest.mark.long
def test_friction_does_not_get_negative():
    scene, log, _ = pushed_box()
    found = fit(scene, replace(log, a=-log.a), ["box/friction"])  # it speeds up as it slides
    assert found.status.ok
    assert found.at_bounds == ("box/friction",)
    assert 0.0 <= found.estimate[0] < 1e-8
    assert "at its bound: box/friction" in str(found)


@pytest.mark.long
def test_outliers_count_less_with_another_loss():
    scene, wanted, log = four_bar()
    noisy = log(np.random.default_rng(0))
    tau = noisy.tau.copy()
    tau[::10, 0] += 20.0
    spoilt = replace(noisy, tau=tau)
    plain, robust = (fit(scene, spoilt, list(wanted), loss=loss) for loss in ("linear", "cauchy"))
    true = np.array(list(wanted.values()))
    off = [np.abs(each.estimate / true - 1.0).max() for each in (plain, robust)]
    assert off[1] < 0.1 * off[0]
    assert (np.abs(robust.estimate - true) < 4.0 * robust.standard_error).all()
    assert (robust.standard_error < 0.1 * plain.standard_error).all()


def test_places_of_joints_and_centres_of_mass():
    its = robot("four_bar")
    model = pin.Model(its.model)
    rocker = model.getJointId("rocker")
    model.jointPlacements[rocker].translation = its.model.jointPlacements[
        rocker
    ].translation + np.array([0.004, 0.0, 0.002])
    true = cp.Scene(replace(its, model=model), its.loops)
    rng = np.random.default_rng(2)
    Q = np.array([true.sample(rng, spread=0.4)[0] for _ in range(10)])
    log = PoseLog({"crank": Q[:, 0], "coupler": Q[:, 1], "rocker": Q[:, 2]})
    names = ["rocker/place.x", "rocker/mass", "rocker/place.z"]
    found = fit(cp.Scene(its, its.loops), log, names)
    assert found.undetermined == ("rocker/mass",)
    np.testing.assert_array_equal(np.isfinite(found.standard_error), [True, False, True])
    wanted = model.jointPlacements[rocker].translation[[0, 2]]
    np.testing.assert_allclose(found.estimate[[0, 2]], wanted, atol=1e-8)

    body = model.inertias[rocker]
    model.inertias[rocker] = pin.Inertia(body.mass, body.lever + 0.03 * np.eye(3)[0], body.inertia)
    heavy = cp.Scene(replace(its, model=model), its.loops)
    q, v, a, tau = motion(heavy, lambda rng: rng.normal(size=3), 20, spread=0.4, speed=2.0)
    start = cp.Scene(found.scene.robot, its.loops)
    again = fit(start, TorqueLog(q, v, a, tau), ["rocker/centre.x"])
    np.testing.assert_allclose(again.estimate, model.inertias[rocker].lever[0], rtol=1e-8)


@pytest.mark.long
def test_a_fit_that_is_cut_short_is_not_ok():
    scene, wanted, log = four_bar()
    found = fit(scene, log(None), list(wanted), iterations=1)
    assert found.status is FitStatus.OUT_OF_ITERATIONS
    assert not found.status.ok


def test_the_table_has_a_line_for_each_parameter():
    scene, log, _ = pushed_box()
    lines = str(fit(scene, log, ["box/friction", "floating/mass"])).splitlines()
    assert lines[0].startswith("converged: ")
    assert [line.split()[0] for line in lines[1:]] == ["parameter", "box/friction", "floating/mass"]
    assert float(lines[2].split()[1]) == pytest.approx(0.35, abs=1e-6)


# Bad input.

BOX, LOG, _ = pushed_box()
LEG = {"leg1": np.zeros(3)}
BAR = cp.Scene(robot("four_bar"), robot("four_bar").loops)
ONCE = PoseLog({joint: BAR.state()[0][i : i + 1] for i, joint in enumerate(BAR.robot.joints)})


@each_row(("call", "error", "text"), [
        (lambda: fit(BOX, LOG, "box/friction"), InvalidArgument, "a list of names"),
        (lambda: fit(BOX, LOG, []), InvalidArgument, "a list of names"),
        (lambda: fit(BOX, LOG, ["box/friction"] * 2), InvalidArgument, "each name once"),
        (lambda: fit(BOX, LOG, ["box/fricton"]), UnknownName, "did you mean 'box/friction'"),
        (lambda: fit(BOX, [1.0], ["box/friction"]), InvalidArgument, "TorqueLog or a PoseLog"),
        (lambda: fit(BOX.robot, LOG, ["box/friction"]), InvalidArgument, "a Scene is needed"),
        (lambda: fit(BOX, LOG, ["box/friction"], loss="l1"), InvalidArgument, "loss = 'l1'"),
        (lambda: fit(BOX, LOG, ["box/friction"], iterations=0), InvalidArgument, "iterations"),
        (lambda: fit(BOX, replace(LOG, tau=LOG.tau[:3]), ["box/friction"]),
         InvalidArgument, "log.tau has 3 rows"),
        (lambda: fit(BOX, replace(LOG, v=LOG.v[:, :5]), ["box/friction"]),
         InvalidArgument, "log.v has shape"),
        (lambda: replace(LOG, a=LOG.a * np.nan), InvalidArgument, "log.a.*finite"),
        (lambda: replace(LOG, sigma=0.0), InvalidArgument, "log.sigma = .*positive"),
        (lambda: replace(LOG, q=[0.1, 0.2]), InvalidArgument, "a row for each sample"),
        (lambda: PoseLog(), InvalidArgument, "name what was measured"),
        (lambda: PoseLog(LEG, {"platform": np.zeros((2, 3))}), InvalidArgument, "samples of each"),
        (lambda: PoseLog({}, {"platform": np.zeros((2, 7))}), InvalidArgument, "unit quaternion"),
        (lambda: PoseLog(LEG, sigma={"leg2": 1.0}), UnknownName, "did you mean 'leg1'"),
        (lambda: fit(BAR, ONCE, ["rocker/place.x", "rocker/place.z"]),
         InvalidArgument, "log more samples"),
        (lambda: fit(BOX, LOG, ["box/friction"]).interval(1.0), InvalidArgument, "between 0 and 1"),
    ])  # fmt: skip
def test_bad_input_is_named(call, error, text):
    with pytest.raises(error, match=text):
        call()
