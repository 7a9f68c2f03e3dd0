"""Steps with contacts by the compiled core are those of Python.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contact_problems import on_a_rough_floor
from numpy.testing import assert_allclose, assert_array_equal
from shared import HEADERS, robot, short_lever

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.tolerances import CONTACT_SOLVED, MOST_FRICTION
from condyn_pin.constraints import Ball, Box, Capsule, FrictionalContact, Plane
from condyn_pin.contact import ADMM, PGS, Lemke, SemismoothNewton
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.model import free_box, together
from condyn_pin.simulation.batch import motions
from condyn_pin.stepping import batch as steps
from condyn_pin.stepping import step_batch
from condyn_pin.stepping.batch import ERRORS

pytestmark = pytest.mark.native

# Both end Newton's method at rounding; what is left is that of M, h and J, and of their products.
EXACT = cp.StewartTrinkle(contact=SemismoothNewton())
ROUNDED = 1e-12
# Motions carry rounding on, step by step, and impacts make it larger.
MOVED = 1e-9
DT = 1e-3
CORE = {"executor": cp.Native(threads=1)} if HEADERS else {}


def on_feet(
    its: str | cp.Robot, friction: float
) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """A robot on its feet, with the torques that hold it: the scene, q, v and tau."""
    its = robot(its) if isinstance(its, str) else its
    scene = cp.Scene(its, its.loops, contacts=its.frictional_contacts(friction))
    q, v = (x.copy() for x in scene.state())
    q[2] -= min(cp.dynamics.contact_gaps(scene, q).values())
    held = cp.Scene(its, (*its.loops, *its.contacts))
    tau = np.array(cp.inverse_dynamics(held, q, v, np.zeros(its.nv)).tau)
    return scene, q, v, tau


def motion_of_solo(how: str, duration: float) -> tuple[cp.Scene, tuple[np.ndarray, ...], float]:
    """Solo12 that stands, slides or falls: the scene, its first states and torques, how long."""
    scene, q, v, tau = on_feet("solo12", friction=0.3 if how == "slides" else 0.7)
    if how == "slides":
        v[:2] = 1.5, 0.4
    if how == "falls":
        q[2] += 0.15
        v[:6] = 0.4, 0.1, 0.0, 1.0, 0.5, 0.2
        tau *= 0.0
    V = np.tile(v, (3, 1))
    V[1:, 6:] += np.random.default_rng(0).normal(scale=0.05, size=(2, 12))
    return scene, (np.tile(q, (3, 1)), V, tau), duration


SOLO = [("stands", 0.1), ("slides", 0.1), ("falls", 0.3)]


def along(how: str, duration: float) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """States along such a motion."""
    scene, (q, v, tau), _ = motion_of_solo(how, duration)
    run = cp.simulate_batch(scene, q, v, tau, duration=duration, dt=DT, record=3)
    assert run.ok
    assert run.samples is not None
    nq, nv = scene.robot.nq, scene.robot.nv
    return scene, run.samples.q.reshape(-1, nq), run.samples.v.reshape(-1, nv), tau


def only_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python takes no step of a batch."""

    def none(*_: object, **__: object) -> None:
        raise AssertionError("a step was left to Python")

    monkeypatch.setattr(steps, "step", none)
    monkeypatch.setattr(motions, "follow", none)


def assert_same_steps(
    found: cp.stepping.BatchStep, wanted: cp.stepping.BatchStep, rounded: float = ROUNDED
) -> None:
    assert_array_equal(found.statuses, wanted.statuses)
    assert_array_equal(found.codes, wanted.codes)
    for one, two in zip(found.v, wanted.v, strict=True):
        assert_allclose(one, two, rtol=0, atol=rounded * max(1.0, np.abs(two).max()))
    assert_allclose(found.q, wanted.q, rtol=0, atol=rounded)
    assert_allclose(found.lam, wanted.lam, rtol=0, atol=rounded * np.abs(wanted.lam).max())
    # of what laws leave both have rounding
    natural, momentum, slip, violation, penetration, *works = found.errors.T
    assert natural.max() <= CONTACT_SOLVED
    assert momentum.max() <= 1e-12
    assert slip.max() <= 1e-9
    assert_allclose(violation, wanted.errors[:, 3], rtol=0, atol=1e-12)
    assert_allclose(penetration, wanted.errors[:, 4], rtol=0, atol=1e-12)
    assert_allclose(np.array(works).T, wanted.errors[:, 5:], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("how", "duration"), SOLO)
