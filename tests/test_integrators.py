"""Integrators that keep the constraints, and implicit ones: closed loops, energy, damping."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest
from motions import bar, body, hanging_cassie, rod_pendulum
from shared import each_row, robot

import condyn_pin as cp

CLOSED = [kind() for kind in cp.simulation.INTEGRATORS.values() if kind.keeps_constraints]
IMPLICIT = [
    cp.simulation.StormerVerlet(), cp.simulation.ImplicitMidpoint(),
    cp.simulation.LinearlyImplicitMidpoint(), *CLOSED
]  # fmt: skip


@pytest.mark.values
@pytest.mark.parametrize("integrator", CLOSED, ids=repr)
@pytest.mark.parametrize("name", ["four_bar", "stewart"])
def test_loops_stay_closed_to_rounding(name, integrator):
    scene = cp.Scene(robot(name), robot(name).loops)
    q, v = scene.sample(np.random.default_rng(1))
    found = cp.simulate(scene, q, v, duration=0.05, dt=2.5e-3, integrator=integrator)
    assert found.status.ok, found.reason
    assert found.run.drift == cp.simulation.NoDrift()
    assert found.violation[1:].max() < 1e-13
    if isinstance(integrator, cp.simulation.Rattle | cp.simulation.GearGuptaLeimkuhler):
        assert found.constraint_velocity[1:].max() < 1e-12


def test_the_energy_of_rattle_does_not_drift():
    """Its first and its last tenth swing by the same; Runge-Kutta 4 loses with every turn."""
    scene, q, v = rod_pendulum()
    spread = []
    for integrator, drift in (
        (cp.simulation.Rattle(), cp.simulation.NoDrift()),
        (cp.RungeKutta4(), cp.simulation.Projection()),
    ):
        found = cp.simulate(scene, q, v, duration=80.0, dt=0.05, integrator=integrator, drift=drift)
        assert found.status.ok, found.reason
        error = np.abs(found.energy.error)
        tenth = len(error) // 10
        spread.append((error[:tenth].max(), error[-tenth:].max()))
    (first, last), (early, late) = spread
    assert last == pytest.approx(first, rel=1e-2)
    assert late > 5 * early


def test_rattle_is_symmetric_in_time():
    """Forth and back again: the start, to rounding."""
    scene, q, v = bar()
    there = cp.simulate(scene, q, v, duration=0.2, dt=0.02, integrator=cp.simulation.Rattle())
    back = cp.simulate(
        scene, there.q[-1], -there.v[-1], duration=0.2, dt=0.02, integrator=cp.simulation.Rattle()
    )
    assert np.abs(back.q[-1] - q).max() < 1e-10
    assert np.abs(back.v[-1] + v).max() < 1e-9


def test_stiff_damping_asks_for_no_small_step_of_implicit_methods():
    """Cassie's rods: 2700 / s, far beyond the 1 / dt of explicit methods."""
    exact = cp.simulate(*hanging_cassie(), duration=0.04, dt=5e-4)
    steps = {
        cp.simulation.GeneralisedAlpha(): 4e-3,
        cp.simulation.GearGuptaLeimkuhler(): 4e-3,
        cp.simulation.ImplicitMidpoint(): 4e-3,
        cp.simulation.LinearlyImplicitMidpoint(): 4e-3,
        cp.simulation.Rattle(): 2e-3,  # its wall are the springs
        cp.simulation.Shake(): 2e-3,
    }
    for integrator, dt in steps.items():
        found = cp.simulate(*hanging_cassie(), duration=0.04, dt=dt, integrator=integrator)
        # SHAKE, whose velocities are not tangent, is told to have them off where damping is stiff
        is_shake = isinstance(integrator, cp.simulation.Shake)
        assert found.run.status.ok, found.run.reason
        assert found.status.ok or (is_shake and "move apart" in found.reason), found.reason
        assert np.abs(found.q[-1] - exact.q[-1]).max() < 1e-3


@pytest.mark.parametrize("integrator", IMPLICIT, ids=repr)
def test_it_does_not_matter_how_far_away_a_machine_stands(integrator):
    """10 km from the origin, where positions are rounded to 2e-12 m."""
    motions = []
    for place in (0.0, 1e4):
        scene, q, v = hanging_box(place)
        found = cp.simulate(scene, q, v, duration=0.1, dt=2e-3, integrator=integrator)
        assert found.status.ok, found.reason
        assert found.violation.max() < 1e-10
        motions.append(np.hstack([found.q[:, :3] - place, found.q[:, 3:], found.v]))
    assert np.abs(motions[1] - motions[0]).max() < 1e-7


def hanging_box(place: float) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Return a box that hangs by a point 0.3 m from its middle, and a slow turn of it."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia.FromBox(1.0, 0.3, 0.2, 0.1), pin.SE3.Identity())
    hook = pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0]))
    model.addFrame(pin.Frame("hook", base, 0, hook, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("box", model), [cp.PointContact("hook")])
    turn = np.array([0.5, 1.0, 2.0])
    v = np.concatenate([-np.cross(turn, hook.translation), turn])
    return scene, np.array([place, place, place, 0.0, 0.0, 0.0, 1.0]), v


@pytest.mark.long
def test_independent_coordinates_do_not_jump_at_a_dead_point():
    """A parallelogram swings through the line where it may fold into a crossed one."""
    robot = cp.model.parallelogram()
    scene = cp.Scene(robot, robot.loops)
    run = cp.simulate(
        scene, *scene.state(), duration=0.5, integrator=cp.simulation.CoordinatePartitioning()
    )
    assert not run.status.ok
    assert "velocities jump by" in run.reason
    assert "as at a dead point; take a smaller dt than 0.001 s, or RungeKutta4()" in run.reason
    assert np.abs(run.energy.error).max() < 1e-8
    hangs = cp.load_robot("n_four_bar")
    scene = cp.Scene(hangs, hangs.loops)
    still = cp.simulate(
        scene, *scene.state(), duration=0.01, integrator=cp.simulation.CoordinatePartitioning()
    )
    assert still.status.ok


@pytest.mark.long
def test_steps_that_are_too_long_are_said_to_be():
    """And no damping is blamed where there is none."""
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=30.0, dt=3.0, integrator=cp.simulation.Rattle())
    assert found.status is cp.simulation.RunStatus.FAILED
    assert "RATTLE" in found.reason
    assert "smaller dt than 3 s" in found.reason
    assert "damping" not in found.reason
    assert np.array_equal(found.q[-1], q)


