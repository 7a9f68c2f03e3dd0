"""Contact solvers: every one on every problem, closed forms, and what cannot be answered."""

from __future__ import annotations

import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pinocchio as pin
import pytest
from contact_problems import (
    bodies,
    box,
    natural,
    on_a_rough_floor,
    random,
    rod,
    rolling_sole,
    solo12,
    touching,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import each_row

import condyn_pin as cp
from condyn_pin._core import _pin
from condyn_pin._core.tolerances import CONTACT_SOLVED
from condyn_pin.constraints import Box, Plane
from condyn_pin.contact import (
    ADMM,
    CONTACT_SOLVERS,
    PGS,
    SAP,
    ContactProblem,
    ContactStatus,
    Lemke,
    SemismoothNewton,
    solve_contact,
)
from condyn_pin.errors import InvalidArgument, SolveFailed, UnsupportedBackend

SOFT = np.full(12, 0.05)  # [1/kg]


def problems() -> dict[str, ContactProblem]:
    """Return problems that have an answer, by what they are."""
    one = random(5, cones=2, half_lines=2, intervals=2)
    return {
        "box at rest": box().problem,
        "box pushed, sticks": box(push=(3.0, 0.0, 0.0)).problem,
        "box slides": box(v=(1.0, 0.0, 0.0)).problem,
        "box pulled up": box(push=(0.0, 0.0, 30.0)).problem,
        "box on a slope, slides": box(slope=np.radians(30), mu=0.3).problem,
        "box on a slope, sticks": box(slope=np.radians(30), mu=0.58).problem,
        "box on ice": box(v=(1.0, 0.0, 0.0), mu=0.0).problem,
        "box, convex": box(v=(1.0, 0.0, 0.0), law="ccp").problem,
        "box, soft": box(v=(1.0, 0.0, 0.0), law="ccp", R=SOFT).problem,
        "solo12": solo12().problem,
        "solo12 slides": solo12(0.5).problem,
        "solo12 slides, convex": solo12(0.5, law="ccp").problem,
        "random": random(0),
        "random, no friction": random(1, mu=0.0),
        "random, friction 10": random(2, mu=10.0),
        "random, compliant": random(3, R=SOFT),
        "random, soft": random(3, R=SOFT, law="ccp"),
        "random, redundant": random(4, cones=8, joints=12),
        "random, stops": random(3, half_lines=3),
        "random, dry friction": random(4, cones=1, intervals=3),
        "stops alone": random(6, cones=0, half_lines=5),
        "random, everything": one,
        "everything, convex and soft": replace(one, law="ccp", R=np.full(10, 0.05)),
        "in tonnes": replace(random(0), G=1e-6 * random(0).G),
        "in grams": replace(random(0), G=1e6 * random(0).G),
        "in micrometres": replace(random(0), g=1e6 * random(0).g),
        "Painleve": rod(1.5, 1e-3),
        "nothing": ContactProblem(np.zeros((0, 0)), [], []),
    }


PROBLEMS = problems()

# What ADMM and Newton are for. The others answer what they can, and say where they cannot.
EXACT = (ADMM(), SemismoothNewton())


def takes(solver, problem) -> bool:
    """Return whether a solver is for problems of this kind."""
    if problem.law not in solver.laws or (isinstance(solver, SAP) and problem.R is None):
        return False
    return not isinstance(solver, PGS) or _pin.solves_contacts(True, len(problem.limits))


@pytest.mark.parametrize(
    ("name", "label"),
    [
        (name, label)
        for name, solver in CONTACT_SOLVERS.items()
        for label, problem in PROBLEMS.items()
        if takes(solver(), problem)
    ],
)
def test_contract(name, label):
    problem, solver = PROBLEMS[label], CONTACT_SOLVERS[name]()
    G, g = problem.G.copy(), problem.g.copy()
    found = solve_contact(problem, solver, throw=False)
    again = solve_contact(problem, solver, throw=False)
    assert np.array_equal(found.lam, again.lam)
    assert np.array_equal(problem.G, G)
    assert np.array_equal(problem.g, g)
    assert found.lam.shape == found.sigma.shape == problem.g.shape
    assert not found.lam.flags.writeable
    assert list(found.forces) == list(problem.names)
    assert str(found).startswith(found.status.name.lower())
    if problem.rows:
        assert found.path[0] in (solver.title, "Newton", "sticking")
        assert natural(problem, found.lam) == pytest.approx(found.residuals.natural, abs=1e-14)
    if found.status.ok:
        assert found.residuals.natural <= CONTACT_SOLVED
        assert np.isfinite(found.lam).all()
    else:
        assert name in ("pgs", "lemke"), found


@pytest.mark.parametrize("label", PROBLEMS)
def test_motion_is_that_of_newton(label):
    """What impulses do to the contacts is theirs, whoever answers, but where several slide."""
    problem = PROBLEMS[label]
    sigma = solve_contact(problem, SemismoothNewton(), accuracy=1e-10).sigma
    for name in CONTACT_SOLVERS:
        solver = CONTACT_SOLVERS[name]()
        if takes(solver, problem):
            found = solve_contact(problem, solver, throw=False)
            if found.status.ok and (found.unique_forces or "box" in label):
                size = np.abs(problem.g).max(initial=0.0)
                assert np.abs(found.sigma - sigma).max(initial=0.0) <= 1e-6 * size


@pytest.mark.values
@pytest.mark.parametrize("solver", [ADMM(), PGS(), SemismoothNewton(), Lemke()], ids=repr)
@pytest.mark.parametrize(
    ("case", "v"),
    [
        ({"push": (3.0, 0.0, 0.0)}, (0.0, 0.0, 0.0)),
        ({"v": (1.0, 0.0, 0.0)}, (0.95095, 0.0, 0.0)),
        ({"push": (8.0, 0.0, 0.0)}, (0.03095, 0.0, 0.0)),
        ({"v": (0.0, 0.0, 1.0)}, (0.0, 0.0, 0.9019)),
        ({"slope": np.radians(30), "mu": 0.3}, (2.35629e-2, 0.0, 0.0)),
        ({"slope": np.radians(30), "mu": 0.58}, (0.0, 0.0, 0.0)),
    ],
    ids=["sticks", "slides", "starts", "lifts", "slope", "slope, sticks"],
)
def test_box_on_four_corners(solver, case, v):
    case = box(**case)
    found = solve_contact(case.problem, solver)
    after = case.after(found.lam)
    assert after[:3] == pytest.approx(v, abs=5e-8)
    assert np.abs(after[3:]).max() < 1e-6
    assert not found.unique_forces


@pytest.mark.long
def test_a_box_slides_the_way_that_it_goes_and_along_polygons_it_does_not():
    case = box(v=(np.cos(0.3), np.sin(0.3), 0.0))
    for solver in (*EXACT, PGS()):
        after = case.after(solve_contact(case.problem, solver).lam)
        assert after[:2] == pytest.approx([0.908477, 0.281025], abs=5e-7)
    polygon = solve_contact(case.problem, Lemke(sides=8), throw=False)
    assert polygon.status is ContactStatus.INACCURATE
    assert case.after(polygon.lam)[:2] == pytest.approx([0.906286, 0.29552], abs=5e-6)
    # the finer the polygon, the nearer: friction is off the slip by half a side at most
    for sides in (4, 8, 16, 64, 256):
        polygon = solve_contact(case.problem, Lemke(sides), throw=False)
        assert polygon.residuals.natural < 0.15 * np.pi / sides
        assert case.after(polygon.lam)[1] == pytest.approx(0.281025, abs=0.06 * np.pi / sides)


def test_anitescu_lifts_what_slides():
    """sigma_n = mu v_t / (1 + mu^2) of the convex law, and forces far above the weight."""
    case = box(v=(1.0, 0.0, 0.0), law="ccp")
    for solver in EXACT:
        found = solve_contact(case.problem, solver)
        after = case.after(found.lam)
        free = case.v_free
        # of the point that the box is: v+ = v_free projected along (mu, 0, 1)
        slip = (free[0] + 0.5 * free[2]) / 1.25
        assert after[0] == pytest.approx(slip, abs=1e-7)
        assert after[2] == pytest.approx(0.5 * slip, abs=1e-7)
        assert found.residuals.uplift == pytest.approx(0.5 * slip / 1.0, rel=1e-6)
    # with the weight carried already, g_n = 0: .38038 of .95095
    problem = ContactProblem(np.eye(3), [0.95095, 0.0, 0.0], [0.5], law="ccp")
    assert solve_contact(problem).sigma[2] == pytest.approx(0.38038, abs=1e-7)


@pytest.mark.long
def test_solo12_shares_its_weight():
    case = solo12()
    for solver in (*EXACT, PGS(), Lemke()):
        found = solve_contact(case.problem, solver)
        assert found.unique_forces
        assert found.lam[2::3] / 1e-3 == pytest.approx(np.full(4, 6.131), abs=5e-4)
        assert np.abs(case.after(found.lam)).max() < 1e-8


@pytest.mark.values
@pytest.mark.parametrize("solver", [ADMM(), PGS(), SemismoothNewton(), Lemke()], ids=repr)
@pytest.mark.parametrize(
    ("dt", "impulse"),
    [
        (1e-2, (0.4294, 0.3834)),
        (1e-3, (0.4029, 0.3083)),
        (1e-4, (0.4003, 0.3008)),
        (1e-5, (0.4000, 0.3001)),
    ],
)
def test_painleves_rod_is_stopped_by_an_impulse(solver, dt, impulse):
    found = solve_contact(rod(1.5, dt), solver)
    assert found.lam[[0, 2]] == pytest.approx(impulse, abs=5e-5)
    assert np.abs(found.sigma).max() < 1e-8  # it sticks


@pytest.mark.long
def test_newton_names_the_polygon_that_it_began_with():
    assert solve_contact(rod(1.5, 1e-3), SemismoothNewton()).path == ("Newton", "Lemke", "Newton")


@pytest.mark.values
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("solver", EXACT, ids=repr)
def test_large_friction_and_redundant_contacts(seed, solver):
    assert solve_contact(random(seed, mu=10.0), solver).status.ok
    assert solve_contact(random(seed, cones=8, joints=12, mu=3.0), solver).status.ok


@pytest.mark.parametrize("solver", [ADMM(), SemismoothNewton()], ids=repr)
@pytest.mark.parametrize("seed", [486, 1966, 2441, 2690, 3401, 3730, 3801])
def test_masses_and_friction_wide_apart(seed, solver):
    """Polygons that follow the slips, and units of each contact: none was answered in a second."""
    problem = bodies(seed)
    assert natural(problem, solve_contact(problem, solver).lam) < 1e-8


@pytest.mark.long
@pytest.mark.parametrize("solver", [ADMM(), SemismoothNewton()], ids=repr)
@pytest.mark.parametrize("seed", [64, 179, 215, 309, 486])
def test_convex_problems_with_masses_and_friction_wide_apart(seed, solver):
    problem = bodies(seed, law="ccp")
    assert natural(problem, solve_contact(problem, solver).lam) < 1e-8


@pytest.mark.long
def test_what_hardly_moves_is_still():
    """Relative to 1e-313 m/s nothing is a number."""
    whole = random(5, cones=2, half_lines=2, intervals=2)
    small = replace(whole, g=whole.g * 1e-313)
    for solver in EXACT:
        found = solve_contact(small, solver)
        assert np.abs(found.sigma).max() < 1e-300


@pytest.mark.long
def test_rounding_proves_nothing_infeasible():
    """Bodies that stop do not go through each other."""
    found = solve_contact(bodies(517, law="ccp"), throw=False)
    assert found.status is not ContactStatus.INFEASIBLE


@pytest.mark.long
def test_polish_ends_at_rounding():
    problem = PROBLEMS["solo12 slides"]
    rough, fine = (solve_contact(problem, ADMM(polish=polish)) for polish in (False, True))
    assert fine.residuals.natural < 1e-14 < rough.residuals.natural
    assert fine.path == ("ADMM", "Newton")


@pytest.mark.parametrize(
    "problem",
    [
        solo12().problem,
        solo12(law="ccp", R=SOFT).problem,
        box(push=(2.0, 0.0, 0.0)).problem,
        box(push=(0.0, 0.0, 30.0)).problem,
        ContactProblem(np.eye(3) + 0.1, [-1.0, 0.2, 0.3], [], 2, [5.0]),
    ],
    ids=["solo12", "soft", "box, redundant", "box flies", "stops and dry friction"],
)
def test_what_does_not_slide_is_answered_at_once_and_to_rounding(problem):
    found = solve_contact(problem, ADMM())
    assert found.path == ("sticking",)
    assert found.iterations == 1
    assert natural(problem, found.lam) < 1e-14


@pytest.mark.long
def test_no_impulse_where_all_contacts_leave():
    """Where friction couples to the normal, one that sticks would answer as well."""
    problem = ContactProblem([[1, 0, -1.9], [0, 1, 0], [-1.9, 0, 4]], [-1.0, 0.0, 0.1], [3.0])
    assert not solve_contact(problem, ADMM()).lam.any()


@pytest.mark.long
def test_newton_is_exact():
    for label in ("box slides", "solo12", "solo12 slides", "random, everything"):
        problem = PROBLEMS[label]
        assert solve_contact(problem, SemismoothNewton()).residuals.natural < 1e-14


@pytest.mark.long
def test_admm_falls_back_when_it_has_no_iterations():
    found = solve_contact(PROBLEMS["solo12 slides"], ADMM(max_iterations=1))
    assert found.status.ok
    assert found.path[:2] == ("ADMM", "Newton")


@pytest.mark.long
@pytest.mark.skipif(not _pin.HAS_ANDERSON, reason="Pinocchio 3 starts again")
def test_a_guess_saves_iterations():
    problem = PROBLEMS["solo12 slides"]
    cold = solve_contact(problem)
    warm = solve_contact(problem, guess=cold.lam)
    assert warm.iterations < cold.iterations
    assert solve_contact(problem, PGS(), guess=cold.lam).iterations < 10


@pytest.mark.long
def test_same_bits_whatever_was_solved_before():
    first = solve_contact(PROBLEMS["solo12 slides"])
    for label in PROBLEMS:
        solve_contact(PROBLEMS[label], throw=False)
    assert np.array_equal(solve_contact(PROBLEMS["solo12 slides"]).lam, first.lam)


@pytest.mark.long
def test_same_bits_from_many_threads():
    asked = [PROBLEMS["solo12 slides"], PROBLEMS["box slides"], PROBLEMS["random, stops"]] * 10
    alone = [solve_contact(problem).lam for problem in asked]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda problem: solve_contact(problem).lam, asked))
    assert all(np.array_equal(x, y) for x, y in zip(alone, together, strict=True))