def test_steps_are_those_of_python(how: str, duration: float) -> None:
    scene, q, v, tau = along(how, duration)
    wanted = step_batch(scene, q, v, tau, dt=DT, integrator=EXACT)
    found = step_batch(scene, q, v, tau, dt=DT, integrator=EXACT, **CORE)
    assert wanted.ok
    assert_same_steps(found, wanted)
    modes = {"stands": {1}, "slides": {2}, "falls": {0, 1, 2}}[how]
    assert modes <= set(np.unique(found.codes).tolist())


def test_quaternions_that_are_off_are_normalised_as_in_python() -> None:
    scene, q, v, tau = along("slides", 0.01)
    q = q.copy()
    q[1::2, 3:7] *= 1.0 + 1e-7  # a step from such a q as it is would be off by as much
    starts = q.copy()
    found, wanted = (
        step_batch(scene, q, v, tau, dt=DT, integrator=EXACT, **by) for by in (CORE, {})
    )
    assert_same_steps(found, wanted)
    assert_array_equal(q, starts)


@pytest.mark.parametrize(("how", "duration"), SOLO)
def test_motions_are_those_of_python(how: str, duration: float) -> None:
    scene, (q, v, tau), _ = motion_of_solo(how, duration)
    about = {"duration": duration, "dt": DT, "integrator": EXACT, "record": 7}
    wanted = cp.simulate_batch(scene, q, v, tau, **about)
    found = cp.simulate_batch(scene, q, v, tau, **about, **CORE)
    assert_array_equal(found.statuses, wanted.statuses)
    for name in ("t", "q", "v", "lam", "contact"):
        one, two = (getattr(x.samples, name) for x in (found, wanted))
        assert_allclose(one, two, rtol=0, atol=MOVED * max(1.0, np.abs(two).max()), err_msg=name)
    assert_allclose(found.samples.a, wanted.samples.a, rtol=0, atol=MOVED / DT)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=0, atol=MOVED)
    for part in ("contact", "correction", "algorithmic"):
        one, two = (getattr(x[1].energy, part) for x in (found, wanted))
        assert_allclose(one, two, rtol=0, atol=MOVED)
    last = cp.simulate_batch(scene, q, v, tau, **(about | {"record": None}), **CORE)
    assert_allclose(last.q, wanted.q, rtol=0, atol=MOVED)


def test_the_core_leaves_nothing_that_stands_or_slides(monkeypatch: pytest.MonkeyPatch) -> None:
    for how in ("stands", "slides"):
        scene, (q, v, tau), duration = motion_of_solo(how, 0.05)
        with monkeypatch.context() as held:
            only_the_core(held)
            for contact in (ADMM(), SemismoothNewton()):
                by = cp.StewartTrinkle(contact=contact)
                assert step_batch(scene, q, v, tau, dt=DT, integrator=by, **CORE).ok
                run = cp.simulate_batch(
                    scene, q, v, tau, duration=duration, dt=DT, integrator=by, **CORE
                )
                assert run.ok


@pytest.mark.parametrize(("how", "duration"), SOLO)
def test_by_default_it_is_as_near_to_the_answer_as_python(how: str, duration: float) -> None:
    """Python's ADMM leaves up to 1e-8 of what slides, and the core begins with Newton's method."""
    scene, q, v, tau = along(how, duration)
    exact = step_batch(scene, q, v, tau, dt=DT, integrator=EXACT)
    wanted = step_batch(scene, q, v, tau, dt=DT)
    found = step_batch(scene, q, v, tau, dt=DT, **CORE)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_same_steps(found, exact)
    assert found.natural.max() <= max(wanted.natural.max(), 1e-13)


