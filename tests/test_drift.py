"""Drift: Baumgarte's terms and their stability limit, and schemes that correct after a step."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from motions import bar, hanging_cassie, rod_pendulum
from shared import HAS_LCABA, SOLVERS, all_scenes, each_row, relative, robot, states, takes

import condyn_pin as cp
from condyn_pin.simulation.drift import FactorisedGaps, SolvedGaps, gaps_of
from condyn_pin.simulation.stability import growth, is_beyond, stability_limit
from condyn_pin.simulation.system import System

PULLED = cp.Baumgarte(4.0, 6.0)
LABELS = [
    "talos contacts",
    "cassie loops",
    "four_bar loops",
    "talos foot to foot, welded",
    "talos hands to the world and together",
    "talos hands hinged",
    "cassie on lines",
]
INTEGRATORS = cp.simulation.INTEGRATORS
NO_DRIFT = cp.simulation.NoDrift()


# What is asked of the rows.


@pytest.mark.parametrize("label", LABELS)
def test_every_method_is_pulled_the_same_way(label):
    """A little off the constraints, where equivalents of a hinge differ by squares of the gap."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    rng = np.random.default_rng(0)
    q = pin.integrate(scene.robot.model, q, 1e-7 * rng.normal(size=scene.robot.nv))
    v = v + 1e-7 * rng.normal(size=scene.robot.nv)

    def solved(solver: object, drift: cp.Baumgarte | None = PULLED) -> cp.dynamics.Solution:
        return cp.solve(scene, q, v, tau, solver=solver, drift=drift, throw=False)

    exact = solved(cp.dynamics.Reference(rank_tolerance=1e-6))
    plain, free = solved(cp.Proximal()), solved(cp.Proximal(), None)
    if not scene.nominal.redundant:  # open loops with redundant rows contradict each other
        for kind in SOLVERS.values():
            solver = kind()
            if kind not in (cp.LCABA, cp.dynamics.Soft) and takes(solver, scene):
                assert relative(solved(solver).a, exact.a) < 1e-8, solver
    assert max(plain.state_error) > 1e-8
    assert relative(plain.a, free.a, 1.0) > 1e-10


def test_rows_are_the_damped_spring():
    """J a + gamma = -2 alpha J v - beta^2 c, row by row, far from closed."""
    word = replace(robot("four_bar"), precision=0.0)
    scene = cp.Scene(word, [cp.Loop("coupler_tip", "rocker_tip", "planar", axis="y")])
    q, v, tau = np.random.default_rng(1).normal(size=(3, 3))
    workspace = cp.Workspace(scene, drift=PULLED)
    solution = workspace.solve(q, v, tau)
    t = workspace.terms(q, v)
    wanted = -8.0 * t.J @ v - 36.0 * workspace.violation(q)
    assert np.allclose(t.a_ref, wanted, rtol=1e-12)
    assert np.allclose(t.J @ solution.a + t.gamma, wanted, rtol=1e-9)


@pytest.mark.long
def test_a_contact_without_anchor_is_only_damped():
    scene = all_scenes()["solo12 contacts"]
    q, _, tau = states("solo12 contacts")[0]
    v = np.random.default_rng(2).normal(size=scene.robot.nv)
    for solver in (cp.Proximal(), cp.DenseKKT(), cp.dynamics.Reference()):
        damped, sprung = (
            cp.solve(scene, q, v, tau, solver=solver, drift=cp.Baumgarte(4.0, beta))
            for beta in (0.0, 1e3)
        )
        assert np.array_equal(damped.a, sprung.a)


@pytest.mark.long
def test_a_gap_closes_as_it_should():
    """c'' + 2 alpha c' + beta^2 c = 0: a four-bar, 1 mm open, integrated with small steps."""
    scene, q, v = bar(1e-3)
    workspace = cp.Workspace(scene, drift=cp.Baumgarte(10.0, 10.0))
    gap, dt, t = workspace.violation(q), 1e-4, 0.2
    for _ in range(round(t / dt)):
        v = v + dt * workspace.acceleration(q, v, np.zeros(3))
        q = pin.integrate(scene.robot.model, q, dt * v)
    wanted = gap * (1 + 10.0 * t) * np.exp(-10.0 * t)
    assert np.abs(workspace.violation(q) - wanted).max() < 0.02 * np.abs(gap).max()


