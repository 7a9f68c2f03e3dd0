"""Springs and dampers between frames in the compiled core are those of Python.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from native_contacts import assert_motions_of_python, assert_steps_of_python, at_rest
from numpy.testing import assert_allclose, assert_array_equal
from shared import all_scenes
from test_applied_forces import chain_on
from test_native import (
    CLOSED,
    DRIFTS,
    MOVED,
    STEPS,
    assert_moved_alike,
    assert_moved_like_python,
    near,
)
from test_native_contact import CORE, DT, EXACT, assert_same_steps, on_feet, only_the_core
from test_native_contact import cassie as cassie_on_points
from test_native_step_derivatives import assert_same, beginning_to_fall, both
from test_spring_dampers import SPRINGS

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled
from condyn_pin.dynamics import DenseKKT
from condyn_pin.dynamics import compiled as arrays
from condyn_pin.gradients import step_derivatives_batch
from condyn_pin.gradients.routes import batch
from condyn_pin.model import SpringDamper, free_box, together
from condyn_pin.simulation.batch import motions
from condyn_pin.stepping import step_batch

pytestmark = pytest.mark.native

# Branch to branch, branch to body and branch to world; longer and shorter than at rest, and two
# that are a spring alone or a damper alone.
BETWEEN = {
    "four_bar": (
        SpringDamper("world", "coupler_tip", 400.0, 20.0, 0.2),
        SpringDamper("crank_tip", "rocker_tip", 1e3, 1e1),
    ),
    "solo12": (
        SpringDamper("FL_FOOT", "HR_FOOT", 300.0, 8.0, 0.1),
        SpringDamper("FR_LOWER_LEG", "base_link", 500.0, 0.0, 0.6),
        SpringDamper("world", "HL_UPPER_LEG", 0.0, 20.0),
    ),
    "cassie": (
        SpringDamper("left-foot", "right-foot", 800.0, 20.0, 0.05),
        SpringDamper("pelvis", "left-tarsus", 2e3, 30.0, 1.2),
    ),
}


def sprung(scene: cp.Scene) -> cp.Scene:
    """The scene of the same robot with springs between its frames."""
    name = next(name for name in BETWEEN if scene.robot.name.startswith(name))
    return replace(scene, robot=replace(scene.robot, spring_dampers=BETWEEN[name]))


def starts(scene: cp.Scene, count: int = 2) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    q, v = (np.array(x) for x in zip(*(scene.sample(rng) for _ in range(count)), strict=True))
    return scene, q, 0.3 * v, rng.normal(size=v.shape)


def chain() -> cp.Scene:
    return cp.Scene(replace(chain_on("spherical"), spring_dampers=SPRINGS))


# ------------------------------------------------------------------------------------------------
# Motions


@pytest.mark.pairs
@pytest.mark.parametrize("drift", ["Baumgarte", "post", "post, every third"])
@pytest.mark.parametrize("by", STEPS)
@pytest.mark.parametrize("label", ["cassie loops", "four_bar loops", "four_bar rod"])
def test_motions_of_loops_are_those_of_python(label: str, by: str, drift: str) -> None:
    """By `Proximal`, and by `Direct`, which corrects in the metric of all that is inertia."""
    within = CLOSED if label == "cassie loops" and drift.startswith("post") else MOVED
    assert_moved_like_python(*starts(sprung(all_scenes()[label])), by, drift, within)


@pytest.mark.parametrize("by", STEPS)
@pytest.mark.parametrize("label", ["solo12 alone", "chain"])
def test_motions_of_trees_are_those_of_python(label: str, by: str) -> None:
    scene = chain() if label == "chain" else sprung(all_scenes()[label])
    assert_moved_like_python(*starts(scene), by, "none")


@pytest.mark.parametrize("by", STEPS)
def test_motions_by_a_direct_solver_are_those_of_python(by: str) -> None:
    scene, q, v, tau = starts(sprung(all_scenes()["solo12 contacts"]))
    how = {"duration": 0.01, "dt": 2e-4, "integrator": STEPS[by], "drift": DRIFTS["post"]}
    how["solver"] = DenseKKT()
    wanted = cp.simulate_batch(scene, q, v, tau, **how)
    assert_moved_alike(cp.simulate_batch(scene, q, v, tau, **how, **CORE), wanted, bits=False)


@pytest.mark.parametrize("by", ["semi-implicit", "linearly implicit midpoint", "implicit midpoint"])
@pytest.mark.parametrize("label", ["four_bar loops", "four_bar rod"])
def test_stiff_ones_are_as_stiff_as_in_python(label: str, by: str) -> None:
    """A strut that is stretched by a tenth of a millimetre, with a rate of 1e5 / s, at 1 ms."""
    scene, q, v, tau = starts(all_scenes()[label], 1)
    length = np.linalg.norm(scene.robot.frame_pose(q[0], "coupler_tip").translation)
    strut = SpringDamper("world", "coupler_tip", 4e7, 2e5, length - 1e-4)
    scene = replace(scene, robot=replace(scene.robot, spring_dampers=[strut]))
    how = {"duration": 0.05, "dt": 1e-3, "integrator": STEPS[by], "drift": DRIFTS["post"]}
    how["limits"] = cp.simulation.MotionLimits(energy=np.inf)  # steps damp what they do not follow
    wanted = cp.simulate_batch(scene, q, 0.01 * v, tau, **how)
    assert wanted.ok
    found = cp.simulate_batch(scene, q, 0.01 * v, tau, **how, **CORE)
    assert_allclose(found.q, wanted.q, rtol=0, atol=1e-9)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-7 * max(1.0, np.abs(wanted.v).max()))


@pytest.mark.parametrize("label", ["four_bar loops", "chain"])
def test_energies_have_them(label: str) -> None:
    scene = chain() if label == "chain" else sprung(all_scenes()[label])
    scene, q, v, tau = starts(scene)
    how = {"duration": 0.2, "dt": 5e-4, "record": 1}
    found = cp.simulate_batch(scene, q, v, tau, **how, **CORE)
    wanted = cp.simulate_batch(scene, q, v, tau, **how)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-5, atol=1e-10)
    for one, two in zip(found, wanted, strict=True):
        assert np.ptp(two.energy.springs) > 0.1
        assert two.energy.damping[-1] < -1e-3
        assert found.energy_error.max() < 1e-5 * two.energy.scale
        assert_allclose(one.energy.springs, two.energy.springs, rtol=0, atol=1e-8)
        assert_allclose(one.energy.damping, two.energy.damping, rtol=0, atol=1e-8)


def test_threads_return_the_same_bits() -> None:
    about = {"duration": 0.02, "dt": DT, "integrator": cp.simulation.LinearlyImplicitMidpoint()}
    state = starts(sprung(all_scenes()["four_bar loops"]), count=8)
    one, three = (
        cp.simulate_batch(*state, **about, executor=cp.Native(threads=threads))
        for threads in (1, 3)
    )
    assert one.ok
    for name in ("q", "v", "energy_error"):
        assert_array_equal(getattr(one, name), getattr(three, name))


# ------------------------------------------------------------------------------------------------
# Steps with contacts


def walking() -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """Solo12 on its feet, that stands, slides and falls: a scene, and states of it."""
    scene, q, _, tau = on_feet("solo12", friction=0.5)
    rng = np.random.default_rng(4)
    Q, V = np.tile(q, (20, 1)), rng.normal(scale=0.3, size=(20, scene.robot.nv))
    Q[10:, 2] += rng.uniform(-1e-4, 5e-3, size=10)
    V[:4] *= 1e-2
    return sprung(scene), Q, V, tau


def loops_on_points() -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """Cassie on points, as it begins to fall."""
    scene, q, v, tau = cassie_on_points()
    scene = sprung(scene)
    Q, V = beginning_to_fall(scene, q, v, tau, times=2)
    return scene, Q, V, tau


def test_steps_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, Q, V, tau = walking()
    group = at_rest(scene, Q, V, np.tile(tau, (len(Q), 1)))
    assert {0, 1, 2} <= assert_steps_of_python([group], monkeypatch)


def test_steps_in_the_air_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, Q, V, tau = walking()
    Q[:, 2] += 0.5
    group = at_rest(scene, Q, V, np.tile(tau, (len(Q), 1)))
    assert assert_steps_of_python([group], monkeypatch) == {0}


def test_steps_of_loops_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, *state = loops_on_points()
    wanted = step_batch(scene, *state, dt=DT, integrator=EXACT)
    assert wanted.ok
    only_the_core(monkeypatch)
    found = step_batch(scene, *state, dt=DT, integrator=EXACT, **CORE)
    assert_same_steps(found, wanted, rounded=1e-10)  # as without springs


def test_motions_with_contacts_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, Q, V, tau = walking()
    assert_motions_of_python(at_rest(scene, Q[0], V[0], tau), 0.05, monkeypatch, record=4)


def test_samples_behind_steps_of_python_have_their_energies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the core takes no step, every one is left to Python."""

    class Idle:
        def simulate(self, **_: object) -> None:
            """Take none."""

    scene, Q, V, tau = walking()
    about = {"duration": 0.02, "dt": DT, "record": 1}
    wanted = cp.simulate_batch(scene, Q[:1], V[:1], tau, **about)
    monkeypatch.setattr(motions, "contacts_of", lambda *_: Idle())
    found = cp.simulate_batch(scene, Q[:1], V[:1], tau, **about, **CORE)
    assert np.ptp(wanted[0].energy.springs) > 1e-4
    assert wanted[0].energy.damping[-1] < -1e-4
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-12)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=0, atol=1e-12)


