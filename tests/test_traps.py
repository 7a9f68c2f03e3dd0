"""What Pinocchio does silently wrong, and that condyn_pin does not.

Where it is cheap, a test first asks bare Pinocchio, and fails on the day that Pinocchio is mended.
Tests that share a number in their names share a trap.
"""

from __future__ import annotations

import copy
import functools
import pickle

import crash
import numpy as np
import pytest
from shared import all_scenes, each_row, relative, robot, states, takes
from shared import truth as true_answers

import condyn_pin as cp
from condyn_pin._core import _pin
from condyn_pin._core._pin import HAS_LCABA, pin
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from lab.extremes.base import Units

GRAVITY = 9.81
IS_4 = _pin.VERSION >= (4, 0)

SOLVERS = [s() for s in cp.dynamics.SOLVERS.values() if s.exact and not s.missing()]
each_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.title)
takes_redundant = pytest.mark.parametrize(
    "solver", [s for s in SOLVERS if s.takes_redundant], ids=lambda s: s.title
)


@functools.cache
def scene(name: str) -> cp.Scene:
    talos, cassie, solo = robot("talos"), robot("cassie"), robot("solo12")
    left, right = talos.contacts
    return cp.Scene(
        *{
            "four_bar": (robot("four_bar"), robot("four_bar").loops),
            "talos": (talos, talos.contacts),
            "talos left foot": (talos, [left]),
            "talos points": (talos, [*left.corners()[:1], right]),
            "talos hands": (
                talos,
                [left, cp.Loop("gripper_left_base_link", "gripper_right_base_link")],
            ),
            "talos foot twice": (
                talos,
                [left, cp.SurfaceContact("left_sole_link", name="again"), right],
            ),
            "cassie": (cassie, [*cassie.loops, *cassie.contacts]),
            "solo": (solo, solo.contacts),
        }[name]
    )


@functools.cache
def moving(name: str, count: int = 3) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """States on the constraints, with velocities and motor torques."""
    rng = np.random.default_rng(3)
    made = []
    for _ in range(count):
        tau = rng.normal(size=scene(name).robot.nv)
        if name != "four_bar":
            tau[:6] = 0.0
        made.append((*scene(name).sample(rng), tau))
    return made


def bare(of: cp.Scene):
    """Return Pinocchio's own objects for the constraints of a scene, initialised."""
    model, data = of.robot.model, of.robot.model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for bound in pinocchio_constraints_of(of).constraints:
        models.append(bound.to_pinocchio(model))
        datas.append(models[len(models) - 1].createData())
    _pin.init_constraint_dynamics(model, data, models, datas)
    return model, data, models, datas


def bare_acceleration(of: cp.Scene, q, v, tau, *settings: float) -> np.ndarray:
    model, data, models, datas = bare(of)
    chosen = pin.ProximalSettings(*settings) if settings else pin.ProximalSettings()
    return pin.constraintDynamics(model, data, q, v, tau, models, datas, chosen)


def bare_lcaba(of: cp.Scene, *states, mu: float = 1e-6, ordered: bool = True):
    """Return what Pinocchio's lcaba answers at states in turn, its settings, and datas."""
    model, data, models, datas = bare(of)
    settings = pin.ProximalSettings(1e-12, 0.0, mu, 20)
    if ordered:
        pin.computeJointMinimalOrdering(model, data, models)
    found = [pin.lcaba(model, data, *state, models, datas, settings) for state in states]
    return found, settings, datas


def truth(of: cp.Scene, q, v, tau) -> cp.dynamics.Solution:
    return cp.solve(of, q, v, tau, solver=cp.dynamics.Reference())


needs_lcaba = pytest.mark.skipif(not HAS_LCABA, reason="Pinocchio 3 has no lcaba")


@pytest.mark.skipif(HAS_LCABA, reason="Pinocchio 4 has lcaba")
def test_lcaba_is_refused_where_pinocchio_has_none():
    with pytest.raises(
        cp.errors.UnsupportedBackend, match=r"LCABA needs Pinocchio 4, and 3\.\d+\."
    ):
        cp.Workspace(scene("talos"), cp.LCABA())


# --- 3: the world as the first body


def held_by_a_hand(kind: str, *, world_first: bool) -> cp.Scene:
    talos = robot("talos")
    q = talos.postures["half_sitting"]
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, q)
    oMh = data.oMf[talos.model.getFrameId("gripper_left_base_link")]
    held = talos.with_frame("rail", "world", oMh.translation, oMh.rotation)
    frames = ("rail", "gripper_left_base_link")
    if not world_first:
        frames = frames[::-1]
    return cp.Scene(held, [cp.Loop(*frames, kind=kind, name="held"), *held.contacts])


@each_solver
@pytest.mark.parametrize("kind", ["ball", "weld"])
def test_trap_3_world_first_gives_the_same_a_and_the_opposite_force(solver, kind):
    """Pinocchio: derivatives and impulses are wrong, and lcaba dies, with joint1 the world."""
    rng = np.random.default_rng(0)
    one, two = (held_by_a_hand(kind, world_first=first) for first in (False, True))
    q, v = one.state()
    v = 0.3 * rng.normal(size=v.size)
    tau = rng.normal(size=v.size)
    a, b = (cp.solve(s, q, v, tau, solver=solver) for s in (one, two))
    assert relative(b.a, a.a) < 1e-10
    np.testing.assert_allclose(b.forces["held"], -a.forces["held"], rtol=1e-7, atol=1e-6)
    for name in ("left_sole_link", "right_sole_link"):
        np.testing.assert_allclose(b.forces[name], a.forces[name], rtol=1e-7, atol=1e-6)


BARE_SOLO = """
import numpy as np, pinocchio as pin
from condyn_pin._core import _pin
import condyn_pin as cp
robot = cp.load_robot("solo12")
model = robot.model
data = model.createData()
q, v, tau = pin.neutral(model), np.zeros(model.nv), np.ones(model.nv)
settings = pin.ProximalSettings(1e-12, 1e-6, 10)
def end(name):
    frame = model.frames[model.getFrameId(name)]
    return frame.parentJoint, frame.placement
WORLD = (0, pin.SE3.Identity())
def raw(*pairs, kind=pin.ContactType.CONTACT_3D):
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for one, two in pairs:
        made = pin.RigidConstraintModel(kind, model, *one, *two, pin.ReferenceFrame.LOCAL)
        models.append(made)
        datas.append(made.createData())
    return models, datas
FL, FR, HL, HR = (end(f"{leg}_FOOT") for leg in ("FL", "FR", "HL", "HR"))
two, four = raw((FL, WORLD), (FR, WORLD)), raw(*((foot, WORLD) for foot in (FL, FR, HL, HR)))
"""


