"""Time stepping with contacts, against motions that are known."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from contact_problems import on_a_rough_floor
from numpy.testing import assert_allclose
from shared import each_row, short_lever

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    Driven,
    FrictionalContact,
    HeldJoint,
    JointFriction,
    JointLimit,
    Plane,
    Point,
    Polynomial,
)
from condyn_pin.constraints.contacts.shapes import Shape
from condyn_pin.contact import ADMM, ContactProblem, SemismoothNewton, SolverResult
from condyn_pin.dynamics import contact_gaps
from condyn_pin.errors import StepFailed
from condyn_pin.model import free_ball, free_box, painleve_rod, pendulum, together
from condyn_pin.stepping import Anitescu, Moreau, SoftStep, StewartTrinkle, step_problem

G = 9.81
SCHEMES = (StewartTrinkle(), Moreau(), Anitescu(), SoftStep())
HARD = SCHEMES[:3]
EXACT = SemismoothNewton()
FLOOR = Plane()


def box_scene(friction: float, plane: Plane = FLOOR) -> cp.Scene:
    """A box of 1 kg whose lower face is four points."""
    box = free_box(mass=1.0, size=(0.2, 0.2, 0.1))
    corners = [
        FrictionalContact("box", offset=(x, y, -0.05), friction=friction, on=plane, name=f"{x}{y}")
        for x in (-0.1, 0.1)
        for y in (-0.1, 0.1)
    ]
    return cp.Scene(box, contacts=corners)


def lying(slope: float) -> np.ndarray:
    """The box with its lower face on a plane through the origin that rises along x."""
    R = pin.utils.rotate("y", -slope)
    return np.concatenate([R @ (0, 0, 0.05), pin.Quaternion(R).coeffs()])


def sloped(slope: float, friction: float) -> cp.Scene:
    return box_scene(friction, Plane(normal=(-sin(slope), 0, cos(slope))))


def robot_scene(name: str, friction: float = 0.7, **options: object) -> cp.Scene:
    robot = cp.load_robot(name, **options)
    return cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(friction))


def standing(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """The first posture, its lowest contact on the ground."""
    q, v = scene.state()
    q[2] -= min(contact_gaps(scene, q).values())
    return q, v


@pytest.mark.parametrize("scheme", HARD)
def test_a_box_slides_down_a_slope(scheme: cp.simulation.ContactScheme) -> None:
    scene, dt = sloped(pi / 6, 0.3), 1e-3
    q, v = lying(pi / 6), np.zeros(6)
    for _ in range(3):
        now = cp.step(scene, q, v, dt=dt, integrator=replace(scheme, contact=EXACT))
        a = (now.v - v) / dt
        q, v = now.q, now.v
        if scheme.law == "ncp":
            assert_allclose(a[:3], (-2.35629, 0, 0), atol=1e-5)
            assert set(now.modes.values()) == {"slide"}


@pytest.mark.parametrize("scheme", HARD)
@pytest.mark.parametrize("friction", [0.57736, 0.8])
def test_a_box_sticks_on_a_slope(scheme: cp.simulation.ContactScheme, friction: float) -> None:
    now = cp.step(
        sloped(pi / 6, friction), lying(pi / 6), np.zeros(6), dt=1e-3,
        integrator=replace(scheme, contact=EXACT),
    )  # fmt: skip
    assert np.abs(now.v).max() < 1e-12
    assert set(now.modes.values()) == {"stick"}


def test_a_box_slides_on_a_level_floor_and_stops() -> None:
    angle, dt = 0.3, 1e-3
    v = np.array([cos(angle), sin(angle), 0, 0, 0, 0])
    run = cp.simulate(box_scene(0.5), lying(0.0), v, duration=0.25, dt=dt)
    moved = run.q[-1, :2]
    assert_allclose(np.linalg.norm(moved), 0.101437, atol=2e-6)
    assert_allclose(np.arctan2(moved[1], moved[0]), angle, atol=1e-6)
    stops = run.t[np.linalg.norm(run.v[:, :2], axis=1) > 1e-9][-1]
    assert_allclose(stops, 0.203874, atol=dt)
    corner = next(iter(run.modes.values()))
    assert corner[1] == "slide"
    assert corner[-1] == "stick"
    # friction takes all of it, and the balance has nothing left over but what a step is off by
    assert_allclose(run.energy.contact[-1], -0.5, atol=1e-6)
    assert np.abs(run.energy.error).max() < 1e-6


@pytest.mark.long
def test_the_forces_of_four_corners_carry_the_box() -> None:
    now = cp.step(box_scene(0.5), lying(0.0), np.zeros(6), (3.0, 0, 0, 0, 0, 0), dt=1e-2)
    assert not now.contact.unique_forces  # rank 6 of 12: only what they do together is known
    assert_allclose(sum(now.forces.values()), (-3, 0, G), atol=1e-5)
    assert np.abs(now.v).max() < 1e-7
    assert now.dynamics_error < 1e-15


@pytest.mark.parametrize(("dt", "error"), [(1e-3, 1.3e-4), (1e-4, 2.4e-5)])
def test_a_ball_rebounds(dt: float, error: float) -> None:
    ball = free_ball(mass=1.0, radius=0.05)
    scene = cp.Scene(
        ball, contacts=[FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)]
    )
    q = np.array([0, 0, 0.55, 0, 0, 0, 1.0])
    run = cp.simulate(scene, q, np.zeros(6), duration=0.6, dt=dt, integrator=Moreau())
    assert abs(run.q[-1, 2] - 0.05 - 0.316859) < error
    assert_allclose(run.energy.contact[-1], -0.36 * G * 0.5, rtol=5 * dt)


def test_a_ball_comes_to_rest() -> None:
    ball = free_ball(mass=1.0, radius=0.05)
    scene = cp.Scene(
        ball, contacts=[FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)]
    )
    q = np.array([0, 0, 0.55, 0, 0, 0, 1.0])
    run = cp.simulate(scene, q, np.zeros(6), duration=3.0, dt=1e-3, integrator=Moreau())
    heights = run.q[:, 2] - 0.05
    peaks = [h for a, h, b in zip(heights, heights[1:], heights[2:], strict=False) if a < h >= b]
    assert_allclose(peaks[:2], (0.32, 0.2048), rtol=0.01)
    assert np.abs(run.v[run.t > 2.95]).max() < 0.02
    assert abs(heights[-1]) < 1e-3


def test_a_cradle_obeys_newtons_law_of_impact() -> None:
    model = pin.Model()
    for i in range(3):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"slide {i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"ball {i}", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    left_half = Plane(normal=(-1, 0, 0), height=0.05)
    contacts = [
        FrictionalContact(
            f"ball {i}", Ball(0.05), on=f"ball {i + 1}", on_shape=left_half, friction=0.0,
            restitution=1.0, name=f"hit {i}",
        )
        for i in range(2)
    ]  # fmt: skip
    scene = cp.Scene(cp.Robot("cradle", model), contacts=contacts)
    now = cp.step(scene, (0, 0.1, 0.2), (1.0, 0, 0), dt=1e-9, integrator=Moreau(contact=EXACT))
    assert_allclose(now.v, (-1 / 3, 2 / 3, 2 / 3), atol=1e-12)
    assert abs(now.energy_lost) < 1e-12


def test_painleves_rod_is_stopped_by_an_impulse() -> None:
    rod = painleve_rod()
    scene = cp.Scene(rod, contacts=[FrictionalContact("tip", Point(), friction=1.5)])
    q = rod.postures["paradox"]
    for dt, expected in ((1e-3, (0.4029, 0.3083)), (1e-5, (0.4000, 0.3001))):
        now = cp.step(scene, q, (-1.0, 0, 0), dt=dt)
        t1, _, n = now.impulses["tip"]
        assert_allclose((t1, n), expected, atol=2e-4)
        assert now.modes == {"tip": "stick"}
        assert now.status.ok


@pytest.mark.long
def test_anitescus_relaxation_hops() -> None:
    v = np.array([1.0, 0, 0, 0, 0, 0])
    scene, q = box_scene(0.5), lying(0.0)
    now = cp.step(scene, q, v, dt=1e-2, integrator=Anitescu(contact=EXACT))
    assert_allclose(now.v[[0, 2]], (0.76076, 0.38038), atol=2e-5)
    assert_allclose(now.contact.residuals.uplift * now.contact.problem.scale[1], 0.38038, atol=2e-5)
    for dt in (1e-3, 1e-4):
        run = cp.simulate(scene, q, v, duration=0.08, dt=dt, integrator=Anitescu())
        assert 7e-3 < min(gap.max() for gap in run.gaps.values()) < 9.5e-3


def test_solo12_stands_on_its_four_feet() -> None:
    scene = robot_scene("solo12")
    q, v = standing(scene)
    closed = cp.Scene(scene.robot, scene.robot.contacts)
    tau = cp.inverse_dynamics(closed, q, v, np.zeros_like(v)).tau
    now = cp.step(scene, q, v, tau, dt=1e-3)
    up = [force[2] for force in now.forces.values()]
    assert_allclose(np.sum(up), 4 * 6.131, atol=2e-3)
    assert set(now.modes.values()) == {"stick"}
    assert now.penetration < 1e-9


@pytest.mark.long
def test_feet_that_stick_move_alike_however_rough_the_floor_is() -> None:
    ends = []
    for friction in (0.7, 100.0, tolerances.MOST_FRICTION):
        now = cp.step(*on_a_rough_floor("talos", friction), dt=1e-3)
        assert now.contact.iterations == 1
        ends.append(now.v)
    assert_allclose(ends[1:], ends[:1] * 2, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scheme", HARD)
def test_cassie_falls_with_its_loops_closed(scheme: cp.simulation.ContactScheme) -> None:
    scene = robot_scene("cassie", variant={"feet": "points"})
    q, v = standing(scene)
    run = cp.simulate(scene, q, v, duration=0.1, dt=1e-3, integrator=scheme)
    assert run.status.ok, run.reason
    assert run.violation.max() < 1e-5
    assert run.contact is not None
    assert run.contact.natural.max() <= 1e-8


def test_a_step_holds_loops_to_rounding() -> None:
    scene = robot_scene("cassie", variant={"feet": "points"})
    q, v = standing(scene)
    now = cp.step(scene, q, v, dt=1e-3)
    speed = float(np.abs(now.v).max())
    assert now.constraint_error < 1e-15 * max(speed, 1.0)
    assert now.dynamics_error < 1e-14
    assert now.violation < 1e-9


def test_a_stop_and_dry_friction_hold_a_joint() -> None:
    arm = cp.model.pendulum()
    joint = arm.joints[0]
    model = pin.Model(arm.model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -0.5, 0.5
    arm = replace(arm, model=model)
    stops = cp.Scene(arm, contacts=[JointLimit(joint)])
    q, v = np.array([0.5]), np.array([1.0])
    exact = StewartTrinkle(contact=EXACT)
    now = cp.step(stops, q, v, dt=1e-3, integrator=exact)
    assert abs(now.v[0]) < 1e-12
    dry = cp.Scene(arm, contacts=[JointFriction(joint, torque=100.0)])
    now = cp.step(dry, np.array([0.3]), np.zeros(1), dt=1e-3, integrator=exact)
    assert abs(now.v[0]) < 1e-12
    assert list(now.modes.values()) == ["stick"]
    weak = cp.Scene(arm, contacts=[JointFriction(joint, torque=1e-3)])
    now = cp.step(weak, np.array([0.3]), np.zeros(1), dt=1e-3)
    assert_allclose(abs(now.forces[now.contact.problem.names[0]]), 1e-3)
    assert list(now.modes.values()) == ["slide"]


@pytest.mark.values
@pytest.mark.parametrize("torque", [0.0, 0.05, 5.0, 1e3])
@pytest.mark.parametrize("reach", [1e-3, 1e-9, 0.0])  # [rad]
def test_stops_at_both_ends_and_dry_friction_come_to_rest(reach: float, torque: float) -> None:
    """What a step leaves of a gap is not pushed out against friction that could hold it."""
    model, joint = pin.Model(), 0
    for i in range(3):
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.3 if i else 0.0]))
        joint = model.addJoint(
            joint, pin.JointModelRY(), at, f"j{i}",
            np.array([10.0]), np.array([100.0]), np.array([-reach]), np.array([reach]),
        )  # fmt: skip
        middle = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.15]))
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.05, 0.05, 0.3), middle)
    stops = [JointLimit(f"j{i}") for i in range(3)]
    dry = [JointFriction(f"j{i}", torque=torque) for i in range(3)]
    scene = cp.Scene(cp.Robot("arm", model), contacts=[*stops, *dry])
    for dt in (1e-3, 2e-2):
        run = cp.simulate(scene, np.zeros(3), np.array([2.0, -1.0, 3.0]), duration=0.4, dt=dt)
        assert run.status.ok, run.reason
        assert min(gap.min() for gap in run.gaps.values()) > -2e-9
        assert not torque or np.abs(run.v[-1]).max() < 1e-6


def test_a_soft_contact_sinks_in_and_rests() -> None:
    run = cp.simulate(
        box_scene(0.5), lying(0.0), np.zeros(6), duration=0.5, dt=1e-3, integrator=SoftStep()
    )
    assert run.status.ok, run.reason
    assert np.abs(run.v[-1]).max() < 1e-6
    depth = -min(gap[-1] for gap in run.gaps.values())
    assert 1e-6 < depth < 1e-3
    assert_allclose(sum(force[-1, 2] for force in run.forces.values()), G, rtol=1e-6)


def test_an_integrator_that_cannot_let_go_is_refused() -> None:
    with pytest.raises(cp.errors.UnsupportedConstraint, match="StewartTrinkle"):
        cp.simulate(
            box_scene(0.5), lying(0.0), np.zeros(6), duration=0.1, integrator=cp.RungeKutta4()
        )
    with pytest.raises(cp.InvalidArgument, match="a scheme with contacts"):
        cp.step(box_scene(0.5), lying(0.0), np.zeros(6), dt=1e-3, integrator=cp.RungeKutta4())


@each_row("scheme", [StewartTrinkle(), Anitescu(), SoftStep()])
def test_restitution_is_refused_where_nothing_rebounds(
    scheme: cp.simulation.ContactScheme,
) -> None:
    scene = cp.Scene(
        free_ball(), contacts=[FrictionalContact("ball", Ball(0.05), friction=0, restitution=0.5)]
    )
    with pytest.raises(cp.InvalidArgument, match=r"restitution = 0.5.*Moreau"):
        cp.simulate(scene, scene.state()[0], np.zeros(6), duration=0.1, integrator=scheme)


@each_row("member", ["asked", "asked_by", "gives_way"])
def test_a_scheme_with_a_member_of_the_last_version_is_refused(member: str) -> None:
    with pytest.raises(cp.InvalidArgument, match=f"Own.{member}: its name is `\\w+` now"):
        type("Own", (Moreau,), {member: None})
    assert "own" not in cp.simulation.INTEGRATORS


@pytest.mark.long
def test_a_start_that_penetrates_is_refused() -> None:
    q = lying(0.0)
    q[2] -= 2e-3
    with pytest.raises(cp.errors.NotAssembled, match=r"penetrates by 0\.002"):
        cp.simulate(box_scene(0.5), q, np.zeros(6), duration=0.1)
    run = cp.simulate(box_scene(0.5), q, np.zeros(6), duration=0.05, close_start=False)
    assert run.status.ok
    assert min(gap[-1] for gap in run.gaps.values()) > -1e-6


def thrown() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    q = lying(0.2)
    q[2] += 0.02
    return box_scene(0.5), q, np.array([0.5, 0.2, 0, 0, 1.0, 0])


@pytest.mark.long
def test_a_file_keeps_contacts(tmp_path: Path) -> None:
    scene, q, v = thrown()
    run = cp.simulate(scene, q, v, duration=0.2, integrator=StewartTrinkle(contact=EXACT))
    run.save(tmp_path / "run.npz")
    read = cp.Trajectory.load(tmp_path / "run.npz")
    assert read.run.integrator == run.run.integrator
    assert read.row_names == run.row_names
    for name, force in run.forces.items():
        assert np.array_equal(read.forces[name], force)
        assert (read.modes[name] == run.modes[name]).all()
    assert np.array_equal(read.energy.contact, run.energy.contact)
    read.to_csv(tmp_path / "run.csv")
    assert "contact [J]" in (tmp_path / "run.csv").read_text().partition("\n")[0]


def test_a_batch_is_what_simulate_returns_to_the_bit() -> None:
    scene, q, v = thrown()
    both = cp.simulate_batch(scene, [q, q], [v, 0 * v], duration=0.1, record=1)
    for i, start in enumerate((v, 0 * v)):
        alone = cp.simulate(scene, q, start, duration=0.1)
        assert np.array_equal(both[i].q, alone.q)
        assert np.array_equal(both[i].lam, alone.lam)
        assert np.array_equal(both[i].energy.contact, alone.energy.contact)
        assert both[i].row_names == alone.row_names


def test_an_event_sees_gaps_and_modes() -> None:
    scene, q, v = thrown()
    name = "0.10.1"
    touches = cp.Event(name="touches", when=lambda moment: moment.gaps[name] - 1e-3)
    run = cp.simulate(scene, q, v, duration=0.3, events=[touches])
    assert run.status.name == "ENDED"
    assert abs(run.gaps[name][-1] - 1e-3) < 1e-9
    pressed = cp.Event(
        name="pressed", when=lambda m: float(m.modes[name] == "open" and m.forces[name][2] == 0)
    )
    free = cp.simulate(scene, q, v, duration=0.3)
    run = cp.simulate(scene, q, v, duration=0.3, events=[pressed])
    assert run.status.name == "ENDED"
    first = free.t[free.modes[name] != "open"][0]
    assert abs(run.t[-1] - first) <= 1.001e-3


def test_work_of_contacts_counts_the_steps_between_samples() -> None:
    scene, q, v = thrown()
    every = cp.simulate(scene, q, v, duration=0.2)
    tenth = cp.simulate(scene, q, v, duration=0.2, record=10)
    assert_allclose(tenth.energy.contact[-1], every.energy.contact[-1], rtol=1e-12)
    never = cp.Event(name="never", when=lambda moment: moment.q[2] + 1.0)
    half = cp.Event(name="half", at=0.1005, scene=scene)
    watched = cp.simulate(scene, q, v, duration=0.2, events=[never, half])
    assert_allclose(watched.energy.contact[-1], every.energy.contact[-1], rtol=1e-12)


def test_a_batch_of_steps_is_what_step_returns_to_the_bit() -> None:
    scene = robot_scene("solo12")
    q, v = standing(scene)
    rng = np.random.default_rng(4)
    V = rng.normal(scale=0.3, size=(5, len(v)))
    batch = cp.stepping.step_batch(scene, np.tile(q, (5, 1)), V, dt=1e-3)
    assert batch.ok
    for i, start in enumerate(V):
        now = cp.step(scene, q, start, dt=1e-3)
        assert np.array_equal(batch.v[i], now.v)
        assert np.array_equal(batch.lam[i], now.lam)
        assert [modes[i] for modes in batch.modes.values()] == list(now.modes.values())
        assert np.array_equal(batch[i].q, batch.q[i])
    assert len(batch[1:3]) == 2
    assert "5 ok" in str(batch)


@pytest.mark.long
def test_a_box_lies_on_a_box() -> None:
    """Pairs of bodies: the forces on both are in the proof of the step."""
    half = Box(0.1, 0.1, 0.05)
    boxes = together({name: free_box(size=(0.2, 0.2, 0.1)) for name in ("lower", "upper")})
    contacts = [
        FrictionalContact("lower/box", half, friction=0.5, name="ground"),
        FrictionalContact(
            "upper/box", half, on="lower/box", on_shape=half, friction=0.5, name="boxes"
        ),
    ]
    scene = cp.Scene(boxes, contacts=contacts)
    q = np.array([0, 0, 0.05, 0, 0, 0, 1, 0, 0, 0.15, 0, 0, 0, 1.0])
    run = cp.simulate(scene, q, np.zeros(12), duration=0.05, dt=1e-3)
    assert run.status.ok, run.reason
    assert np.abs(run.v[-1]).max() < 1e-6
    weight = {
        part: sum(force[-1, 2] for name, force in run.forces.items() if name.startswith(part))
        for part in ("ground", "boxes")
    }
    assert_allclose((weight["ground"], weight["boxes"]), (2 * G, G), rtol=1e-5)
    now = cp.step(scene, q, np.zeros(12), dt=1e-3)
    assert now.dynamics_error < 1e-15


@pytest.mark.parametrize(
    ("name", "options"),
    [("solo12", {}), ("go2", {}), ("talos", {}), ("cassie", {"variant": {"feet": "points"}})],
)
def test_robots_fall(name: str, options: dict[str, object]) -> None:
    """Limp, from random states: every step is answered, and what is closed stays closed."""
    scene, rng = robot_scene(name, **options), np.random.default_rng(0)
    q, v = scene.sample(rng)
    q[2] += 0.02 - min(contact_gaps(scene, q).values())
    run = cp.simulate(scene, q, v, duration=0.25, dt=5e-4)
    assert run.status.ok, run.reason
    assert run.contact is not None
    assert run.contact.natural.max() <= 1e-8
    assert any((modes != "open").any() for modes in run.modes.values())
    assert run.violation.max() <= 1e-9
    assert min(gap.min() for gap in run.gaps.values()) > -1e-3
    if not scene.robot.springs:  # stiff ones, at the end of a step, lose what they swing with
        assert np.abs(run.energy.error).max() < 0.05 * run.energy.scale


@pytest.mark.long
def test_a_first_order_step_keeps_a_four_bar_nearly_as_it_moves() -> None:
    """3e-4 m and 0.004 J after a second at 1 ms; 0.007 m and 0.15 J with velocities J_b v+ = 0."""
    robot = cp.load_robot("four_bar")
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.state()
    exact = cp.simulate(
        scene, q, v, duration=1.0, dt=1e-3, integrator=cp.simulation.DormandPrince()
    )
    for scheme, far, lost in ((cp.StewartTrinkle(), 2e-3, 0.01), (Moreau(), 2e-5, 1e-4)):
        run = cp.simulate(scene, q, v, duration=1.0, dt=1e-3, integrator=scheme)
        assert np.abs(run.q[-1] - exact.q[-1]).max() < far
        energy = run.energy
        assert abs(energy.error[-1] + energy.correction[-1]) < lost
        assert run.violation.max() < 1e-9


@pytest.mark.long
def test_a_foot_that_lands_with_both_ends_in_one_step() -> None:
    """Its ends are asked to approach each other by 1e-7 m/s, which no rigid foot does."""
    scene = robot_scene("cassie", variant={"feet": "points"})
    q, v = scene.sample(np.random.default_rng(2), spread=0.3)
    q[2] += 0.02 - min(contact_gaps(scene, q).values())
    run = cp.simulate(scene, q, v, duration=0.5, dt=5e-4)
    assert run.status.ok, run.reason
    assert run.violation.max() < 1e-9


def test_a_step_without_an_answer_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def give_up(problem: ContactProblem, *_: object) -> tuple[SolverResult, float]:
        return SolverResult(np.zeros(problem.rows), 1, ("nothing",)), float(problem.rows > 0)

    for name in ("first_attempt", "fallbacks"):
        monkeypatch.setattr(step_problem, name, give_up)
    scene, q, v = thrown()
    q[2] += 0.05
    run = cp.simulate(scene, q, v, duration=0.3)
    assert run.status.name == "FAILED"
    assert "leaves a natural residual of 1.0e+00" in run.reason
    assert "smaller dt" in run.reason
    assert 0 < run.t[-1] < 0.3
    with pytest.raises(cp.SolveFailed, match="inaccurate"):
        cp.step(box_scene(0.5), lying(0.0), np.zeros(6), dt=1e-3)
    now = cp.step(box_scene(0.5), lying(0.0), np.zeros(6), dt=1e-3, throw=False)
    assert not now.status.ok


@pytest.mark.long
def test_a_first_attempt_that_fails_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def fail(_: ADMM, problem: ContactProblem, guess: np.ndarray | None = None) -> SolverResult:
        asked.append(guess)
        return SolverResult(np.zeros(problem.rows), 1, ("ADMM",))

    monkeypatch.setattr(ADMM, "at_once", lambda _, problem: None)
    monkeypatch.setattr(ADMM, "attempt", fail)
    now = cp.step(box_scene(0.5), lying(0.0), np.zeros(6), dt=1e-3)
    assert now.status.ok
    assert now.contact.path == ("ADMM", "Newton")
    assert asked == [None]


def test_a_run_that_ends_in_the_infeasible_names_what_no_impulse_can_meet() -> None:
    """A ball between a floor and a lid that is driven down, at which nothing yields."""
    model = pin.Model()
    for name, joint in (("ball", pin.JointModelFreeFlyer()), ("lid", pin.JointModelPZ())):
        i = model.addJoint(0, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(i, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
        model.addFrame(pin.Frame(name, i, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    floor = FrictionalContact("ball", Ball(0.05), friction=0.5, name="floor")
    ceiling = replace(floor, on="lid", on_shape=Plane((0, 0, -1), 0.0), name="ceiling")
    wall = replace(floor, on=Plane((-1, 0, 0), -1.0), name="wall")
    down = Driven(HeldJoint("lid"), Polynomial((0.1, -1.0)))
    scene = cp.Scene(cp.Robot("pressed", model), [down], contacts=[floor, ceiling, wall])
    q, v = np.array([0, 0, 0.05, 0, 0, 0, 1.0, 0.1]), np.append(np.zeros(6), -1.0)
    with pytest.raises(cp.SolveFailed) as caught:
        cp.step(scene.at(0.0), q, v, dt=1e-3)
    answer = caught.value.solution.contact
    assert (answer.status.name, answer.unmet) == ("INFEASIBLE", ("floor", "ceiling"))
    with pytest.raises(StepFailed) as told:
        cp.simulate(scene, q, v, duration=0.01)
    assert str(answer.status) in str(told.value)
    assert "no impulse can meet floor, ceiling" in str(told.value)


@pytest.mark.long
def test_a_run_goes_on_from_its_own_end() -> None:
    """Also where loops have turned since the last step, so that v is a little off them."""
    scene = robot_scene("cassie", variant={"feet": "points"})
    q, v = scene.sample(np.random.default_rng(1))
    q[2] += 0.02 - min(contact_gaps(scene, q).values())
    whole = cp.simulate(scene, q, v, duration=0.1, dt=1e-3)
    half = cp.simulate(scene, q, v, duration=0.05, dt=1e-3)
    rest = cp.simulate(scene, half.q[-1], half.v[-1], duration=0.05, dt=1e-3)
    assert half.constraint_velocity[-1] > 1e-4  # else there is nothing to allow
    assert np.array_equal(rest.q[-1], whole.q[-1])
    fast = half.v[-1] + np.random.default_rng(0).normal(size=len(v))
    with pytest.raises(cp.errors.NotAssembled, match=r"\|J v\| = "):
        cp.simulate(scene, half.q[-1], fast, duration=0.05, dt=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("scheme", [StewartTrinkle(), Anitescu()])
@pytest.mark.parametrize("height", [-0.15, 0.1])  # [m], of the floor above the pivot
def test_a_fast_tip_lands_where_its_curved_path_ends(
    scheme: cp.simulation.ContactScheme, height: float
) -> None:
    """200 rad/s in steps of 0.5 ms: 1 mm off the tangent in a step, down and up."""
    floor = Plane(height=height)
    tip = FrictionalContact("tip", friction=0.5, on=floor)
    scene = cp.Scene(pendulum(length=0.2), contacts=[tip])
    begin, speed = (-1.4, 200.0) if height < 0 else (pi - 0.8, -200.0)
    for phase in np.linspace(0.0, 0.1, 5):
        run = cp.simulate(
            scene, [begin + phase], [speed], duration=0.02, dt=5e-4, integrator=scheme
        )
        gaps = run.gaps["tip"]
        assert gaps.min() > -1.5e-4
        assert gaps.min() < 1e-3  # it was there


def arms(one: Shape, other: Shape) -> cp.Scene:
    """Two links of 0.2 m, hinged 0.3 m apart, with a shape at each tip."""
    model = pin.Model()
    for k, x in enumerate((0.0, 0.3)):
        hinge = pin.SE3(np.eye(3), np.array([x, 0, 0]))
        joint = model.addJoint(0, pin.JointModelRY(), hinge, f"hinge {k}")
        tip = pin.SE3(np.eye(3), np.array([0, 0, -0.2]))
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(0.5, 0.02), tip)
        model.addFrame(pin.Frame(f"tip {k}", joint, 0, tip, pin.FrameType.OP_FRAME))
    tips = FrictionalContact("tip 0", one, on="tip 1", on_shape=other, friction=0.3)
    return cp.Scene(cp.Robot("arms", model), contacts=[tips])


SMALL, ROUND = Box(0.04, 0.04, 0.04), Capsule(0.02, 0.03)


@pytest.mark.parametrize(
    ("one", "other"), [(SMALL, SMALL), (ROUND, SMALL), (ROUND, ROUND)], ids=str
)
def test_shapes_on_fast_links_meet_where_their_curved_paths_do(one: Shape, other: Shape) -> None:
    """200 rad/s in steps of 0.5 ms: by straight paths they stopped up to 20 mm apart."""
    scene, met, rng = arms(one, other), 0, np.random.default_rng(0)
    for _ in range(20):
        q, speed = [rng.uniform(0.3, 0.6), rng.uniform(-0.6, 0.6)], rng.uniform(-200.0, 200.0)
        run = cp.simulate(scene, q, [-200.0, speed], duration=0.02, dt=5e-4)
        forces, gaps = np.array(list(run.forces.values()))[:, :, 2], np.array([*run.gaps.values()])
        first = np.flatnonzero((forces > 0).any(axis=0))[:1]
        met += len(first)
        assert np.abs(gaps.min(axis=0)[first]).max(initial=0.0) < 1.5e-4
    assert met >= 5


@pytest.mark.long
def test_balls_on_fast_links_meet_where_their_curved_paths_do() -> None:
    """100 rad/s in steps of 0.5 ms: straight paths end up to 0.6 mm before they meet."""
    scene, met = arms(Ball(0.02), Ball(0.02)), 0
    for lean in (-0.2, 0.0, 0.2, 0.4):
        for phase in np.linspace(0.3, 0.38, 5):
            run = cp.simulate(scene, [phase, lean], [-100.0, 100.0], duration=0.02, dt=5e-4)
            presses = np.flatnonzero(run.forces["tip 0"][:, 2] > 0)
            met += len(presses) > 0
            assert np.abs(run.gaps["tip 0"][presses[:1]]).max(initial=0.0) < 1e-4
    assert met >= 5


@pytest.mark.parametrize("scheme", [StewartTrinkle(), Anitescu()])
def test_a_limb_that_turns_over_its_top_wins_no_energy(
    scheme: cp.simulation.ContactScheme,
) -> None:
    """Under the floor its tip goes down while it turns: impulses of the beginning lift the body."""
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(body, pin.Inertia.FromSphere(5.0, 0.1), pin.SE3.Identity())
    limb = model.addJoint(body, pin.JointModelRY(), pin.SE3.Identity(), "limb")
    tip = pin.SE3(np.eye(3), np.array([0, 0, 0.2]))
    model.appendBodyToJoint(limb, pin.Inertia.FromSphere(0.1, 0.02), tip)
    model.addFrame(pin.Frame("tip", limb, 0, tip, pin.FrameType.OP_FRAME))
    scene = cp.Scene(
        cp.Robot("limb", model), contacts=[FrictionalContact("tip", Point(), friction=0.0)]
    )
    for down in (-0.5, -2.0):
        for speed in (50.0, 100.0, 200.0):
            for angle in np.linspace(0.0, 0.5, 6):
                q, v = [1e-4 - 0.2 * cos(angle), angle], [down, speed]
                now = cp.step(scene, q, v, dt=1e-3, integrator=scheme)
                assert now.gaps["tip"] == pytest.approx(0.0, abs=1e-4)
                assert now.energy_lost > now.correction_work + now.algorithmic_work
                assert now.dynamics_error < 1e-13


@pytest.mark.long
@pytest.mark.parametrize("seed", [7, 918])
def test_limp_legs_land_fast(seed: int) -> None:
    """Falls that went through by 3.4 mm, by straight paths, and by impulses of the beginning."""
    scene = robot_scene("go2")
    q, v = scene.sample(np.random.default_rng(seed), spread=0.3)
    q[2] += 0.02 - min(contact_gaps(scene, q).values())
    run = cp.simulate(scene, q, v, duration=0.5, dt=1e-3)
    assert run.status.ok, run.reason
    assert min(gap.min() for gap in run.gaps.values()) > -2e-4
    energy = run.energy
    assert np.diff(energy.contact + energy.algorithmic).max() < 1e-3 * energy.kinetic.max()


@pytest.mark.long
def test_contacts_stiffer_than_a_step_allows_throw_nothing_off() -> None:
    """At 5 ms a spring of 1 ms would: it counts as one of 10 ms, as MuJoCo has it."""
    scene, q = box_scene(0.5), lying(0.0)
    run = cp.simulate(
        scene, q, np.zeros(6), duration=0.5, dt=5e-3, integrator=SoftStep(solref=(1e-3, 1.0))
    )
    assert np.abs(run.q[:, 2] - q[2]).max() < 2e-3


@pytest.mark.long
@pytest.mark.parametrize("seed", [4])
def test_a_box_that_tumbles_comes_to_rest(seed: int) -> None:
    """On its edges four corners are about to slide: only one of several solvers ends there."""
    rng = np.random.default_rng(seed)
    shape = Box(0.1, 0.1, 0.1)
    contact = FrictionalContact("box", shape, friction=0.5, restitution=0.7)
    R = pin.exp3(0.4 * rng.normal(size=3))
    q = np.array([0, 0, 0.5, *pin.Quaternion(R).coeffs()])
    v = rng.normal(size=6) * [1, 1, 1, 5, 5, 5]
    scene = cp.Scene(free_box(), contacts=[contact])
    run = cp.simulate(scene, q, v, duration=2.0, dt=1e-3, integrator=Moreau())
    assert run.status.ok, run.reason


@pytest.mark.parametrize(("r", "is_right"), [(1e-6, True), (2e-11, False)])
def test_impulses_that_rounding_balances_are_not_ok(r: float, is_right: bool) -> None:
    """They lift the tip by 1e11 N s, and all but 1e-6 of what they do is taken back by what holds.

    The contact problem is solved to rounding; Newton and Euler see that momentum is not conserved.
    """
    scene = short_lever(r)
    q, v = scene.state()
    q[2] = -1e-6
    now = cp.step(scene, q, v, dt=1e-3, throw=False)
    assert now.contact.status.ok
    assert now.status.ok == is_right
    assert (now.dynamics_error <= now.dynamics_limit) == is_right
    assert any("M (v+ - v) is off by" in notice for notice in now.notices) != is_right
    assert ("note: M (v+ - v)" in str(now)) != is_right
    batch = cp.stepping.step_batch(scene, [q, q], [v, v], dt=1e-3)
    assert (not len(batch.failed)) == is_right
    if not is_right:
        with pytest.raises(cp.errors.SolveFailed, match=r"inaccurate: .*; M .v. - v. is off by"):
            cp.step(scene, q, v, dt=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("dt", [1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_what_may_be_off_is_never_less_than_rounding(dt: float, gravity: float) -> None:
    """Of fast bodies in short steps momentum hardly changes, and rounds all the same."""
    scene = robot_scene("solo12")
    model = pin.Model(scene.robot.model)
    model.gravity.linear = np.array([0, 0, -gravity])
    scene = replace(scene, robot=replace(scene.robot, model=model))
    rng = np.random.default_rng(1)
    q, _ = standing(scene)
    for speed in (0.0, 1.0, 1e3):
        now = cp.step(scene, q, speed * rng.normal(size=18), dt=dt, throw=False)
        assert now.status == now.contact.status


@pytest.mark.long
@pytest.mark.parametrize("scheme", [StewartTrinkle(), Anitescu(), Moreau()])
@pytest.mark.parametrize("soles", [1, 2])
def test_corners_of_a_sole_that_constraints_hold_move_nothing(soles, scheme) -> None:
    """G of them was rounding: impulses of 1e29 N s were said to be ok."""
    talos = cp.load_robot("talos")
    feet = talos.frictional_contacts(friction=0.7)
    scene = cp.Scene(talos, talos.contacts[:soles], contacts=feet)
    q, _ = scene.state(on_ground=False)
    rng = np.random.default_rng(0)
    for size in (0.0, 0.3, 3.0):
        v = cp.mechanism.project_velocity(scene, q, size * rng.normal(size=talos.nv))
        taken = cp.stepping.step(scene, q, v, dt=1e-3, integrator=scheme)
        assert taken.dynamics_error < 1e-10
        assert taken.constraint_error < 1e-10
        assert np.abs(taken.v).max() < 10 * max(np.abs(v).max(), 1.0)
        held = {name for name in taken.gaps if name.startswith(talos.contacts[0].name)}
        assert all(taken.modes[name] == "open" for name in held), taken.modes