def test_it_is_a_value_and_goes_along():
    workspace = cp.Workspace(all_scenes()["four_bar loops"], drift=PULLED)
    assert pickle.loads(pickle.dumps(workspace)).drift == PULLED
    assert (PULLED.Kd, PULLED.Kp) == (8.0, 36.0)


@pytest.mark.parametrize(("T", "remaining"), [(0.3, 0.05), (0.1, 0.02)])
def test_the_settling_time_is_met(T, remaining):
    gains = cp.Baumgarte.from_settling_time(T, remaining=remaining)
    x = gains.alpha * T
    assert (1 + x) * math.exp(-x) == pytest.approx(remaining, rel=1e-12)
    assert gains.alpha == gains.beta


@each_row(
    "solref", [(0.02, 1.0), (0.02, 0.5), (0.005, 0.7), (-400.0, -40.0), (-400.0, 0.0), (0.0, -40.0)]
)
def test_solref_goes_there_and_back(solref):
    gains = cp.Baumgarte.from_solref(*solref)
    again = cp.Baumgarte.from_solref(*gains.to_solref())
    assert (again.alpha, again.beta) == pytest.approx((gains.alpha, gains.beta), rel=1e-14)
    if solref[0] > 0:
        assert gains.to_solref() == pytest.approx(solref, rel=1e-14)
    if solref == (0.02, 1.0):
        assert gains == cp.Baumgarte.critical(50.0)


@each_row(
    ("call", "said"),
    [
        (lambda: cp.Baumgarte(-1.0, 1.0), "alpha"),
        (lambda: cp.Baumgarte(np.nan, 1.0), "alpha"),
        (lambda: cp.Baumgarte("a", 1.0), "alpha"),
        (lambda: cp.Baumgarte(1e300, 1.0), "alpha"),
        (lambda: cp.Baumgarte(1.0, -1e-9), "beta"),
        (lambda: cp.Baumgarte(1.0, 1e155), "beta"),
        (lambda: cp.Baumgarte.critical(-1.0), "alpha = -1.0"),
        (lambda: cp.Baumgarte.from_settling_time(0.0), "T = 0.0"),
        (lambda: cp.Baumgarte.from_settling_time(1.0, remaining=1.0), "remaining = 1.0"),
        (lambda: cp.Baumgarte.deadbeat(-1e-3), "dt = -0.001"),
        (lambda: cp.Baumgarte.from_solref(0.02, -1.0), "both positive"),
        (lambda: cp.Baumgarte.from_solref(0.0, 1.0), "both positive"),
        (lambda: cp.simulation.Projection(metric="weight"), "metric = 'weight'"),
        (lambda: cp.simulation.Projection(every=0), "every = 0"),
        (lambda: cp.simulation.Projection(every=1.5), "every = 1.5"),
        (lambda: cp.simulation.Projection(tolerance=-1.0), "tolerance = -1.0"),
        (lambda: cp.simulation.Projection(tolerance=math.nan), "tolerance"),
        (lambda: cp.simulation.Projection(position=False, velocity=False), "NoDrift"),
        (lambda: cp.simulation.PostStabilization(every=True), "every = True"),
        (lambda: cp.solve(*bar(), 0, drift=10.0), "drift = 10"),
        (
            lambda: cp.solve(*bar(), 0, solver=cp.dynamics.Soft(), drift=PULLED),
            "use it without drift",
        ),
    ],
)
def test_what_means_nothing_is_refused(call, said):
    with pytest.raises(cp.InvalidArgument, match=said):
        call()


@pytest.mark.long
@pytest.mark.skipif(not HAS_LCABA, reason="Pinocchio 3 has none")
def test_lcaba_takes_no_gains():
    with pytest.raises(cp.errors.UnsupportedConstraint, match="ignores drift control"):
        cp.solve(*bar(), np.zeros(3), solver=cp.LCABA(), drift=PULLED)


# A pendulum on a rod in motion: gaps, and gains that are too large for a step.


