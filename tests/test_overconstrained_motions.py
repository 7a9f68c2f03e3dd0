"""Motions, projections, steps and ticks of machines whose rows are redundant when closed only.

Bennett's linkage and a trammel with a crank say whether stages of a step, a little open, keep the
rank of the closed machine: with all rows they hold still. Cassie's loops are the same, with noise.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from overconstrained import BENNETTS, bennett, machines

import condyn_pin as cp
from condyn_pin.constraints import JointFriction
from condyn_pin.mechanism import project_acceleration, project_velocity
from condyn_pin.simulation import (
    INTEGRATORS,
    CoordinatePartitioning,
    DormandPrince,
    Integrator,
    PostStabilization,
    Projection,
    RungeKutta4,
)
from condyn_pin.stepping import StewartTrinkle

Array = np.ndarray

MOVING = [*BENNETTS, "trammel", "three cranks"]

NOISE = (1e-7, 1e-5, 1e-4)


def run(name: str, integrator: Integrator, duration: float, **options) -> cp.simulation.Trajectory:
    """A motion from rest, or of Cassie from slow, without what takes energy."""
    scene = machines()[name]
    if scene.robot.nv > 4:
        q, v = scene.sample(np.random.default_rng(0))
        v = 0.03 * v
    else:
        q, v = scene.state()
    return cp.simulate(
        scene, q, v, duration=duration, integrator=integrator, springs=False, damping=False,
        **options,
    )  # fmt: skip


def energy_off(motion: cp.simulation.Trajectory) -> float:
    """Largest energy that appeared or vanished [J]."""
    return float(np.abs(motion.energy.error).max())


def off(one: cp.simulation.Trajectory, other: cp.simulation.Trajectory) -> float:
    """Distance of the ends of two motions [rad, m]."""
    return float(np.abs(pin.difference(one.scene.robot.model, one.q[-1], other.q[-1])).max())


# Motions


@pytest.mark.parametrize("name", ["bennett", "bennett, twisted", "trammel"])
def test_the_default_motion_is_that_of_independent_coordinates(name):
    motion = run(name, RungeKutta4(), 0.4, dt=1e-3)
    assert motion.t[-1] == pytest.approx(0.4)
    assert energy_off(motion) < 1e-8
    assert off(motion, run(name, CoordinatePartitioning(), 0.4, dt=1e-3)) < 1e-8


@pytest.mark.parametrize("name", MOVING)
def test_stages_keep_their_order(name):
    """Halving dt leaves a sixteenth of the energy."""
    coarse, fine = (energy_off(run(name, RungeKutta4(), 0.4, dt=dt)) for dt in (8e-3, 4e-3))
    assert 11 < coarse / fine < 23


def torques_asked(scene: cp.Scene) -> int:
    """How often a second of an adaptive method evaluates torques: six times a substep."""
    count = 0

    def still(t: float, q: Array, v: Array) -> Array:
        nonlocal count
        count += 1
        return np.zeros(scene.robot.nv)

    method = DormandPrince(1e-6, 1e-9, method=5)
    motion = cp.simulate(scene, *scene.state(), still, duration=1.0, dt=1.0, integrator=method)
    assert energy_off(motion) < 1e-3
    return count


@pytest.mark.parametrize("name", ["bennett", "trammel"])
def test_substeps_are_as_long_as_those_of_a_four_bar(name):
    assert torques_asked(machines()[name]) < 1.2 * torques_asked(machines()["four_bar, hinge"])


@pytest.mark.values
@pytest.mark.parametrize("name", ["bennett", "trammel", "bricard", "cassie"])
@pytest.mark.parametrize("method", INTEGRATORS)
def test_every_integrator_keeps_the_energy(name, method):
    """As well as its order says: within what half the step leaves of it, and a tenth of it."""
    dt, steps = 2e-3, 8
    whole, half = (
        run(name, INTEGRATORS[method](), steps * dt, dt=h) for h in (dt, dt / 2)
    )  # fmt: skip
    assert whole.t[-1] == pytest.approx(steps * dt)
    assert half.t[-1] == pytest.approx(steps * dt)
    scale = max(whole.energy.scale, 1e-3)
    assert energy_off(half) <= max(0.7 * energy_off(whole), 1e-9 * scale)
    assert off(whole, half) < 1e-2


@pytest.mark.parametrize(
    "drift", [PostStabilization(), PostStabilization("euclidean"), Projection()]
)
@pytest.mark.parametrize("name", ["bennett", "trammel"])
def test_large_steps_are_closed_along_the_rows_that_are_kept(name, drift):
    """Euler's steps open the loops by 1e-4: what looks independent there would stop the machine."""
    motion = run(name, INTEGRATORS["expliciteuler"](), 0.2, dt=4e-3, drift=drift)
    exact = run(name, RungeKutta4(), 0.2, dt=1e-3)
    assert off(motion, exact) < 2e-2
    assert motion.violation.max() < 1e-6