@needs_lcaba
@pytest.mark.parametrize("kind", ["ball", "weld"])
def test_trap_3_lcaba_dies_with_the_world_first(kind):
    """Pinocchio: lcaba reads the memory of a joint that the world does not have."""
    rows = "3" if kind == "ball" else "6"
    alone = crash.run(
        BARE_SOLO
        + f"""
models, datas = raw((WORLD, FL), kind=pin.ContactType.CONTACT_{rows}D)
pin.computeJointMinimalOrdering(model, data, models)
pin.lcaba(model, data, q, v, tau, models, datas, settings)
"""
    )
    assert alone == crash.Outcome("signal", "SIGSEGV")
    hand = held_by_a_hand(kind, world_first=True)
    q, v = hand.state()
    assert cp.solve(hand, q, v, v, solver=cp.LCABA()).status.ok


# --- 5 to 8: lcaba


@needs_lcaba
def test_trap_5_lcaba_is_right_on_every_call():
    """Pinocchio: with 6 rows, lcaba reads what the last call left: every second call is wrong."""
    talos = scene("talos")
    states = moving("talos")
    right = [truth(talos, *state).a for state in states]
    raw, _, _ = bare_lcaba(talos, states[0], states[0])
    assert relative(raw[0], right[0]) < 1e-6
    assert relative(raw[1], right[0]) > 1e-3

    one, two = cp.Workspace(talos, cp.LCABA()), cp.Workspace(talos, cp.LCABA())
    for k in (0, 0, 1, 2, 0, 1):
        for workspace in (one, two):
            assert relative(workspace.acceleration(*states[k]), right[k]) < 1e-8


@needs_lcaba
def test_trap_6_lcaba_returns_lam_with_the_sign_of_the_others():
    """Pinocchio: the contact_force of lcaba is minus lam, in LOCAL whatever was asked for."""
    talos = scene("talos points")
    for state in moving("talos points"):
        right = truth(talos, *state).lam
        lam = cp.solve(talos, *state, solver=cp.LCABA()).lam
        np.testing.assert_allclose(lam, right, atol=1e-6 * np.abs(right).max())
    _, _, datas = bare_lcaba(talos, state)
    raw = np.concatenate([datas[0].contact_force.linear, datas[1].contact_force.vector])
    np.testing.assert_allclose(raw, -right, atol=1e-3 * np.abs(right).max())


@needs_lcaba
def test_trap_7_lcaba_and_constraint_dynamics_do_not_share_their_datas():
    """Pinocchio: lcaba leaves an acceleration in the datas, and constraintDynamics obeys it."""
    talos = scene("talos")
    state = moving("talos")[0]
    model, data, models, datas = bare(talos)
    settings = pin.ProximalSettings(0.0, 1e-9, 1e-8, 20)
    before = pin.constraintDynamics(model, data, *state, models, datas, settings)
    other = model.createData()
    pin.computeJointMinimalOrdering(model, other, models)
    pin.lcaba(model, other, *state, models, datas, pin.ProximalSettings(1e-12, 0.0, 1e-6, 20))
    after = pin.constraintDynamics(model, data, *state, models, datas, settings)
    assert relative(after, before) > 1e-3

    proximal, lcaba = cp.Workspace(talos), cp.Workspace(talos, cp.LCABA())
    alone = proximal.acceleration(*state)
    for _ in range(3):
        lcaba.acceleration(*state)
        np.testing.assert_array_equal(proximal.acceleration(*state), alone)


@needs_lcaba
@pytest.mark.parametrize(("mu", "off"), [(1e-6, 1e-8), (1e-7, 1e-3), (1e-8, 1e-2)])
def test_trap_8_lcaba_with_a_too_small_mu_is_never_ok(mu, off):
    """Pinocchio: rounding of 1/mu ends up in a, while J a + gamma stays at 1e-12.

    Cassie under motor torques is off by per cents at 1e-8: what the README says.
    """
    label = "cassie loops + contacts"
    workspace = cp.Workspace(all_scenes()[label], cp.LCABA(mu=mu))
    for state, right in zip(states(label), true_answers(label), strict=True):
        solution = workspace.solve(*state, throw=False)
        assert relative(solution.a, right.a) > off
        assert solution.constraint_error < 1e-8
        assert solution.dynamics_error > 1e3 * right.dynamics_error
        assert solution.status is cp.Status.INACCURATE
        with pytest.raises(cp.SolveFailed, match="try another mu"):
            workspace.solve(*state)


@pytest.mark.long
def test_trap_9_the_stop_test_fires_on_redundant_rows():
    """Pinocchio: with its own accuracy of 1e-12 every iteration that is allowed is spent."""
    cassie = scene("cassie")
    for state in moving("cassie"):
        ours = cp.solve(cassie, *state)
        mu = 1e-6 * cassie.nominal.delassus_norm
        theirs = cp.solve(cassie, *state, solver=cp.Proximal(mu=mu, relative_accuracy=1e-12))
        assert ours.iterations <= 5
        assert theirs.iterations == 20
        assert relative(ours.a, theirs.a) < 1e-10


@pytest.mark.long
def test_trap_8_lcaba_refuses_mu_zero():
    """Pinocchio: NaN, and an absolute_residual of zero."""
    with pytest.raises(cp.InvalidArgument, match=r"mu = 0\.0: a finite number >= "):
        cp.LCABA(mu=0.0)
    if HAS_LCABA:
        (a,), settings, _ = bare_lcaba(scene("talos"), moving("talos")[0], mu=0.0)
        assert np.isnan(a).all()
        assert settings.absolute_residual == 0.0


@pytest.mark.long
@needs_lcaba
def test_trap_8_lcaba_finds_its_own_elimination_order():
    """Pinocchio: without computeJointMinimalOrdering the answer is off by 100 %."""
    talos, state = scene("talos"), moving("talos")[0]
    right = truth(talos, *state).a
    assert relative(bare_lcaba(talos, state, ordered=False)[0][0], right) > 0.1
    assert relative(cp.Workspace(talos, cp.LCABA()).acceleration(*state), right) < 1e-8


# --- 9: residuals


@each_solver
def test_trap_9_errors_are_residuals_of_the_two_equations(solver):
    """Pinocchio: absolute_residual is |J a_free - 2 b|, whatever a is."""
    talos = scene("talos")
    q, v, tau = moving("talos")[0]
    solution = cp.solve(talos, q, v, tau, solver=solver)
    terms = cp.Workspace(talos).terms(q, v)
    a_free = np.linalg.solve(terms.M, tau - terms.h)

    model, data, models, datas = bare(talos)
    settings = pin.ProximalSettings(1e-12, 1e-9, 1e-8, 20)
    pin.constraintDynamics(model, data, q, v, tau, models, datas, settings)
    not_a_residual = np.abs(terms.J @ a_free + 2 * terms.gamma).max()
    assert settings.absolute_residual == pytest.approx(not_a_residual, rel=1e-9)

    dynamics = terms.M @ solution.a + terms.h - tau - terms.J.T @ solution.lam
    constraint = terms.J @ solution.a + terms.gamma - terms.a_ref
    assert solution.dynamics_error == pytest.approx(np.abs(dynamics).max(), abs=1e-9)
    assert solution.constraint_error == pytest.approx(np.abs(constraint).max(), abs=1e-9)
    assert solution.constraint_error < 1e-6 < settings.absolute_residual