@pytest.mark.long
def test_gauss_seidel_after_admm_is_not_damped():
    problem = PROBLEMS["solo12"]
    alone = solve_contact(problem, PGS()).lam
    solve_contact(problem, ADMM())
    assert np.array_equal(solve_contact(problem, PGS()).lam, alone)


def test_gauss_seidel_knows_what_it_may_ask_of_a_contact():
    """A mass that differs by 2.5 along t1 and t2: it never ends with 1, and does below 0.8."""
    G = np.diag([1.0, 2.5, 1.0])
    problem = ContactProblem(G, [0.1, 0.2, -1.0], [0.5], names=["foot"])
    with pytest.raises(InvalidArgument, match=r"over_relaxation = 1: foot needs less than 0\.8"):
        solve_contact(problem, PGS(over_relaxation=1.0))
    assert solve_contact(problem, PGS()).status.ok
    assert solve_contact(problem, PGS(over_relaxation=0.7)).status.ok


@pytest.mark.long
@pytest.mark.parametrize("solver", [ADMM(), PGS(), SemismoothNewton()])
def test_a_sole_that_rolls_over_its_edge(solver):
    """Neither Newton nor polygons lead there, one contact after the other does."""
    problem = rolling_sole()
    found = solve_contact(problem, solver)
    assert natural(problem, found.lam) < CONTACT_SOLVED


