"""The work of contacts in its three parts: what they take, corrections, and the step's own."""

from __future__ import annotations

import json
from math import cos, sin, sqrt
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import condyn_pin as cp
from condyn_pin import FrictionalContact
from condyn_pin.constraints import Ball, Plane
from condyn_pin.contact import SemismoothNewton
from condyn_pin.dynamics import contact_gaps
from condyn_pin.model import free_ball, free_box
from condyn_pin.stepping import Anitescu, Moreau, SoftStep, StewartTrinkle
from condyn_pin.viewing import plots

G = 9.81  # [m/s^2]
EXACT = SemismoothNewton()
FLOOR = Plane()


def box_scene(friction: float, plane: Plane = FLOOR) -> cp.Scene:
    """A box of 1 kg on four corners."""
    corners = [
        FrictionalContact("box", offset=(x, y, -0.05), friction=friction, on=plane, name=f"{x}{y}")
        for x in (-0.1, 0.1)
        for y in (-0.1, 0.1)
    ]
    return cp.Scene(free_box(mass=1.0, size=(0.2, 0.2, 0.1)), contacts=corners)


def lying(deep: float = 0.0) -> np.ndarray:
    return np.array([0, 0, 0.05 - deep, 0, 0, 0, 1.0])


def fallen(name: str, seed: int, duration: float, **variant: str) -> cp.Trajectory:
    """A limp robot from a random state, 2 cm over the floor."""
    robot = cp.load_robot(name, variant=variant) if variant else cp.load_robot(name)
    scene = cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(0.7))
    q, v = scene.sample(np.random.default_rng(seed), spread=0.3)
    q[2] += 0.02 - min(contact_gaps(scene, q).values())
    run = cp.simulate(scene, q, v, duration=duration, dt=1e-3)
    assert run.status.ok, run.reason
    return run


FALLS = [
    ("solo12", 1, {}),
    ("go2", 2, {}),
    ("talos", 1, {}),
    ("cassie", 2, {"feet": "points"}),
]


@pytest.mark.parametrize(("name", "seed", "variant"), FALLS)
def test_contacts_only_take_in_a_fall(name: str, seed: int, variant: dict[str, str]) -> None:
    """All in one, their work rose in single steps of these falls, by 18 mJ in that of Talos."""
    energy = fallen(name, seed, 0.5, **variant).energy
    size = float(np.ptp(energy.total))
    assert energy.contact[-1] < -0.1 * size
    assert np.diff(energy.contact).max() <= 1e-9 * size
    assert np.diff(energy.algorithmic).min() >= 0.0
    assert 0.0 < energy.algorithmic[-1] < 5e-3 * size
    assert 0.0 < np.abs(energy.correction).max() < 1e-2 * size


def test_a_box_is_pushed_out_of_the_floor_slowly() -> None:
    """A fifth of 1 mm in each step of 20 ms, pressed all the time: friction and impacts have none.

    Impulses m (g dt + c_k - c_k-1), velocities c_k-1 to c_k = 0.2 0.8^k h / dt.
    """
    deep, dt, steps = 1e-3, 0.02, 30
    c = np.concatenate(([0.0], 0.2 * 0.8 ** np.arange(steps) * deep / dt))
    done = (G * dt + np.diff(c)) * (c[1:] + c[:-1]) / 2
    run = cp.simulate(
        box_scene(0.5), lying(deep), np.zeros(6), duration=steps * dt, dt=dt, close_start=False,
        integrator=StewartTrinkle(contact=EXACT),
    )  # fmt: skip
    energy = run.energy
    assert_allclose(energy.correction[1:], np.cumsum(done), rtol=1e-9)
    assert_allclose(energy.correction[-1], G * deep, rtol=0.12)  # m g h, to a step
    assert_allclose(energy.correction + energy.error, energy.total - energy.total[0], atol=1e-12)
    assert np.abs(energy.contact).max() < 1e-12
    assert energy.algorithmic.max() < 1e-12


def test_a_box_is_thrown_out_of_the_floor() -> None:
    """A fifth of 1 mm in 1 ms is 0.2 m/s, with which it flies on: m c (c + g dt) / 2."""
    deep, dt = 1e-3, 1e-3
    c = 0.2 * deep / dt
    now = cp.step(box_scene(0.5), lying(deep), np.zeros(6), dt=dt)
    assert_allclose(now.correction_work, c * (c + G * dt) / 2, rtol=1e-6)
    assert abs(now.energy_lost) < 1e-12
    assert now.algorithmic_work < 1e-12
    assert "added by corrections 0.021" in str(now)