def test_what_sticks_is_judged_by_its_velocity_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction makes a thousand times too much of its slip."""
    scene, *state = on_a_rough_floor("talos", MOST_FRICTION)
    wanted = step_batch(scene, *(x[None] for x in state), dt=DT)
    only_the_core(monkeypatch)
    found = step_batch(scene, *(x[None] for x in state), dt=DT, **CORE)
    assert_array_equal(found.codes, wanted.codes)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-10)
    assert 1e-10 < found.natural.max() < 1e-9  # what is left of the slip, and not a thousand times


ALTERNATING = [
    ADMM(anderson=0), ADMM(anderson=2), ADMM(tolerance=1e-10), ADMM(tolerance=1e-5),
    ADMM(polish=True), ADMM(max_iterations=5), ADMM(max_iterations=999),
]  # fmt: skip


@pytest.mark.once  # two solvers of one G and g
@pytest.mark.parametrize("contact", ALTERNATING, ids=repr)
@pytest.mark.parametrize(("how", "duration"), SOLO)
def test_alternating_directions_are_those_of_python(
    how: str, duration: float, contact: ADMM
) -> None:
    """Iteration by iteration, and what is tried where they fail.

    Few stall until the iterations end, and some are led ahead by nearly singular memories: these
    carry rounding on, and are as near as their residuals.
    """
    scene, q, v, tau = along(how, duration)
    by = cp.StewartTrinkle(contact=contact)
    wanted = step_batch(scene, q, v, tau, dt=DT, integrator=by)
    found = step_batch(scene, q, v, tau, dt=DT, integrator=by, **CORE)
    assert_as_near_as_residuals(found, wanted)
    if pin.__version__ == HEADERS:  # another version has another iteration
        assert np.median(np.abs(found.v - wanted.v).max(axis=1)) <= ROUNDED
        assert np.median(np.abs(found.natural - wanted.natural)) <= ROUNDED
        modes = np.unique(found.codes)
        iterates = not (contact.polish or contact.tolerance > 1e-8 or contact.max_iterations < 9)
        assert not (2 in modes and iterates) or found.natural.max() > 1e-12  # none is polished


def test_a_tolerance_of_zero_is_as_good_as_any() -> None:
    """It ended in an error of the core; nothing reaches it, and Newton's method ends each step."""
    how, duration = SOLO[-1]
    scene, q, v, tau = along(how, duration)
    by = cp.StewartTrinkle(contact=ADMM(tolerance=0.0))
    found = step_batch(scene, q, v, tau, dt=DT, integrator=by, **CORE)
    assert_as_near_as_residuals(found, step_batch(scene, q, v, tau, dt=DT, integrator=by))


def assert_as_near_as_residuals(
    found: cp.stepping.BatchStep, wanted: cp.stepping.BatchStep
) -> None:
    assert wanted.ok
    assert_array_equal(found.statuses, wanted.statuses)
    left = 100 * np.maximum(found.natural, wanted.natural) + ROUNDED
    size = max(1.0, np.abs(wanted.v).max())
    assert (np.abs(found.v - wanted.v).max(axis=1) <= left * size).all()
    assert max(found.natural.max(), wanted.natural.max()) <= CONTACT_SOLVED