@pytest.mark.long
def test_lemke_ends_on_ties():
    """Many equal corners of a box without friction: every ratio is tied."""
    G = np.ones((30, 30))
    problem = ContactProblem(G, -np.ones(30), [], half_lines=30)
    assert solve_contact(problem, Lemke()).lam.sum() == pytest.approx(1.0)


def redundant_boxes(seed: int) -> ContactProblem:
    """Return boxes on up to eight equal corners each, stacked or not, asked to close odd gaps."""
    rng = np.random.default_rng(seed)
    boxes, corners = rng.integers(1, 4), rng.integers(2, 9)
    J = np.zeros((3 * boxes * corners, 6 * boxes))
    for row in range(0, len(J), 3):
        i = row // (3 * corners)
        p, below = (rng.choice([-1.0, 1.0], 3) * (0.1, 0.2, 0.05) for _ in range(2))
        J[row : row + 3, 6 * i : 6 * i + 6] = np.hstack([np.eye(3), -pin.skew(p)])
        if i:
            J[row : row + 3, 6 * i - 6 : 6 * i] = -np.hstack([np.eye(3), -pin.skew(below)])
    M = np.diag(np.repeat(10 ** rng.uniform(-2, 2, boxes), 6))
    gaps = rng.choice([0.0, 1e-9, 1e-6]) * rng.uniform(size=len(J))
    mu = rng.choice([0.0, 0.3, 1.0, 100.0])
    problem = touching(J, M, rng.normal(size=6 * boxes), np.full(len(J) // 3, mu)).problem
    return replace(problem, g=problem.g + gaps)


@pytest.mark.parametrize("sides", [4, 8, 16])
def test_lemke_answers_redundant_polygons_on_any_processor(sides):
    """The most dissipation of a polygon, l_t . s_t = -mu l_n max(-d . s_t), and pivots that end."""
    angles = 2 * np.pi * np.arange(sides) / sides
    c, s = np.cos(np.pi / sides), np.sin(np.pi / sides)
    D = np.column_stack([np.cos(angles), np.sin(angles)])
    outward = D @ [[c, s], [-s, c]]  # normals of the sides, halfway between corners
    for seed in range(100):
        problem = redundant_boxes(seed)
        found = Lemke(sides).attempt(problem)
        assert found.answered
        assert found.iterations < 20 * problem.rows
        (stiff, speed), mu = problem.scale, problem.friction
        L = found.lam.reshape(-1, 3) * stiff / speed
        S = problem.velocities(found.lam).reshape(-1, 3) / speed
        small = 1e-7 * max(1.0, np.abs(L).max(), mu.max())
        assert np.minimum(L[:, 2], S[:, 2]).min() > -small
        assert (L[:, :2] @ outward.T - mu[:, None] * c * L[:, 2:]).max() < small
        assert (L[:, 2] * S[:, 2]).max() < small
        slip = (-S[:, :2] @ D.T).max(axis=1)
        assert np.abs((L[:, :2] * S[:, :2]).sum(axis=1) + mu * L[:, 2] * slip).max() < small


@pytest.mark.long
def test_polygons_without_an_answer_are_no_nan():
    """What is nearest to one comes back, and says that it is none."""
    G = np.zeros((6, 6))
    G[:3, :3] = np.eye(3)
    problem = ContactProblem(G, [0, 0, -1, 0, 0, -1], [0.5, 0.5])
    found = Lemke().attempt(problem)
    assert not found.answered
    assert np.isfinite(found.lam).all()


def plate(points: int, rough: float = 0.0, **fields) -> ContactProblem:
    """Return a plate that slides and turns on many points, in gaps of up to `rough` [m/s]."""
    rng = np.random.default_rng(0)
    P = np.column_stack([rng.uniform(-1, 1, (points, 2)), np.full(points, -0.05)])
    J = np.vstack([np.hstack([np.eye(3), -pin.skew(p)]) for p in P])
    v = np.array([0.5, 0.2, -1e-2, 0.0, 0.0, 1.0])
    problem = touching(J, np.diag([1, 1, 1, 0.3, 0.3, 0.6]), v, np.full(points, 0.5)).problem
    g = problem.g + np.where(np.arange(problem.rows) % 3 == 2, rough * rng.uniform(size=len(J)), 0)
    return problem.replaced(g=g, **fields)


@pytest.mark.parametrize("solver", EXACT, ids=repr)
@pytest.mark.parametrize(
    "problem",
    [
        plate(60),
        plate(200),
        plate(200, rough=1e-6),
        plate(200, rough=1e-3),
        plate(80, rough=0.1),
        plate(80, law="ccp"),
        plate(80, rough=1e-3, law="ccp"),
        plate(80, R=np.full(240, 1e-3), law="ccp"),
    ],
    ids=["60", "200", "micrometres", "millimetres", "decimetres", "convex", "convex gaps", "soft"],
)
def test_hundreds_of_points_below_a_plate(solver, problem):
    found = solve_contact(problem, solver)
    assert natural(problem, found.lam) <= 1.01 * CONTACT_SOLVED
    assert "Lemke" not in found.path  # whose pivots are on thousands of rows


@pytest.mark.parametrize("solver", EXACT, ids=repr)
@pytest.mark.parametrize("seed", range(3))
def test_a_tower_of_boxes_that_slide_on_each_other(seed, solver):
    """What joins them is redundant; ADMM finds it, and Newton begins there."""
    rng = np.random.default_rng(seed)
    corners = np.array([(x, y, 0.05) for x in (0.1, -0.1) for y in (0.1, -0.1)])
    rows = []
    for i in range(16):
        for p in corners:
            J = np.zeros((3, 96))
            J[:, 6 * i : 6 * i + 6] = np.hstack([np.eye(3), pin.skew(p)])
            if i:
                J[:, 6 * i - 6 : 6 * i] = -np.hstack([np.eye(3), -pin.skew(p)])
            rows.append(J)
    v = 0.3 * rng.normal(size=(16, 6)) * (1, 1, 0, 0, 0, 1) - np.array([0, 0, 1e-2, 0, 0, 0])
    M = np.diag(np.tile([1, 1, 1, 4e-3, 4e-3, 7e-3], 16))
    problem = touching(np.vstack(rows), M, v.ravel(), np.full(64, 0.5)).problem
    found = solve_contact(problem, solver)
    assert natural(problem, found.lam) <= 1.01 * CONTACT_SOLVED
    assert set(found.path) <= {"ADMM", "Newton", "equal compliance"}


@pytest.mark.long
@pytest.mark.parametrize("R", [0.2, 0.05, 0.01, 1e-3, 1e-6])
def test_sap_finds_what_newton_finds(R):
    for seed in range(5):
        problem = random(seed, half_lines=2, intervals=2, R=np.full(16, R), law="ccp")
        sap, newton = (solve_contact(problem, solver) for solver in (SAP(), SemismoothNewton()))
        assert sap.natural < 1e-14 / R
        assert np.abs(sap.lam - newton.lam).max() < max(1e-12 / R, 1e-9) * np.abs(newton.lam).max()


def test_sap_with_few_steps_goes_by_way_of_softer_problems():
    problem = random(1, cones=8, joints=12, R=np.full(24, 1e-6), law="ccp")
    found = solve_contact(problem, SAP(max_iterations=12))
    assert found.status.ok
    assert found.iterations > 12
    assert found.path == ("SAP",)


def test_sap_takes_compliance_below_the_rounding_of_g():
    """Two contacts in one place: 1 + G / R is G / R, which is singular in every digit."""
    G, g = np.kron(np.ones((2, 2)), np.eye(3)), np.tile([0.1, 0.0, -1.0], 2)
    problem = ContactProblem(G, g, [0.5, 0.5], R=np.full(6, 1e-17), law="ccp")
    found = solve_contact(problem, SAP(), throw=False)
    assert found.status.ok == (found.natural <= CONTACT_SOLVED)


@each_row("name", ["admm", "pgs", "semismoothnewton", "lemke"])
def test_what_no_impulse_can_do_is_said_by_name(name):
    G = np.zeros((6, 6))
    G[:3, :3] = np.eye(3)
    problem = ContactProblem(G, [0, 0, -1, 0, 0, -1], [0.5, 0.5], names=["floor", "wall"])
    with pytest.raises(SolveFailed, match="no impulse can meet wall") as caught:
        solve_contact(problem, CONTACT_SOLVERS[name]())
    assert caught.value.solution.status is ContactStatus.INFEASIBLE
    assert caught.value.solution.unmet == ("wall",)


@pytest.mark.long
def test_a_body_between_two_walls_that_close():
    J = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0.0]])
    closing = ContactProblem(J @ J.T, [0, 0, -0.1, 0, 0, -0.2], [0.5, 0.5], names=["l", "r"])
    found = solve_contact(closing, throw=False)
    assert (found.status, found.unmet) == (ContactStatus.INFEASIBLE, ("l", "r"))
    assert found.iterations < 10_000  # and not millions: the proof says that all are in vain
    opening = replace(closing, g=[0, 0, -0.1, 0, 0, 0.2])
    assert solve_contact(opening).status.ok