@pytest.mark.parametrize(
    ("integrator", "dt", "alpha_dt", "gap", "slip", "energy"),
    [
        (cp.RungeKutta4(), 1e-2, 0.03, 5.10e-08, 2.26e-07, 1.80e-06),
        (cp.RungeKutta4(), 1e-2, 0.3, 2.70e-06, 1.39e-04, 1.43e-04),
        (cp.SemiImplicitEuler(), 1e-3, 0.1, 1.96e-04, 9.76e-03, 1.96e-02),
    ],
)
def test_drift_of_a_pendulum(integrator, dt, alpha_dt, gap, slip, energy):
    found = cp.simulate(
        *rod_pendulum(), duration=10.0, dt=dt, integrator=integrator,
        drift=cp.Baumgarte.critical(alpha_dt / dt), record=round(1e-2 / dt),
    )  # fmt: skip
    lost = np.abs(found.energy.error).max()
    measured = found.violation.max(), found.constraint_velocity.max(), lost
    assert np.allclose(measured, (gap, slip, energy), rtol=0.2)


@pytest.mark.parametrize(
    ("integrator", "dt", "power"),
    [(cp.RungeKutta4(), 2e-2, 2.0), (cp.simulation.ExplicitEuler(), 4e-3, 1.0)],
)
def test_growth_of_gaps_that_nothing_closes(integrator, dt, power):
    """As t^2 with high orders, as t with Euler's methods."""
    found = cp.simulate(
        *rod_pendulum(), duration=8.0, dt=dt, integrator=integrator, drift=NO_DRIFT,
        record=round(2e-2 / dt),
    )  # fmt: skip
    early, late = found.violation[len(found) // 2], found.violation[-1]
    assert np.log2(late / early) == pytest.approx(power, abs=0.2)


def test_limits_are_those_of_linear_theory():
    semi, explicit = cp.SemiImplicitEuler(), cp.simulation.ExplicitEuler()
    assert stability_limit(explicit) == pytest.approx(2.0, abs=2e-4)
    assert stability_limit(semi) == pytest.approx(2 * np.sqrt(2) - 2, abs=2e-4)
    assert stability_limit(cp.RungeKutta4()) == pytest.approx(2.7853, abs=2e-4)
    assert stability_limit(cp.simulation.DormandPrince()) == np.inf
    popular = cp.Baumgarte(1e3, np.sqrt(2) * 1e3)  # Taylor's rule
    assert growth(semi, popular, 1e-3) == pytest.approx(1 + np.sqrt(2))
    assert growth(explicit, popular, 1e-3) == pytest.approx(1.0)
    for dt in (1e-150, 1e-3, 1e150):  # only the product of gain and step counts
        assert growth(semi, cp.Baumgarte.deadbeat(dt), dt) < 1e-7
    assert growth(cp.RungeKutta4(), cp.Baumgarte(1.0, 1.0), 1e150) == np.inf
    # springs and dampers that the integrator does not know of, as its docstring says
    middle = cp.simulation.LinearlyImplicitMidpoint()
    assert 2 * stability_limit(middle, beta_per_alpha=0.0) == pytest.approx(1.0, abs=2e-4)
    slow, below, above = (growth(middle, cp.Baumgarte(0.0, w), 1.0) for w in (0.1, 1.4, 1.42))
    assert 1 - 1e-4 < slow < 1.0
    assert below < 1.0 < above


@pytest.mark.parametrize(
    ("integrator", "near"),
    [
        (cp.SemiImplicitEuler(), 0.01),
        (cp.simulation.Leapfrog(), 0.05),
        (cp.simulation.LinearlyImplicitMidpoint(), 0.05),
    ],
    ids=repr,
)
@pytest.mark.parametrize("stable", [True, False])
def test_the_limit_is_where_gaps_grow(integrator, near, stable, monkeypatch):
    """The run itself, past the check; the last two remember a step."""
    monkeypatch.setattr("condyn_pin.simulation.plan.check_stability_limit", lambda *_: None)
    dt, share = 1e-2, 1 - near if stable else 1 + near
    found = cp.simulate(
        *rod_pendulum(), duration=20.0, dt=dt, integrator=integrator,
        drift=cp.Baumgarte.critical(share * stability_limit(integrator) / dt),
    )  # fmt: skip
    # to its end, however wide coarse steps come open beside gaps that grow
    assert (found.run.status.ok and found.violation.max() < 0.1) == stable


def test_gains_beyond_the_limit_are_refused():
    popular = cp.Baumgarte(1e3, np.sqrt(2) * 1e3)  # Taylor's rule
    for integrator, drift, words in (
        (cp.SemiImplicitEuler(), popular, r"2\.41 times a step; .* below 828\.4 / s"),
        # an iteration that does not converge
        (
            cp.simulation.ImplicitMidpoint(),
            cp.Baumgarte.critical(2e3),
            r"every gap grows .* is stable below",
        ),
    ):
        with pytest.raises(cp.InvalidArgument, match=words):
            cp.simulate(*bar(), duration=1.0, dt=1e-3, integrator=integrator, drift=drift)
    assert cp.simulate(*bar(), duration=0.01, drift=popular).status.ok


@pytest.mark.long
@pytest.mark.parametrize(
    ("integrator", "alpha", "beta"),
    [
        (cp.simulation.ExplicitEuler(), 2.0, 2.0),
        (cp.simulation.ExplicitEuler(), 1.0, 0.0),
        (cp.simulation.ExplicitEuler(), 0.5, 1.0),  # two conjugate eigenvalues on the circle
        (cp.simulation.ExplicitEuler(), 1.0, np.sqrt(2)),
        (cp.SemiImplicitEuler(), 1.0, 0.0),
        (cp.SemiImplicitEuler(), 0.0, 2.0),
        (cp.SemiImplicitEuler(), 2 * np.sqrt(2) - 2, 2 * np.sqrt(2) - 2),
        (cp.simulation.StormerVerlet(), 1.0, 1.0),
        (cp.simulation.StormerVerlet(), 0.0, 2.0),
        (cp.simulation.Leapfrog(), 0.0, 2.0),
        (cp.RungeKutta4(), 2.785293563405282 / 2, 0.0),
        (cp.simulation.LinearlyImplicitMidpoint(), 0.5, 0.0),
    ],
    ids=lambda each: f"{each:.3g}" if isinstance(each, float) else each.title,
)
def test_gains_at_the_limit_are_refused(integrator, alpha, beta):
    """There no gap shrinks, and a hundredth below it each does."""
    dt = 1e-3
    options = {"duration": 0.01, "dt": dt, "integrator": integrator}
    with pytest.raises(cp.InvalidArgument, match=r"no gap shrinks; .* is stable below"):
        cp.simulate(*rod_pendulum(), drift=cp.Baumgarte(alpha / dt, beta / dt), **options)
    below = cp.Baumgarte(0.99 * alpha / dt, 0.99 * beta / dt)
    assert cp.simulate(*rod_pendulum(), drift=below, **options).status.ok


@pytest.mark.long
@pytest.mark.parametrize(
    "kind",
    [kind for kind in INTEGRATORS.values() if not (kind.keeps_constraints or kind.is_adaptive)],
)
def test_the_limits_of_all_integrators_are_open(kind):
    """What is refused begins at the limit that is told, whatever it is."""
    integrator = kind()
    limit = stability_limit(integrator)
    assert is_beyond(integrator, cp.Baumgarte.critical(limit + 2e-4), 1.0)
    assert not is_beyond(integrator, cp.Baumgarte.critical(limit - 2e-4), 1.0)
    for slow in (1e-9, 1e-6, 1e-3):  # gains that hardly do anything are within
        for alpha, beta in ((slow, slow), (slow, 0.0), (0.0, 0.0)):
            assert not is_beyond(integrator, cp.Baumgarte(alpha, beta), 1.0)


# Schemes in motion: what each keeps closed, what it costs, and where it ends.

DT = 2e-3  # [s]


@pytest.fixture(scope="module")
def four_bar():
    return bar()[0]


def run(scene, drift, *, solver=None, integrator=None, duration=0.4):
    return cp.simulate(
        scene, *scene.sample(np.random.default_rng(3)), duration=duration, dt=DT,
        integrator=integrator or cp.SemiImplicitEuler(), drift=drift, solver=solver,
    )  # fmt: skip


def gaps(trajectory):
    """The largest gap and slip after the first sample, which is as closed as it was sampled."""
    equations = cp.Workspace(trajectory.scene).equations
    both = [equations.gaps(q, v) for q, v in zip(trajectory.q[1:], trajectory.v[1:], strict=True)]
    return max(np.abs(c).max() for c, _ in both), max(np.abs(s).max() for _, s in both)


SCHEMES = [
    drift() for name, drift in cp.simulation.DRIFTS.items() if name not in ("baumgarte", "nodrift")
]
read_off_or_factorised = pytest.mark.parametrize(
    "solver", [None, cp.dynamics.NullSpace()], ids=["read off", "factorised"]
)


@pytest.mark.long
@read_off_or_factorised
@pytest.mark.parametrize("scheme", [cp.Baumgarte.critical(60.0), *SCHEMES], ids=repr)
def test_every_scheme_keeps_a_four_bar_better_closed_than_none(four_bar, scheme, solver):
    open_c, open_s = gaps(run(four_bar, NO_DRIFT, solver=solver))
    c, s = gaps(run(four_bar, scheme, solver=solver))
    assert c < 0.5 * open_c
    assert s < 0.5 * open_s


@pytest.mark.parametrize("metric", ["mass", "euclidean"])
@read_off_or_factorised
@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
def test_projection_keeps_what_it_promises(four_bar, metric, solver, tolerance):
    drift = cp.simulation.Projection(metric=metric, tolerance=tolerance)
    for left in gaps(run(four_bar, drift, solver=solver)):
        assert left <= tolerance


@pytest.mark.long
def test_a_gap_is_closed_nearly_on_the_shortest_way():
    """A bob on a rod, 10 kg along x and 1 kg along z: off the closest place by the gap squared."""
    model, still = pin.Model(), pin.SE3.Identity()
    joint = model.addJoint(0, pin.JointModelPX(), still, "x")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(9.0, 0.1), still)
    joint = model.addJoint(joint, pin.JointModelPZ(), still, "z")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), still)
    model.gravity = pin.Motion.Zero()
    model.addFrame(pin.Frame("bob", joint, 0, still, pin.FrameType.OP_FRAME))
    bob = cp.Robot("bob", model, postures={"right": np.array([1.0, 0.0])})
    scene = cp.Scene(bob, [cp.Loop("bob", "universe", "rod", length=1.0)])
    closest, how = np.array([math.cos(0.6), math.sin(0.6)]), {"duration": 1e-3, "dt": 1e-3}
    off = []
    for gap in (0.1, 0.05):  # along W^-1 J^T of the closest place
        start = closest + gap * closest / np.array([10.0, 1.0])
        drift = cp.simulation.Projection()
        end = cp.simulate(scene, start, 0.0 * start, drift=drift, close_start=False, **how).q[-1]
        assert np.linalg.norm(end) == pytest.approx(1.0, abs=1e-10)
        off.append(np.linalg.norm(end - closest))
    assert 0.01 * gap > off[1] > 0
    assert 3 < off[0] / off[1] < 5