@pytest.mark.parametrize("scheme", [StewartTrinkle(contact=EXACT), Moreau(contact=EXACT)])
def test_friction_takes_what_a_box_slides(scheme: cp.simulation.ContactScheme) -> None:
    """- mu m g s of the mean velocity, and m v^2 / 2 until it rests."""
    mu, v0, dt = 0.5, 1.0, 1e-3
    v = np.array([v0, 0, 0, 0, 0, 0])
    run = cp.simulate(box_scene(mu), lying(), v, duration=0.3, dt=dt, integrator=scheme)
    energy = run.energy
    slid = np.concatenate(([0.0], np.cumsum(dt * (run.v[1:, 0] + run.v[:-1, 0]) / 2)))
    moving = run.v[:, 0] > 1e-6
    assert_allclose(energy.contact[moving], -mu * G * slid[moving], atol=1e-9)
    assert_allclose(energy.contact[-1], -(v0**2) / 2, atol=1e-9)
    assert np.abs(energy.correction).max() < 1e-12
    assert energy.algorithmic.max() < 1e-9


@pytest.mark.parametrize("scheme", [StewartTrinkle(), Moreau(), Anitescu()])
def test_an_impact_takes_the_kinetic_energy(scheme: cp.simulation.ContactScheme) -> None:
    """Of a ball that falls by 0.2 m, without restitution: m g h."""
    fall, dt = 0.2, 1e-4
    scene = cp.Scene(free_ball(mass=1.0, radius=0.05), contacts=[
        FrictionalContact("ball", Ball(0.05), friction=0.2)])  # fmt: skip
    q = np.array([0, 0, 0.05 + fall, 0, 0, 0, 1.0])
    run = cp.simulate(scene, q, np.zeros(6), duration=0.3, dt=dt, integrator=scheme)
    energy = run.energy
    assert_allclose(energy.contact[-1], -G * fall, rtol=2 * dt * sqrt(2 * G / fall))
    assert np.abs(energy.correction).max() < 1e-8
    assert energy.algorithmic.max() < 1e-8


@pytest.mark.long
def test_the_parts_are_all_that_impulses_do() -> None:
    """lam_n of every corner times the mean of its velocities, by rigid-body kinematics."""
    scene, rng, dt = box_scene(0.0), np.random.default_rng(5), 1e-3
    taken, pushed = 0, 0
    for _ in range(40):
        turn = pin.exp3(0.1 * rng.normal(size=3))
        q = np.concatenate([[0, 0, 0], pin.Quaternion(turn).coeffs()])
        q[2] = -min(contact_gaps(scene, q).values()) + rng.uniform(-1e-3, 5e-4)
        v = rng.normal(size=6) * [0.3, 0.3, 0.5, 3, 3, 3]
        now = cp.step(scene, q, v, dt=dt, integrator=StewartTrinkle(contact=EXACT))
        v1 = now.v.copy()  # in the axes of q
        v1[:3] = pin.exp3(dt * v1[3:]) @ v1[:3]
        mean, work = (v + v1) / 2, 0.0
        for contact in scene.contacts:
            speed = turn @ (mean[:3] + np.cross(mean[3:], contact.offset))
            work += now.impulses[contact.name][2] * speed[2]
        done = now.correction_work + now.algorithmic_work - now.energy_lost
        assert_allclose(done, work, rtol=1e-9, atol=1e-12)
        assert min(now.energy_lost, now.algorithmic_work, now.correction_work) >= 0.0
        taken, pushed = taken + (now.energy_lost > 0), pushed + (now.correction_work > 0)
    assert taken > 10
    assert pushed > 10


def test_closing_loops_is_a_correction() -> None:
    """The energy of q+ less that of q (+) dt v+, where the loops are open, springs with it."""
    robot = cp.load_robot("cassie", variant={"feet": "points"})
    scene = cp.Scene(robot, robot.loops)
    model, data = robot.model, robot.model.createData()
    q, v = scene.sample(np.random.default_rng(3), spread=0.2)
    dt = 1e-3
    now = cp.step(scene, q, v, dt=dt)
    # v+ of the floating body in the axes of q
    v1, i = now.v.copy(), robot.model.joints[1].idx_v
    v1[i : i + 3] = pin.exp3(dt * v1[i + 3 : i + 6]) @ v1[i : i + 3]
    left = pin.integrate(model, q, dt * v1)
    left[:3] = q[:3] + dt * (pin.Quaternion(q[3:7]) * v1[i : i + 3])
    energies = [
        pin.computeKineticEnergy(model, data, at, now.v)
        + pin.computePotentialEnergy(model, data, at)
        + sum(
            spring.stiffness * (at[model.joints[model.getJointId(spring.joint)].idx_q]
                                - spring.reference) ** 2 / 2
            for spring in robot.springs
        )
        for at in (left, now.q)
    ]  # fmt: skip
    assert abs(now.correction_work) > 1e-6
    assert_allclose(now.correction_work, energies[1] - energies[0], rtol=1e-6, atol=1e-12)
    assert now.energy_lost == 0.0