def test_an_ncp_may_slide_where_a_ccp_has_no_answer():
    """z on the surface of K with G z = 0 and g.z < 0: a proof for the one, none for the other."""
    z = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    G = np.eye(3) - np.outer(z, z)
    ncp = ContactProblem(G, [-1.0, 0.0, 0.0], [1.0])
    assert solve_contact(ncp, SemismoothNewton()).status.ok
    proved = solve_contact(replace(ncp, law="ccp"), throw=False)
    assert proved.status is ContactStatus.INFEASIBLE
    assert proved.iterations < 10_000


def test_friction_that_locks_is_named():
    """With u = l_t - l_n, to stick takes u = 2, to part u <= -0.2, and to slide u = l_n."""
    z = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    problem = ContactProblem(np.eye(3) - np.outer(z, z), [-1.0, 0.0, -0.1], [2.0], names=["jaw"])
    for solver in EXACT:
        found = solve_contact(problem, solver, throw=False)
        assert found.status in (ContactStatus.INACCURATE, ContactStatus.OUT_OF_BUDGET)
        assert "friction locks jaw" in found.notices[0]
    less = replace(problem, friction=[0.9])
    assert solve_contact(less, SemismoothNewton()).status.ok


def test_nothing_that_is_not_finite_is_ok():
    """Also of problems that nothing was checked of."""
    problem = random(0)
    for change in (
        {"g": np.full(12, np.nan)},
        {"G": np.full((12, 12), np.nan)},
        {"g": np.full(12, -1e308)},
        {"G": np.full((12, 12), 1e308)},
        {"G": 1e-310 * np.eye(12)},
        {"friction": np.full(4, np.inf)},
    ):
        bad = problem.replaced(**change)
        for name in ("admm", "pgs", "semismoothnewton", "lemke"):
            found = solve_contact(bad, CONTACT_SOLVERS[name](), throw=False)
            assert found.status in (ContactStatus.NOT_FINITE, ContactStatus.INACCURATE), change