@pytest.mark.long
@pytest.mark.parametrize("mu", [1.0, 1e3])
@pytest.mark.parametrize(
    "scheme", [cp.simulation.PostStabilization(), cp.simulation.Projection()], ids=repr
)
def test_a_factor_that_closes_nothing_is_not_used(four_bar, scheme, mu):
    """With a large mu Proximal iterates to the right answer; its factor alone is far from it."""
    found, wanted = (
        gaps(run(four_bar, scheme, solver=solver, duration=0.1))
        for solver in (cp.Proximal(mu=mu, max_iterations=10_000), cp.dynamics.NullSpace())
    )
    for left, most in zip(found, wanted, strict=True):
        assert left < 2 * most + 1e-12


@pytest.mark.long
@pytest.mark.parametrize("kept", ["position", "velocity"])
def test_projection_of_one_level_leaves_the_other_alone(four_bar, kept):
    drift = cp.simulation.Projection(position=kept == "position", velocity=kept == "velocity")
    c, s = gaps(run(four_bar, drift))
    assert (c if kept == "position" else s) <= 1e-10
    assert (s if kept == "position" else c) > 1e-5


@pytest.mark.long
def test_every_other_step_is_left_alone(four_bar):
    open_by = run(four_bar, cp.simulation.Projection(every=2)).constraint_velocity
    assert max(open_by[2::2]) <= 1e-10 < min(open_by[1::2])