@pytest.mark.long
def test_rows_without_a_position_are_held_or_refused():
    """A sleigh that glides on its knife."""
    sleigh = robot("sleigh")
    scene = cp.Scene(sleigh, sleigh.contacts)
    q, v = scene.sample(np.random.default_rng(2))
    exact = cp.simulate(scene, q, v, duration=0.5, dt=5e-3)
    for integrator in CLOSED:
        if integrator.needs_positions:
            with pytest.raises(cp.errors.UnsupportedConstraint, match="restrict velocities only"):
                cp.simulate(scene, q, v, duration=0.5, dt=5e-3, integrator=integrator)
        else:
            found = cp.simulate(scene, q, v, duration=0.5, dt=5e-3, integrator=integrator)
            # steps with contacts have a velocity that is tangent in their middle, not at their end
            assert found.constraint_velocity.max() < (0.03 if integrator.takes_contacts else 1e-12)
            near = 1e-5 if integrator.order.v > 1 and not integrator.takes_contacts else 0.1
            assert np.abs(found.v[-1] - exact.v[-1]).max() < near
    for drift in (cp.simulation.Projection(), cp.simulation.PostStabilization()):
        found = cp.simulate(scene, q, v, duration=0.5, dt=5e-3, drift=drift)
        assert found.constraint_velocity.max() < 1e-9
        assert np.abs(found.v[-1] - exact.v[-1]).max() < 1e-7


@each_row(
    ("call", "said"),
    [
        (lambda: cp.simulation.RadauIIA(stages=4), "stages = 4"),
        (lambda: cp.simulation.RadauIIA(stages=True), "stages = True"),
        (lambda: cp.simulation.RadauIIA(stages=3.0), "stages = 3.0"),
        (lambda: cp.simulation.GearGuptaLeimkuhler(stages=0), "stages = 0"),
        (lambda: cp.simulation.GeneralisedAlpha(rho=1.5), r"rho = 1\.5"),
        (lambda: cp.simulation.GeneralisedAlpha(rho=1.0), r"rho = 1\.0: from 0 to below 1"),
        (lambda: cp.simulation.GeneralisedAlpha(rho=float("nan")), "rho"),
    ],
)
def test_knobs_that_mean_nothing_are_refused(call, said):
    with pytest.raises(cp.InvalidArgument, match=said):
        call()


@pytest.mark.long
@pytest.mark.parametrize("integrator", [cp.RungeKutta4(), cp.simulation.StormerVerlet()], ids=repr)
def test_a_run_that_damping_breaks_down_says_which_joint_and_what_dt_would_do(integrator):
    start = hanging_cassie()
    lost = cp.simulate(*start, duration=0.2, dt=2.5e-3, integrator=integrator)
    assert not lost.status.ok
    said = re.search(
        r"damping of joint '\w+-tarsus-crank-joint' .* RadauIIA\(3\), "
        r"LinearlyImplicitMidpoint\(\), or dt below (\S+) s",
        lost.reason,
    )
    assert said, lost.reason
    for dt, method in (
        (0.95 * float(said[1]), integrator),
        (2.5e-3, cp.simulation.RadauIIA(3)),
        (2.5e-3, cp.simulation.LinearlyImplicitMidpoint()),
    ):
        found = cp.simulate(*start, duration=0.05, dt=dt, integrator=method)
        assert found.status.ok, found.reason


@pytest.mark.long
def test_damping_that_stops_a_tumbling_body_at_once():
    """dt/2 of the first acceleration is a thousand times the velocity, and Coriolis its square."""
    damping = np.array([0.0, 0.0, 1e5])
    scene = cp.Scene(body(pin.JointModelSpherical(), centre=(0.1, 0.2, -0.1), damping=damping))
    v = np.array([50.0, 0.0, 50.0])
    parameters = {"duration": 0.02, "integrator": cp.simulation.LinearlyImplicitMidpoint()}
    found = cp.simulate(scene, [0, 0, 0, 1], v, **parameters)
    assert found.status.ok
    assert np.abs(found.v).max() < 10 * np.abs(v).max()  # measured: 3.6 times, it was 1e120


@pytest.mark.long
def test_rattle_with_a_row_that_is_nothing():
    """Along the axis of a wheel there is nothing to hold: J M^-1 J^T is zero."""
    wheel = body(pin.JointModelRZ(), centre=(0.1, 0.0, 0.0))
    across = cp.constraints.PlanarContact("origin", normal=(0.0, 0.0, 1.0))
    free, held = (
        cp.simulate(scene, [0.0], [3.0], duration=0.1, integrator=cp.simulation.Rattle())
        for scene in (cp.Scene(wheel), cp.Scene(wheel, [across]))
    )
    assert held.status.ok
    assert np.abs(held.q - free.q).max() < 1e-12