@pytest.mark.long
@pytest.mark.parametrize("friction", [100.0, 300.0, 1000.0])
@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_feet_on_a_rough_floor_stick_at_once(name, friction):
    """Those that close, as if they were held."""
    problem = cp.stepping.contact_problem(*on_a_rough_floor(name, friction), dt=1e-3)
    found, held = solve_contact(problem), np.zeros(problem.rows)
    closing = np.flatnonzero(np.repeat(problem.g[2::3] < 0, 3))
    G = problem.G[closing[:, None], closing]
    held[closing] = np.linalg.pinv(G, rcond=1e-9) @ -problem.g[closing]
    assert found.iterations == 1
    assert found.sigma == pytest.approx(problem.velocities(held), abs=1e-9 * problem.scale[1])


@pytest.mark.long
def test_velocities_whose_squares_vanish_are_rest():
    """1e-310 m/s is met by no impulse to within itself; nothing of it overflows."""
    problem = random(0).replaced(g=np.full(12, -1e-310))
    for name in ("admm", "pgs", "semismoothnewton", "lemke"):
        found = solve_contact(problem, CONTACT_SOLVERS[name](), throw=False)
        assert np.abs(found.lam).max() <= 1e-300, name
        assert found.status.ok or found.status is ContactStatus.INACCURATE, name


