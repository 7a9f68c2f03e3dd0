"""Every solver on every scene: what a user may rely on, whichever they choose."""

from __future__ import annotations

import functools
import pickle
import re

import numpy as np
import pinocchio as pin
import pytest
from shared import (
    SOLVED,
    SOLVERS,
    all_scenes,
    each_scene,
    each_solver,
    relative,
    robot,
    states,
    takes,
    truth,
    unsupported_constraints,
)

import condyn_pin as cp
from condyn_pin._core.arguments import Arguments


def almost_hard(solver: cp.dynamics.Solver, softness: float) -> cp.dynamics.Solver:
    """Return a solver of other equations with those so near the hard ones."""
    (kind,) = (k for k in (cp.dynamics.Soft,) if isinstance(solver, k))
    return kind(solimp=(1 - softness, 1 - softness, *solver.solimp[2:]))


def agrees_with_reference_or_says_why_not(solver, label):
    scene = all_scenes()[label]
    if refused := unsupported_constraints(scene, solver):
        with pytest.raises(cp.errors.UnsupportedConstraint, match=re.escape(refused[0])):
            cp.Workspace(scene, solver)
        return
    workspace = cp.Workspace(scene, solver)
    for state, reference in zip(states(label), truth(label), strict=True):
        solution = workspace.solve(*state, throw=False)
        if not solver.exact and scene.rows:
            assert solution.status is cp.Status.INACCURATE
            assert relative(solution.a, reference.a) > SOLVED
        elif takes(solver, scene):
            assert solution.status is cp.Status.OK, solution
            error = relative(solution.a, reference.a)
            assert error < SOLVED, f"a is off by {error:.3g} of max(|a|, g), and the status is ok"
        else:
            assert solution.status is cp.Status.SINGULAR, (
                "rows are redundant: raise Singular, or set takes_redundant = True"
            )


@pytest.mark.parametrize("solver", [s() for s in SOLVERS.values() if not s.exact])
@each_scene
def test_other_equations_tend_to_the_hard_ones_at_first_order(solver, label):
    """Ten times nearer, ten times less error: a and the generalised force."""
    scene = all_scenes()[label]
    if not scene.rows:
        return
    state, hard = states(label)[1], truth(label)[1]
    J = cp.Workspace(scene).jacobian(state[0])
    errors = []
    for softness in (1e-5, 1e-6, 1e-7):
        soft = cp.solve(scene, *state, solver=almost_hard(solver, softness), throw=False)
        forces = relative(J.T @ soft.lam, J.T @ hard.lam, floor=scene.nominal.weight)
        errors.append((relative(soft.a, hard.a), forces))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.allclose(ratios, 10.0, rtol=0.02), ratios


def generalised_constraint_force_agrees(solver, label):
    """J^T lam is unique also where lam is not."""
    scene = all_scenes()[label]
    if not solver.exact or not takes(solver, scene) or not scene.rows:
        return
    workspace = cp.Workspace(scene, solver)
    for state, reference in zip(states(label), truth(label), strict=True):
        J = workspace.jacobian(state[0])
        lam = workspace.solve(*state).lam
        error = relative(J.T @ lam, J.T @ reference.lam, floor=scene.nominal.weight)
        assert error < 1e-7, f"J^T lam is off by {error:.3g}: check sign and axes of lam (rule 5)"


def residuals_hold_in_the_assembled_equations(solver, label):
    """The proof, once more, with M, h, J and gamma in place of the recursions."""
    scene = all_scenes()[label]
    if not takes(solver, scene):
        return
    workspace = cp.Workspace(scene, solver)
    q, v, tau = states(label)[0]
    solution = workspace.solve(q, v, tau, throw=False)
    t = workspace.terms(q, v)
    dynamics = t.M @ solution.a + t.h - tau - t.J.T @ solution.lam
    constraint = t.J @ solution.a + t.gamma - t.a_ref
    size = np.abs(t.M) @ np.abs(solution.a) + np.abs(t.h) + np.abs(tau)
    assert abs(np.abs(dynamics).max() - solution.dynamics_error) < 1e-12 * size.max()
    rows = np.abs(t.J) @ np.abs(solution.a) + np.abs(t.gamma)
    gap = np.abs(constraint).max(initial=0.0) - solution.constraint_error
    assert abs(gap) < 1e-12 * rows.max(initial=1.0)


def same_input_gives_the_same_bits(solver, label):
    scene = all_scenes()[label]
    if not takes(solver, scene):
        return
    one, two = cp.Workspace(scene, solver), cp.Workspace(scene, solver)
    first, second, *_ = states(label)
    fresh = one.acceleration(*first)
    one.acceleration(*second)
    one.solve(*second, throw=False)
    again = one.acceleration(*first)
    assert np.array_equal(again, fresh), "an earlier call changes the answer (rule 4 of a solver)"
    assert np.array_equal(one.acceleration(*first), fresh)
    assert np.array_equal(one.solve(*first, throw=False).a, fresh)
    assert np.array_equal(two.acceleration(*first), fresh)