# --- 10: redundant rows


def test_trap_10_default_settings_on_a_planar_loop():
    """Pinocchio: mu = 0 and one iteration, its defaults, give NaN without a word."""
    bar = scene("four_bar")
    q, v, tau = moving("four_bar")[0]
    assert np.isnan(bare_acceleration(bar, q, v, tau)).all()
    solution = cp.solve(bar, q, v, tau)
    assert solution.status.ok
    # the accelerations of the one degree of freedom that is left, from J alone
    terms = cp.Workspace(bar).terms(q, v)
    J, gamma = np.delete(terms.J, 1, axis=0), np.delete(terms.gamma, 1)
    K = np.block([[terms.M, -J.T], [J, np.zeros((2, 2))]])
    a = np.linalg.solve(K, np.concatenate([tau - terms.h, -gamma]))[:3]
    assert relative(solution.a, a) < 1e-12


@pytest.mark.long
def test_trap_10_the_summary_names_the_redundant_row_of_a_planar_loop():
    """Pinocchio: nothing says that a row is redundant."""
    summary = scene("four_bar").summary()
    assert (summary.rows, summary.rank, summary.mobility) == (3, 2, 1)
    assert summary.redundant == ("coupler_rocker.y",)
    assert "rank 2" in str(summary)
    assert "coupler_rocker.y" in str(summary)


@takes_redundant
def test_trap_10_a_contact_that_is_there_twice(solver):
    """Pinocchio: NaN by default, at most states."""
    twice, once = scene("talos foot twice"), scene("talos")
    raw = [bare_acceleration(twice, *state) for state in moving("talos")]
    assert not np.isfinite(raw).all()
    for q, v, tau in moving("talos"):
        solution = cp.solve(twice, q, v, tau, solver=solver)
        right = truth(once, q, v, tau)
        assert relative(solution.a, right.a) < 1e-8
        shared = solution.forces["left_sole_link"] + solution.forces["again"]
        np.testing.assert_allclose(shared, right.forces["left_sole_link"], atol=1e-3)
    assert len(twice.summary().redundant) == 6


def test_trap_10_a_method_that_cannot_take_redundant_rows_says_so():
    """Pinocchio: no method says that its matrix is singular."""
    q, v, tau = moving("talos")[0]
    for name, state in (("talos foot twice", (q, v, tau)), ("four_bar", moving("four_bar")[0])):
        solution = cp.solve(scene(name), *state, solver=cp.DenseKKT(), throw=False)
        assert solution.status is cp.Status.SINGULAR
        with pytest.raises(cp.SolveFailed, match=r"redundant .*\(Scene\.summary\(\) names"):
            cp.solve(scene(name), *state, solver=cp.DenseKKT())


# --- 11: where a contact belongs


def displaced(q: np.ndarray, by: tuple[float, float, float]) -> np.ndarray:
    moved = q.copy()
    moved[:3] += by
    return moved


def test_trap_11_a_contact_without_anchor_belongs_where_it_is():
    """Pinocchio: its default target is the world origin, to which stabilisation pulls the foot."""
    solo = scene("solo")
    q, v, tau = moving("solo")[0]
    far = displaced(q, (3.0, -2.0, 1.0))

    model, data, models, datas = bare(solo)
    settings = pin.ProximalSettings(0.0, 1e-9, 1e-8, 20)
    for made in models:
        _pin.set_baumgarte(made, 100.0, 20.0)
    still = np.zeros(solo.robot.nv)
    pulled = pin.constraintDynamics(model, data, far, still, tau, models, datas, settings)
    workspace = cp.Workspace(solo)
    foot = cp.Scene(solo.robot, solo.constraints[:1])
    terms = cp.Workspace(foot).terms(far, still)
    to_origin = -cp.Workspace(foot).equations.placements(far)[0][0].translation
    assert np.abs(terms.J @ pulled).max() > 0.5 * 100.0 * np.linalg.norm(to_origin) / np.sqrt(3)

    here, there = workspace.solve(q, v, tau), workspace.solve(far, v, tau)
    assert here.state_error.position == there.state_error.position == 0.0
    np.testing.assert_array_equal(workspace.violation(far), np.zeros(12))
    assert relative(there.a, here.a) < 1e-10


@pytest.mark.long
def test_trap_11_an_anchored_contact_reports_its_distance():
    """Pinocchio: the desired_contact_placement of a model is read by nothing."""
    solo = robot("solo12")
    q, v = scene("solo").state()
    at = cp.Workspace(scene("solo")).equations.placements(q)[0][0]
    anchor = at.translation + np.array([0.03, 0.0, -0.04])
    anchored = cp.Scene(solo, [cp.PointContact("FL_FOOT", anchor=anchor)])
    solution = cp.solve(anchored, q, v, v, throw=False)  # 5 cm away: in doubt
    c = cp.Workspace(anchored).violation(q)
    assert np.linalg.norm(c) == pytest.approx(0.05, rel=1e-12)
    np.testing.assert_allclose(at.rotation @ c, [-0.03, 0.0, 0.04], atol=1e-15)
    assert solution.state_error.position == np.abs(c).max()
    # stated as the state's error, and never turned into an acceleration
    free = cp.solve(cp.Scene(solo, [cp.PointContact("FL_FOOT")]), q, v, v)
    assert relative(solution.a, free.a) < 1e-12
    closed = anchored.assemble(q).q
    assert np.abs(cp.Workspace(anchored).violation(closed)).max() < 1e-10


@pytest.mark.long
def test_trap_11_an_anchored_surface_reports_position_and_turn():
    """Pinocchio: there is no call that says how far a contact is from where it belongs."""
    q, _ = scene("talos").state()
    at = cp.Workspace(scene("talos")).equations.placements(q)[0][0]
    turned = at * pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.1])), np.zeros(3))
    foot = cp.SurfaceContact("left_sole_link", anchor=turned)
    c = cp.Workspace(cp.Scene(robot("talos"), [foot])).violation(q)
    np.testing.assert_allclose(c, [0, 0, 0, 0, 0, -0.1], atol=1e-9)


# --- 14 and 16: the constraint Jacobian


@functools.cache
def anchored(name: str) -> tuple[cp.Scene, np.ndarray]:
    """Return a scene that has a position error in every row, and a state where all are zero."""
    if name != "talos":
        return scene(name), moving(name)[0][0]
    talos = robot("talos")
    q = moving("talos")[0][0]
    (left, _), (right, _) = cp.Workspace(scene("talos")).equations.placements(q)
    point = tuple(right.act(np.array([0.05, 0.02, 0.0])))
    constraints = [
        cp.SurfaceContact("left_sole_link", anchor=left),
        cp.PointContact("right_sole_link", offset=(0.05, 0.02, 0.0), anchor=point),
    ]
    return cp.Scene(talos, constraints), q