@each_row(
    ("change", "said"),
    [
        ({"g": [0, np.nan, 0]}, r"g\[1\] = nan"),
        ({"g": [0, 0]}, "shape"),
        ({"G": [[1, 0, 0], [1, 1, 0], [0, 0, 1]]}, "differs from its transpose"),
        ({"G": np.full((3, 3), np.inf)}, "finite"),
        ({"friction": [-0.5]}, r"friction\[0\] = -0.5"),
        ({"friction": [0.5, 0.5]}, "g has 3 rows"),
        ({"half_lines": 1}, "g has 3 rows"),
        ({"half_lines": -1}, "g has 3 rows"),
        ({"half_lines": True}, "a count"),
        ({"limits": [-1]}, "limits"),
        ({"R": [1, 1]}, "R: 2 numbers"),
        ({"g": [0, 0, -1e60]}, "g: 1e.60 is in it"),
        ({"friction": [1e60]}, "friction: 1e.60 is in it, and 1000 is the most"),
        ({"law": "lcp"}, "law"),
        ({"level": "position"}, "level"),
        ({"names": ["a", "b"]}, "names"),
    ],
)
def test_bad_problems(change, said):
    with pytest.raises(InvalidArgument, match=said):
        ContactProblem(**{"G": np.eye(3), "g": np.zeros(3), "friction": [0.5], **change})


