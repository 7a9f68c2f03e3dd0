"""Reduced and vakonomic motion: judged by closed forms, by differences, and by the full machine."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipj
from shared import robot

import condyn_pin as cp
from condyn_pin.model.mechanisms.machine import disc
from condyn_pin.nonholonomic import ChaplyginReduction, vakonomic

MASS, INERTIA = 1.3, 0.2


def skate(arm: float = 0.0, offset: float = 0.0) -> cp.Scene:
    """A body on a blade, its centre of mass ahead of it by `arm`."""
    model, here, joint = pin.Model(), pin.SE3.Identity(), 0
    for name, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()),
                       ("heading", pin.JointModelRZ())):  # fmt: skip
        joint = model.addJoint(joint, kind, here, name)
    inertia = pin.Inertia(MASS, np.array([arm, 0.0, 0.0]), INERTIA * np.eye(3))
    model.appendBodyToJoint(joint, inertia, here)
    model.addFrame(pin.Frame("blade", joint, 0, here, pin.FrameType.OP_FRAME))
    blade = cp.constraints.KnifeEdge("blade", offset=(offset, 0.0, 0.0))
    return cp.Scene(cp.Robot("skate", model), [blade])


def two_wheels() -> cp.Scene:
    """A base on two driven wheels, its centre of mass off their axle: a plane and two hinges."""
    model, here = pin.Model(), pin.SE3.Identity()
    base = model.addJoint(0, pin.JointModelPlanar(), here, "plane")
    model.appendBodyToJoint(
        base, pin.Inertia(5.0, np.array([0.15, 0.02, 0.0]), 0.3 * np.eye(3)), here
    )
    for name, y in (("left", 0.25), ("right", -0.25)):
        at = pin.SE3(np.eye(3), np.array([0.0, y, 0.2]))
        joint = model.addJoint(base, pin.JointModelRY(), at, name)
        model.appendBodyToJoint(joint, disc(0.2, 0.8), here)
        model.addFrame(pin.Frame(f"{name}_wheel", joint, 0, here, pin.FrameType.OP_FRAME))
    wheels = [
        cp.constraints.RollingWheel("left_wheel", 0.2, holds=("rolling", "lateral")),
        cp.constraints.RollingWheel("right_wheel", 0.2, holds=("rolling",)),
    ]
    return cp.Scene(cp.Robot("two wheels", model, actuated=("left", "right")), wheels)


def ball() -> cp.Scene:
    made = robot("rolling_ball")
    return cp.Scene(made, made.contacts)


def unicycle() -> cp.Scene:
    return cp.Scene(robot("unicycle"), robot("unicycle").contacts)


REDUCED = {
    "skate": (lambda: skate(arm=0.3), ["y"]),
    "unicycle": (unicycle, ["x", "y"]),
    "two wheels": (two_wheels, ["plane"]),
    "ball": (ball, ["floating.translation"]),
}
each_reduction = pytest.mark.parametrize(("made", "fibre"), REDUCED.values(), ids=list(REDUCED))


def start(reduction: ChaplyginReduction) -> tuple[np.ndarray, np.ndarray]:
    q, v = reduction.scene.sample(np.random.default_rng(4), spread=0.3, speed=1.5)
    return q, reduction.base(v)


@each_reduction
def test_the_base_moves_as_the_whole_machine_does(made, fibre):
    scene = made()
    reduction = ChaplyginReduction(scene, fibre)
    q, w = start(reduction)
    tau = 0.01 * np.random.default_rng(5).normal(size=scene.robot.nv)
    tau[reduction.columns[1]] = 0.0

    v = reduction.velocity(q, w)
    assert scene.check(q, v).consistent
    M, h, connection, H = reduction.terms(q, w)
    a = cp.solve(scene, q, v, tau).a
    assert np.linalg.solve(M, H.T @ tau + connection - h) == pytest.approx(
        reduction.base(a), abs=1e-11
    )
    errors = []
    for dt in (0.05, 0.025):
        motion = reduction.simulate(q, w, duration=0.5, dt=dt, tau=tau)
        run = cp.simulate(scene, q, v, tau, duration=0.5, dt=dt, drift=cp.simulation.NoDrift())
        errors.append(motion.distance(run).max())
        assert all(scene.check(*each).consistent for each in zip(motion.q, motion.v, strict=True))
    assert errors[1] < 1e-6  # of both, by Runge and Kutta's method of order 4
    assert errors[1] < errors[0] / 8 or errors[0] < 1e-12


@pytest.mark.parametrize(("made", "fibre"), [REDUCED[name] for name in ("skate", "two wheels")],
                         ids=["skate", "two wheels"])  # fmt: skip
def test_what_is_left_without_the_connection_is_the_machine_of_the_reduced_energy(made, fibre):
    """h_c = (dM_c w) w - d(w^T M_c w) / 2 by differences of M_c; bases here are plain vectors."""
    reduction = ChaplyginReduction(made(), fibre)
    q, w = start(reduction)
    terms, model, h = reduction.terms(q, w), reduction.scene.robot.model, 1e-4
    base, by_s = reduction.columns[0], []
    for i in base:
        step = h * np.eye(model.nv)[i]
        two = (reduction.terms(pin.integrate(model, q, k * step), w).M for k in (1, -1))
        by_s.append(np.subtract(*two) / (2 * h))
    turned = np.array(by_s)  # by s_c: dM_ab / ds_c
    wanted = np.einsum("cab,c,b->a", turned, w, w) - np.einsum("abc,b,c->a", turned, w, w) / 2
    assert terms.h == pytest.approx(wanted, abs=1e-6)
    # the torque of the connection turns the motion and does no work
    assert terms.connection @ w == pytest.approx(0.0, abs=1e-12)
    assert np.abs(terms.connection).max() > 1e-2


def test_a_fibre_that_counts_is_refused():
    refused = [
        ("2 independent rows", lambda: ChaplyginReduction(unicycle(), ["x"])),
        ("decide 1", lambda: ChaplyginReduction(unicycle(), ["heading", "roll"])),
        ("rows of skate", lambda: ChaplyginReduction(skate(offset=0.4), ["heading"])),
        ("planes", lambda: ChaplyginReduction(unicycle(), ["x.translation", "y"])),
        ("list", lambda: ChaplyginReduction(unicycle(), "x")),
    ]  # fmt: skip
    for text, call in refused:
        with pytest.raises(cp.InvalidArgument, match=text):
            call()
    with pytest.raises(cp.errors.UnknownName):
        ChaplyginReduction(unicycle(), ["z"])


def test_a_vakonomic_skate_drives_off_where_a_real_one_turns_on_the_spot():
    """From u = 0 and omega_0, with mu_0 = P: theta = asin(k sn(W t)), u = (P / m) k sn(W t),

    W = P / sqrt(m J), k = omega_0 / W, and mu = P dn(W t), since chi = 2 theta obeys the pendulum.
    """
    scene, P, omega = skate(), 0.9, 0.7
    q, v = np.zeros(3), np.array([0.0, 0.0, omega])
    W = P / np.sqrt(MASS * INERTIA)
    k = omega / W
    motion = vakonomic(scene, q, v, [P], duration=3.0, dt=0.02)
    sn, cn, dn, _ = ellipj(W * motion.t, k**2)
    assert motion.q[:, 2] == pytest.approx(np.arcsin(k * sn), abs=1e-6)
    assert motion.v[:, 2] == pytest.approx(k * W * cn, abs=1e-6)
    speed = P / MASS * k * sn
    assert motion.v[:, :2] == pytest.approx(
        speed[:, None] * np.column_stack([np.cos(motion.q[:, 2]), np.sin(motion.q[:, 2])]), abs=1e-6
    )
    assert motion.mu[:, 0] == pytest.approx(P * dn, abs=1e-6)
    assert np.ptp(motion.energy) < 1e-7

    run = cp.simulate(scene, q, v, duration=3.0, dt=0.02)
    assert run.q == pytest.approx(np.outer(run.t, v), abs=1e-12)
    apart = motion.distance(run)
    assert apart[0] == 0.0
    assert apart[-1] > 0.5
    with pytest.raises(cp.InvalidArgument, match="instants"):
        motion.distance(cp.simulate(scene, q, v, duration=1.0, dt=0.02))


def test_both_principles_agree_where_rows_are_integrable():
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.sample(np.random.default_rng(2))
    motion = vakonomic(scene, q, v, [0.3, -0.1, 0.2], duration=0.2, dt=0.01)
    run = cp.simulate(scene, q, v, duration=0.2, dt=0.01, drift=cp.simulation.NoDrift())
    assert motion.distance(run).max() < 1e-7


def test_motions_begin_as_the_rows_allow():
    with pytest.raises(cp.errors.NotAssembled, match="blade"):
        vakonomic(skate(), np.zeros(3), [0.0, 1.0, 0.0], duration=1.0, dt=0.1)
    with pytest.raises(cp.InvalidArgument, match="mu"):
        vakonomic(skate(), np.zeros(3), np.zeros(3), [np.nan], duration=1.0, dt=0.1)
    with pytest.raises(cp.InvalidArgument, match="dt"):
        vakonomic(skate(), np.zeros(3), np.zeros(3), duration=1.0, dt=0.0)