@pytest.mark.parametrize("contact", [ADMM(), ADMM(anderson=0), ADMM(polish=True)], ids=repr)
def test_alternating_directions_of_stops_dry_friction_and_islands(contact: ADMM) -> None:
    """Three bodies apart, and joints at their stops: each island by itself."""
    by = cp.StewartTrinkle(contact=contact)
    scene, q, _, tau = on_feet("solo12", friction=0.3)
    held = at_stops(scene, q)
    V = np.random.default_rng(2).normal(scale=0.5, size=(20, held.robot.nv))
    state = np.tile(q, (20, 1)), V, tau
    wanted = step_batch(held, *state, dt=DT, integrator=by)
    found = step_batch(held, *state, dt=DT, integrator=by, **CORE)
    assert_as_near_as_residuals(found, wanted)
    three, Q, V = boxes_on_their_way()
    wanted = step_batch(three, Q, V, dt=5e-3, integrator=by)
    found = step_batch(three, Q, V, dt=5e-3, integrator=by, **CORE)
    fine = wanted.statuses == 0
    assert fine.mean() > 0.8
    assert_array_equal(found.statuses, wanted.statuses)
    if contact.polish:
        assert_allclose(found.v[fine], wanted.v[fine], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "value"),
    [(0, 0.0), (4, -1.0), (5, -1e-9), (5, np.nan), (6, -1.0), (7, 1e12), (8, np.nan)],
)
def test_plans_that_make_no_sense_are_refused_at_the_border(place: int, value: float) -> None:
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    workspace = cp.Workspace(scene.bilateral)
    contacts = steps.contacts_of(workspace, tuple(scene.contacts))
    plan = steps.step_plan(cp.StewartTrinkle(), DT)
    rows = 3 * len(scene.contacts)
    out = {
        "q": np.zeros((1, len(q))), "v": np.zeros((1, len(v))), "lam": np.zeros((1, rows)),
        "errors": np.zeros((1, len(ERRORS))), "modes": np.zeros((1, 4), np.int32),
        "done": np.zeros(1, np.int32), **steps.paths_of(workspace, DT),
    }  # fmt: skip
    contacts.step(q[None], v[None], tau[None], plan=plan, **out, threads=1)
    assert out["done"][0]
    plan[place] = value
    with pytest.raises(ValueError, match=r"dt|method of contacts"):
        contacts.step(q[None], v[None], tau[None], plan=plan, **out, threads=1)
    with pytest.raises(ValueError, match="plan of a step"):
        contacts.step(q[None], v[None], tau[None], plan=plan[:-1].copy(), **out, threads=1)


def test_threads_and_other_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, q, v, tau = along("falls", 0.1)
    one = step_batch(scene, q, v, tau, dt=DT, **CORE)
    two = step_batch(scene, q, v, tau, dt=DT, executor=cp.Native(threads=3), chunk=7)
    for name in ("q", "v", "lam", "codes", "errors"):
        assert_array_equal(getattr(one, name), getattr(two, name))


def boxes(friction: float) -> cp.Scene:
    """A box over a slanted plane, a ball and a capsule over the floor."""
    bodies = together({name: free_box(size=(0.2, 0.1, 0.1)) for name in ("box", "ball", "rod")})
    slope = Plane((0.3, 0.1, 1.0))
    contacts = [
        FrictionalContact("box/box", Box(0.1, 0.05, 0.05), on=slope, friction=friction),
        FrictionalContact("ball/box", Ball(0.05), friction=friction),
        FrictionalContact("rod/box", Capsule(0.05, 0.05), friction=0.0),
    ]
    return cp.Scene(bodies, contacts=contacts)


