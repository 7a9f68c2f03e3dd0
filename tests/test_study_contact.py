"""Studies of contact: solvers by the impulses of a step, schemes by where a motion ends."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from shared import each_row
from shell import condyn

import condyn_pin as cp
from condyn_pin import constraints as c
from condyn_pin._core.arguments import Call, read_call
from condyn_pin.contact import ADMM, PGS, SAP, Lemke, SemismoothNewton
from condyn_pin.dynamics import Proximal
from condyn_pin.gradients import ActiveSet, EventLocated, Kappa, Randomised, Softened
from condyn_pin.stepping import Anitescu, Moreau, SoftStep, StewartTrinkle, contact_problem
from condyn_pin.study import (
    ContactMeasure,
    GivenStates,
    GradientMeasure,
    SampledStates,
    Study,
    Table,
    TrajectoryMeasure,
    sweep,
)
from condyn_pin.study.fresh import measure_of, measured_as, solver_of


@cache
def box():
    body = cp.model.free_box(size=(0.2, 0.12, 0.08))
    return cp.Scene(
        body, contacts=[c.FrictionalContact("box", c.Box(0.1, 0.06, 0.04), friction=0.5)]
    )


@cache
def slide():
    """One state: the box slides at 1 m/s."""
    q, v = box().state()
    v[:2] = np.cos(0.3), np.sin(0.3)
    return GivenStates("slide", [(q, v, 0 * v)])


def solved(*solvers, **options):
    measure = ContactMeasure(**options)
    study = Study({"box": box()}, solvers, states=slide(), measure=measure)
    return {row.short: row for row in study.run(timed=False).rows}


# Values with values in them


@each_row(
    ("text", "wanted"),
    [
        ("Moreau", Call("Moreau", {})),
        ("Moreau()", Call("Moreau", {})),
        ("Baumgarte(alpha=1.0, beta=-2.0)", Call("Baumgarte", {"alpha": 1.0, "beta": -2.0})),
        (
            "Moreau(contact=ADMM(tolerance=1e-06))",
            Call("Moreau", {"contact": Call("ADMM", {"tolerance": 1e-6})}),
        ),
        ("A(b=(1, 2), c=None, d='e')", Call("A", {"b": (1, 2), "c": None, "d": "e"})),
    ],
)
def test_calls_are_read_with_calls_in_them(text, wanted):
    assert read_call(text) == wanted


@each_row("text", ["", "1", "a.b()", "A(1)", "A(**b)", "A(b=c)", "A(b=c.d())", "A(",
                                  "A()()", "A(b=[x for x in y])", "A" * 2000])  # fmt: skip
def test_what_is_no_call_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011  whatever the reader stumbles over
        read_call(text)


@pytest.mark.long
@pytest.mark.parametrize("scheme", [Moreau(), Moreau(contact=ADMM(1e-6, polish=True)), Anitescu()])
def test_schemes_come_back_from_a_row_with_their_contact_solver(scheme):
    measure = TrajectoryMeasure(duration=0.002, dt=1e-3, integrator=scheme)
    ball = cp.Scene(
        cp.model.free_ball(), contacts=[c.FrictionalContact("ball", c.Ball(0.05), friction=0.5)]
    )
    states = GivenStates("flies", [(*ball.state(), np.zeros(6))])
    study = Study({"ball": ball}, [Proximal()], states=states, measure=measure)
    assert measured_as(study.run(timed=False).rows[0]) == measure


@pytest.mark.long
def test_contact_measures_come_back_from_their_label():
    measure = ContactMeasure(dt=1e-2, integrator=Anitescu(contact=SAP()))
    assert measure_of(measure.label) == measure
    assert measure_of("contact") == ContactMeasure()


# Contact solvers


def test_exact_solvers_agree_and_polygons_do_not():
    rows = solved(ADMM(), ADMM(polish=True), PGS(), SemismoothNewton(), Lemke(4), Lemke(32))
    assert all(rows[each].ok for each in ("ADMM()", "PGS()", "SemismoothNewton()"))
    assert rows["ADMM(polish=True)"].error_worst < 1e-13
    assert rows["ADMM()"].error_worst < 1e-6
    assert rows["Lemke(sides=4)"].said == "1 inaccurate"
    errors = [rows[f"Lemke(sides={sides})"].error_worst for sides in (4, 32)]
    assert errors[0] > 2 * errors[1] > 1e-3


@pytest.mark.long
def test_a_solver_that_does_not_know_the_law_is_refused_by_name():
    rows = solved(PGS(), SAP(), ADMM(), integrator=SoftStep())
    assert rows["PGS()"].said == "1 refused"
    assert "ccp" in rows["PGS()"].note
    assert rows["SAP()"].ok
    assert rows["ADMM()"].ok


@pytest.mark.long
def test_an_exact_answer_is_not_wrong_for_being_another():
    """Four corners that slide: impulses move from corner to corner, and nobody feels it."""
    problem = contact_problem(box(), *slide().of(box())[0], dt=1e-3)
    lam = cp.contact.solve_contact(problem, SemismoothNewton()).lam
    null = np.linalg.svd(problem.G)[2][-1]
    assert np.linalg.norm(problem.G @ null) < 1e-12 * np.linalg.norm(problem.G)
    assert not cp.contact.solve_contact(problem).unique_forces
    assert solved(SemismoothNewton())["SemismoothNewton()"].error_worst == 0.0
    assert lam.shape == (12,)


@pytest.mark.long
def test_states_of_a_scene_with_contacts_touch():
    solo = cp.load_robot("solo12")
    feet = solo.frictional_contacts(0.7)
    scene = cp.Scene(solo, contacts=[cp.constraints.FrictionalContact(
        f.frame, f.shape, f.offset, c.Plane((0.2, 0.1, 1.0), 0.3), friction=0.7, name=f.name
    ) for f in feet])  # fmt: skip
    for q, v, tau in SampledStates(4).of(scene):
        gaps = cp.step(scene, q, 0 * v, 0 * tau, dt=1e-9).gaps
        assert min(gaps.values()) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", ["solo12", "cassie"])
def test_the_name_of_a_robot_is_its_feet_on_the_floor(name):
    robot = cp.load_robot(name, variant={"feet": "points"} if name == "cassie" else None)
    (scene,) = ContactMeasure().scenes_of(robot).values()
    assert scene.constraints == robot.loops
    assert {each.friction for each in scene.contacts} == {0.7}
    row = (
        Study({name: scene}, [ADMM(polish=True)], states=3, measure="contact")
        .run(timed=False)
        .rows[0]
    )
    assert row.ok
    assert row.constraint_error < 1e-8


def test_a_study_takes_only_what_its_measure_asks():
    with pytest.raises(cp.InvalidArgument, match="is no ContactSolver, and contact measures"):
        Study(box(), [Proximal()], measure="contact")
    with pytest.raises(cp.InvalidArgument, match="is no Solver, and acceleration measures"):
        Study(box(), [ADMM()])
    with pytest.raises(cp.InvalidArgument, match="no feet"):
        Study("four_bar", measure="contact")
    with pytest.raises(cp.InvalidArgument, match="dt = 0"):
        ContactMeasure(dt=0)
    with pytest.raises(cp.InvalidArgument, match="a scheme with contacts"):
        ContactMeasure(integrator=cp.RungeKutta4())


def test_the_cheapest_contact_solver_meets_the_error(tmp_path):
    solvers = [SemismoothNewton(), Lemke(4)]
    table = Study({"box": box()}, solvers, states=4, measure="contact").run()
    choice = table.cheapest(1e-9, measure="contact", states=20)
    assert choice.solver == SemismoothNewton()
    table.to_json(tmp_path / "table.json")
    again = Table.from_json(tmp_path / "table.json")
    assert [solver_of(row) for row in again.rows] == solvers


# Motions


@pytest.mark.long
def test_schemes_are_compared_by_where_a_motion_ends():
    schemes = [StewartTrinkle(), Moreau(), cp.RungeKutta4()]
    measures = sweep(TrajectoryMeasure(duration=0.02), dt=[1e-2, 1e-3], integrator=schemes)
    study = Study({"box": box()}, [Proximal()], states=slide(), measure=measures)
    rows = {
        (row.how["integrator"].split("(")[0], row.how["dt"]): row
        for row in study.run(timed=False).rows
    }
    errors = [rows["StewartTrinkle", dt].error_worst for dt in (1e-2, 1e-3)]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05)  # of first order
    assert rows["Moreau", 1e-3].error_worst < 1e-6  # exact where it slides straight on
    assert rows["Moreau", 1e-3].constraint_error < 1e-9  # nothing penetrates
    assert rows["RungeKutta4", 1e-3].said == "1 refused"


# The command


def test_condyn_trade_prints_a_table_of_contact_solvers():
    said = condyn("trade", "solo12", "--measure", "contact", "--states", "2", "--quick",
                  "--solvers", "admm,semismoothnewton", "--dt", "1e-3")  # fmt: skip
    assert said.exit_code == 0
    assert "solo12 on its feet, contact" in said.stdout
    assert "ADMM" in said.stdout


@each_row(
    ("words", "match"),
    [
        (("--dt", "1e-3"), "has no effect on acceleration"),
        (("--measure", "trajectory", "--dt", "x"), "--dt x: a number"),
        (("--measure", "trajectory", "--integrator", "Moreau(contact=A())"), "'a'"),
        (("--measure", "trajectory", "--integrator", "Moreau(step=1)"), "the parameters contact"),
        (("--measure", "contact", "--solvers", "proximal"), "no solver of contact"),
    ],
)
def test_condyn_trade_refuses_by_name(words, match):
    said = condyn("trade", "solo12", *words)
    assert said.exit_code != 0
    assert match in str(said.exception)


@pytest.mark.long
def test_condyn_simulate_puts_a_robot_onto_its_feet_and_view_shows_it(tmp_path):
    motion, page = tmp_path / "motion.npz", tmp_path / "page.html"
    scheme = "Moreau(contact=ADMM(polish=True))"
    said = condyn("simulate", "solo12", "--friction", "0.7", "--duration", "0.02", "--integrator",
               scheme, "--save", str(motion))  # fmt: skip
    assert said.exit_code == 0, said.stderr
    assert "Moreau(contact=ADMM(" in said.stdout
    assert max(abs(gap[0]) for gap in cp.Trajectory.load(motion).gaps.values()) < 1e-9
    assert condyn("view", str(motion), "--html", str(page), "--light", "--cones").exit_code == 0
    assert "contact, sticking" in page.read_text(encoding="utf-8")
    assert "friction cone" in page.read_text(encoding="utf-8")


# Routes to derivatives


def slopes(scene, q, v, *routes, **options):
    """Rows of routes, by name and parameters, of one motion."""
    measure, states = GradientMeasure(**options), GivenStates("one", [(q, v, 0 * v)])
    rows = Study({"it": scene}, routes, states=states, measure=measure).run(timed=False).rows
    return {row.short.partition(", dt=")[0]: row for row in rows}


def test_routes_are_compared_by_the_slope_of_a_bounce():
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = c.FrictionalContact("ball", c.Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()
    q[2] = 0.15
    routes = ActiveSet(), EventLocated(), Randomised(10, 1e-4), Softened()
    rows = slopes(scene, q, v, *routes, duration=0.25, dt=1e-2, wrt=["q", "v"])
    assert rows["EventLocated()"].error_worst < 1e-7
    assert rows["EventLocated()"].constraint_error < 1e-9
    assert rows["ActiveSet()"].error_worst > 0.1  # a step of fixed length knows no time of impact
    drawn = rows["Randomised(samples=10, sigma=0.0001)"]
    assert 0 < drawn.dynamics_error < drawn.error_worst


def test_routes_are_compared_where_a_box_slides_and_stops():
    q, v, _ = slide().of(box())[0]
    rows = slopes(box(), q, v / 2, ActiveSet(), Kappa(1e-2), Kappa(1e-6), duration=0.12, dt=1e-2)
    assert rows["ActiveSet()"].error_worst < 0.1  # it stops in the middle of a step
    off = [rows[f"Kappa(kappa={kappa})"].constraint_error for kappa in ("0.01", "1e-06")]
    assert off[1] < 0.1 * off[0]  # the ends of smooth steps


def test_a_route_that_takes_no_such_steps_is_refused_by_name():
    q, v, _ = slide().of(box())[0]
    rows = slopes(box(), q, v, EventLocated(), Softened(), duration=0.02, integrator=SoftStep())
    assert rows["EventLocated()"].said == "1 refused"
    assert "convex" in rows["EventLocated()"].note
    measure = GradientMeasure(duration=0.01, integrator=Anitescu(contact=SAP()), wrt=["q"])
    row = Study({"box": box()}, [Kappa(1e-3)], states=slide(), measure=measure)
    row = row.run(timed=False).rows[0]
    assert (measured_as(row), solver_of(row)) == (measure, Kappa(1e-3))
    for wrong, said in (
        ({"dt": 0}, "dt = 0"), ({"wrt": ["mass"]}, "some of q, v, tau"),
        ({"dt": 1.0}, "at most the duration"), ({"integrator": cp.RungeKutta4()}, "with contacts"),
    ):  # fmt: skip
        with pytest.raises(cp.InvalidArgument, match=said):
            GradientMeasure(**wrong)


def test_condyn_trade_prints_a_table_of_routes():
    said = condyn("trade", "solo12", "--measure", "gradients", "--states", "1", "--quick",
                  "--solvers", "activeset,kappa", "--dt", "5e-3")  # fmt: skip
    assert said.exit_code == 0, said.stderr
    assert "solo12 on its feet, gradients: " in said.stdout
    assert "of 4 rows" in said.stdout  # ActiveSet, and Kappa with three kappas