# ------------------------------------------------------------------------------------------------
# Derivatives of steps


def test_derivatives_are_those_of_python() -> None:
    scene, Q, V, tau = walking()
    Q[:, 2] -= 1e-4  # a gap of zero is a kink: rounding says on which side of it
    found, wanted = both(scene, Q, V, tau)
    assert wanted.ok
    assert {0, 1, 2} <= set(np.unique(found.codes).tolist())
    assert_same(found, wanted)


def test_derivatives_in_the_air_are_those_of_python() -> None:
    scene, Q, V, tau = walking()
    Q[:, 2] += 0.5
    found, wanted = both(scene, Q[:5], V[:5], tau)
    assert_same(found, wanted)


def test_derivatives_of_loops_are_those_of_python() -> None:
    scene, Q, V, tau = loops_on_points()
    found, wanted = both(scene, Q, V, np.tile(tau, (len(Q), 1)))
    assert wanted.ok
    assert_same(found, wanted, rounded=1e-8)  # loops as they are there: 1 / 1.3e-5


def test_loops_are_closed_along_springs_that_are_part_of_M() -> None:
    """As they turn: what is left out of that is 1e-7 here, and more in longer steps."""
    scene = all_scenes()["four_bar loops"]
    strut = SpringDamper("crank_tip", "rocker_tip", 2e5, 50.0, 0.5)
    scene = replace(scene, robot=replace(scene.robot, spring_dampers=[strut]))
    q, _ = scene.state()
    v = cp.mechanism.project_velocity(scene, q, np.full(scene.robot.nv, 5.0))
    found, wanted = both(scene, q[None], v[None], np.zeros((1, len(v))))
    assert wanted.ok
    assert found.step.errors[0, 6] != 0.0  # what moving q back has brought
    assert_same(found, wanted)


