"""Drift schemes in motion: what each keeps closed, what it costs, and where it ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.simulation.drift import DRIFTS
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.drift.post_stabilization import PostStabilization
from condyn_pin.simulation.drift.projection import Projection
from condyn_pin.simulation.gaps import FactorisedGaps, SolvedGaps, gaps_of
from condyn_pin.simulation.integrators.explicit import RungeKutta4, SemiImplicitEuler
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.system import System

DT = 2e-3  # [s]


@pytest.fixture(scope="module")
def four_bar():
    robot = cp.load_robot("four_bar")
    return cp.Scene(robot, robot.loops)


def gaps(trajectory):
    """The largest gap and slip after the first sample, which is as closed as it was sampled."""
    equations = cp.Workspace(trajectory.scene).equations
    both = [equations.gaps(q, v) for q, v in zip(trajectory.q[1:], trajectory.v[1:], strict=True)]
    return max(np.abs(c).max() for c, _ in both), max(np.abs(s).max() for _, s in both)


def run(scene, drift, *, solver=None, integrator=None, duration=0.4):
    q, v = scene.sample(np.random.default_rng(3))
    return simulate(
        scene,
        q,
        v,
        duration=duration,
        dt=DT,
        integrator=integrator or SemiImplicitEuler(),
        drift=drift,
        solver=solver,
    )


SCHEMES = [drift() for name, drift in DRIFTS.items() if name not in ("baumgarte", "nodrift")]


@pytest.mark.parametrize("solver", [None, cp.dynamics.NullSpace()], ids=["read off", "factorised"])
@pytest.mark.parametrize("scheme", [Baumgarte.critical(60.0), *SCHEMES], ids=repr)
def test_every_scheme_keeps_a_four_bar_better_closed_than_none(four_bar, scheme, solver):
    open_c, open_s = gaps(run(four_bar, NoDrift(), solver=solver))
    c, s = gaps(run(four_bar, scheme, solver=solver))
    assert c < 0.5 * open_c
    assert s < 0.5 * open_s


@pytest.mark.parametrize("metric", ["mass", "euclidean"])
@pytest.mark.parametrize("solver", [None, cp.dynamics.NullSpace()], ids=["read off", "factorised"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
def test_projection_keeps_what_it_promises(four_bar, metric, solver, tolerance):
    drift = Projection(metric=metric, tolerance=tolerance)
    for left in gaps(run(four_bar, drift, solver=solver)):
        assert left <= tolerance


@pytest.mark.parametrize("mu", [1.0, 1e3])
@pytest.mark.parametrize("scheme", [PostStabilization(), Projection()], ids=repr)
def test_a_factor_that_closes_nothing_is_not_used(four_bar, scheme, mu):
    """With a large mu Proximal iterates to the right answer; its factor alone is far from it."""
    solver = cp.Proximal(mu=mu, max_iterations=10_000)
    c, s = gaps(run(four_bar, scheme, solver=solver, duration=0.1))
    wanted_c, wanted_s = gaps(run(four_bar, scheme, solver=cp.dynamics.NullSpace(), duration=0.1))
    assert c < 2 * wanted_c + 1e-12
    assert s < 2 * wanted_s + 1e-12


@pytest.mark.parametrize("kept", ["position", "velocity"])
def test_projection_of_one_level_leaves_the_other_alone(four_bar, kept):
    drift = Projection(position=kept == "position", velocity=kept == "velocity", tolerance=1e-10)
    c, s = gaps(run(four_bar, drift))
    assert (c if kept == "position" else s) <= 1e-10
    assert (s if kept == "position" else c) > 1e-5


def test_every_other_step_is_left_alone(four_bar):
    trajectory = run(four_bar, Projection(every=2))
    equations = cp.Workspace(trajectory.scene).equations
    open_by = [
        np.abs(equations.gaps(q, v)[1]).max()
        for q, v in zip(trajectory.q, trajectory.v, strict=True)
    ]
    assert max(open_by[2::2]) <= 1e-10 < min(open_by[1::2])


@pytest.mark.parametrize("name", ["four_bar", "stewart", "cassie"])
def test_what_the_solver_leaves_behind_closes_as_well_as_a_factor_of_our_own(name):
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, robot.loops)
    rng = np.random.default_rng(5)
    closed, v = scene.sample(rng)
    system = System(cp.Workspace(scene))
    opened = system.integrate(closed, 1e-6 * rng.normal(size=robot.nv))
    slipping = v + 1e-5 * rng.normal(size=robot.nv)
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


def test_a_projected_velocity_has_no_more_energy(four_bar):
    system = System(cp.Workspace(four_bar))
    rng = np.random.default_rng(2)
    q, _ = four_bar.sample(rng)
    M = system.mass(q)
    for _ in range(20):
        v = rng.normal(size=four_bar.robot.nv)
        after = Projection(position=False).start(system, DT)(0.0, q, v)[1]
        assert after @ M @ after <= v @ M @ v


def test_a_state_within_tolerance_costs_no_further_solve(four_bar):
    q, v = four_bar.state("home") if "home" in four_bar.robot.postures else four_bar.state()
    workspace = cp.Workspace(four_bar)
    system, calls = System(workspace), []
    solve = system.solve
    system.solve = lambda *state: calls.append(state) or solve(*state)
    correct = Projection().start(system, DT)
    q1, v1 = correct(0.0, q, v)
    assert (q1 is q, v1 is v) == (True, True)
    system.acceleration(0.0, q1, v1)  # the step that follows asks for the same
    assert len(calls) == 1


def test_post_stabilisation_costs_no_solve_more(four_bar, monkeypatch):
    counts = []
    solve = System.solve
    monkeypatch.setattr(System, "solve", lambda *state: counts.append(1) or solve(*state))
    numbers = []
    for drift in (NoDrift(), PostStabilization()):
        counts.clear()
        run(four_bar, drift)
        numbers.append(len(counts))
    assert numbers[0] == numbers[1] == 201  # 200 steps, and the last sample


@pytest.mark.parametrize(
    "drift", [PostStabilization(), Projection(), Projection(tolerance=1.0)], ids=repr
)
@pytest.mark.parametrize("integrator", [SemiImplicitEuler(), RungeKutta4()], ids=repr)
def test_forces_belong_to_their_sample(four_bar, drift, integrator):
    """What a correction solves at the end of a step is not what the step began with."""
    trajectory = run(four_bar, drift, integrator=integrator)
    workspace = cp.Workspace(trajectory.scene, cp.dynamics.Reference())
    for k in range(0, len(trajectory.t), 20):
        solution = workspace.solve(trajectory.q[k], trajectory.v[k], np.zeros(3), throw=False)
        size = np.abs(solution.a).max()
        assert np.abs(trajectory.a[k] - solution.a).max() < 1e-3 * size
        wanted = solution.forces["coupler_rocker"].components
        found = trajectory.lam[k]
        assert np.abs(found - wanted).max() < 1e-3 * max(np.abs(wanted).max(), 1.0)


def test_the_settling_time_is_met():
    gains = Baumgarte.from_settling_time(0.3, remaining=0.05)
    x = gains.alpha * 0.3
    assert (1 + x) * math.exp(-x) == pytest.approx(0.05, rel=1e-12)
    assert gains.alpha == gains.beta


@pytest.mark.parametrize(
    "solref", [(0.02, 1.0), (0.005, 0.7), (-400.0, -40.0), (-400.0, 0.0), (0.0, -40.0)]
)
def test_solref_goes_there_and_back(solref):
    gains = Baumgarte.from_solref(*solref)
    again = Baumgarte.from_solref(*gains.to_solref())
    assert (again.alpha, again.beta) == pytest.approx((gains.alpha, gains.beta), rel=1e-14)
    if solref[0] > 0:
        assert gains.to_solref() == pytest.approx(solref, rel=1e-14)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Projection(metric="weight"), "metric = 'weight'"),
        (lambda: Projection(every=0), "every = 0"),
        (lambda: Projection(every=1.5), "every = 1.5"),
        (lambda: Projection(tolerance=-1.0), "tolerance = -1.0"),
        (lambda: Projection(tolerance=math.nan), "tolerance"),
        (lambda: Projection(position=False, velocity=False), "NoDrift"),
        (lambda: PostStabilization(every=True), "every = True"),
        (lambda: Baumgarte.from_settling_time(0.0), "T = 0.0"),
        (lambda: Baumgarte.from_settling_time(1.0, remaining=1.0), "remaining = 1.0"),
        (lambda: Baumgarte.deadbeat(-1e-3), "dt = -0.001"),
        (lambda: Baumgarte.from_solref(0.02, -1.0), "both positive"),
        (lambda: Baumgarte.critical(-1.0), "alpha = -1.0"),
    ],
)
def test_knobs_that_mean_nothing_are_refused(call, said):
    with pytest.raises(cp.InvalidArgument, match=said):
        call()


def test_a_robot_with_redundant_loops_stays_closed():
    """Cassie: slips of open loops contradict each other, so gaps are closed first."""
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")])
    q, v = scene.state()
    for drift in (Projection(), PostStabilization()):
        found = simulate(
            scene, q, v, duration=0.1, dt=1e-3, integrator=SemiImplicitEuler(), drift=drift
        )
        assert found.violation.max() < 1e-10
        assert found.constraint_velocity.max() < (1e-9 if isinstance(drift, Projection) else 1e-4)