@pytest.mark.parametrize("name", ["talos", "cassie", "four_bar"])
def test_trap_16_the_jacobian_is_right_just_after_construction(name):
    """Pinocchio 4: getConstraintsJacobian is wrong until each constraint's calc was called."""
    held, q = anchored(name)
    J = cp.Workspace(held).jacobian(q)
    if IS_4:
        model, data, models, datas = bare(held)
        pin.computeJointJacobians(model, data, q)
        raw = np.array(pin.getConstraintsJacobian(model, data, models, datas))
        assert not np.allclose(raw, J, atol=1e-2)
    model, h = held.robot.model, 1e-6
    workspace = cp.Workspace(held)
    rows = [k for b in held.bounds if b.anchored for k in range(b.rows.start, b.rows.stop)]
    for i, step in enumerate(h * np.eye(model.nv)):
        ahead, behind = (pin.integrate(model, q, sign * step) for sign in (1, -1))
        slope = (workspace.violation(ahead) - workspace.violation(behind)) / (2 * h)
        np.testing.assert_allclose(J[rows, i], slope[rows], atol=1e-8)


def test_trap_14_the_jacobian_is_zero_outside_the_support():
    """Pinocchio 4: RigidConstraintModel.jacobian() has uninitialised memory there."""
    held, q = anchored("talos")
    J = cp.Workspace(held).jacobian(q)
    model = held.robot.model
    for bound in held.bounds:
        support = set(model.supports[bound.joint1])
        for i in range(1, model.njoints):
            joint = model.joints[i]
            columns = J[bound.rows, joint.idx_v : joint.idx_v + joint.nv]
            assert bool(columns.any()) == (i in support)


# --- 17: who owns an answer


@each_solver
def test_trap_17_answers_are_owned_and_stay(solver):
    """Pinocchio: lambda_c and the derivatives are views that the next call overwrites."""
    talos = scene("talos")
    states = moving("talos")
    model, data, models, datas = bare(talos)
    settings = pin.ProximalSettings(0.0, 1e-9, 1e-8, 20)
    pin.constraintDynamics(model, data, *states[0], models, datas, settings)
    view = data.lambda_c
    first = view.copy()
    pin.constraintDynamics(model, data, *states[1], models, datas, settings)
    assert not np.array_equal(view, first)

    def arrays(workspace: cp.Workspace, q, v, tau) -> list[np.ndarray]:
        solution = workspace.solve(q, v, tau)
        terms = workspace.terms(q, v)
        return [
            *(workspace.acceleration(q, v, tau), workspace.jacobian(q), workspace.violation(q)),
            *(solution.a, solution.lam, solution.q, *solution.forces.values()),
            *solution.world_forces.values(),
            *(terms.M, terms.h, terms.J, terms.gamma, terms.a_ref),
        ]

    workspace = cp.Workspace(talos, solver)
    kept = arrays(workspace, *states[0])
    values = [array.copy() for array in kept]
    others = [array for state in states[1:] for array in arrays(workspace, *state)]
    workspace.use(scene("talos left foot"))
    workspace.solve(*states[0])
    for array, value in zip(kept, values, strict=True):
        np.testing.assert_array_equal(array, value)
    every = [*kept, *others, *(part for state in states for part in state)]
    for i, array in enumerate(every):
        for other in every[i + 1 :]:
            assert not np.shares_memory(array, other)
    del workspace
    for array, value in zip(kept, values, strict=True):
        np.testing.assert_array_equal(array, value)


# --- 18: arguments that are not numbers, not of the size, not of unit length


def calls(of: cp.Scene, solver: cp.dynamics.Solver):
    """Return the three ways to solve, by name."""
    workspace = cp.Workspace(of, solver)
    return {
        "acceleration": workspace.acceleration,
        "Workspace.solve": workspace.solve,
        "without throw": functools.partial(workspace.solve, throw=False),
        "solve": functools.partial(cp.solve, of, solver=solver),
    }


@each_solver
def test_trap_18_every_entry_that_is_not_finite_is_named(solver):
    """Pinocchio: NaN in, NaN out, and no sign of it."""
    q, v, tau = moving("talos")[0]
    assert not np.isfinite(
        bare_acceleration(scene("talos"), q, v, tau * np.nan, 1e-12, 1e-6, 20)
    ).any()
    for way, call in calls(scene("talos"), solver).items():
        for place, name in enumerate(("q", "v", "tau")):
            for i in range((q, v, tau)[place].size):
                bad = (np.nan, np.inf, -np.inf)[i % 3]
                state = [q.copy(), v.copy(), tau.copy()]
                state[place][i] = bad
                with pytest.raises(cp.InvalidArgument) as caught:
                    call(*state)
                assert str(caught.value).startswith(f"{name}[{i}] = {bad}: finite"), way
    # nothing of it stays behind
    right = cp.Workspace(scene("talos"), solver).acceleration(q, v, tau)
    workspace = cp.Workspace(scene("talos"), solver)
    with pytest.raises(cp.InvalidArgument):
        workspace.acceleration(q, v, tau * np.nan)
    np.testing.assert_array_equal(workspace.acceleration(q, v, tau), right)


@pytest.mark.values
@each_solver
@pytest.mark.parametrize("name", ["talos", "four_bar"])
def test_trap_18_every_wrong_size_is_named(solver, name):
    """Pinocchio: an error of three lines from a header file, or none at all for a column."""
    if not takes(solver, scene(name)):
        solver = cp.DenseKKT(mu=1e-8)
    good = moving(name)[0]
    wrong = {
        "too short": lambda x: x[:-1],
        "too long": lambda x: np.append(x, 0.0),
        "one": lambda x: x[:1],
        "empty": lambda x: x[:0],
        "row": lambda x: x[None],
    }
    for way, call in calls(scene(name), solver).items():
        for place, argument in enumerate(("q", "v", "tau")):
            for label, change in wrong.items():
                state = list(good)
                state[place] = change(state[place])
                with pytest.raises(cp.InvalidArgument) as caught:
                    call(*state)
                text = str(caught.value)
                assert text.startswith(f"{argument} has shape"), (way, label)
                assert f"({good[place].size},) is needed" in text


@pytest.mark.values
@each_solver
@pytest.mark.parametrize("factor", [0.0, 0.999, 1.001, 1.1, -2.0])
def test_trap_18_an_unnormalised_quaternion_is_refused(solver, factor):
    """Pinocchio: a quaternion of norm 1.001 makes a wrong by 5e-4, without a word."""
    q, v, tau = moving("talos")[0]
    bad = q.copy()
    bad[3:7] *= factor
    raw = bare_acceleration(scene("talos"), bad, v, tau, 1e-12, 1e-8, 20)
    assert np.isfinite(raw).all()
    assert relative(raw, truth(scene("talos"), q, v, tau).a) > 1e-5
    for call in calls(scene("talos"), solver).values():
        with pytest.raises(cp.InvalidArgument, match=r"q\[3:7\] = .*norm.*pin\.normalize"):
            call(bad, v, tau)