# Projections


def off_by(name: str, noise: float, seed: int = 0) -> tuple[cp.Scene, Array, Array]:
    """A state that is open by some noise, and the closed one beside it."""
    scene, rng = machines()[name], np.random.default_rng(seed)
    closed = scene.state()[0]
    return (
        scene,
        pin.integrate(scene.robot.model, closed, noise * rng.normal(size=scene.robot.nv)),
        closed,
    )


@pytest.mark.values
@pytest.mark.parametrize("noise", [1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize("name", [*BENNETTS, "trammel", "three cranks"])
def test_velocities_on_open_loops_are_those_of_the_closed_machine(name, noise):
    scene, q, closed = off_by(name, noise)
    rng = np.random.default_rng(1)
    v, a = rng.normal(size=(2, scene.robot.nv))
    at_rest = 0.0 * v
    there = project_velocity(scene, closed, v)
    assert np.abs(there).max() > 0.01
    assert np.abs(project_velocity(scene, q, v) - there).max() < 50 * noise
    found = project_acceleration(scene, q, at_rest, a)
    assert np.abs(found - project_acceleration(scene, closed, at_rest, a)).max() < 50 * noise


# Steps with contacts


@pytest.mark.parametrize("noise", NOISE)
def test_a_step_on_open_loops_is_that_of_the_closed_machine(noise):
    loop = bennett(*BENNETTS["bennett"])
    scene = cp.Scene(loop.robot, loop.constraints, [JointFriction("hinge0", 0.3)])
    _, q, closed = off_by("bennett", noise)
    v = project_velocity(loop, closed, np.ones(3))
    here, there = (
        cp.step(scene, at, v, dt=1e-3, integrator=StewartTrinkle()) for at in (q, closed)
    )
    assert here.status.ok
    assert here.constraint_error < 1e-12
    assert np.abs(here.v - there.v).max() < 50 * noise
    assert np.abs(here.lam - there.lam).max() < 50 * noise


# Control


@pytest.fixture(scope="module")
def standing():
    """A controller of Cassie on the edges of its feet."""
    pytest.importorskip("proxsuite")
    robot = cp.load_robot("cassie", variant={"feet": "lines", "springs": "locked"})
    scene = cp.Scene(robot, [*robot.loops, *robot.contacts])
    tasks = (
        cp.control.CenterOfMass(kp=20, weight=100),
        cp.control.Orientation("pelvis", weight=50),
        cp.control.Posture(weight=0.1),
    )
    cones = cp.contact.WrenchCone(0.6, normal=(0.0, 0.0, 1.0))
    return cp.control.Controller(scene, tasks, cones=cones), scene, cp.Scene(robot, robot.loops)


@pytest.mark.parametrize("noise", NOISE)
def test_a_tick_at_noisy_encoders_is_that_of_the_closed_machine(standing, noise):
    controller, scene, loops = standing
    rng, robot = np.random.default_rng(0), scene.robot
    start = scene.state()[0]
    for _ in range(3):
        q = pin.integrate(robot.model, start, noise * rng.normal(size=robot.nv))
        v = noise * rng.normal(size=robot.nv)
        found, closed = controller.solve(q, v), loops.assemble(q).q
        wanted = controller.solve(closed, project_velocity(loops, closed, v))
        assert found.status.ok
        assert np.abs(found.a - wanted.a).max() < 100 * noise * max(np.abs(wanted.a).max(), 9.81)


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-4])
def test_a_tick_at_noisy_velocities_is_solved(standing, noise):
    controller, scene, _ = standing
    rng, robot = np.random.default_rng(0), scene.robot
    q = pin.integrate(robot.model, scene.state()[0], noise * rng.normal(size=robot.nv))
    assert controller.solve(q, 0.1 * rng.normal(size=robot.nv)).status.ok