@pytest.mark.long
def test_springs_of_contacts_give_back() -> None:
    run = cp.simulate(
        box_scene(0.5), lying(-0.01), np.zeros(6), duration=0.3, integrator=SoftStep()
    )
    assert np.diff(run.energy.contact).max() > 1e-6
    assert not run.energy.correction.any()
    assert not run.energy.algorithmic.any()


def tipping(dt: float) -> cp.Trajectory:
    """A rod that tips over a point of its own, which sticks: its path bends in every step."""
    rod, tilt = free_box(mass=1.0, size=(0.02, 0.02, 1.0)), 0.3
    foot = FrictionalContact("box", offset=(0, 0, -0.5), friction=5.0, name="foot")
    q = np.array([0, 0, 0.5 * cos(tilt), 0, sin(tilt / 2), 0, cos(tilt / 2)])
    return cp.simulate(cp.Scene(rod, contacts=[foot]), q, np.zeros(6), duration=0.5, dt=dt)


def test_what_is_of_the_steps_goes_with_their_size() -> None:
    """Friction would do nothing, for the point stands still: what it gives is of first order."""
    energies = [tipping(dt).energy for dt in (2e-3, 1e-3, 5e-4)]
    given = [float(energy.algorithmic[-1]) for energy in energies]
    assert given[0] == pytest.approx(4.9e-4, rel=0.05)
    assert_allclose(given[1:], np.divide(given[:2], 2), rtol=0.05)
    assert all(-1e-3 < energy.contact[-1] < 0.0 for energy in energies)
    assert not any("steps added" in notice for notice in tipping(1e-2).notices)
    assert "use a smaller dt" in next(x for x in tipping(5e-2).notices if "steps added" in x)


def test_files_of_before_have_all_work_in_one(tmp_path: Path) -> None:
    scene = box_scene(0.5)
    run = cp.simulate(scene, lying(-0.01), np.zeros(6), duration=0.1)
    batch = cp.simulate_batch(scene, [lying(-0.01)] * 2, np.zeros((2, 6)), duration=0.1, record=1)
    run.save(tmp_path / "run.npz")
    batch.save(tmp_path / "batch.npz")
    for name, columns in (("run", "contact"), ("batch", "samples_contact")):
        with np.load(tmp_path / f"{name}.npz") as file:
            content = dict(file)
        assert json.loads(str(content["header"]))["format"].endswith("trajectory 2")
        content[columns] = np.delete(content[columns], [2, 3], axis=-1)
        np.savez(tmp_path / f"{name}-before.npz", **content)
    for read in (
        cp.Trajectory.load(tmp_path / "run-before.npz"),
        cp.simulation.BatchTrajectory.load(tmp_path / "batch-before.npz")[1],
    ):
        assert np.array_equal(read.energy.contact, run.energy.contact)
        assert not read.energy.correction.any()
        assert not read.energy.algorithmic.any()
        assert (read.modes["-0.1-0.1"] == run.modes["-0.1-0.1"]).all()


def test_files_and_tables_have_every_part(tmp_path: Path) -> None:
    scene = box_scene(0.5)
    run = cp.simulate(scene, lying(1e-3), np.zeros(6), duration=0.05, close_start=False)
    assert run.energy.correction[-1] > 0.0
    assert f"corrections {run.energy.correction[-1]:.4g} J" in str(run)
    run.save(tmp_path / "run.npz")
    read = cp.Trajectory.load(tmp_path / "run.npz")
    for part in ("contact", "correction", "algorithmic"):
        assert np.array_equal(getattr(read.energy, part), getattr(run.energy, part))
    labels = [text.get_text() for text in plots.energy(run).get_legend().get_texts()]
    assert {"contacts", "corrections"} <= set(labels)
    run.to_csv(tmp_path / "run.csv")
    heading = (tmp_path / "run.csv").read_text().partition("\n")[0]
    assert heading.endswith("contact [J],correction [J],algorithmic [J],doubt [J]")
    steps = cp.stepping.step_batch(scene, [lying(1e-3)], np.zeros((1, 6)), dt=1e-3)
    one = steps[0]
    lost = [one.energy_lost, one.correction_work, one.algorithmic_work]
    assert np.array_equal(steps.errors[0, 5:], lost)