@pytest.mark.long
def test_a_problem_keeps_copies():
    g = np.zeros(3)
    problem = ContactProblem(np.eye(3), g, [0.5])
    g[2] = -1.0
    assert problem.g[2] == 0.0
    for array in (problem.G, problem.g, problem.friction, problem.limits):
        assert not array.flags.writeable


def test_bad_solvers_and_arguments():
    problem = PROBLEMS["solo12"]
    for make in (
        lambda: Lemke(sides=7),
        lambda: Lemke(sides=2),
        lambda: ADMM(anderson=-1),
        lambda: ADMM(max_iterations=0),
        lambda: ADMM(tolerance=np.nan),
        lambda: PGS(over_relaxation=0.0),
        lambda: SemismoothNewton(max_iterations=0),
        lambda: solve_contact(problem, guess=np.zeros(3)),
        lambda: solve_contact(problem, guess=np.full(12, np.nan)),
        lambda: solve_contact(problem, accuracy=0.0),
        lambda: solve_contact(replace(problem, law="ccp"), PGS()),
        lambda: solve_contact(problem, SAP()),
        lambda: solve_contact(replace(problem, law="ccp"), SAP()),
        lambda: solve_contact(replace(problem, law="ccp", R=np.arange(1.0, 13.0)), SAP()),
    ):
        with pytest.raises(InvalidArgument):
            make()


@pytest.mark.long
@pytest.mark.skipif(_pin.solves_contacts(True, 1), reason="Pinocchio 4 takes it")
def test_gauss_seidel_of_pinocchio_3_has_no_intervals():
    with pytest.raises(UnsupportedBackend, match="SemismoothNewton"):
        solve_contact(PROBLEMS["random, everything"], PGS())


@pytest.mark.long
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 50), heavier=st.integers(-20, 20), faster=st.integers(-20, 20))
def test_units_that_are_powers_of_two_change_no_digit(seed, heavier, faster):
    problem = random(seed)
    a, b = 2.0**heavier, 2.0**faster
    other = replace(problem, G=problem.G * a, g=problem.g * b)
    for solver in (*EXACT, Lemke()):
        one, two = (solve_contact(each, solver, throw=False) for each in (problem, other))
        assert np.array_equal(one.lam * (b / a), two.lam)
        assert one.iterations == two.iterations


@pytest.mark.long
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 50), heavier=st.floats(-6, 6), faster=st.floats(-6, 6))
def test_units_do_not_matter(seed, heavier, faster):
    problem = random(seed, half_lines=1, intervals=1)
    a, b = 10.0**heavier, 10.0**faster
    other = replace(problem, G=problem.G * a, g=problem.g * b, limits=problem.limits * (b / a))
    one, two = (solve_contact(each, SemismoothNewton()).lam for each in (problem, other))
    assert np.abs(one * (b / a) - two).max() < 1e-9 * np.abs(two).max()


def test_islands_are_solved_apart():
    parts = [solo12(0.5).problem, box().problem, random(7, cones=0, half_lines=3)]
    m = [part.rows for part in parts]
    G = np.zeros((sum(m), sum(m)))
    for part, start in zip(parts, np.cumsum([0, *m]), strict=False):
        G[start : start + part.rows, start : start + part.rows] = part.G
    together = ContactProblem(
        G,
        np.concatenate([part.g for part in parts]),
        np.concatenate([part.friction for part in parts]),
        half_lines=3,
        names=[f"{i}" for i in range(11)],
    )
    whole = solve_contact(together, SemismoothNewton())
    alone = [solve_contact(part, SemismoothNewton()) for part in parts]
    assert np.array_equal(whole.lam[:24], np.concatenate([part.lam for part in alone[:2]]))
    assert whole.iterations >= sum(part.iterations for part in alone[:2])
    assert whole.path == ("Newton",)
    assert solve_contact(together).status.ok