def test_derivatives_of_a_chain_are_those_of_python() -> None:
    """Ball joints, springs that join branches, and stops."""
    made = chain().robot
    scene = cp.Scene(made, contacts=[cp.constraints.JointFriction("branch", 0.1)])
    rng = np.random.default_rng(8)
    free = pin.neutral(made.model)
    Q = np.array([pin.integrate(made.model, free, rng.uniform(-1, 1, made.nv)) for _ in range(6)])
    V = rng.normal(size=(6, made.nv))
    found, wanted = both(scene, Q, V, np.zeros((6, made.nv)))
    assert wanted.ok
    assert_same(found, wanted)


# ------------------------------------------------------------------------------------------------
# Where there is no direction, and what does not fit


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_where_the_ends_coincide_nothing_pulls(
    rest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    boxes = together({name: free_box(size=(0.2, 0.1, 0.1)) for name in "ab"})
    spring = SpringDamper("a/box", "b/box", 100.0, 3.0, rest)
    boxes = replace(boxes, spring_dampers=[spring])
    q = pin.neutral(boxes.model)[None]
    v = np.random.default_rng(0).normal(size=(1, boxes.nv))
    for by in ("semi-implicit", "linearly implicit midpoint", "Runge-Kutta 4"):
        assert_moved_like_python(cp.Scene(boxes), q, v, np.zeros_like(v), by, "none")
    floor = cp.constraints.FrictionalContact("a/box", cp.constraints.Ball(0.1), friction=0.5)
    scene = cp.Scene(boxes, contacts=[floor])
    assert_steps_of_python([at_rest(scene, q, v, np.zeros_like(v))], monkeypatch)
    found, wanted = both(scene, q, v, np.zeros_like(v))
    assert_array_equal(found.dv, wanted.dv)  # of Python: there are none


def test_numbers_that_do_not_fit_are_refused_at_the_border() -> None:
    workspace = cp.Workspace(sprung(all_scenes()["four_bar loops"]))
    rest = {
        **arrays.of_model(workspace.model), **arrays.of_constraints(workspace),
        **arrays.of_solver(workspace), **arrays.of_precision(workspace.scene),
    }  # fmt: skip
    springs = arrays.of_springs(workspace.scene.robot)
    compiled().Core(**rest, **springs)
    for joint in (-1, 4):
        bad = springs["between"].copy()
        bad[1, 1] = joint
        with pytest.raises(ValueError, match="joint of a spring"):
            compiled().Core(**rest, **(springs | {"between": bad}))
    for bad in ({"between": springs["between"][:1].copy()}, {"of_between": np.zeros((2, 8))}):
        with pytest.raises(ValueError, match="springs between frames"):
            compiled().Core(**rest, **(springs | bad))


@pytest.mark.parametrize("label", ["cassie loops", "four_bar rod", "solo12 alone"])
def test_solves_take_them_by_their_torques_alone(label: str) -> None:
    scene, q, v, tau = starts(sprung(all_scenes()[label]))
    bare = cp.simulation.solve_batch(all_scenes()[label], q, v, tau, **CORE)
    found = cp.simulation.solve_batch(scene, q, v, tau, **CORE)
    assert near(found.a, bare.a, 1e-10)
    pulled = tau + np.array([scene.robot.passive_torque(*x) for x in zip(q, v, strict=True)])
    moved = cp.simulation.solve_batch(scene, q, v, pulled, **CORE)
    assert not near(moved.a, bare.a, 1e-3)
    assert near(moved.a, cp.simulation.solve_batch(scene, q, v, pulled).a, 1e-9)


def test_nothing_is_left_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, Q, V, tau = walking()
    only_the_core(monkeypatch)
    monkeypatch.delattr(batch.DifferentiatedRows, "row")
    assert step_batch(scene, Q, V, tau, dt=DT, integrator=EXACT, **CORE).ok
    assert step_derivatives_batch(scene, Q, V, tau, dt=DT, integrator=EXACT, **CORE).ok
    for label in ("cassie loops", "four_bar rod"):
        loops, q, v, applied = starts(sprung(all_scenes()[label]))
        how = {"duration": 0.005, "dt": 2e-4, "integrator": cp.SemiImplicitEuler()}
        assert cp.simulate_batch(loops, q, v, applied, **how, **CORE).ok