@pytest.mark.parametrize("name", ["four_bar", "stewart", "cassie"])
def test_what_the_solver_leaves_behind_closes_as_well_as_a_factor_of_our_own(name):
    scene = cp.Scene(robot(name), robot(name).loops)
    rng = np.random.default_rng(5)
    closed, v = scene.sample(rng)
    system = System(cp.Workspace(scene))
    opened = system.integrate(closed, 1e-6 * rng.normal(size=scene.robot.nv))
    slipping = v + 1e-5 * rng.normal(size=scene.robot.nv)
    read, factorised = gaps_of(system, "mass"), FactorisedGaps(system, "mass")
    assert isinstance(read, SolvedGaps)
    for level, state in enumerate([(opened, 0 * v), (closed, slipping)]):
        before = np.abs(read.look(0.0, *state))[:, level].max()
        factorised.look(0.0, *state)
        one, other = (gaps.step(False)[level] for gaps in (read, factorised))
        assert np.abs(one - other).max() < 1e-3 * np.abs(other).max()
        q, v = state
        state = (q, v + one) if level else (system.integrate(q, one), v)
        assert np.abs(read.look(0.0, *state))[:, level].max() < 1e-3 * before


@pytest.mark.long
def test_a_projected_velocity_has_no_more_energy(four_bar):
    system = System(cp.Workspace(four_bar))
    rng = np.random.default_rng(2)
    q, _ = four_bar.sample(rng)
    M = system.mass(q)
    for _ in range(20):
        v = rng.normal(size=four_bar.robot.nv)
        after = cp.simulation.Projection(position=False).start(system, DT)(0.0, q, v)[1]
        assert after @ M @ after <= v @ M @ v