UNIT_PARTS = ["Spherical", "Planar", "RUBX", "RUBY", "RUBZ", "FreeFlyer"]


@pytest.mark.parametrize("kind", UNIT_PARTS)
def test_trap_18_every_joint_with_a_unit_part_is_checked(kind):
    """Pinocchio: (cos, sin) pairs that are not normalised are as silently wrong."""
    model = pin.Model()
    joint = model.addJoint(0, getattr(pin, f"JointModel{kind}")(), pin.SE3.Identity(), "joint")
    inertia = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    one_joint = cp.Scene(cp.Robot("one joint", model))
    q, still = pin.neutral(model), np.zeros(model.nv)
    for call in calls(one_joint, cp.Proximal()).values():
        call(q, still, still)
        with pytest.raises(cp.InvalidArgument, match="unit quaternion"):
            call(1.1 * q, still, still)


def test_trap_18_a_joint_that_cannot_be_checked_is_refused():
    """Pinocchio: a composite joint hides a quaternion where no check finds it."""
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelSpherical())
    composite.addJoint(pin.JointModelRX(), pin.SE3(np.eye(3), np.ones(3)))
    model = pin.Model()
    joint = model.addJoint(0, composite, pin.SE3.Identity(), "shoulder")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(cp.errors.InvalidModel, match="'shoulder' is a JointModelComposite"):
        cp.Workspace(cp.Scene(cp.Robot("arm", model)))


# --- 19: gains


@pytest.mark.parametrize("name", ["solo", "talos"])
def test_trap_19_setting_gains_does_not_resize_them(name):
    """Pinocchio 3: assigning six gains to a constraint with three rows is accepted."""
    made = (
        pinocchio_constraints_of(scene(name))
        .constraints[0]
        .to_pinocchio(robot("talos" if name == "talos" else "solo12").model)
    )
    _pin.set_baumgarte(made, 3.0, 4.0)
    gains = made.m_baumgarte_parameters if IS_4 else made.corrector
    size = () if IS_4 else (scene(name).bounds[0].size,)
    assert np.shape(gains.Kp) == np.shape(gains.Kd) == size
    assert np.all(np.asarray(gains.Kp) == 3.0)
    assert np.all(np.asarray(gains.Kd) == 4.0)


# --- 22: copies


def test_trap_22_a_copied_data_kills_pinocchio_4():
    """Pinocchio 4: Data.copy() lacks the constraint part, and constraintDynamics segfaults."""
    outcome = crash.run(
        BARE_SOLO
        + """
_pin.init_constraint_dynamics(model, data, *four)
pin.constraintDynamics(model, data.copy(), q, v, tau, *four, settings)
"""
    )
    if IS_4:
        assert outcome == crash.Outcome("signal", "SIGSEGV")
    else:
        assert outcome.kind == "ok"