def boxes_on_their_way() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Them near the floor, and how they move."""
    scene = boxes(0.4)
    rng = np.random.default_rng(1)
    Q = np.tile(pin.neutral(scene.robot.model), (40, 1))
    for place in range(3):
        Q[:, 7 * place : 7 * place + 3] = rng.uniform(-0.02, 0.02, size=(40, 3))
        Q[:, 7 * place] += place
        Q[:, 7 * place + 2] += rng.uniform(0.05, 0.15, size=40)
        turn = rng.normal(size=(40, 4))
        Q[:, 7 * place + 3 : 7 * place + 7] = turn / np.linalg.norm(turn, axis=1)[:, None]
    return scene, Q, rng.normal(scale=2.0, size=(40, 18))


def test_balls_capsules_and_boxes_over_planes() -> None:
    scene, Q, V = boxes_on_their_way()
    wanted = step_batch(scene, Q, V, dt=5e-3, integrator=EXACT)
    found = step_batch(scene, Q, V, dt=5e-3, integrator=EXACT, **CORE)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-9)
    assert {0, 1, 2} <= set(np.unique(found.codes).tolist())


def test_stops_and_dry_friction_of_joints() -> None:
    scene, q, _, tau = on_feet("solo12", friction=0.7)
    held = at_stops(scene, q)
    rng = np.random.default_rng(2)
    V = rng.normal(scale=0.5, size=(30, held.robot.nv))
    Q = np.tile(q, (30, 1))
    wanted = step_batch(held, Q, V, tau, dt=DT, integrator=EXACT)
    found = step_batch(held, Q, V, tau, dt=DT, integrator=EXACT, **CORE)
    assert wanted.ok
    assert_same_steps(found, wanted, rounded=1e-11)
    of_stops = found.codes[:, 4:16]
    assert 0 < of_stops.mean() < 1


def at_stops(scene: cp.Scene, q: np.ndarray) -> cp.Scene:
    """The scene with ranges of joints that end near q, and stops and dry friction of some."""
    model = pin.Model(scene.robot.model)
    model.lowerPositionLimit[7:] = q[7:] - 1e-4
    model.upperPositionLimit[7:] = q[7:] + 1e-4
    joints = list(model.names)[2:]
    more = [cp.constraints.JointLimit(joint) for joint in joints[:6]]
    more += [cp.constraints.JointFriction(joint, 0.05) for joint in joints[3:]]
    return cp.Scene(replace(scene.robot, model=model), contacts=(*scene.contacts, *more))


def test_a_step_that_is_hard_is_left_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """One in which soles contradict each other by their gaps; the motion goes on in the core."""
    scene, q, v, tau = on_feet("talos", friction=0.7)
    v[0] = 0.2
    about = {"duration": 0.03, "dt": DT, "record": 4}
    wanted = cp.simulate_batch(scene, q[None], v[None], tau, **about)
    taken = []
    step = motions.ContactSteps.step

    def counted(self: object, *state: np.ndarray) -> tuple[np.ndarray, ...]:
        taken.append(state)
        return step(self, *state)

    only_the_core(monkeypatch)
    monkeypatch.setattr(motions.ContactSteps, "step", counted)
    found = cp.simulate_batch(scene, q[None], v[None], tau, **about, **CORE)
    assert 0 < len(taken) < 15
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.samples.t, wanted.samples.t, rtol=0, atol=1e-15)
    assert_allclose(found.samples.v, wanted.samples.v, rtol=0, atol=1e-6)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-4)
    assert found.samples.contact[..., 0].max() <= CONTACT_SOLVED


def cassie() -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    its = cp.load_robot("cassie", variant={"feet": "points", "springs": "locked"})
    return on_feet(its, friction=0.7)


def test_loops_are_condensed_and_closed() -> None:
    scene, q, v, tau = cassie()
    rng = np.random.default_rng(3)
    states = [(q, v)]
    for _ in range(6):
        moved = cp.simulate(
            scene, q, v, tau + 5.0 * rng.normal(size=len(tau)), duration=0.02, dt=DT
        )
        states += [*zip(moved.q[5:], moved.v[5:], strict=True)]
    Q, V = (np.array(x) for x in zip(*states, strict=True))
    wanted = step_batch(scene, Q, V, tau, dt=DT, integrator=EXACT)
    found = step_batch(scene, Q, V, tau, dt=DT, integrator=EXACT, **CORE)
    assert wanted.ok
    assert_same_steps(found, wanted, rounded=1e-10)
    assert found.errors[:, 3].max() <= 1e-12


def test_a_foot_that_is_held_beside_feet_that_are_not() -> None:
    """Anchored where each motion begins, and nowhere in steps that follow."""
    scene, q, _, tau = on_feet("solo12", friction=0.5)
    its = scene.robot
    held = cp.Scene(its, its.contacts[:1], contacts=scene.contacts[1:])
    V = np.random.default_rng(5).normal(scale=0.2, size=(4, its.nv))
    rest = cp.Scene(its, its.contacts[:1])
    V = np.array([cp.impact(rest, q, each).v for each in V])
    Q = np.tile(q, (4, 1))
    about = {"duration": 0.03, "dt": DT, "integrator": EXACT, "record": 10}
    wanted = cp.simulate_batch(held, Q, V, tau, **about)
    found = cp.simulate_batch(held, Q, V, tau, **about, **CORE)
    assert wanted.ok
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.samples.v, wanted.samples.v, rtol=0, atol=MOVED)
    assert_allclose(found.violation, wanted.violation, rtol=0, atol=1e-12)
    moved = wanted.q.copy()
    moved[:, 0] += 0.1
    one = step_batch(held, moved, wanted.v, tau, dt=DT, integrator=EXACT, **CORE)
    assert_same_steps(one, step_batch(held, moved, wanted.v, tau, dt=DT, integrator=EXACT))


@pytest.mark.parametrize("corners", [slice(0, 8), slice(1, 4), slice(5, 8), slice(2, 6)])
@pytest.mark.parametrize("soles", [1, 2])
def test_corners_beside_soles_that_constraints_hold(soles: int, corners: slice) -> None:
    """Without a redundant row the factors of the constraints read what nobody had set."""
    its = robot("talos")
    feet = its.frictional_contacts(friction=0.7)[corners]
    scene = cp.Scene(its, its.contacts[:soles], contacts=feet)
    q, _ = scene.state(on_ground=False)
    rng = np.random.default_rng(0)
    V = [cp.mechanism.project_velocity(scene, q, rng.normal(size=its.nv)) for _ in range(3)]
    Q, V, tau = np.tile(q, (3, 1)), np.array(V), np.zeros(its.nv)
    found = step_batch(scene, Q, V, tau, dt=DT, integrator=EXACT, **CORE)
    assert_same_steps(found, step_batch(scene, Q, V, tau, dt=DT, integrator=EXACT), rounded=1e-10)
    assert found.errors[:, 1:3].max() <= 1e-11


def test_a_start_that_penetrates_is_refused_by_python() -> None:
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    q[2] -= 0.01
    found = cp.simulate_batch(scene, q[None], v[None], tau, duration=0.01, **CORE)
    assert "penetrates" in found.reasons[0]


def test_what_it_does_not_take_is_refused_by_name() -> None:
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    state = q[None], v[None], tau
    for by, words in (
        (cp.Moreau(), "StewartTrinkle alone"),
        (cp.StewartTrinkle(contact=PGS()), "PGS"),
        (cp.StewartTrinkle(contact=Lemke()), "Lemke"),
    ):
        with pytest.raises(UnsupportedBackend, match=words):
            step_batch(scene, *state, dt=DT, integrator=by, **CORE)
        with pytest.raises(UnsupportedBackend, match=words):
            cp.simulate_batch(scene, *state, duration=0.01, integrator=by, **CORE)
        where = cp.Native(threads=1, where_possible=True)
        assert step_batch(scene, *state, dt=DT, integrator=by, executor=where).ok


@pytest.mark.parametrize("r", [1e-6, 2e-11])
def test_impulses_that_rounding_balances_are_not_ok_here_either(r):
    """A thousandth of 8e12 N s is rounding: where a step is ok, momentum balances."""
    scene = short_lever(r)
    q, v = scene.state()
    q[2] = -1e-6
    batch = step_batch(scene, [q, q], [v, v], dt=DT, **CORE)
    ok = np.delete(np.arange(2), batch.failed)
    assert len(ok) == 2 or r < 1e-6
    assert (batch.errors[ok, ERRORS.index("dynamics_error")] < 1e-9).all()


def test_steps_that_may_have_several_motions_are_pythons():
    """A box that slides and spins, one in a slot, and a ball that walls press from both sides."""
    cube = Box(0.1, 0.1, 0.1)
    floor = FrictionalContact("box", cube, friction=0.5, name="floor")
    walls = [
        FrictionalContact("box", cube, on=Plane((s, 0, 0), -0.1), friction=0.2, name=name)
        for s, name in ((1, "left"), (-1, "right"))
    ]
    tight = [replace(each, on=replace(each.on, height=-0.1 + 2e-3)) for each in walls]
    for contacts in ([floor], [*walls, floor], tight):
        scene = cp.Scene(free_box(), contacts=contacts)
        q, v = scene.state()
        v[1], v[5] = 1.0, 2.0 if contacts == [floor] else 0.0
        ended = step_batch(scene, [q], [v], dt=DT, **CORE)
        alone = cp.step(scene, q, v, dt=DT)
        assert_array_equal(ended.v[0], alone.v)
        assert_array_equal(ended.q[0], alone.q)
