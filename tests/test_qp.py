"""Quadratic programs: every solver, the polish, the chain, and what is said of contradictions."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from programs import largest_slack, random_program

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin.control import DAQP, QPS, AnyQP, ProxQP, Quadprog, QuadraticProgram
from condyn_pin.control.qp import qp_solver
from condyn_pin.control.qp.chain import SolverLadder
from condyn_pin.control.qp.qp_solver import QPResult, Saddle, elastic, polish, start_from_active_set

pytest.importorskip("proxsuite")
pytest.importorskip("daqp")
pytest.importorskip("quadprog")
pytest.importorskip("qpsolvers")

SOLVERS = [kind() for kind in QPS.values()]


def soft(program: QuadraticProgram):
    """Every inequality may give, and no equation."""
    return lambda: (np.full(len(program.b), np.inf), np.ones(len(program.lower)))


def any_row(program: QuadraticProgram):
    return lambda: (np.ones(len(program.b)), np.ones(len(program.lower)))


def test_a_program_by_hand():
    """min x^2 + y^2 - 4 x with x + y = 1 and x <= 1: (1, 0), y = 0, z = 2."""
    H, g = 2.0 * np.eye(2), np.array([-4.0, 0.0])
    A, b, C = np.ones((1, 2)), np.ones(1), np.array([[1.0, 0.0]])
    program = QuadraticProgram(H, g, A, b, C, np.array([-np.inf]), np.array([1.0]))
    for solver in SOLVERS:
        found = SolverLadder(solver).solve(program, soft(program))
        assert found.solved
        assert found.path == (repr(solver),)
        assert np.allclose(found.answer.x, [1.0, 0.0], atol=1e-12)
        assert np.allclose([found.answer.y[0], found.answer.z[0]], [0.0, 2.0], atol=1e-12)
        assert found.answer.at_upper.tolist() == [True]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_statuses_agree_with_highs_and_answers_are_proved(solver):
    rng = np.random.default_rng(1)
    seen = {True: 0, False: 0}
    for _ in range(150):
        program = random_program(rng)
        slack = largest_slack(program)
        if slack is not None and abs(slack) < 1e-5:
            continue  # at the edge, where tolerances decide
        found = SolverLadder(solver).solve(program, any_row(program))
        feasible = slack is not None and slack > 0
        seen[feasible] += 1
        assert found.solved == feasible
        assert (found.elastic is None) == feasible
        if feasible:
            assert found.answer.residual <= tolerances.KKT
            x = found.answer.x
            assert np.abs(program.A @ x - program.b).max(initial=0.0) <= 1e-9
            assert (program.C @ x <= program.upper + 1e-9).all()
            assert (program.C @ x >= program.lower - 1e-9).all()
    assert min(seen.values()) > 30


def test_solvers_agree():
    rng = np.random.default_rng(2)
    for _ in range(40):
        program = random_program(rng)
        answers = [SolverLadder(solver).solve(program, any_row(program)) for solver in SOLVERS]
        assert len({found.solved for found in answers}) == 1
        if answers[0].solved:
            first, *others = (found.answer.x for found in answers)
            size = 1.0 + np.abs(first).max()
            assert all(np.abs(first - x).max() < 1e-6 * size for x in others)


def test_the_last_active_set_answers_the_next_program():
    rng = np.random.default_rng(3)
    program = next(
        p for p in iter(lambda: random_program(rng), None) if (largest_slack(p) or 0) > 0.1
    )
    chain = SolverLadder(DAQP())
    chain.solve(program, soft(program))
    again = chain.solve(program, soft(program))
    assert again.path == ("last active set",)
    assert again.iterations == 0
    fresh = SolverLadder(DAQP()).solve(program, soft(program))
    assert np.abs(again.answer.x - fresh.answer.x).max() < 1e-12


def test_a_solver_that_says_infeasible_by_mistake_is_not_believed(monkeypatch):
    """ProxQP does, of programs of Cassie at 1e-9."""

    def liar(self):
        return lambda program: QPResult(
            np.zeros(len(program.g)), np.zeros(len(program.lower)), "infeasible", 1
        )

    for kind in (Quadprog, DAQP, ProxQP):
        monkeypatch.setattr(kind, "start", liar)
    rng = np.random.default_rng(4)
    solved = 0
    for _ in range(40):
        program = random_program(rng)
        slack = largest_slack(program)
        found = SolverLadder(Quadprog()).solve(program, any_row(program))
        if slack is not None and slack > 1e-5:
            assert found.elastic is None
            solved += found.solved
        elif slack is None or slack < -1e-5:
            assert found.elastic is not None
    assert solved > 5


@pytest.mark.long
def test_a_polish_takes_a_rough_answer_to_rounding():
    rng = np.random.default_rng(5)
    polished = 0
    for _ in range(60):
        program = random_program(rng)
        exact = SolverLadder(DAQP()).solve(program, any_row(program))
        if not exact.solved:
            continue
        noise = 1e-7 * rng.normal(size=len(program.g))
        rough = start_from_active_set(program, exact.answer.x + noise, exact.answer.z)
        found = polish(program, rough, 1e-12, 10, Saddle())
        assert found.residual <= 1e-9
        polished += 1
    assert polished > 15


def test_dependent_rows_have_an_answer():
    """Four corners of a sole as points: twelve rows, six of them again."""
    rng = np.random.default_rng(6)
    A = rng.normal(size=(3, 8))
    A = np.vstack((A, A[0] + A[1], A[2] - 2 * A[0]))
    b = A @ rng.normal(size=8)
    program = QuadraticProgram(
        np.eye(8), rng.normal(size=8), A, b, np.eye(8), np.full(8, -3.0), np.full(8, 3.0)
    )
    answers = [SolverLadder(solver).solve(program, soft(program)).answer for solver in SOLVERS]
    assert all(np.abs(program.A @ found.x - b).max() < 1e-12 for found in answers)
    assert all(np.abs(found.x - answers[0].x).max() < 1e-10 for found in answers)


@pytest.mark.long
def test_what_gives_and_what_stands_against_it():
    """x >= 1 and x <= -1, of which only the first may give: by 2."""
    C, none = np.ones((2, 1)), np.zeros((0, 1))
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    program = QuadraticProgram(np.eye(1), np.zeros(1), none, np.zeros(0), C, lower, upper)
    found = elastic(program, np.zeros(0), np.array([1.0, np.inf]))
    assert np.allclose(found.of_inequalities, [2.0, 0.0])
    assert found.against_inequalities[1] == pytest.approx(1.0)
    crossed = QuadraticProgram(
        np.eye(1), np.zeros(1), none, np.zeros(0), C[:1], np.array([1.0]), np.array([-1.0])
    )
    answer = SolverLadder(DAQP()).solve(crossed, soft(crossed))
    assert not answer.solved
    assert answer.elastic.of_inequalities[0] == pytest.approx(1.0)  # either bound by one


@pytest.mark.values
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize(
    ("lower", "upper", "verdict"),
    [
        (1.0, -2.0, "infeasible"),
        (1.0, 1.0 - 1e-9, "infeasible"),
        (np.inf, np.inf, "infeasible"),
        (-np.inf, -np.inf, "infeasible"),
        (np.nan, 1.0, "failed"),
        (-1.0, np.nan, "failed"),
    ],
)
def test_a_solver_alone_calls_nothing_solved_that_bounds_leave_no_value(
    solver, lower, upper, verdict
):
    """At work without a chain, cold, and warm from a program that it has just solved."""
    C, none = np.array([[1.0, 0.5], [0.2, -1.0]]), np.zeros((0, 2))

    def program(least: float, most: float) -> QuadraticProgram:
        bounds = np.array([least, -1.0]), np.array([most, 1.0])
        return QuadraticProgram(np.eye(2), np.array([1.0, -2.0]), none, np.zeros(0), C, *bounds)

    work = solver.start()
    assert work(program(lower, upper)).verdict == verdict
    first = work(program(-1.0, 1.0))
    assert first.verdict == "solved"
    assert work(program(lower, upper)).verdict == verdict
    again = work(program(-1.0, 1.0))
    assert again.verdict == "solved"
    assert again.x == pytest.approx(first.x, abs=1e-5)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_a_solver_alone_calls_no_answer_solved_that_is_not_finite(solver):
    C, none = np.array([[1.0, 0.5]]), np.zeros((0, 2))
    program = QuadraticProgram(
        np.eye(2), np.array([np.nan, 1.0]), none, np.zeros(0), C, -np.ones(1), np.ones(1)
    )
    assert solver.start()(program).verdict != "solved"


def test_a_missing_package_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "proxsuite", None)
    with pytest.raises(cp.errors.MissingExtra, match=r'pip install "condyn_pin\[control\]"'):
        SolverLadder(ProxQP())


def test_bad_parameters_are_refused():
    for wrong in ({"tolerance": -1.0}, {"tolerance": np.nan}, {"max_iterations": 0}):
        with pytest.raises(cp.InvalidArgument, match=next(iter(wrong))):
            ProxQP(**wrong)
        with pytest.raises(cp.InvalidArgument, match=next(iter(wrong))):
            DAQP(**wrong)
    with pytest.raises(cp.errors.UnknownName, match="no QP solver installed named 'gurobi2'"):
        AnyQP("gurobi2").start()
    assert ProxQP().rougher == ProxQP(tolerance=1e-4)
    assert "tolerance=0.0001," in repr(ProxQP().rougher)
    assert qp_solver.QPS["daqp"] is DAQP


@pytest.mark.long
@pytest.mark.parametrize("qp", [ProxQP(), DAQP(), Quadprog()], ids=repr)
def test_equations_are_independent_whatever_their_sizes(qp):
    """That of a rod that spins is 1e-7 of that of a force, and was taken for a contradiction."""
    A = np.array([[30.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 5e-7, 5e-7], [0.0, 0.0, 0.0]])
    b, C, one = A @ (0.5, 70.0, 30.0), np.eye(3)[1:2], np.ones(1)
    H = np.diag((1.0, 1e-5, 1e-5))  # what no task cares for
    program = QuadraticProgram(H, np.zeros(3), A, b, C, -one, 40.0 * one)
    found = SolverLadder(qp).solve(program, soft(program))
    assert found.solved
    assert found.path == (repr(qp),)
    assert found.answer.x == pytest.approx([0.5, 40.0, 60.0], rel=1e-9)
    other = b + np.array([1.0, 0.0, 0.0, 0.0])
    apart = QuadraticProgram(H, np.zeros(3), A, other, C, -one, one)
    assert not SolverLadder(qp).solve(apart, any_row(apart)).solved


def test_a_program_without_unknowns_is_a_question_of_its_bounds():
    none, rows = np.zeros((0, 0)), np.zeros((1, 0))
    for upper, fine in ((1.0, True), (-1.0, False)):
        program = QuadraticProgram(
            none, np.zeros(0), none, np.zeros(0), rows, np.array([-np.inf]), np.array([upper])
        )
        found = SolverLadder(DAQP()).solve(program, soft(program))
        assert found.solved == fine
        assert (found.elastic is None) == fine


@pytest.mark.long
def test_bounds_that_are_crossed_are_no_answer_of_the_last_active_set():
    """x <= 1 was active, and then x >= 2 is asked for too: no x, and x = 1 violates it by 1."""

    def asked(least: float) -> QuadraticProgram:
        none = np.zeros((0, 1)), np.zeros(0)
        bounds = np.array([least]), np.ones(1)
        return QuadraticProgram(np.eye(1), np.array([-3.0]), *none, np.eye(1), *bounds)

    chain = SolverLadder(ProxQP())
    first, crossed = asked(0.0), asked(2.0)
    found = chain.solve(first, soft(first))
    assert found.answer.x == pytest.approx([1.0])
    assert crossed.kkt_residual(np.ones(1), np.zeros(0), np.array([2.0])) == 1.0
    found = chain.solve(crossed, soft(crossed))
    assert not found.solved
    assert found.elastic.of_inequalities == pytest.approx([0.5])  # each bound gives a half


def test_a_budget_ends_the_search_and_is_named(monkeypatch):
    """Solvers that say nothing, after a hundred iterations each."""

    def silent(self):
        return lambda program: QPResult(
            np.full(len(program.g), np.nan), np.full(len(program.lower), np.nan), "failed", 100
        )

    for solver in (DAQP, ProxQP, Quadprog):
        monkeypatch.setattr(solver, "_start", silent)
    program = random_program(np.random.default_rng(3))
    tried = [
        SolverLadder(DAQP(budget=budget)).solve(program, any_row(program)) for budget in (1, 3, 100)
    ]
    assert [found.stopped for found in tried] == [True, True, False]
    assert [len(found.path) for found in tried[:2]] == [1, 2]
    assert tried[2].path[-1] == "elastic program"
    with pytest.raises(cp.InvalidArgument, match="budget"):
        SolverLadder(DAQP(budget=0))