def inputs_are_untouched_and_results_are_owned(solver, label):
    scene = all_scenes()[label]
    if not takes(solver, scene):
        return
    workspace = cp.Workspace(scene, solver)
    first, second, *_ = states(label)
    before = [x.copy() for x in first]
    a, solution = workspace.acceleration(*first), workspace.solve(*first, throw=False)
    kept = a.copy(), solution.a.copy(), solution.lam.copy(), solution.q.copy()
    untouched = all(np.array_equal(x, y) for x, y in zip(first, before, strict=True))
    assert untouched, "the solver writes to q, v or tau (rule 4 of a solver)"
    workspace.solve(*second, throw=False)
    workspace.acceleration(*second)
    now = a, solution.a, solution.lam, solution.q
    owned = all(np.array_equal(x, y) for x, y in zip(now, kept, strict=True))
    assert owned, "a later call writes to arrays that were returned (rules 4 and 5): return copies"
    assert not np.shares_memory(solution.q, first[0])
    a[:] = solution.a[:] = solution.lam[:] = np.nan
    assert np.array_equal(workspace.solve(*first, throw=False).a, kept[1])


@functools.cache
def turned_scene(label: str) -> cp.Scene:
    """The last constraint first."""
    scene = all_scenes()[label]
    return cp.Scene(scene.robot, tuple(reversed(scene.constraints)))


def order_of_constraints_does_not_matter(solver, label):
    scene, turned = all_scenes()[label], turned_scene(label)
    if not takes(solver, scene):
        return
    for q, v, tau in states(label)[:2]:
        one = cp.Workspace(scene, solver).solve(q, v, tau, throw=False)
        two = cp.Workspace(turned, solver).solve(q, v, tau, throw=False)
        assert relative(one.a, two.a) < 2 * SOLVED
        scale = max(np.abs(one.lam).max(initial=0.0), scene.nominal.weight)
        for name, force in one.forces.items():
            # the smallest lam is unique; the iteration leaves a little noise in it
            assert np.abs(force - two.forces[name]).max() < 1e-6 * scale


PROPERTIES = [
    agrees_with_reference_or_says_why_not,
    generalised_constraint_force_agrees,
    residuals_hold_in_the_assembled_equations,
    same_input_gives_the_same_bits,
    inputs_are_untouched_and_results_are_owned,
    order_of_constraints_does_not_matter,
]


@pytest.mark.pairs
@pytest.mark.parametrize("holds", PROPERTIES, ids=lambda holds: holds.__name__)
@each_solver
@each_scene
def test_contract(holds, solver, label):
    holds(solver, label)


@each_solver
def test_no_constraints_is_the_unconstrained_dynamics(solver):
    talos = robot("talos")
    scene = cp.Scene(talos)
    rng = np.random.default_rng(1)
    q, v = scene.sample(rng)
    tau = rng.normal(size=talos.nv)
    solution = cp.solve(scene, q, v, tau, solver=solver)
    free = pin.aba(talos.model, talos.model.createData(), q, v, tau)
    assert relative(solution.a, free) < 1e-10
    assert solution.lam.shape == (0,)
    assert solution.forces == {}
    assert solution.state_error == (0.0, 0.0)


@each_solver
def test_lists_and_other_dtypes_are_welcome(solver):
    scene = all_scenes()["solo12 contacts"]
    q, v, _ = states("solo12 contacts")[0]
    tau = np.zeros(scene.robot.nv, dtype=int)
    workspace = cp.Workspace(scene, solver)
    wanted = workspace.acceleration(q, v, tau.astype(float))
    for given in ((q.tolist(), v.tolist(), tau.tolist()), (q, v, tau), (tuple(q), v, tau)):
        assert np.array_equal(workspace.acceleration(*given), wanted)
        assert np.array_equal(workspace.solve(*given, throw=False).a, wanted)


@pytest.mark.long
def test_states_that_were_pickled_are_not_taken_the_slow_way(monkeypatch):
    """An array that comes from another process has a dtype of its own, equal to float64."""
    scene, state = all_scenes()["solo12 contacts"], states("solo12 contacts")[0]
    workspace = cp.Workspace(scene, cp.Proximal())
    wanted = workspace.acceleration(*state)
    for kind, slow in ((cp.Workspace, "careful_acceleration"), (Arguments, "check")):
        monkeypatch.setattr(kind, slow, lambda *_: pytest.fail("the slow way"))
    received = pickle.loads(pickle.dumps(state))
    assert np.array_equal(workspace.acceleration(*received), wanted)
    assert np.array_equal(workspace.solve(*received).a, wanted)


@pytest.mark.long
@each_solver
def test_another_byte_order_is_the_same_number(solver):
    """Pinocchio reads the bytes as they are: 1.0 becomes 3e-319."""
    scene = all_scenes()["solo12 contacts"]
    state = states("solo12 contacts")[0]
    workspace = cp.Workspace(scene, solver)
    right = workspace.acceleration(*state)
    for i in range(3):
        turned = [x.astype(">f8") if k == i else x for k, x in enumerate(state)]
        assert np.array_equal(workspace.acceleration(*turned), right)
        assert np.array_equal(workspace.solve(*turned, throw=False).a, right)


@pytest.mark.long
@each_solver
def test_a_huge_quaternion_is_refused_by_name(solver):
    scene = all_scenes()["solo12 contacts"]
    q, v, tau = (x.copy() for x in states("solo12 contacts")[0])
    q[3] = 1e200
    workspace = cp.Workspace(scene, solver)
    for call in (workspace.acceleration, workspace.solve):
        with pytest.raises(cp.InvalidArgument, match="unit quaternion"):
            call(q, v, tau)


@each_solver
def test_a_solver_says_what_it_is(solver):
    for field in ("title", "cost", "use", "takes_redundant"):
        assert getattr(solver, field) is not None
    assert type(solver).__doc__
    assert solver == type(solver)(), "decorate the solver with @dataclass(frozen=True)"
    assert hash(solver) == hash(type(solver)())