def test_a_solution_says_what_it_is():
    found = solve_contact(replace(PROBLEMS["random, everything"], names=list("abcdef")))
    assert list(found.forces) == list("abcdef")
    assert [force.size for force in found.forces.values()] == [3, 3, 1, 1, 1, 1]
    assert np.array_equal(np.concatenate(list(found.forces.values())), found.lam)
    text = str(found)
    assert text.startswith("ok in ")
    for word in ("natural", "uplift", "axes of each contact [N s]", "f  "):
        assert word in text
    assert "ContactSolution(6 contacts: ok" in repr(found)
    sliding = solve_contact(PROBLEMS["box slides"])
    assert sliding.notices == ("the contacts are redundant: lam is one of many",)
    assert solve_contact(PROBLEMS["solo12"]).notices == ()


@pytest.mark.long
@pytest.mark.parametrize("solver", [Lemke(), PGS()], ids=lambda solver: solver.title)
def test_an_error_says_which_accuracy_would_pass(solver):
    problem = PROBLEMS["solo12 slides"]
    if not takes(solver, problem):
        pytest.skip("not its problem")
    with pytest.raises(SolveFailed, match=r"solve with SemismoothNewton\(\)") as caught:
        solve_contact(problem, solver, accuracy=1e-14)
    enough = float(re.search(r"accuracy=(\S+) would pass", str(caught.value))[1])
    assert solve_contact(problem, solver, accuracy=enough).status.ok
    assert not solve_contact(problem, solver, accuracy=enough / 10, throw=False).status.ok


def test_newton_that_has_failed_is_not_advised():
    for status in (ContactStatus.INACCURATE, ContactStatus.NOT_FINITE):
        assert "SemismoothNewton" in status.text("ADMM")
        assert "SemismoothNewton" not in status.text("SemismoothNewton")


def test_a_failed_solve_survives_a_pickle():
    problem = ContactProblem(np.zeros((3, 3)), [0, 0, -1], [0.5], names=["wall"])
    with pytest.raises(SolveFailed) as caught:
        solve_contact(problem)
    back = pickle.loads(pickle.dumps(caught.value))
    assert back.solution.unmet == ("wall",)


def foot_in_the_floor() -> ContactProblem:
    """Return a pendulum with its foot 10 cm in the floor: friction locks it, nothing answers."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hip")
    middle, tip = (pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-0.15, -0.3))
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.1, 0.1, 0.3), middle)
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.BODY))
    foot = cp.FrictionalContact(
        "tip", Box(0.1, 0.1, 0.05), friction=3.0, on=Plane(height=-0.3), name="foot"
    )
    scene = cp.Scene(cp.Robot("leg", model), contacts=[foot])
    return cp.stepping.contact_problem(scene, np.array([0.6]), np.ones(1), dt=1e-3)


@pytest.mark.parametrize("solver", [ADMM, SemismoothNewton])
def test_a_budget_ends_the_search_and_is_named(solver):
    problem, tried = foot_in_the_floor(), []
    for budget in (1, 30, 100):
        found = solve_contact(problem, solver(budget=budget), throw=False)
        tried.append(found)
        assert found.status is ContactStatus.OUT_OF_BUDGET
        # one ordinary solve is 500 iterations at most, and the last method ends its step
        assert found.iterations <= 500 * (budget + 10)
    assert [found.iterations for found in tried] == sorted({found.iterations for found in tried})
    assert min(found.natural for found in tried) == tried[-1].natural
    with pytest.raises(SolveFailed, match=rf"out_of_budget.*{solver.__name__}\(budget=1000\)"):
        solve_contact(problem, solver())
    with pytest.raises(InvalidArgument, match="budget"):
        solver(budget=0)
    assert [each.name for each in fields(solver)][-1] == "budget"  # the others are by place too


@pytest.mark.long
@pytest.mark.parametrize("label", ["box slides", "solo12 slides", "random, everything"])
def test_what_is_answered_needs_no_budget(label):
    for solver in (ADMM, SemismoothNewton):
        one, usual = (solve_contact(PROBLEMS[label], s) for s in (solver(budget=1), solver()))
        np.testing.assert_array_equal(one.lam, usual.lam)


@pytest.mark.long
def test_line_searches_of_sap_end_at_rounding():
    """A step that is right but for rounding is taken, and not halved until nothing is left."""
    problem = foot_in_the_floor().replaced(law="ccp")
    problem = problem.replaced(R=np.full(problem.rows, 1e-5 * problem.scale[0]))
    found = solve_contact(problem, SAP(50), throw=False)
    assert found.iterations < 50