@pytest.mark.long
def test_a_state_within_tolerance_costs_no_further_solve(four_bar):
    q, v = four_bar.state()
    system, calls = System(cp.Workspace(four_bar)), []
    solve = system.solve
    system.solve = lambda *state: calls.append(state) or solve(*state)
    q1, v1 = cp.simulation.Projection().start(system, DT)(0.0, q, v)
    assert (q1 is q, v1 is v) == (True, True)
    system.acceleration(0.0, q1, v1)  # the step that follows asks for the same
    assert len(calls) == 1


@pytest.mark.long
def test_post_stabilisation_costs_no_solve_more(four_bar, monkeypatch):
    counts, numbers = [], []
    solve = System.solve
    monkeypatch.setattr(System, "solve", lambda *state: counts.append(1) or solve(*state))
    for drift in (NO_DRIFT, cp.simulation.PostStabilization()):
        counts.clear()
        run(four_bar, drift)
        numbers.append(len(counts))
    assert numbers == [201, 201]  # 200 steps, and the last sample


@pytest.mark.long
@pytest.mark.parametrize(
    "drift",
    [
        cp.simulation.PostStabilization(),
        cp.simulation.Projection(),
        cp.simulation.Projection(tolerance=1.0),
    ],
    ids=repr,
)
@pytest.mark.parametrize("integrator", [cp.SemiImplicitEuler(), cp.RungeKutta4()], ids=repr)
def test_forces_belong_to_their_sample(four_bar, drift, integrator):
    """What a correction solves at the end of a step is not what the step began with."""
    trajectory = run(four_bar, drift, integrator=integrator)
    workspace = cp.Workspace(trajectory.scene, cp.dynamics.Reference())
    for k in range(0, len(trajectory.t), 20):
        solution = workspace.solve(trajectory.q[k], trajectory.v[k], np.zeros(3), throw=False)
        wanted = solution.forces["coupler_rocker"].components
        assert np.abs(trajectory.a[k] - solution.a).max() < 1e-3 * np.abs(solution.a).max()
        assert np.abs(trajectory.lam[k] - wanted).max() < 1e-3 * max(np.abs(wanted).max(), 1.0)


@pytest.mark.long
def test_a_robot_with_redundant_loops_stays_closed():
    """Cassie: slips of open loops contradict each other, so gaps are closed first."""
    for drift, most in (
        (cp.simulation.Projection(), 1e-9),
        (cp.simulation.PostStabilization(), 1e-4),
    ):
        found = cp.simulate(
            *hanging_cassie(), duration=0.1, dt=1e-3, integrator=cp.SemiImplicitEuler(), drift=drift
        )
        assert found.violation.max() < 1e-10
        assert found.constraint_velocity.max() < most


@pytest.mark.long
@pytest.mark.parametrize(
    ("drift", "most"),
    [(cp.simulation.PostStabilization(), 1e-15), (cp.Baumgarte(30.0, 30.0), 2.5e-12)],
)
def test_feet_are_corrected_towards_where_they_touched_first(drift, most):
    """The run anchors them; Pinocchio's own rows of the workspace have to stand there too."""
    solo = robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    run = cp.simulate(scene, *scene.state(), duration=0.02, dt=1e-3, drift=drift)
    assert run.violation.max() < most
