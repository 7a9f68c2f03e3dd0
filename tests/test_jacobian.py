"""Stiff torques of a function: with their derivatives, or differenced where a step needs it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.simulation.torques import AppliedTorques

IMPLICIT = [
    cp.simulation.ImplicitMidpoint(), cp.simulation.LinearlyImplicitMidpoint(),
    cp.simulation.GeneralisedAlpha(), cp.simulation.RadauIIA(),
    cp.simulation.GearGuptaLeimkuhler(),
]  # fmt: skip
TAKING = [*IMPLICIT, cp.SemiImplicitEuler()]

K, C, REST = 8e5, 4e4, 0.1  # [N/m], [N s/m], [m]


def title(integrator) -> str:
    return type(integrator).__name__


def slider() -> cp.Scene:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slider")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("slider", model))


def held(t, q, v):
    return -K * (q - REST) - C * v


def of_held(t, q, v):
    return [[-K]], [[-C]]


def exactly(t: float) -> float:
    """q of m q'' + c q' + k (q - rest) = 0 from rest at zero."""
    root = np.sqrt(C**2 / 4 - K)
    fast, slow = -C / 2 - root, -K / (C / 2 + root)
    return REST + REST * (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (slow - fast)


@pytest.mark.parametrize("jacobian", [None, of_held], ids=["differences", "jacobian"])
@pytest.mark.parametrize("integrator", IMPLICIT, ids=title)
def test_a_stiff_slider_needs_no_small_step(integrator, jacobian):
    """The rates are 20 and 40 000 / s, a step is 1 ms."""
    found = cp.simulate(
        slider(), [0.0], [0.0], held, jacobian=jacobian, duration=0.2, integrator=integrator
    )
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert found.q[-1, 0] == pytest.approx(exactly(0.2), abs=2e-4)
    said = [notice for notice in found.notices if "differences" in notice]
    assert len(said) == (jacobian is None)
    assert all("3 times per step: pass jacobian=... to avoid them" in notice for notice in said)


@pytest.mark.long
def test_semi_implicit_euler_takes_derivatives_that_are_given():
    options = {"duration": 0.2, "integrator": cp.SemiImplicitEuler()}
    lost = cp.simulate(slider(), [0.0], [0.0], held, **options)
    assert lost.status is cp.simulation.RunStatus.DIVERGED
    assert "pass its derivatives as jacobian=..." in lost.reason
    assert lost.notices  # what overflows is no error of the measures
    found = cp.simulate(slider(), [0.0], [0.0], held, jacobian=of_held, **options)
    assert found.q[-1, 0] == pytest.approx(exactly(0.2), abs=1e-3)


@pytest.mark.parametrize("integrator", TAKING, ids=title)
def test_a_function_with_derivatives_is_what_springs_and_damping_are(integrator):
    """On a closed loop: step by step the same motion, to rounding."""
    plain = robot("four_bar")
    d, k, joint = np.array([3.0, 0.5, 1.0]), 4e3, plain.joints[0]
    model = pin.Model(plain.model)
    model.damping = d
    passive = replace(plain, model=model, springs=[cp.model.Spring(joint, k, 0.2)])
    q, v = cp.Scene(plain, plain.loops).sample(np.random.default_rng(2))
    at = plain.model.joints[plain.model.getJointId(joint)].idx_q
    by_q = np.zeros((3, 3))
    by_q[at, at] = -k

    def tau(t, q, v):
        out = -d * v
        out[at] -= k * (q[at] - 0.2)
        return out

    # a projection moves a body less where its springs and damping count as inertia
    options = {"duration": 0.05, "integrator": integrator, "drift": cp.simulation.NoDrift()}
    wanted = cp.simulate(cp.Scene(passive, plain.loops), q, v, **options)
    found = cp.simulate(
        cp.Scene(plain, plain.loops), q, v, tau, jacobian=lambda t, q, v: (by_q, -np.diag(d)),
        **options,
    )  # fmt: skip
    assert found.run.status.ok
    assert found.status is wanted.status  # without a drift scheme some come open, both alike
    assert np.abs(found.q - wanted.q).max() < 1e-9
    assert np.abs(found.v - wanted.v).max() < 1e-7
    lam = np.abs(wanted.lam).max()
    assert np.abs(found.lam - wanted.lam).max() < 1e-6 * lam


@pytest.mark.parametrize("given", [True, False], ids=["jacobian", "differences"])
@pytest.mark.parametrize("integrator", IMPLICIT, ids=title)
def test_springs_between_joints_have_derivatives_off_the_diagonal(integrator, given):
    """Two sliders tied to one another: together they fall as one, stiff as the tie is."""
    model = pin.Model()
    for name in ("one", "two"):
        joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), name)
        body = pin.Inertia(1.0, np.zeros(3), np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    scene = cp.Scene(cp.Robot("pair", model))
    tie = np.array([[-1.0, 1.0], [1.0, -1.0]])
    found = cp.simulate(
        scene, [1e-6, 0.0], [0.0, 0.0], lambda t, q, v: tie @ (K * q + C * v), duration=0.1,
        jacobian=(lambda t, q, v: (K * tie, C * tie)) if given else None, integrator=integrator,
    )  # fmt: skip
    assert found.status.ok
    assert found.q[-1].mean() == pytest.approx(5e-7 - 9.81 * 0.1**2 / 2, abs=2e-3 * 0.05)
    assert abs(np.diff(found.q[-1]).item()) < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("integrator", TAKING, ids=title)
def test_redundant_rows_do_not_matter(integrator):
    scene = slider()
    rails = [cp.Loop("world", "tip", "slider", axis="x", name=name) for name in ("rail", "again")]
    doubled, q, v = cp.Scene(scene.robot, rails), [0.0], [0.0]
    found = cp.simulate(doubled, q, v, held, jacobian=of_held, duration=0.02, integrator=integrator)
    wanted = cp.simulate(scene, q, v, held, jacobian=of_held, duration=0.02, integrator=integrator)
    assert found.status.ok
    assert found.q[-1, 0] == pytest.approx(wanted.q[-1, 0], abs=1e-7)


@pytest.mark.long
def test_what_is_not_stiff_is_not_differenced():
    """Nor is it said to be stiff, though one method looks at its differences at the start."""
    for integrator in IMPLICIT:
        found = cp.simulate(
            slider(), [0.0], [0.0], lambda t, q, v: -40.0 * q - v, duration=0.05,
            integrator=integrator,
        )  # fmt: skip
        assert found.status.ok
        assert found.run.differenced == 0
        assert not any("stiff" in notice for notice in found.notices)


@pytest.mark.long
def test_differences_are_along_the_tangent():
    """Of a free body, whose configuration has another coordinate than its velocity."""
    solo = robot("solo12")
    model = solo.model
    rng, n = np.random.default_rng(0), model.nv
    q0, q = (pin.integrate(model, pin.neutral(model), rng.normal(size=n)) for _ in range(2))
    D = rng.normal(size=(n, n))

    def tau(t, q, v):
        return 50.0 * pin.difference(model, q0, q) + D @ v

    by_q, by_v = AppliedTorques(solo, tau).slopes(0.0, q, rng.normal(size=n))
    wanted = 50.0 * pin.dDifference(model, q0, q, pin.ARG1)
    assert np.abs(by_q - wanted).max() < 1e-5
    assert np.abs(by_v - D).max() < 1e-6


@pytest.mark.long
def test_a_batch_takes_them_too():
    Q = np.linspace(0.0, 0.2, 3)[:, None]
    options = {"jacobian": of_held, "duration": 0.02, "integrator": cp.SemiImplicitEuler()}
    batch = cp.simulate_batch(slider(), Q, np.zeros((3, 1)), held, **options)
    for i, q in enumerate(Q):
        one = cp.simulate(slider(), q, [0.0], held, **options)
        assert np.array_equal(batch.q[i], one.q[-1])


@pytest.mark.long
def test_files_know_what_was_differenced(tmp_path):
    found = cp.simulate(
        slider(), [0.0], [0.0], held, duration=0.01, integrator=cp.simulation.ImplicitMidpoint()
    )
    found.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").run.differenced == found.run.differenced > 0


@pytest.mark.long
@pytest.mark.parametrize("rate", [1e3, 1e5, 1e7])
def test_a_start_that_damping_stops_within_a_step_is_not_thrown(rate):
    """A step is 1 ms: of 1 m/s there are 1 / rate metres left."""
    model = pin.Model(slider().robot.model)
    model.damping = np.array([rate])
    damped = cp.Scene(cp.Robot("slider", model))
    for rho in (0.0, 0.5, 0.8, 0.95):
        stopped = cp.simulate(
            damped, [0.0], [1.0], duration=0.5, integrator=cp.simulation.GeneralisedAlpha(rho=rho)
        )
        assert stopped.status.ok
        assert stopped.q[-1, 0] == pytest.approx(1 / rate, abs=1e-4)


@pytest.mark.parametrize(
    ("tau", "jacobian", "integrator", "match"),
    [
        (held, 3.0, cp.simulation.RadauIIA(), "jacobian = 3.0: a function"),
        (held, lambda t: ([[0.0]], [[0.0]]), cp.simulation.RadauIIA(), r"jacobian takes \(t\)"),
        ([1.0], of_held, cp.simulation.RadauIIA(), "tau is no function"),
        (held, of_held, None, "Runge-Kutta 4 does not use it; GearGuptaLeimkuhler, "),
        (held, of_held, cp.SemiImplicitEuler(implicit=False), "does not use it"),
        (
            held,
            lambda t, q, v: np.zeros((1, 1)),
            cp.simulation.RadauIIA(),
            "returns ndarray: a pair",
        ),
        (held, lambda t, q, v: (0.0, 0.0), cp.simulation.RadauIIA(), r"jacobian\(.*\)\[0\]"),
        (
            held,
            lambda t, q, v: ([[np.nan]], [[0.0]]),
            cp.simulation.RadauIIA(),
            r"jacobian\(.*\)\[0\]",
        ),
    ],
    ids=[
        "number",
        "of t alone",
        "constant torque",
        "explicit",
        "not implicit",
        "no pair",
        "shape",
        "nan",
    ],
)
def test_what_does_not_fit_is_refused(tau, jacobian, integrator, match):
    with pytest.raises(cp.InvalidArgument, match=match):
        cp.simulate(
            slider(), [0.0], [0.0], tau, jacobian=jacobian, duration=0.01, integrator=integrator
        )


@pytest.mark.parametrize("integrator", [*TAKING, cp.simulation.RadauIIA(1)], ids=repr)
def test_a_torque_that_takes_all_inertia_away_ends_a_run_by_name(integrator):
    """M - dt dtau/dv - dt^2 dtau/dq = 0 for the step of Euler's, and near it for the others."""
    stiffness = 1.0 / 1e-3**2
    found = cp.simulate(
        slider(), [0.1], [0.0], lambda t, q, v: stiffness * q, duration=5e-3,
        jacobian=lambda t, q, v: ([[stiffness]], [[0.0]]), integrator=integrator,
    )  # fmt: skip
    assert found.status.ok or "take a smaller dt" in found.reason
    if integrator == cp.SemiImplicitEuler():
        assert "M - dt dtau/dv - dt^2 dtau/dq is singular" in found.reason


@pytest.mark.long
@pytest.mark.parametrize(
    "solver", [cp.dynamics.NullSpace(), cp.dynamics.Reference(), cp.Proximal()]
)
@pytest.mark.parametrize(
    "integrator", [cp.SemiImplicitEuler(), cp.simulation.ImplicitMidpoint()], ids=title
)
def test_any_solver_of_hard_constraints_takes_them(integrator, solver):
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.sample(np.random.default_rng(2))
    options = {
        "duration": 0.02, "integrator": integrator, "drift": cp.Baumgarte.critical(50.0),
        "jacobian": lambda t, q, v: (-1e4 * np.eye(3), -1e3 * np.eye(3)),
    }  # fmt: skip
    found, wanted = (
        cp.simulate(scene, q, v, lambda t, q, v: -1e4 * q - 1e3 * v, solver=each, **options)
        for each in (solver, cp.dynamics.GaussPrinciple())
    )
    assert found.status.ok
    assert np.abs(found.q - wanted.q).max() < 1e-7


def test_constraints_that_give_way_take_them_or_say_that_they_cannot():
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()

    def run(stiff: float) -> cp.Trajectory:
        return cp.simulate(
            scene, q, v, lambda t, q, v: -stiff * v, solver=cp.dynamics.Soft(), duration=5e-3,
            jacobian=lambda t, q, v: (np.zeros((3, 3)), -stiff * np.eye(3)),
            integrator=cp.SemiImplicitEuler(),
        )  # fmt: skip

    assert run(1.0).status.ok
    hard = run(1e9)
    assert hard.status.ok or "too soft for the derivatives of tau" in hard.reason