@pytest.mark.values
@each_solver
@pytest.mark.parametrize(
    "how",
    [copy.copy, copy.deepcopy, lambda w: pickle.loads(pickle.dumps(w))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_trap_22_a_copied_workspace_has_memory_of_its_own(solver, how):
    """Pinocchio 4: two owners of one Data corrupt it, and a copied Data crashes."""
    states = moving("talos")
    workspace = cp.Workspace(scene("talos"), solver)
    before = workspace.solve(*states[0])
    twin = how(workspace)
    assert twin.data is not workspace.data
    assert (twin.scene, twin.solver) == (workspace.scene, workspace.solver)
    twin.use(twin.scene)
    again = twin.solve(*states[0])
    np.testing.assert_array_equal(again.a, before.a)
    np.testing.assert_array_equal(again.lam, before.lam)
    twin.use(scene("talos left foot"))
    twin.solve(*states[1])
    np.testing.assert_array_equal(workspace.acceleration(*states[0]), before.a)


# --- 23: memory for another number of constraints


def test_trap_23_bare_pinocchio_with_other_constraints_than_it_was_initialised_for():
    """Pinocchio 4: with fewer the answer is wrong, with more the heap is corrupted as well."""
    fewer = crash.run(
        BARE_SOLO
        + """
_pin.init_constraint_dynamics(model, data, *four)
a = pin.constraintDynamics(model, data, q, v, tau, *two, settings)
right = cp.Workspace(cp.Scene(robot, robot.contacts[:2])).acceleration(q, v, tau)
print(np.abs(a - right).max())
"""
    )
    more = crash.run(
        BARE_SOLO
        + """
_pin.init_constraint_dynamics(model, data, *two)
pin.constraintDynamics(model, data, q, v, tau, *four, settings)
"""
    )
    if IS_4:
        assert fewer.kind == "ok"
        assert not float(fewer.text) < 1.0  # of memory that nobody wrote: NaN at times
        assert more.kind == "signal"
    else:
        assert fewer.kind == more.kind == "exception"


@each_solver
def test_trap_23_a_workspace_put_to_other_constraints_equals_a_fresh_one(solver):
    """Pinocchio: its memory is sized once, for the constraints of that moment."""
    workspace = cp.Workspace(scene("talos"), solver)
    order = ("talos left foot", "talos", "talos points", "talos hands", "talos left foot", "talos")
    for name in (name for name in order if takes(solver, scene(name))):
        workspace.use(scene(name))
        fresh = cp.Workspace(scene(name), solver)
        for state in moving(name):
            one, two = workspace.solve(*state), fresh.solve(*state)
            np.testing.assert_array_equal(one.a, two.a)
            np.testing.assert_array_equal(one.lam, two.lam)
            assert one.residuals == two.residuals


@pytest.mark.parametrize("attribute", ["constraint_models", "constraint_datas"])
def test_trap_23_the_raw_lists_keep_their_length(attribute):
    """Pinocchio 4: with one constraint more than initialised for, the heap is corrupted."""
    workspace = cp.Workspace(scene("talos"))
    raw = getattr(workspace, attribute)
    member = raw[0]
    edits = {
        "append": lambda: raw.append(member),
        "extend": lambda: raw.extend([member]),
        "insert": lambda: raw.insert(0, member),
        "del": lambda: raw.__delitem__(0),
        "del slice": lambda: raw.__delitem__(slice(None)),
        "set": lambda: raw.__setitem__(0, member),
        "set slice": lambda: raw.__setitem__(slice(0, 1), []),
    }
    for edit in edits.values():
        with pytest.raises(cp.errors.StaleModel, match=r"workspace\.use\(scene\)"):
            edit()
    assert len(raw) == 2
    state = moving("talos")[0]
    np.testing.assert_array_equal(
        workspace.acceleration(*state), cp.Workspace(scene("talos")).acceleration(*state)
    )


# --- 24: ids and names


@pytest.mark.long
def test_trap_24_pinocchio_takes_any_number_for_a_joint():
    """Pinocchio: an id out of range is accepted or kills it; a frame's id passes for a joint's."""
    outcome = crash.run(
        BARE_SOLO
        + """
pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, 999, pin.ReferenceFrame.LOCAL)
"""
    )
    assert outcome.kind in ("ok", "signal")
    model = robot("solo12").model
    frame = model.getFrameId("FL_HFE")
    assert model.names[min(frame, model.njoints - 1)] != "FL_HFE"


SOLE, ANKLE = "left_sole_link", "joint 'leg_left_6_joint'"


@each_row(
    ("wrong", "near"),
    [
        ("left_sole_lnk", "'left_sole_link'"),
        ("left_sole", "'left_sole_link'"),
        ("leg_left_7_joint", "'leg_left_6_joint'"),
        ("gripper_left", "'gripper_left_base_link'"),
    ],
)
def test_trap_24_an_unknown_frame_lists_near_names(wrong, near):
    """Pinocchio: getFrameId of a name that does not exist is the number of frames."""
    talos = robot("talos")
    assert talos.model.getFrameId(wrong) == len(talos.model.frames)
    for constraint in (
        cp.PointContact(wrong),
        cp.SurfaceContact(wrong),
        cp.Loop(wrong, "right_sole_link"),
        cp.Loop("right_sole_link", wrong),
    ):
        with pytest.raises(
            cp.errors.UnknownName, match=f"no frame named '{wrong}'; did you mean"
        ) as e:
            cp.Scene(talos, [constraint])
        assert near in str(e.value)


@pytest.mark.long
def test_trap_24_a_name_like_no_other_lists_what_exists():
    """Pinocchio: there is no list to choose from."""
    with pytest.raises(
        cp.errors.UnknownName, match=r"no frame named '###'; known: universe, crank"
    ):
        cp.Scene(robot("four_bar"), [cp.PointContact("###")])


@each_row(
    ("constraint", "where"),
    [
        *((cp.Loop("world", "universe", kind), "the world") for kind in ("ball", "weld")),
        *((cp.Loop("universe", "rail", kind), "the world") for kind in ("ball", "weld")),
        *((cp.Loop(SOLE, "leg_left_6_joint", kind), ANKLE) for kind in ("ball", "weld")),
        *((cp.Loop(SOLE, SOLE, kind), ANKLE) for kind in ("ball", "weld")),
        (cp.PointContact("world"), "the world"),
        (cp.SurfaceContact("universe"), "the world"),
    ],
)
def test_trap_24_two_frames_of_one_body_constrain_nothing(constraint, where):
    """Pinocchio: accepted by constraintDynamics as if it were not there; lcaba dies."""
    talos = robot("talos").with_frame("rail", "world", [0, 0, 1])
    with pytest.raises(cp.errors.InvalidConstraint, match=f"both sides belong to {where}"):
        cp.Scene(talos, [constraint])


# --- 25: elimination order


@needs_lcaba
@pytest.mark.parametrize("case", ["another order", "the same joint twice"])
def test_trap_25_lcaba_dies_where_condyn_pin_answers(case):
    """Pinocchio 4: SIGSEGV with an order for other constraints, or one joint on both sides."""
    pair, ordered = ("(FL, HR)", "two[0]") if case == "another order" else ("(FL, FL)", "models")
    outcome = crash.run(
        BARE_SOLO
        + f"""
models, datas = raw({pair})
pin.computeJointMinimalOrdering(model, data, {ordered})
pin.lcaba(model, data, q, v, tau, models, datas, settings)
"""
    )
    assert outcome.kind == "signal"
    workspace = cp.Workspace(scene("talos"), cp.LCABA())
    for name in ("talos hands", "talos points", "talos hands"):
        workspace.use(scene(name))
        for state in moving(name):
            assert relative(workspace.solve(*state).a, truth(scene(name), *state).a) < 1e-8


# --- 26: models that change, and models that cannot be used


EDITS = {
    "joint": lambda m: m.addJoint(1, pin.JointModelRX(), pin.SE3.Identity(), "more"),
    "frame": lambda m: m.addFrame(
        pin.Frame("more", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    ),
    "mass": lambda m: setattr(m.inertias[1], "mass", 7.0),
    "placement": lambda m: setattr(m.jointPlacements[2], "translation", np.ones(3)),
    "gravity": lambda m: setattr(m.gravity, "linear", np.zeros(3)),
    "armature": lambda m: setattr(m, "armature", m.armature + 1.0),
}


def test_trap_26_pinocchio_dies_or_stumbles_over_an_old_data():
    """Pinocchio: a Data that is older than its model ends in SIGABRT or in a bad_get."""
    outcome = crash.run(
        BARE_SOLO
        + """
_pin.init_constraint_dynamics(model, data, *four)
model.addJoint(1, pin.JointModelRX(), pin.SE3.Identity(), "more")
more = (np.append(x, 0.0) for x in (q, v, tau))
pin.constraintDynamics(model, data, *more, *four, settings)
"""
    )
    assert outcome.kind in ("exception", "signal")


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_trap_26_an_edited_model_is_noticed_and_harms_no_workspace(edit):
    """Pinocchio: nobody looks whether the model is still the one that the memory is for."""
    q, v, tau = moving("solo")[0]
    solo = cp.Robot("solo", pin.Model(robot("solo12").model), contacts=robot("solo12").contacts)
    made = cp.Scene(solo, solo.contacts)
    workspace = cp.Workspace(made)
    before = workspace.solve(q, v, tau)
    answer, foot = cp.solve(made, q, v, tau), made.names[0]
    np.testing.assert_array_equal(answer.a, before.a)
    at, pull = before.forces[foot].at, before.forces[foot].generalized()
    edit(solo.model)
    np.testing.assert_array_equal(answer.forces[foot].at, at)
    np.testing.assert_array_equal(answer.forces[foot].generalized(), pull)
    stale = {
        "solve": lambda: cp.solve(made, q, v, tau),
        "Scene": lambda: cp.Scene(solo),
        "Workspace": lambda: cp.Workspace(made),
        "another solver": lambda: cp.solve(made, q, v, tau, solver=cp.DenseKKT()),
        "state": made.state,
        "assemble": lambda: made.assemble(q),
        "sample": lambda: made.sample(np.random.default_rng(0)),
        "Workspace.solve": lambda: workspace.solve(q, v, tau),
        "Workspace.acceleration": lambda: workspace.acceleration(q, v, tau),
        "Workspace.derivatives": lambda: workspace.derivatives(q, v, tau),
        "Workspace.terms": lambda: workspace.terms(q, v),
        "Workspace.jacobian": lambda: workspace.jacobian(q),
    }
    for call in stale.values():
        with pytest.raises(cp.errors.StaleModel, match=r"model of solo was edited .* pin\.Model\("):
            call()
    with pytest.raises(cp.InvalidArgument, match="make a new Workspace"):
        workspace.use(made)


HELD = {
    "the model": (lambda m: m, lambda m: setattr(m.inertias[1], "mass", 7.0)),
    "a list": (lambda m: m.inertias, lambda bodies: setattr(bodies[1], "mass", 7.0)),
    "a body": (lambda m: m.inertias[1], lambda body: setattr(body, "mass", 7.0)),
    "an array": (lambda m: m.armature, lambda x: x.__setitem__(7, x[7] + 1.0)),
    "gravity": (lambda m: m.gravity, lambda g: setattr(g, "linear", np.zeros(3))),
    "a frame": (lambda m: m.frames[3].placement, lambda M: setattr(M, "translation", np.ones(3))),
}


@pytest.mark.parametrize(("held", "edit"), HELD.values(), ids=HELD)
def test_trap_26_an_edit_through_a_part_that_was_kept_is_noticed(held, edit):
    """Whoever kept a part of the model may edit it at any time, many calls later too."""
    q, v, tau = moving("solo")[0]
    solo = cp.Robot("solo", pin.Model(robot("solo12").model), contacts=robot("solo12").contacts)
    workspace = cp.Workspace(cp.Scene(solo, solo.contacts))
    part = held(solo.model)
    for _ in range(3):
        workspace.acceleration(q, v, tau)
    edit(part)
    for _ in range(2):  # it stays so
        with pytest.raises(cp.errors.StaleModel):
            workspace.acceleration(q, v, tau)
    del part
    with pytest.raises(cp.errors.StaleModel):
        workspace.acceleration(q, v, tau)


@pytest.mark.long
def test_trap_26_models_that_nobody_holds_are_not_compared(monkeypatch):
    """A comparison takes microseconds; `Workspace.acceleration` of small machines takes nine."""
    four_bar = cp.model.four_bar()
    made = cp.Scene(four_bar, four_bar.loops)
    q, v = made.state()
    workspace, compared = cp.Workspace(made), []
    workspace.acceleration(q, v, np.zeros(3))
    monkeypatch.setattr(pin.Model, "__ne__", lambda *models: bool(compared.append(models)))
    for _ in range(3):
        workspace.acceleration(q, v, np.zeros(3))
    assert not compared
    assert four_bar.model.nv == 3  # read by somebody, who may have edited it
    workspace.acceleration(q, v, np.zeros(3))
    assert len(compared) == 1


def chain(order: list[tuple[str, str]]) -> pin.Model:
    """Return a fixed tree of hinges, added in the order (name, parent) given."""
    model, ids = pin.Model(), {"": 0}
    for name, parent in order:
        at = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
        ids[name] = model.addJoint(ids[parent], pin.JointModelRY(), at, name)
        inertia = pin.Inertia(1.0, np.array([0.1, 0.0, 0.2]), 0.1 * np.eye(3))
        model.appendBodyToJoint(ids[name], inertia, pin.SE3.Identity())
    return model


def test_joints_that_were_not_added_depth_first_are_refused():
    """Pinocchio: crba assumes that the joints below a joint follow it, and is silently wrong."""
    model = chain([("a", ""), ("b", ""), ("c", "a")])
    q, still = np.array([0.1, 0.2, 0.3]), np.zeros(3)
    h = pin.rnea(model, model.createData(), q, still, still)
    columns = [pin.rnea(model, model.createData(), q, still, e) - h for e in np.eye(3)]
    assert np.abs(pin.crba(model, model.createData(), q) - np.array(columns)).max() > 0.1
    with pytest.raises(cp.errors.InvalidModel, match="not added depth-first"):
        cp.Robot("wide", model)
    cp.Robot("deep", chain([("a", ""), ("c", "a"), ("b", "")]))


@pytest.mark.long
def test_a_massless_leaf_is_refused_by_name():
    """Pinocchio: NaN, without a word."""
    model = chain([("a", ""), ("b", "a")])
    leaf = model.addJoint(2, pin.JointModelRY(), pin.SE3.Identity(), "leaf")
    nothing = np.zeros(3)
    assert not np.isfinite(pin.aba(model, model.createData(), nothing, nothing, nothing)).all()
    with pytest.raises(cp.errors.InvalidModel, match=r"no inertia moves with leaf: .* armature"):
        cp.Robot("chain", model)
    model.appendBodyToJoint(leaf, pin.Inertia.Random(), pin.SE3.Identity())
    cp.Robot("chain", model)


def test_mimic_joints_are_refused_by_name():
    """Pinocchio: the model loads, and its constrained dynamics raise from a header."""
    model = pin.transformJointIntoMimic(chain([("a", ""), ("b", "a"), ("c", "b")]), 1, 3, 2.0, 0.0)
    with pytest.raises(cp.errors.InvalidModel, match=r"mimic joints \(c\): .* without mimic"):
        cp.Robot("chain", model)


def test_a_mass_below_zero_is_refused_by_name():
    """Pinocchio: accepted."""
    model = chain([("a", ""), ("b", "a")])
    model.inertias[2].mass = -0.1
    with pytest.raises(cp.errors.InvalidModel, match="the mass on b is negative"):
        cp.Robot("chain", model)


@pytest.mark.long
def test_a_limit_that_is_nan_is_not_mistaken_for_an_edit():
    """Pinocchio: a model with NaN in it does not equal itself."""
    model = chain([("a", ""), ("b", "a")])
    model.upperPositionLimit = np.array([1.0, np.nan])
    with pytest.raises(cp.errors.InvalidModel, match="NaN, such as a limit"):
        cp.Robot("chain", model)


# --- forces: their sum, their place, their sign


@pytest.mark.parametrize(("name", "weight"), [("talos", 885.57), ("cassie", 323.14)])
def test_at_rest_the_contacts_carry_the_weight(name, weight):
    """Pinocchio: signs and frames of forces differ between its algorithms."""
    standing = scene(name)
    q, still = standing.state()
    workspace = cp.Workspace(standing)
    terms = workspace.terms(q, still)
    # h = tau + J^T lam: lam such that the free-flyer needs no torque, motors for the rest
    lam = np.linalg.lstsq(terms.J[:, :6].T, terms.h[:6], rcond=None)[0]
    tau = terms.h - terms.J.T @ lam
    assert np.abs(tau[:6]).max() < 1e-10
    tau[:6] = 0.0

    model = standing.robot.model
    com = pin.centerOfMass(model, model.createData(), q)
    for solver in SOLVERS:
        if not takes(solver, standing):
            continue
        solution = cp.solve(standing, q, still, tau, solver=solver, throw=False)
        assert np.abs(solution.a).max() < 1e-6
        places = dict(zip(standing.names, workspace.equations.placements(q), strict=True))
        force, moment = np.zeros(3), np.zeros(3)
        corners = []
        for contact in standing.robot.contacts:
            (at, _), F = places[contact.name], solution.world_forces[contact.name]
            force += F[:3]
            moment += np.cross(at.translation, F[:3]) + (F[3:] if F.size == 6 else 0.0)
            tips = contact.corners() if F.size == 6 else [cp.PointContact(contact.frame)]
            corners += [at.act(np.array(tip.offset)) for tip in tips]
        np.testing.assert_allclose(force, [0.0, 0.0, weight], atol=0.01)
        corners = np.array(corners)
        # the point of the ground about which the contact forces have no horizontal moment
        height = corners[:, 2].mean()
        cop = np.array([-moment[1], moment[0]]) / force[2]
        np.testing.assert_allclose(cop, com[:2], atol=1e-5)
        assert np.ptp(corners[:, 2]) < 1e-3 < com[2] - height
        assert inside(cop, corners[:, :2])


def inside(point: np.ndarray, corners: np.ndarray) -> bool:
    """Return whether a point is a convex combination of the corners."""
    from scipy.optimize import linprog

    weights = np.vstack([corners.T, np.ones(len(corners))])
    return linprog(np.zeros(len(corners)), A_eq=weights, b_eq=[*point, 1.0]).status == 0


def two_boxes() -> cp.Robot:
    """Return two bodies of 2 kg and 3 kg that float without gravity."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    for name, mass in (("one", 2.0), ("two", 3.0)):
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        model.addJointFrame(joint)
        inertia = pin.Inertia(mass, np.array([0.1, -0.2, 0.05]), mass * np.diag([0.1, 0.2, 0.15]))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return (
        cp.Robot("two boxes", model)
        .with_frame("one_corner", "one", [0.3, 0.1, 0.2], pin.exp3(np.array([0.3, -0.5, 0.2])))
        .with_frame("two_corner", "two", [-0.2, 0.4, 0.1], pin.exp3(np.array([-0.6, 0.1, 0.9])))
    )


@pytest.mark.parametrize("solver", [s for s in SOLVERS if s.takes_loops], ids=lambda s: s.title)
@pytest.mark.parametrize("kind", ["ball", "weld"])
def test_a_loop_pushes_its_two_bodies_equally_and_oppositely(solver, kind):
    """Pinocchio: the forces on the second body are nowhere to be read."""
    boxes = two_boxes()
    loops = [cp.Loop(a, b, kind, name="joint") for a, b in
             (("one_corner", "two_corner"), ("two_corner", "one_corner"))]  # fmt: skip
    one, two = (cp.Scene(boxes, [loop]) for loop in loops)
    rng = np.random.default_rng(5)
    q, v = one.sample(rng, spread=0.5)
    tau = rng.normal(size=12)
    a, b = (cp.solve(s, q, v, tau, solver=solver) for s in (one, two))
    assert relative(b.a, a.a) < 1e-9
    # exchanged frames: the same force with the other sign, at the same point
    np.testing.assert_allclose(a.world_forces["joint"], -b.world_forces["joint"], atol=1e-6)
    # each body by itself, under its own wrench and the loop's
    model = boxes.model
    for name, solution in (("one", a), ("two", b)):
        joint = model.getJointId(name)
        rows = slice(6 * (joint - 1), 6 * joint)
        wrenches = [pin.Force.Zero() for _ in range(model.njoints)]
        _, placement = boxes.frame(f"{name}_corner")
        force = np.zeros(6)
        force[: solution.lam.size] = solution.lam
        wrenches[joint] = placement.act(pin.Force(force))
        needed = pin.rnea(model, model.createData(), q, v, solution.a, wrenches)
        np.testing.assert_allclose(needed[rows], tau[rows], atol=1e-6)


@functools.cache
def box() -> cp.Robot:
    """Return a free box of 5 kg, turned, with an eye and a hook of the world at the eye."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "box")
    model.addJointFrame(joint)
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(5.0, 0.3, 0.2, 0.4), pin.SE3.Identity())
    at = pin.SE3(pin.exp3(np.array([0.4, -0.3, 0.8])), np.array([1.0, 2.0, 3.0]))
    eye = pin.SE3(pin.exp3(np.array([-0.2, 0.7, 0.1])), np.zeros(3))
    hook = at * eye
    made = cp.Robot("box", model, postures={"hanging": pin.SE3ToXYZQUAT(at)})
    made = made.with_frame("eye", "box", eye.translation, eye.rotation)
    return made.with_frame("hook", "world", hook.translation, hook.rotation)


HANGING = {
    "point contact": (cp.PointContact("eye", name="it"), 1.0),
    "surface contact": (cp.SurfaceContact("eye", name="it"), 1.0),
    "ball": (cp.Loop("eye", "hook", name="it"), 1.0),
    "ball, world first": (cp.Loop("hook", "eye", name="it"), -1.0),
    "weld": (cp.Loop("eye", "hook", "weld", name="it"), 1.0),
    "weld, world first": (cp.Loop("hook", "eye", "weld", name="it"), -1.0),
}


@each_solver
@pytest.mark.parametrize(("constraint", "sign"), HANGING.values(), ids=HANGING)
def test_a_hanging_box_pulls_with_its_weight(solver, constraint, sign):
    """Pinocchio: lambda_c is the force on joint 1, and the contact_force of lcaba minus that."""
    hanging = cp.Scene(box(), [constraint])
    q, still = hanging.state()
    solution = cp.solve(hanging, q, still, still, solver=solver, throw=False)
    assert np.abs(solution.a).max() < 1e-9
    force = np.zeros(constraint.rows)
    force[2] = sign * 5.0 * GRAVITY
    np.testing.assert_allclose(solution.world_forces["it"], force, atol=1e-7)
    eye = q_rotation(q) @ box().frame("eye")[1].rotation
    np.testing.assert_allclose(eye @ solution.forces["it"][:3], force[:3], atol=1e-7)


def q_rotation(q: np.ndarray) -> np.ndarray:
    return pin.Quaternion(q[6], *q[3:6]).toRotationMatrix()


@pytest.mark.long
@pytest.mark.parametrize("length", [1e-6, 1e-4, 1.0, 1e4, 1e6])
@pytest.mark.parametrize("name", ["cassie", "talos", "stewart"])
def test_no_unit_of_length_makes_a_machine_massless(name, length):
    """Inertias of turns go with its square, those of shifts do not: Cassie was refused at 1e-4."""
    robot = cp.load_robot(name)
    assert Units(length).scene(cp.Scene(robot, robot.loops)).robot.nv == robot.nv


@pytest.mark.long
@pytest.mark.parametrize("kind", [pin.JointModelPX, pin.JointModelRX])
def test_a_massless_leaf_is_refused_beside_joints_of_the_other_kind(kind):
    other = pin.JointModelRY if kind is pin.JointModelPX else pin.JointModelPZ
    model = pin.Model()
    arm = model.addJoint(0, other(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, pin.Inertia.Random(), pin.SE3.Identity())
    model.addJoint(arm, kind(), pin.SE3.Identity(), "leaf")
    with pytest.raises(cp.errors.InvalidModel, match="no inertia moves with leaf"):
        cp.Robot("arm", model)
