"""Hard contact problems: a status, and never one that is ok and wrong."""

from __future__ import annotations

import numpy as np
import pytest
from shared import HAS_LCABA
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin.contact import (
    ADMM,
    CONTACT_SOLVERS,
    PGS,
    ContactProblem,
    ContactSolver,
    SemismoothNewton,
    SolverResult,
    natural_residual,
)
from condyn_pin.errors import CondynError
from lab import CONTACT_EXTREMES, EXTREMES, Verdict, judge_contact
from lab.cli import app
from lab.extremes.stress import Memory, answers, asked, methods, stress, tasks
from lab.extremes.verdicts import Task, long_residual

each_family = pytest.mark.parametrize("name", CONTACT_EXTREMES)

# Those of a family whose Newton takes a minute: they are for `python benchmarks/lab stress`.
LARGE = {"stack": 5, "corners": 32}


def severities(name):
    return [s for s in CONTACT_EXTREMES[name].severities if s <= LARGE.get(name, np.inf)]


@pytest.mark.long
@each_family
def test_a_family_repeats_itself(name):
    family = CONTACT_EXTREMES[name]
    assert name not in EXTREMES
    assert family.title
    assert not family.title.endswith(".")
    assert len(set(family.severities)) == len(family.severities) > 4 or name.startswith("bad")
    one, same, other = (family.problem(family.severities[0], seed) for seed in (5, 5, 6))
    assert np.array_equal(one.g, same.g)
    assert np.array_equal(one.G, same.G)
    assert not np.array_equal(one.g, other.g)


@pytest.mark.once  # a contact solver sees G and g, and no model
@each_family
def test_nothing_is_wrong_unsaid(name):
    """Every solver at every severity but the largest: no defect, and no warning."""
    found = [
        answer
        for severity in severities(name)
        for answer in answers(
            Task(name, severity), asked(Task(name, severity), methods()), Memory()
        )
        if not isinstance(answer, str)
    ]
    defects = [answer for answer in found if answer.verdict.defect]
    assert defects == []


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    ["friction", "grazing", "corners", "painleve", "other_units", "other_speed"],
)
def test_the_default_solver_answers_all_that_has_an_answer(name):
    for severity in severities(name):
        verdict, error, said = judge_contact(CONTACT_EXTREMES[name].problem(severity), ADMM())
        assert verdict is Verdict.OK, (severity, said)
        assert error <= 1e-8


@pytest.mark.long
def test_contacts_that_give_way_have_an_answer_down_to_a_thousandth():
    """Pinocchio 3 has no convex law: Newton answers there, and less compliance is hard for it."""
    for severity in severities("compliance"):
        problem = CONTACT_EXTREMES["compliance"].problem(severity)
        verdict, error, said = judge_contact(problem, ADMM())
        if HAS_LCABA or severity >= 1e-3:
            assert verdict is Verdict.OK, (severity, said)
            assert error <= 1e-8
        assert not verdict.defect


@pytest.mark.long
def test_a_light_box_under_a_heavy_one_is_no_trouble_the_other_way_round():
    problem = CONTACT_EXTREMES["heavy_on_light"].problem
    for severity in (1e3, 1.0, 1e-6):
        assert judge_contact(problem(severity), ADMM())[0] is Verdict.OK


@pytest.mark.long
def test_what_nothing_moves_is_infeasible():
    verdict, _, said = judge_contact(CONTACT_EXTREMES["immovable"].problem(0.0), ADMM())
    assert (verdict, said) == (Verdict.SAID_SO, "infeasible")


def test_a_huge_impulse_hides_no_velocity():
    """PGS pushes 1e15 N s against what cannot move: beside that d is rounded away."""
    problem = CONTACT_EXTREMES["immovable"].problem(0.0)
    lam = np.zeros(problem.rows)
    lam[:3] = -2e15, -1.4e15, 5e15
    assert long_residual(problem, lam) > 0.1
    assert natural_residual(problem, lam) > 0.1


@pytest.mark.long
def test_fifty_digits_agree_where_doubles_do():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(9, 9))
    for law in ("ncp", "ccp"):
        problem = ContactProblem(
            G=root @ root.T, g=rng.normal(size=9), friction=[0.5, 1.5], half_lines=2,
            limits=[0.3], R=np.full(9, 0.1), law=law,
        )  # fmt: skip
        for lam in rng.normal(size=(20, 9)):
            wanted = natural_residual(problem, lam)
            assert long_residual(problem, lam) == pytest.approx(wanted, rel=1e-12)


def test_a_solver_that_lies_is_found_out():
    problem = CONTACT_EXTREMES["stack"].problem(1.0)  # which has one motion
    right = SemismoothNewton().attempt(problem).lam

    class Unsteady(ContactSolver):
        title, cost, use, calls = "unsteady", "", "", []

        def attempt(self, problem, guess=None):
            self.calls.append(1)
            return SolverResult(right * (1 + 1e-12 * len(self.calls)), 1, ("unsteady",))

    try:
        assert judge_contact(problem, Unsteady())[0] is Verdict.WRONG
    finally:
        del CONTACT_SOLVERS["unsteady"]


@pytest.mark.parametrize("size", [np.inf, np.nan])
@pytest.mark.parametrize("name", ["bad_g", "bad_G"])
def test_what_is_no_number_is_refused_by_name(name, size):
    with pytest.raises(CondynError, match=name[-1]):
        CONTACT_EXTREMES[name].problem(size)


@pytest.mark.long
def test_contact_problems_are_put_to_contact_solvers_only():
    of_contact, other = Task("painleve", 1.5), Task("mass_ratio", 1.0)
    assert asked(of_contact, methods()) == list(CONTACT_SOLVERS)
    assert asked(of_contact, ["proximal", "pgs"]) == ["pgs"]
    assert asked(other, ["proximal", "pgs"]) == ["proximal"]
    assert {task.family for task in tasks()} == set(EXTREMES)
    with pytest.raises(cp.errors.UnknownName, match="painleve"):
        tasks(["painlev"])


@pytest.mark.long
def test_stress_runs_them_in_a_process_of_their_own():
    found = stress(tasks(["painleve"])[:2], ["admm", "pgs"])
    assert [one.verdict for one in found] == [Verdict.OK] * 4
    assert {one.method for one in found} == {"admm", "pgs"}


@pytest.mark.long
def test_the_command_says_how_far_solvers_go(tmp_path):
    table = tmp_path / "stress.csv"
    said = CliRunner().invoke(
        app, ["stress", "--families", "grazing", "--solvers", "admm", "--csv", str(table)]
    )
    assert said.exit_code == 0
    assert "Share of its weight" in said.stdout
    assert "admm: right to" in said.stdout
    assert len(table.read_text().splitlines()) == 1 + len(CONTACT_EXTREMES["grazing"].severities)


def test_pgs_says_that_it_cannot_where_nothing_moves_along_the_floor():
    problem = CONTACT_EXTREMES["bad_G"].problem(0.0)
    solution = cp.contact.solve_contact(problem, PGS(), throw=False)
    assert solution.status.name == "INACCURATE"
    assert np.isfinite(solution.lam).all()
